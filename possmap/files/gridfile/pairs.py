"""Two grids read side by side: only tiles that one of them holds, one at a time."""

from __future__ import annotations

from collections.abc import Iterator

from possmap.core.difference import CellPair
from possmap.core.evidence import Layer
from possmap.core.fusion import TileLayers, blank
from possmap.core.lattice import TileKey, Window, tile_window
from possmap.files.gridfile.tiles import TileStore


class TilePairs:
    """The tiles of two grids of one lattice, A and B.

    window : cells beyond it are left out.
    """

    def __init__(self, a: TileStore, b: TileStore, window: Window) -> None:
        self._a, self._b, self._window = a, b, window

    def rows(self) -> list[int]:
        """Return the rows of tiles in which A or B holds anything."""
        return sorted({*self._a.rows(self._window), *self._b.rows(self._window)})

    def keys(self, row: int) -> Iterator[tuple[TileKey, bool]]:
        """Yield a row's tiles that A or B holds, and whether they are the same in both.

        Equal hashes tell: no cell is read.
        """
        a, b = (store.hashes_of_row(row, self._window) for store in (self._a, self._b))
        for column in sorted(a.keys() | b.keys()):
            yield TileKey(row, column), a.get(column) == b.get(column)

    def read(self, key: TileKey, equal: bool = False) -> CellPair:
        """Read one tile of both.

        equal : it is known to be the same in both, so that one is read for the two.
        """
        window = tile_window(key).intersection(self._window)
        a = _layers(self._a, key, window)
        return CellPair(window, a, a if equal else _layers(self._b, key, window), equal)


_BLANK: TileLayers = {layer: blank(layer) for layer in Layer}
for _array in _BLANK.values():
    _array.flags.writeable = False


def _layers(store: TileStore, key: TileKey, window: Window) -> TileLayers:
    """Return every layer of a tile within a window."""
    held = store.read(key)
    part = window.slices_in(tile_window(key))
    return {layer: held.get(layer, _BLANK[layer])[part] for layer in Layer}

"""Two grids read side by side: only tiles that one of them holds, one at a time."""

from __future__ import annotations

from collections.abc import Iterator

from possmap.core.evidence import Layer
from possmap.core.fusion import TileLayers
from possmap.core.lattice import TileKey, Window
from possmap.core.patches import Patch, cropped, extent_of, joined, spread
from possmap.grid.tiles import TileStore
from possmap.inspection.difference import CellPair


class TilePairs:
    """The tiles of two grids of one lattice, A and B.

    window : cells beyond it are left out.
    """

    def __init__(self, a: TileStore, b: TileStore, window: Window) -> None:
        self._a, self._b, self._window = a, b, window

    def rows(self) -> list[int]:
        """Return the rows of tiles in which A or B holds anything."""
        return sorted(
            {row for store in (self._a, self._b) for row in store.directory.rows(self._window)}
        )

    def row(self, row: int) -> Iterator[tuple[TileKey | None, CellPair]]:
        """Yield a row's tiles that A or B holds: first those that differ, each with its key.

        Then the others, of which one is read for the two, and neighbours together. Equal hashes
        tell: no cell is compared.
        """
        a, b = (store.directory.hashes_of_row(row, self._window) for store in (self._a, self._b))
        equal = {column for column in a.keys() & b.keys() if a[column] == b[column]}
        for column in sorted((a.keys() | b.keys()) - equal):
            key = TileKey(row, column)
            yield key, self.read(key)
        if equal:
            held = (one for one in self._a.row(row, self._window) if one[0] in equal)
            for patch in joined(held):
                window = extent_of(patch)
                layers = _layers(patch, window)
                yield None, CellPair(window, layers, layers, equal=True)

    def read(self, key: TileKey) -> CellPair:
        """Read what either holds of one tile; what neither knows is left out."""
        a, b = (cropped(store.patch(key), self._window) for store in (self._a, self._b))
        held = [extent_of(patch) for patch in (a, b) if patch]
        window = held[0].union(held[-1]) if held else _NOTHING
        return CellPair(window, _layers(a, window), _layers(b, window), equal=False)


_NOTHING = Window(0, 0, 0, 0)


def _layers(patch: Patch, window: Window) -> TileLayers:
    """Return every layer of a patch over a window."""
    return {layer: spread(patch, layer, window) for layer in Layer}

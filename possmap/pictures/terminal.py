"""``possmap render --show``: the map in the terminal, two rows of blocks a character."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.pictures import layers, raster
from possmap.pictures.palettes import Indices, Table
from possmap.pictures.render import Look, evidence_window, opened, scene_of

_RESET = "\x1b[0m"

Depth: TypeAlias = Literal["none", "256", "24 bits"]
"""What colours a terminal has."""


def preview(path: Path, look: Look, columns: int, lines: int, colours: Depth) -> str:
    """Return a picture of a grid as text for a terminal of so many columns and lines.

    Raises
    ------
    OutputError
        If there is no evidence.
    """
    name = look.layers[0]
    with opened(path, look) as grid:
        window = evidence_window(grid, look.window_m)
        rows_high, cells_wide = window.shape
        factor = max(cells_wide / columns, rows_high / (2 * lines), 1.0)
        chosen = raster.plan(window, 1, max(1, int(max(window.shape) / factor)))
        index, _ = scene_of(grid, look, chosen).drawn(name, chosen)
    if colours == "none":
        return in_letters(index, layers.letters(name))
    return in_colour(index, layers.colours(name, look.palette), colours)


def in_colour(index: Indices, table: Table, depth: Depth = "24 bits") -> str:
    """Return half-block characters in colour; rows are taken two at a time."""
    lines: list[str] = []
    rows, columns = index.shape
    for top in range(0, rows, 2):
        line, last = "", ""
        for column in range(columns):
            code = _code(table[index[top, column]], depth, ground=False)
            if top + 1 < rows:
                code += _code(table[index[top + 1, column]], depth, ground=True)
            line += (code if code != last else "") + "▀"
            last = code
        lines.append(line + _RESET)
    return "\n".join(lines)


def _code(colour: NDArray[np.uint8], depth: Depth, ground: bool) -> str:
    """Return the escape code of a colour, for the character or the ground behind it."""
    layer = 48 if ground else 38
    red, green, blue = (int(channel) for channel in colour)
    if depth == "24 bits":
        return f"\x1b[{layer};2;{red};{green};{blue}m"
    # The nearest of the 6 × 6 × 6 colours that every terminal of 256 has.
    six = (round(channel / 255 * 5) for channel in (red, green, blue))
    return f"\x1b[{layer};5;{16 + sum(c * w for c, w in zip(six, (36, 6, 1), strict=True))}m"


_RANK = " .o!#0123456789"
"""Of two blocks that share a character, the sign further right is shown."""


def in_letters(index: Indices, signs: str) -> str:
    """Return one character for two rows of blocks; ``signs`` has one for each index."""
    rank = np.array([_RANK.index(sign) for sign in signs])[index]
    rows = [rank[top : top + 2].max(axis=0) for top in range(0, len(rank), 2)]
    return "\n".join("".join(_RANK[k] for k in row).rstrip() for row in rows)

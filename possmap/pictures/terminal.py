"""A preview in the terminal: two rows a character, in colour where the terminal has it."""

from __future__ import annotations

import numpy as np

from possmap.pictures.layers import Indices
from possmap.pictures.palettes import Table

_RESET = "\x1b[0m"


def in_colour(index: Indices, table: Table) -> str:
    """Return half-block characters in 24-bit colour; rows are taken two at a time."""
    lines: list[str] = []
    rows, columns = index.shape
    for top in range(0, rows, 2):
        line, last = "", ""
        for column in range(columns):
            upper = table[index[top, column]]
            code = f"\x1b[38;2;{upper[0]};{upper[1]};{upper[2]}m"
            if top + 1 < rows:
                lower = table[index[top + 1, column]]
                code += f"\x1b[48;2;{lower[0]};{lower[1]};{lower[2]}m"
            line += (code if code != last else "") + "▀"
            last = code
        lines.append(line + _RESET)
    return "\n".join(lines)


_RANK = " .o+#!0123456789"
"""Of two blocks that share a character, the sign further right is shown."""


def in_letters(index: Indices, signs: str) -> str:
    """Return one character for two rows of blocks; ``signs`` has one for each index."""
    rank = np.array([_RANK.index(sign) for sign in signs])[index]
    rows = [rank[top : top + 2].max(axis=0) for top in range(0, len(rank), 2)]
    return "\n".join("".join(_RANK[k] for k in row).rstrip() for row in rows)

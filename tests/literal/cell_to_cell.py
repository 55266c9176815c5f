"""The paper's own propagation of one position's pyramid, from cell to cell (section 4.1).

With METHOD.md's two amendments: the sign in front of the second fraction, and half a cell added
to the rectangle so that every cell that it covers in part gets a positive value.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple


class _Sides(NamedTuple):
    """The paper's e_r, e_l, e_u, e_d: distances from a cell to the four sides [cells]."""

    right: float
    left: float
    up: float
    down: float

    def passed(self, columns: int, rows: int) -> _Sides:
        """Return what a neighbour receives: "unitarily increased or decreased in each step"."""
        return _Sides(self.right - columns, self.left + columns, self.up - rows, self.down + rows)

    @property
    def inside(self) -> bool:
        """The spreading goes on "until they reach the zero value"."""
        return min(self) > 0.0


def pyramid_cell_to_cell(
    half_x: float, half_y: float, resolution: float, max_error: float
) -> dict[tuple[int, int], float]:
    """N by (columns away, rows away) of the central cell, only where > 0; lengths in metres."""
    # e_r = e_l = error_x / 2, half the rectangle's base, and half a cell more.
    e_x, e_y = half_x / resolution + 0.5, half_y / resolution + 0.5
    limit = max_error / resolution
    received = {(0, 0): _Sides(e_x, e_x, e_y, e_y)}
    waiting = deque(received)
    while waiting:
        cell = waiting.popleft()
        for columns, rows in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            neighbour = (cell[0] + columns, cell[1] + rows)
            sides = received[cell].passed(columns, rows)
            if neighbour not in received and sides.inside:
                received[neighbour] = sides
                waiting.append(neighbour)
    heights = {
        cell: min(_along(e.left, e.right, limit), _along(e.down, e.up, limit))
        for cell, e in received.items()
    }
    return {cell: value for cell, value in heights.items() if value > 0.0}


def _along(one: float, other: float, limit: float) -> float:
    """N_x from e_l and e_r, or N_y from e_d and e_u; everything in cells."""
    x = abs(one - other) / 2.0
    err = (one + other) / 2.0
    # The paper's (x - err) / max_error compares the rectangle's error with the largest one. The
    # half cell belongs to the base, not to the error: x and err count without its share there.
    own = (err - 0.5) / err
    return 1.0 - x / err + (x - err) * own / limit

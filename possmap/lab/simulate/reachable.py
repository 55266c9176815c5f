"""Whether a robot can leave home at all."""

from __future__ import annotations

import math
from collections import deque

from possmap.lab.simulate.world import World

ENOUGH = 2.0
"""Floor that a robot must reach [m2]; less is a cupboard."""
SHARE, MOST = 0.05, 20.0
"""So much of what the walls span it must reach too, or so much floor [m2]: a closed room is a world
of its own, but not within a building."""
_STEP = 0.1  # of the robot that tries [m]


def check_home(world: World, length: float, width: float) -> None:
    """Refuse a home from which a robot cannot set out.

    Parameters
    ----------
    length, width
        Of the robot's body [m].

    Raises
    ------
    ValueError
        ``home, found place, what is wrong there, expected``.
    """
    x, y = world.home
    found = f"home, found [{x:g}, {y:g}]"
    low_x, low_y, high_x, high_y = world.bounds
    if not (low_x <= x <= high_x and low_y <= y <= high_y):
        raise ValueError(
            f"{found}, outside the walls, expected within x {low_x:g} to {high_x:g} and "
            f"y {low_y:g} to {high_y:g}"
        )
    half = math.hypot(length, width) / 2
    if world.clearance(x, y) < half:
        raise ValueError(
            f"{found}, {world.clearance(x, y):.2f} m from a wall, expected at least {half:.2f} m, "
            "half the robot"
        )
    for x0, y0, x1, y1 in world.drops.tolist():
        if x0 - half < x < x1 + half and y0 - half < y < y1 + half:
            raise ValueError(
                f"{found}, at the drop [{x0:g}, {y0:g}, {x1:g}, {y1:g}], expected {half:.2f} m off"
            )
    spanned = (high_x - low_x) * (high_y - low_y)
    enough = max(ENOUGH, min(MOST, SHARE * spanned))
    area = reachable_area(world, width, enough)
    if area < enough - _STEP**2 / 2:
        raise ValueError(
            f"{found}, where walls enclose a robot {width:g} m wide: it reaches {area:.1f} m2, "
            f"expected {enough:.3g} m2 or more"
        )


def reachable_area(world: World, width: float, enough: float) -> float:
    """Return how much floor a robot can reach from home in steps along the axes [m2].

    Parameters
    ----------
    width
        Of its body [m].
    enough
        Where the count ends [m2].
    """
    cells = math.ceil(enough / _STEP**2)
    seen, waiting = {(0, 0)}, deque([(0, 0)])
    while waiting and len(seen) < cells:
        column, row = waiting.popleft()
        x, y = world.home[0] + column * _STEP, world.home[1] + row * _STEP
        for across, up in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            cell = column + across, row + up
            heading = math.atan2(up, across)
            if cell in seen or world.ahead(x, y, heading, width / 2, _STEP + width / 2) is not None:
                continue
            if world.drop_ahead(x, y, heading, _STEP) is None:
                seen.add(cell)
                waiting.append(cell)
    return len(seen) * _STEP**2

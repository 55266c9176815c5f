"""What a world file draws itself: walls, rooms with doors, obstacles, drops (docs/simulate.md)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import yaml

from possmap.errors import SettingsError, did_you_mean, shown
from possmap.lab.simulate.floor_plan import Rectangle, Wall, sides
from possmap.settings.yaml_nodes import items, members, number, numbers, place, refusal, scalar_text

Entries: TypeAlias = dict[str, tuple[yaml.Node, str]]
"""Key of a world -> value, and the name of the file or the option that gave it.

All readers of entries raise SettingsError: ``file:line: key, value found, what was expected``.
"""


def read_walls(entries: Entries) -> list[Wall]:
    """Return the entries of ``walls``."""
    walls: list[Wall] = []
    for node, name, key in _listed(entries, "walls"):
        x, y, x2, y2 = numbers(node, name, key, "expected [x, y, x2, y2]", 4)
        if x != x2 and y != y2:
            raise refusal(node, name, key, "expected a wall along x or y: y = y2 or x = x2")
        if (x, y) == (x2, y2):
            raise refusal(node, name, key, "expected a wall with a length")
        walls.append((min(x, x2), min(y, y2), max(x, x2), max(y, y2)))
    return walls


def read_rooms(entries: Entries) -> Iterator[tuple[Rectangle, list[Wall]]]:
    """Yield the entries of ``rooms``, each with its doors."""
    expected = "expected {at: [x0, y0, x1, y1], doors: [[side, from, to], ...]}"
    for node, name, key in _listed(entries, "rooms"):
        given = {}
        for part, value, line in members(node, name, expected):
            if part not in ("at", "doors"):
                guess = did_you_mean(part, ("at", "doors")) or f", {expected}"
                raise SettingsError(f"{name}:{line}: unknown key {shown(part)} of a room{guess}")
            given[part] = value
        if "at" not in given:
            raise SettingsError(f"{place(node, name)}: {key}.at is missing, {expected}")
        room = _rectangle(given["at"], name, f"{key}.at")
        doors = []
        if "doors" in given:
            form = "expected [[side, from, to], ...]"
            for index, door in enumerate(items(given["doors"], name, f"{key}.doors", form)):
                doors.append(_door(room, door, name, f"{key}.doors[{index}]"))
        yield room, doors


def _door(room: Rectangle, node: yaml.Node, name: str, key: str) -> Wall:
    """Return the opening of a room's side; from and to are x on south and north, else y."""
    expected = "expected [side, from, to] with side south, north, west or east"
    entries = items(node, name, key, expected)
    if len(entries) != 3:
        raise refusal(node, name, key, expected)
    side = dict(zip(("south", "north", "west", "east"), sides(room), strict=True)).get(
        scalar_text(entries[0], place(node, name), key)
    )
    if side is None:
        raise refusal(node, name, key, expected)
    begin, end = (number(entry, name, key) for entry in entries[1:])
    x, y, x2, y2 = side
    low, high = (x, x2) if y == y2 else (y, y2)
    if not low <= begin < end <= high:
        raise refusal(node, name, key, f"expected from < to within {low:g} to {high:g}")
    return (begin, y, end, y2) if y == y2 else (x, begin, x2, end)


def read_rectangles(entries: Entries, key: str) -> list[Rectangle]:
    """Return the entries of a list of rectangles: ``obstacles`` or ``drops``."""
    return [_rectangle(node, name, at) for node, name, at in _listed(entries, key)]


def _rectangle(node: yaml.Node, name: str, key: str) -> Rectangle:
    expected = "expected [x0, y0, x1, y1] with x0 < x1 and y0 < y1"
    x0, y0, x1, y1 = numbers(node, name, key, expected, 4)
    if not (x0 < x1 and y0 < y1):
        raise refusal(node, name, key, expected)
    return x0, y0, x1, y1


def _listed(entries: Entries, key: str) -> Iterator[tuple[yaml.Node, str, str]]:
    """Yield the entries of a list of a world, each with its file and its full key."""
    if key in entries:
        node, name = entries[key]
        for index, entry in enumerate(items(node, name, f"world.{key}", "expected a list")):
            yield entry, name, f"world.{key}[{index}]"

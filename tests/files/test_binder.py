"""YAML bound to dataclasses: what a type says is what a file may say, and all else has its line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple

import pytest

from possmap.core.ranges import PROBABILITY, Count, Number, Positive
from possmap.errors import SettingsError
from possmap.settings.binder import bind
from possmap.settings.yaml_file import parse_yaml


class Wall(NamedTuple):
    """A row of four numbers."""

    x: Number
    y: Number
    x2: Number
    y2: Number


def straight(wall: Wall) -> Wall:
    if wall.x != wall.x2 and wall.y != wall.y2:
        raise ValueError("expected a wall along x or y")
    return wall


@dataclass(frozen=True, kw_only=True)
class Room:
    """What must be given, and what need not."""

    at: Annotated[Wall, "[x, y, x2, y2]"]
    doors: Count = 1


@dataclass(frozen=True, kw_only=True)
class House:
    """A field of each kind."""

    walls: tuple[Annotated[Wall, straight], ...] = ()
    room: Room | None = None
    style: Literal["hall", "maze"] = "hall"
    owners: tuple[str, ...] = ()
    units: Annotated[Mapping[Literal["length", "time"], str], "quantity: unit"] = field(
        default_factory=dict
    )
    height: Positive = 3.0
    share: Annotated[float, PROBABILITY] = 0.5
    open: bool = False

    def __post_init__(self) -> None:
        if self.height > 9:
            raise ValueError(f"height, found {self.height:g}, expected a house, not a tower")
        if self.open and self.walls:
            raise ValueError("found walls around what is open")


def house(text: str) -> House:
    root = parse_yaml(text, "house.yaml")
    assert root is not None
    return bind(root, House)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("walls: [[0, 0, 1, 0]]", {"walls": (Wall(0, 0, 1, 0),)}),
        ("walls:", {"walls": ()}),
        ("room: {at: [0, 0, 2, 2]}", {"room": Room(at=Wall(0, 0, 2, 2))}),
        ("style: maze", {"style": "maze"}),
        ("owners: ann", {"owners": ("ann",)}),
        ("owners: [ann, 3]", {"owners": ("ann", "3")}),
        ("units: {time: s}", {"units": {"time": "s"}}),
        ("{height: &h .5, share: *h, open: true}", {"height": 0.5, "share": 0.5, "open": True}),
    ],
)
def test_a_file_becomes_what_its_dataclass_says(text: str, expected: dict[str, Any]) -> None:
    assert house(text) == House(**expected)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wals: []", '1: unknown key "wals", did you mean "walls"?'),
        ("q: []", '1: unknown key "q", expected one of walls, room, style, owners, units,'),
        ("open: true\nopen: true", '2: "open" is given twice'),
        ("walls: 3", '1: walls, found "3", expected a list'),
        ("walls:\n- [0, 0, 1]", "2: walls[0], found [0, 0, 1], expected [x, y, x2, y2]"),
        ("walls: [[0, 0, 1, b]]", '1: walls[0].y2, found "b", expected a number within ±1e6'),
        ("walls: [[0, 0, 1, 1]]", "1: walls[0], found [0, 0, 1, 1], expected a wall along x or y"),
        ("\nroom: {doors: 2}", "2: room.at is missing, expected [x, y, x2, y2]"),
        ("room: {att: 2}", '1: unknown key "att" of room, did you mean "at"?'),
        ("room: 3", '1: room, found "3", expected at, doors'),
        ("room: {at: [0, 0, 1, 1], doors: 0}", '1: room.doors, found "0", expected a whole number'),
        ("style: mase", '1: style, found "mase", expected hall or maze, did you mean "maze"?'),
        ("style: [a]", "1: style, found [a], expected one value"),
        ("units: {tim: s}", '1: unknown key "tim", expected length or time, did you mean "time"?'),
        ("units: s", '1: units, found "s", expected quantity: unit'),
        ("height: 0", '1: height, found "0", expected a number > 0'),
        ("height: .nan", '1: height, found ".nan", expected a number > 0'),
        ("height: 1e7", '1: height, found "1e7", expected a number within ±1e6'),
        ("open: false\nheight: 10", "2: height, found 10, expected a house, not a tower"),
        ("share: 1", '1: share, found "1", expected a number between 0 and 1'),
        ("open: yes", '1: open, found "yes", expected true or false'),
        ("{open: true, walls: [[0, 0, 1, 0]]}", "1: found walls around what is open"),
    ],
)
def test_what_does_not_fit_is_told_with_its_line(text: str, message: str) -> None:
    with pytest.raises(SettingsError) as caught:
        house(text)
    assert str(caught.value).startswith(f"house.yaml:{message}")

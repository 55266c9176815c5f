"""The roles that columns of a recording may have: one table, from which every check follows."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, Protocol, TypeAlias

Role: TypeAlias = Literal[
    "t", "x", "y", "yaw", "compass", "qx", "qy", "qz", "qw", "turn", "forward", "left", "right",
    "vx", "vy",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a role says: the quantity in whose unit it stands, the words, and what it needs.

    beside : roles that must stand in the same table. only_with : of these one at least.
    """

    quantity: str
    words: str
    beside: tuple[str, ...] = ()
    only_with: tuple[str, ...] = ()


ROLES: Mapping[str, Meaning] = MappingProxyType(
    {
        "t": Meaning("time", "when"),
        "x": Meaning("length", "place", ("y",)),
        "y": Meaning("length", "place", ("x",)),
        "yaw": Meaning("angle", "heading of the body, anticlockwise from +x"),
        "compass": Meaning("angle", "heading of the body, clockwise from +y (north)"),
        "qx": Meaning("", "heading of the body, as a quaternion", ("qy", "qz", "qw")),
        "qy": Meaning("", "heading of the body, as a quaternion", ("qx", "qz", "qw")),
        "qz": Meaning("", "heading of the body, as a quaternion", ("qw",)),
        "qw": Meaning("", "heading of the body, as a quaternion", ("qz",)),
        "turn": Meaning("turn_rate", "rate of turn since the row before, of a gyro"),
        "forward": Meaning("speed", "speed ahead since the row before"),
        "left": Meaning("", "ticks of the left wheel", ("right",)),
        "right": Meaning("", "ticks of the right wheel", ("left",)),
        "vx": Meaning("speed", "velocity, which checks the place", ("vy",), ("x",)),
        "vy": Meaning("speed", "velocity, which checks the place", ("vx",), ("x",)),
    }
)
"""Role -> what it says."""

PLACES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"x and y": ("x", "y"), "forward": ("forward",), "left and right": ("left", "right")}
)
"""How the robot's place can be had, and by which roles."""

HEADINGS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"yaw": ("yaw",), "compass": ("compass",), "a quaternion": ("qz", "qw"), "turn": ("turn",)}
)
"""How the body's heading can be measured, the surest first: a gyro's rate beside one is not read.
Measured, it beats what wheels say."""


class HasColumns(Protocol):
    """A table whose columns have roles."""

    @property
    def columns(self) -> Mapping[Role, str]:
        """Role -> where it stands."""


def said(kinds: Mapping[str, tuple[str, ...]], columns: Collection[str]) -> list[str]:
    """Return which of several ways the columns of a table tell something."""
    return [kind for kind, roles in kinds.items() if set(roles) <= set(columns)]


def fault_of(tables: Sequence[HasColumns], has_ticks: bool, in_body: bool) -> str | None:
    """Return what the roles of a recording lack or have too much of; None if all are of use.

    Parameters
    ----------
    has_ticks
        Whether somebody says what ticks are worth.
    in_body
        Whether vx and vy are of the robot's own frame.
    """
    return next(_faults(tables, has_ticks, in_body), None)


def _faults(tables: Sequence[HasColumns], has_ticks: bool, in_body: bool) -> Iterator[str]:
    for table in tables:
        yield from _of_one(table.columns)
    places = [table.columns for table in tables if said(PLACES, table.columns)]
    ways = "x and y, forward (with a heading), or left and right"
    if len(places) != 1:
        found = "no table" if not places else f"{len(places)} tables"
        yield f"{found} with the robot's place, expected one with {ways}"
        return
    (place,) = places
    (way, *others) = said(PLACES, place)
    if others:
        yield f"the place comes from {way} and from {others[0]}, expected one of them"
    headings = [one for one in (said(HEADINGS, table.columns) for table in tables) if one]
    if len(headings) > 1:
        yield (
            f"{len(headings)} tables with the body's heading ({headings[0][0]}, {headings[1][0]}), "
            "expected one"
        )
    heading = headings[0][0] if headings else None
    if way == "forward" and heading is None:
        yield (
            "forward says how far the robot went, not where to; expected turn, yaw, compass, or qz "
            "and qw as well"
        )
    if way == "x and y" and any("turn" in table.columns for table in tables):
        yield (
            "turn is of use beside forward or left and right, and not beside x and y; expected "
            "yaw, compass, qz and qw, or no heading"
        )
    if way == "left and right" and not has_ticks:
        yield "left and right are ticks, expected the key ticks to say what they are worth"
    if in_body and "vx" in place and not set(said(HEADINGS, place)) - {"turn"}:
        yield "velocity_in_body needs the body's heading in the table of vx and vy"


def _of_one(columns: Mapping[Role, str]) -> Iterator[str]:
    """Yield what one table lacks."""
    for role in columns:
        needs = ROLES[role]
        lacks = [one for one in needs.beside if one not in columns]
        if lacks:
            yield f"found {role} without {' and '.join(lacks)}, expected them together"
        if needs.only_with and not set(needs.only_with) & set(columns):
            yield f"{role} checks the place, expected it in the table of {needs.only_with[0]} and y"
    measured = [one for one in said(HEADINGS, columns) if one != "turn"]
    if len(measured) > 1:
        yield f"the heading comes from {measured[0]} and from {measured[1]}, expected one of them"

"""What is true: a truth file as a simulation writes it (docs/logs.md), or a building's plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from possmap.core.ranges import TIME, WITHIN
from possmap.errors import LogError, SettingsError, printable, shown
from possmap.logs.fields import Fault, as_object, name_of, number
from possmap.logs.json_text import JsonSyntaxError, JsonText
from possmap.logs.text import read_text
from possmap.settings.limits import Limits
from possmap.truth.plans import FINE, FINEST, read_image, read_ros_map

Wall = tuple[float, float, float, float]
Track = NDArray[np.float64]
"""t [s], x, y [m], heading [deg], then the same three as believed; one row per moment."""

COLUMNS = "t, x, y, heading, believed_x, believed_y, believed_heading"
PLAN_SUFFIXES = (".yaml", ".yml")
IMAGE_SUFFIXES = (".png", ".pgm", ".bmp")


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What no robot knows.

    walls : x, y, x2, y2 [m].
    home : where robots set out; None if that is not said.
    tracks : by robot and excursion.
    """

    walls: tuple[Wall, ...]
    home: tuple[float, float] | None = None
    tracks: Mapping[tuple[str, str], Track] = field(default_factory=dict)


def read_any_truth(
    path: Path,
    limits: Limits,
    resolution: float | None = None,
    origin: tuple[float, float] | None = None,
) -> Truth:
    """Read a truth file, a ROS ``map.yaml``, or the bare image of a floor plan, by its suffix.

    Parameters
    ----------
    resolution, origin
        Metres per pixel of a bare image, and its lower left corner [m].

    Raises
    ------
    LogError, SettingsError
        If it cannot be read, or an image has no resolution.
    """
    name, suffix = printable(str(path)), path.suffix.lower()
    if suffix not in IMAGE_SUFFIXES:
        for option, value in (("--truth-resolution", resolution), ("--truth-origin", origin)):
            if value is not None:
                raise SettingsError(f"{option}, which only the image of a floor plan needs: {name}")
    if suffix in PLAN_SUFFIXES:
        return _of_walls(read_ros_map(path).walls())
    if suffix in IMAGE_SUFFIXES:
        if resolution is None:
            raise SettingsError(
                f"{name}: an image has no resolution, expected --truth-resolution METRES per pixel"
            )
        if not resolution >= FINEST:
            raise SettingsError(f"--truth-resolution, found {resolution}, {FINE}")
        return _of_walls(read_image(path, resolution, origin or (0.0, 0.0)).walls())
    return read_truth(path, limits)


def _of_walls(walls: Track) -> Truth:
    return Truth(tuple((x, y, x2, y2) for x, y, x2, y2 in walls.tolist()))


def read_truth(path: Path, limits: Limits) -> Truth:
    """Read a truth file.

    Raises
    ------
    LogError
        If it is no truth file, or anything in it that is read is wrong.
    """
    source = read_text(path, limits)
    if source.is_cut:
        raise LogError(source.name, "the file is cut short")
    source.check_objects(limits)
    cursor = JsonText(source.text)
    try:
        fields = as_object(cursor.value())
        cursor.end()
        if fields.get("possmap_truth") != 1:
            raise Fault(("possmap_truth",), "is missing or not 1, expected a truth file")
        walls = _rows("walls", fields.get("walls"), "x, y, x2, y2")
        home = _row("home", fields["home"], "x, y") if fields.get("home") is not None else None
        robots = _list("robots", fields.get("robots", []))
        return Truth(
            tuple((x, y, x2, y2) for x, y, x2, y2 in walls),
            (home[0], home[1]) if home else None,
            dict(_entry(index, robot) for index, robot in enumerate(robots)),
        )
    except JsonSyntaxError as error:
        line = cursor.line_of(error.position)
        raise LogError(f"{source.name}:{line}", f"not JSON: {error}") from None
    except Fault as fault:
        where = ".".join(map(str, fault.path))
        raise LogError(source.name, f"{where}: {fault.problem}".removeprefix(": ")) from None


def _list(name: str, given: object) -> list[object]:
    if not isinstance(given, list):
        raise Fault((name,), f"found {shown(given)}, expected a list")
    return given


def _entry(index: int, robot: object) -> tuple[tuple[str, str], Track]:
    try:
        fields = as_object(robot)
        name = name_of("robot", fields.get("robot")), name_of("excursion", fields.get("excursion"))
        track = _rows("track", fields.get("track"), COLUMNS)
        return name, np.array(track, dtype=np.float64).reshape(-1, 7)
    except Fault as fault:
        raise fault.below(f"robots[{index}]") from None


def _rows(name: str, given: object, columns: str) -> list[list[float]]:
    """Return rows of numbers, one for each of the columns."""
    rows = enumerate(_list(name, given))
    return [_row(f"{name}[{index}]", row, columns) for index, row in rows]


def _row(name: str, given: object, columns: str) -> list[float]:
    names = columns.split(", ")
    if not isinstance(given, list) or len(given) != len(names):
        raise Fault((name,), f"found {shown(given)}, expected [{columns}]")
    if all(type(value) is float and -1e6 <= value <= 1e6 for value in given):
        return given  # one look suffices for a sound row
    allowed = (TIME if column == "t" else WITHIN for column in names)
    return [number(name, value, range_) for value, range_ in zip(given, allowed, strict=True)]

"""What is true: a truth file as a simulation writes it (docs/logs.md), or a building's plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from possmap.core.ranges import TIME
from possmap.errors import LogError, SettingsError, printable, shown
from possmap.logs.fields import Fault, as_object, name_of, number
from possmap.logs.json_text import JsonSyntaxError, JsonText
from possmap.logs.text import read_text
from possmap.settings.limits import Limits
from possmap.truth.plans import FINE, FINEST, read_image, read_ros_map

Wall = tuple[float, float, float, float]
Track = NDArray[np.float64]
"""t [s], x, y [m], heading [deg], then the same three as believed; one row per moment."""

COLUMNS = 7
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
        walls = _walls(fields.get("walls"))
        home = fields.get("home")
        robots = fields.get("robots", [])
        if not isinstance(robots, list):
            raise Fault(("robots",), f"found {shown(robots)}, expected a list")
        return Truth(
            walls,
            None if home is None else _place(home),
            dict(_entry(index, robot) for index, robot in enumerate(robots)),
        )
    except JsonSyntaxError as error:
        line = cursor.line_of(error.position)
        raise LogError(f"{source.name}:{line}", f"not JSON: {error}") from None
    except Fault as fault:
        where = ".".join(map(str, fault.path))
        raise LogError(
            source.name, f"{where}: {fault.problem}" if where else fault.problem
        ) from None


def _walls(given: object) -> tuple[Wall, ...]:
    if not isinstance(given, list):
        raise Fault(("walls",), f"found {shown(given)}, expected a list")
    return tuple(_wall(index, wall) for index, wall in enumerate(given))


def _wall(index: int, wall: object) -> Wall:
    x, y, x2, y2 = _numbers(f"walls[{index}]", wall, "x, y, x2, y2")
    return x, y, x2, y2


def _place(home: object) -> tuple[float, float]:
    x, y = _numbers("home", home, "x, y")
    return x, y


def _numbers(name: str, given: object, names: str) -> Sequence[float]:
    if not isinstance(given, list) or len(given) != names.count(",") + 1:
        raise Fault((name,), f"found {shown(given)}, expected [{names}]")
    return [number(name, value) for value in given]


def _entry(index: int, robot: object) -> tuple[tuple[str, str], Track]:
    try:
        fields = as_object(robot)
        name = name_of("robot", fields.get("robot")), name_of("excursion", fields.get("excursion"))
        return name, _track(fields.get("track"))
    except Fault as fault:
        raise fault.below(f"robots[{index}]") from None


def _track(given: object) -> Track:
    if not isinstance(given, list):
        raise Fault(("track",), f"found {shown(given)}, expected a list")
    names = "t, x, y, heading, believed_x, believed_y, believed_heading"
    for index, row in enumerate(given):
        # One look suffices for a sound row; the number that is none is then looked for.
        if not isinstance(row, list) or len(row) != COLUMNS:
            raise Fault((f"track[{index}]",), f"found {shown(row)}, expected [{names}]")
        if not all(type(value) is float and -1e6 <= value <= 1e6 for value in row):
            number(f"track[{index}]", row[0], TIME)
            for value in row[1:]:
                number(f"track[{index}]", value)
    return np.array(given, dtype=np.float64).reshape(-1, COLUMNS)

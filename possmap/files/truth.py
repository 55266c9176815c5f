"""The truth file: what no robot knows, written by a simulation (docs/logs.md, "The truth file")."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from possmap.errors import LogError, shown
from possmap.files.limits import Limits
from possmap.files.logs.fields import Fault, as_object, number
from possmap.files.logs.json_text import JsonSyntaxError, JsonText
from possmap.files.logs.text import read_text

Wall = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Truth:
    """The true walls, as x, y, x2, y2 [m]."""

    walls: tuple[Wall, ...]


def read_truth(path: Path, limits: Limits) -> Truth:
    """Read the walls of a truth file.

    Raises
    ------
    LogError
        If it is no truth file, or a wall is none.
    """
    source = read_text(path, limits)
    cursor = JsonText(source.text)
    try:
        fields = as_object(cursor.value())
        cursor.end()
        if fields.get("possmap_truth") != 1:
            raise Fault(("possmap_truth",), "is missing or not 1, expected a truth file")
        walls = fields.get("walls")
        if not isinstance(walls, list):
            raise Fault(("walls",), f"found {shown(walls)}, expected a list")
        return Truth(tuple(_wall(index, wall) for index, wall in enumerate(walls)))
    except JsonSyntaxError as error:
        line = cursor.line(error.position)
        raise LogError(f"{source.name}:{line}", f"not JSON: {error}") from None
    except Fault as fault:
        where = ".".join(map(str, fault.path))
        raise LogError(
            source.name, f"{where}: {fault.problem}" if where else fault.problem
        ) from None


def _wall(index: int, wall: object) -> Wall:
    name = f"walls[{index}]"
    if not isinstance(wall, list) or len(wall) != 4:
        raise Fault((name,), f"found {shown(wall)}, expected [x, y, x2, y2]")
    x, y, x2, y2 = (number(name, value) for value in wall)
    return x, y, x2, y2

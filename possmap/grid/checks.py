"""What a value of a grid file may be, looked at as it leaves the file: files come from anywhere.

SQLite keeps any type in any column, and numbers that no log may hold. Each function raises
TypeError or ValueError; ``Database.sound`` makes of them the line that says what is damaged.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TypeVar

from possmap.core.lattice import TILE, TileKey, Window
from possmap.core.model import LARGEST, PARAMETERS, ErrorModel, check_parameter
from possmap.core.records import CORNER_KINDS, Beam, Corner, Meet, OwnModel, Pose, Record, Wall
from possmap.errors import shown
from possmap.logs.fields import LARGEST_SEQ, NAME

FARTHEST_TILE = 2**53
"""Rows and columns of tiles lie within ± this: more than any log reaches at any resolution, and
few enough that its cells can be counted in 64 bits."""

FARTHEST_M = 1e15
"""So far may a corrected place lie [m], and so wide a rectangle: a model's scale may be 10⁶."""

_MOST = sys.float_info.max

_T = TypeVar("_T")


def check_types(*values: tuple[object, type]) -> None:
    """Raise TypeError unless each value is exactly of its type."""
    for value, expected in values:
        if type(value) is not expected:
            raise TypeError(f"found a {type(value).__name__}, expected a {expected.__name__}")


def check_counts(*values: object) -> None:
    """Raise an error unless each value is a whole number of at least 0, as may be counted."""
    for value in values:
        if whole(value) < 0:
            raise ValueError(f"found {value}, expected at least 0")
        if whole(value) > LARGEST_SEQ:  # a sum of two is a number of SQLite still
            raise ValueError(f"found {value}, expected at most 2^53 - 1")


def exactly(value: object, expected: type[_T]) -> _T:
    """Return a value that is exactly of its type."""
    if type(value) is not expected:
        check_types((value, expected))
    return value  # type: ignore[return-value]


def whole(value: object) -> int:
    """Return a whole number."""
    return exactly(value, int)


def tile_place(value: object) -> int:
    """Return the row or the column of a tile."""
    place = whole(value)
    if not -FARTHEST_TILE <= place <= FARTHEST_TILE:
        raise ValueError(f"found a tile in row or column {place}, expected it within ±2^53")
    return place


def tile_key(row: object, column: object) -> TileKey:
    """Return the place of a tile."""
    return TileKey(tile_place(row), tile_place(column))


def bounds_in_tile(row0: object, row1: object, column0: object, column1: object) -> Window:
    """Return the rows and columns of a tile that hold all that is not 0."""
    found = Window(whole(row0), whole(row1), whole(column0), whole(column1))
    if not (0 <= found.row0 < found.row1 <= TILE and 0 <= found.column0 < found.column1 <= TILE):
        raise ValueError("bounds outside the tile")
    return found


def check_places(values: Iterable[object]) -> None:
    """Raise an error unless all are finite lengths that the map may have [m], or angles [deg]."""
    for value in values:
        if not -FARTHEST_M <= exactly(value, float) <= FARTHEST_M:
            raise ValueError(f"found {value}, expected a number within ±1e15")


def _is_when(seq: int, t: float | None) -> bool:
    return 0 <= seq <= LARGEST_SEQ and (t is None or -_MOST <= t <= _MOST)


def _fits_pose(
    seq: int, t: float | None, x: float, y: float, heading: float,
    error_x: float, error_y: float, error_heading: float, _: int | None, __: str,
) -> bool:  # fmt: skip
    return (
        0 <= seq <= LARGEST_SEQ
        and (t is None or -_MOST <= t <= _MOST)
        and -LARGEST <= x <= LARGEST
        and -LARGEST <= y <= LARGEST
        and -LARGEST <= heading <= LARGEST
        and 0 <= error_x <= LARGEST
        and 0 <= error_y <= LARGEST
        and 0 <= error_heading <= LARGEST
    )


def _fits_line(
    seq: int, t: float | None, x: float, y: float, x2: float, y2: float, _: int, __: str
) -> bool:
    return (
        0 <= seq <= LARGEST_SEQ
        and (t is None or -_MOST <= t <= _MOST)
        and -LARGEST <= x <= LARGEST
        and -LARGEST <= y <= LARGEST
        and -LARGEST <= x2 <= LARGEST
        and -LARGEST <= y2 <= LARGEST
    )


def _fits_corner(seq: int, t: float | None, x: float, y: float, corner: str, _: str) -> bool:
    within = -LARGEST <= x <= LARGEST and -LARGEST <= y <= LARGEST
    return within and _is_when(seq, t) and corner in CORNER_KINDS


def _fits_meet(
    seq: int, t: float | None, peer: str, excursion: str, upto: int | None, _: str
) -> bool:
    named = NAME.fullmatch(peer) and NAME.fullmatch(excursion)
    return bool(named) and _is_when(seq, t) and (upto is None or 0 <= upto <= LARGEST_SEQ)


FITS: Mapping[type[Record], Callable[..., bool]] = MappingProxyType(
    {
        Pose: _fits_pose,
        Wall: _fits_line,
        Beam: _fits_line,
        Corner: _fits_corner,
        Meet: _fits_meet,
    }
)
"""Of each kind of record, whether a log may hold its values, which have the right types.

Written out, for every record that is read back passes here.
"""


def unfit(columns: Sequence[str], values: Sequence[object]) -> ValueError:
    """Return the error that names the first value of a record which no log may hold."""
    for column, value in zip(columns, values, strict=True):
        found = f"{column}, found {shown(value) if isinstance(value, str) else value}, expected"
        match value:
            case int() if column in ("seq", "upto") and not 0 <= value <= LARGEST_SEQ:
                return ValueError(f"{found} 0 to 2^53 - 1")
            case float() if column == "t" and not -_MOST <= value <= _MOST:
                return ValueError(f"{found} a finite number")
            case float() if column != "t" and not -LARGEST <= value <= LARGEST:
                return ValueError(f"{found} a number within ±1e6")
            case float() if column.startswith("error_") and value < 0:
                return ValueError(f"{found} a half-width >= 0")
            case str() if column == "corner" and value not in CORNER_KINDS:
                return ValueError(f"{found} one of {', '.join(CORNER_KINDS)}")
            case str() if column.startswith("peer") and not NAME.fullmatch(value):
                return ValueError(f"{found} a name")
    raise AssertionError("a log may hold all values")


def json_value(text: object) -> object:
    """Return the value of a JSON text."""
    try:
        found: object = json.loads(exactly(text, str))
    except RecursionError:
        raise ValueError("JSON nested too deeply") from None
    except ValueError:
        raise ValueError(f"found {shown(text)}, expected JSON") from None
    return found


def own_model(text: object) -> OwnModel:
    """Return the parameters that a log gave itself, sorted by name."""
    return tuple(sorted(_parameters(text).items()))


def model_in_force(text: object) -> ErrorModel:
    """Return the error model of an excursion; what an older possmap did not know is as by default.

    Each of the numbers is looked at as ErrorModel does.
    """
    return ErrorModel(**_parameters(text))


def _parameters(text: object) -> dict[str, float]:
    found = json_value(text)
    if not isinstance(found, dict):
        raise TypeError(f"model, found {shown(found)}, expected an object")
    for name, value in found.items():
        if name not in PARAMETERS:
            raise ValueError(f"unknown parameter {shown(name)}")
        if type(value) is not float and type(value) is not int:
            raise TypeError(f"{name}, found {shown(value)}, expected a number")
        check_parameter(name, value)
    return found

"""An excursion as rows of the ledger, with its hash; columns follow the records' own fields.

A field that is added to a kind of record (``core.records``) becomes a column here by itself; the
format's number must then be raised, since a file's tables are held to the letter.
"""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from functools import cache
from operator import attrgetter, itemgetter
from types import NoneType
from typing import Any, NamedTuple, TypeAlias

from possmap.core.evidence import Geometry
from possmap.core.model import PARAMETERS, ErrorModel
from possmap.core.observations import Observations
from possmap.core.plan import Touched
from possmap.core.records import FIELDS, KIND_OF, KINDS, PartialMap, Pose, Record

Values: TypeAlias = tuple[Any, ...]

LATER = frozenset({"turned", "wall_noise", "wall_tilt", "frame_x", "frame_y", "frame_heading"})
"""Fields and parameters that came after the first hashes: while they say nothing, or what was so
before, they are not hashed, and digests stay."""


def excursion_hash(excursion: PartialMap, model: ErrorModel) -> bytes:
    """Return SHA-256 of an excursion's names, model in force and records, in a canonical form.

    Doubles are hashed as 8 bytes, big-endian, and absent values by a mark of their own: the same
    log gives the same hash from every encoding.
    """
    parts = [_tagged((excursion.robot, excursion.excursion)), _tagged(_told(model))]
    for record in excursion.records:
        kind = type(record)
        values = _CONTENT[kind](record)
        parts.append(_packer(KIND_OF[kind], tuple(map(type, values)))(values))
    return hashlib.sha256(b"".join(parts)).digest()


def _told(model: ErrorModel) -> Iterable[object]:
    """Yield a model's parameters in their order, then of later ones those that say something."""
    yield from (float(getattr(model, name)) for name in PARAMETERS if name not in LATER)
    for name in PARAMETERS:
        if name in LATER and getattr(model, name) != getattr(_PLAIN, name):
            yield from (name, float(getattr(model, name)))


_PLAIN = ErrorModel()


def _tagged(values: Iterable[object]) -> bytes:
    """Return values as they are hashed: each behind a letter that tells its type."""
    parts: list[bytes] = []
    for value in values:
        if isinstance(value, str):
            data = value.encode()
            parts.append(b"s" + struct.pack(">I", len(data)) + data)
        elif isinstance(value, float):
            parts.append(b"d" + struct.pack(">d", value))
        elif value is None:
            parts.append(b"-")
        else:
            parts.append(b"i" + struct.pack(">q", value))
    return b"".join(parts)


_CONTENT: dict[type[Record], Callable[[Record], Values]] = {
    kind: attrgetter(*(one.attribute for one in FIELDS[name])) for name, kind in KINDS.items()
}


@cache
def _packer(kind: str, types: tuple[type, ...]) -> Callable[[Values], bytes]:
    """Return what makes of a record's values the bytes that ``_tagged`` would.

    In one go, if they are numbers of these types: most of a log's time would go here otherwise.
    """
    used = [
        place
        for place, (field, of) in enumerate(zip(FIELDS[kind], types, strict=True))
        if not (field.name in LATER and of is NoneType)
    ]
    if str in types:
        return lambda values: _tagged((kind, *(values[place] for place in used)))
    layout, mark, marks, numbers = ">", _tagged((kind,)), list[Any](), list[int]()
    for place in used:
        if types[place] is NoneType:
            mark += b"-"
            continue
        letter, code = (b"d", "d") if types[place] is float else (b"i", "q")
        layout += f"{len(mark + letter)}s{code}"
        marks += [mark + letter, None]
        mark = b""
        numbers.append(place)
    content, pack = itemgetter(*numbers), struct.Struct(f"{layout}{len(mark)}s").pack

    def packed(values: Values) -> bytes:
        parts = marks.copy()
        parts[1::2] = content(values)  # each behind its mark
        return pack(*parts, mark)

    return packed


GEOMETRY = (
    "map_x", "map_y", "half_x", "half_y",
    "map_x2", "map_y2", "half_x2", "half_y2", "map_heading",
)  # fmt: skip

HEAD = (
    "robot", "name", "own_model", "model",
    "records", "hash", "extra", "beyond", *Observations._fields,
)  # fmt: skip
"""Columns of an excursion's own row; from the fifth on they change when it grows."""

_SQL = {float: "REAL", int: "INTEGER", bool: "INTEGER"}


_COLUMN_TYPES = {
    **{one.name: _SQL.get(one.type, "TEXT") for of_kind in FIELDS.values() for one in of_kind},
    "extra": "TEXT",
}
RECORD_COLUMNS = tuple(_COLUMN_TYPES)
"""Of all fields of all kinds."""


def record_fields_sql() -> str:
    """Return the columns of ``RECORD_COLUMNS`` as the statement that makes their table."""
    return ",\n    ".join(f'"{column}" {of}' for column, of in _COLUMN_TYPES.items())


class RowShape(NamedTuple):
    """Rows of the ledger that have the same columns, apart from those that are NULL.

    To bind a None takes SQLite's module as long as to bind five numbers: such columns are left out.

    statement : the SQL that writes such a row.
    content : takes a record's own values.
    """

    statement: str
    content: Callable[[Record], Values]


@cache
def _shape(kind: str, has_time: bool, is_placed: bool) -> RowShape:
    own = [one for one in FIELDS[kind] if one.name != "t" or has_time]
    columns = ["excursion", "number", "kind", *(one.name for one in own), "extra"]
    if is_placed:
        columns += GEOMETRY if kind == "pose" else GEOMETRY[:-1]
    listed = ", ".join(f'"{column}"' for column in columns)
    marks = ", ".join("?" * len(columns))
    statement = f"INSERT OR REPLACE INTO record ({listed}) VALUES ({marks})"
    return RowShape(statement, attrgetter(*(one.attribute for one in own), "extra"))


def record_rows(
    records: Iterable[tuple[int, Record]], geometry: Mapping[int, Geometry]
) -> dict[str, list[Values]]:
    """Return rows to write, by the statements that write them; the excursion's id comes first.

    records : with their numbers; geometry : where those lie that have a place yet.
    """
    found: dict[str, list[Values]] = {}
    for number, record in records:
        at, kind = geometry.get(number), KIND_OF[type(record)]
        statement, content = _shape(kind, record.t is not None, at is not None)
        row = (number, kind, *content(record))
        if at is not None:
            x, y, (half_x, half_y), x2, y2, (half_x2, half_y2), heading = at
            row += (x, y, half_x, half_y, x2, y2, half_x2, half_y2)
            if kind == "pose":
                row += (heading,)
        found.setdefault(statement, []).append(row)
    return found


NOTHING_OBSERVED = Observations()


class ExcursionRows(NamedTuple):
    """All that the ledger writes of an excursion, apart from its id, which only the file knows.

    head : its row of ``excursion``; records : rows of ``record``, by the statements that write
    them; touched : those of ``touched``.
    """

    head: Values
    records: dict[str, list[Values]]
    touched: Touched


def excursion_rows(
    version: PartialMap,
    model: ErrorModel,
    known_records: int,
    geometry: Mapping[int, Geometry],
    touched: Touched,
    observations: Observations = NOTHING_OBSERVED,
) -> ExcursionRows:
    """Return what to write of a new excursion, or of the later part of a known one.

    Parameters
    ----------
    version
        All that is known of it, with what is new.
    known_records
        How many of its records the ledger holds already.
    geometry
        Of the whole version.
    touched
        Tiles and the numbers of the new records that touch them.
    observations
        What walls told of its heading.
    """
    # Records that waited for a pose lie on the map now: they are written again.
    first = known_records
    while first and not isinstance(version.records[first - 1], Pose):
        first -= 1
    # And so is the last pose: only what comes tells whether the robot turned there (walls).
    first = max(0, first - 1)
    most = model.max_error
    beyond = sum(max(*at.rect, *at.rect2) >= most for at in geometry.values())
    head = (
        version.robot, version.excursion, json.dumps(dict(version.model)),
        json.dumps(asdict(model)), len(version.records), excursion_hash(version, model),
        version.extra, beyond, *observations,
    )  # fmt: skip
    records = record_rows(enumerate(version.records[first:], first), geometry)
    return ExcursionRows(head, records, touched)


_PICK: dict[str, Callable[[Values], Values]] = {
    name: itemgetter(*(RECORD_COLUMNS.index(column) for column in (*columns, "extra")))
    for name, of_kind in FIELDS.items()
    for columns in [[one.name for one in of_kind]]
}
_FLAGS = {
    name: [place for place, one in enumerate(of_kind) if one.type is bool]
    for name, of_kind in FIELDS.items()
}


def record_of_row(kind: str, row: Values) -> Record:
    """Return a record of its row; KeyError for a kind that there is not.

    row : the values of RECORD_COLUMNS.
    """
    make: Callable[..., Record] = KINDS[kind]
    flags = _FLAGS[kind]
    if not flags:
        return make(*_PICK[kind](row))
    found = list(_PICK[kind](row))
    for place in flags:
        if found[place] is not None:
            found[place] = found[place] != 0
    return make(*found)

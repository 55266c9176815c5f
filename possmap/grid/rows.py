"""Records as rows of the ledger's table, and the hash of an excursion, both exact and canonical."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from itertools import product
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple, TypeAlias

from possmap.core.evidence import Geometry
from possmap.core.model import PARAMETERS, ErrorModel
from possmap.core.plan import Touched
from possmap.core.records import KIND_OF, KINDS, Beam, PartialMap, Pose, Record, Wall
from possmap.errors import shown
from possmap.grid.checks import FITS, unfit


def columns_of(kind: type[Record]) -> list[tuple[str, str]]:
    """Return attribute and column of each field of a kind of record."""
    return [(f.name, f.name.removesuffix("_deg")) for f in fields(kind)]


LATER_PARAMETERS = ("wall_noise", "wall_tilt")
"""Parameters that the first grids did not have."""
FIRST_PARAMETERS = tuple(name for name in PARAMETERS if name not in LATER_PARAMETERS)
_DEFAULT = ErrorModel()

GEOMETRY = (
    "map_x", "map_y", "half_x", "half_y",
    "map_x2", "map_y2", "half_x2", "half_y2", "map_heading",
)  # fmt: skip
_FLAGS = frozenset({"followed", "hit", "turned"})
_MAY_BE_ABSENT = frozenset({"t", "upto", "turned"})
_TYPES: dict[str, type] = {
    "seq": int, "followed": int, "hit": int, "turned": int, "upto": int,
    "corner": str, "peer": str, "peer_excursion": str, "extra": str,
}  # fmt: skip
RECORD_COLUMNS = (
    "seq", "t", "x", "y", "x2", "y2", "followed", "hit", "corner", "peer", "peer_excursion", "upto",
    "heading", "error_x", "error_y", "error_heading", "turned", "extra",
)  # fmt: skip
"""In an order in which those that a pose or a wall does not have stand side by side."""

Values: TypeAlias = tuple[Any, ...]


def excursion_hash(excursion: PartialMap, model: ErrorModel) -> bytes:
    """Return SHA-256 of an excursion's names, model in force and records, in a canonical form.

    Doubles are hashed as 8 bytes, big-endian, and absent values by a mark of their own: the same
    log gives the same hash from every encoding.
    """
    parts = [_tagged((excursion.robot, excursion.excursion))]
    parts.append(_tagged(float(getattr(model, name)) for name in FIRST_PARAMETERS))
    for name in LATER_PARAMETERS:
        # What came later and is as by default leaves every hash as it was.
        if getattr(model, name) != getattr(_DEFAULT, name):
            parts.append(_tagged((name, float(getattr(model, name)))))
    for record in excursion.records:
        kind = type(record)
        pack = _PACK.get((kind, record.t is None))
        if pack is not None:
            parts.append(pack(record))
            if kind is Pose and record.turned is not None:  # type: ignore[union-attr]
                parts.append(_tagged((record.turned,)))  # type: ignore[union-attr]
        else:
            parts.append(_tagged((KIND_OF[kind], *_CONTENT[kind](record))))
    return hashlib.sha256(b"".join(parts)).digest()


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
    kind: attrgetter(*(name for name, _ in columns_of(kind) if name != "extra"))
    for kind in KINDS.values()
}


def _packer(kind: type[Record], is_timeless: bool) -> Callable[[Record], bytes]:
    """Return what makes of a record of numbers, in one go, the bytes that ``_tagged`` would."""
    names: list[str] = []
    layout, mark, marks = ">", _tagged((KIND_OF[kind],)), []
    for name, column in columns_of(kind):
        if name == "t" and is_timeless:
            mark += b"-"
        elif name not in ("extra", "turned"):
            letter, code = (b"i", "q") if _TYPES.get(column) is int else (b"d", "d")
            layout += f"{len(mark + letter)}s{code}"
            marks += [mark + letter, None]
            mark = b""
            names.append(name)
    content, pack = attrgetter(*names), struct.Struct(layout).pack

    def packed(record: Record) -> bytes:
        parts = marks.copy()
        parts[1::2] = content(record)  # each behind its mark
        return pack(*parts)

    return packed


_PACK: dict[tuple[type[Record], bool], Callable[[Record], bytes]] = {
    (kind, is_timeless): _packer(kind, is_timeless)
    for kind in (Pose, Wall, Beam)
    for is_timeless in (False, True)
}


class RowShape(NamedTuple):
    """Rows of the ledger that have the same columns, apart from those that are NULL.

    To bind a None takes SQLite's module as long as to bind five numbers: such columns are left out.

    statement : the SQL that writes such a row.
    kind : as written in it.
    content : takes a record's own values.
    has_heading : whether its place on the map has one.
    """

    statement: str
    kind: str
    content: Callable[[Record], Values]
    has_heading: bool


def _shape(kind: type[Record], has_time: bool, is_placed: bool) -> RowShape:
    own = [names for names in columns_of(kind) if names[0] != "t" or has_time]
    has_heading = kind is Pose
    columns = ["excursion", "number", "kind", *(column for _, column in own)]
    if is_placed:
        columns += GEOMETRY if has_heading else GEOMETRY[:-1]
    names = ", ".join(f'"{column}"' for column in columns)
    marks = ", ".join("?" * len(columns))
    statement = f"INSERT OR REPLACE INTO record ({names}) VALUES ({marks})"
    return RowShape(statement, KIND_OF[kind], attrgetter(*(name for name, _ in own)), has_heading)


_SHAPES = {
    (kind, has_time, is_placed): _shape(kind, has_time, is_placed)
    for kind, has_time, is_placed in product(KINDS.values(), (False, True), (False, True))
}


def record_rows(
    records: Iterable[tuple[int, Record]], geometry: Mapping[int, Geometry]
) -> dict[str, list[Values]]:
    """Return rows to write, by the statements that write them; the excursion's id comes first.

    records : with their numbers; geometry : where those lie that have a place yet.
    """
    found: dict[str, list[Values]] = {}
    for number, record in records:
        at = geometry.get(number)
        shape = _SHAPES[type(record), record.t is not None, at is not None]
        statement, kind, content, has_heading = shape
        row = (number, kind, *content(record))
        if at is not None:
            x, y, (half_x, half_y), x2, y2, (half_x2, half_y2), heading = at
            row += (x, y, half_x, half_y, x2, y2, half_x2, half_y2)
            if has_heading:
                row += (heading,)
        found.setdefault(statement, []).append(row)
    return found


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
) -> ExcursionRows:
    """Return what to write of a new excursion, or of the later part of a known one.

    Parameters
    ----------
    known_records
        How many records the ledger holds already.
    touched
        Tiles and the numbers of the new records that touch them.
    """
    # Records that waited for a pose lie on the map now: they are written again.
    first = known_records
    while first and not isinstance(version.records[first - 1], Pose):
        first -= 1
    # And so is the last pose: only what comes tells whether the robot turned there (walls).
    first = max(0, first - 1)
    head = (
        version.robot, version.excursion, json.dumps(dict(version.model)),
        json.dumps(asdict(model)), len(version.records), excursion_hash(version, model),
        version.extra,
    )  # fmt: skip
    return ExcursionRows(
        head,
        record_rows(enumerate(version.records[first:], first), geometry),
        touched,
    )


class _FromRow(NamedTuple):
    """How a kind of record is made of its row.

    pick : takes its values out of a row's of RECORD_COLUMNS.
    unused : takes out those of other kinds, which are ``nothing``.
    sound : the types that its values may have; usual : those that they mostly have.
    fits : whether a log may hold them.
    has_flag : whether its last value but one is true or false.
    """

    make: Callable[..., Record]
    pick: Callable[[Values], Values]
    unused: Callable[[Values], Values]
    nothing: Values
    columns: tuple[str, ...]
    usual: tuple[type, ...]
    sound: frozenset[tuple[type, ...]]
    fits: Callable[..., bool]
    has_flag: bool


def _from_row(kind: type[Record]) -> _FromRow:
    columns = tuple(column for _, column in columns_of(kind))
    may_be = [
        (_TYPES.get(column, float), *([type(None)] if column in _MAY_BE_ABSENT else []))
        for column in columns
    ]
    pick = itemgetter(*(RECORD_COLUMNS.index(column) for column in columns))
    unused = itemgetter(*_runs([column not in columns for column in RECORD_COLUMNS]))
    nothing = unused((None,) * len(RECORD_COLUMNS))
    usual = tuple(
        types[-1 if at == "turned" else 0] for at, types in zip(columns, may_be, strict=True)
    )
    sound = frozenset(product(*may_be))
    has_flag = columns[-2] in _FLAGS
    return _FromRow(kind, pick, unused, nothing, columns, usual, sound, FITS[kind], has_flag)


def _runs(chosen: Sequence[bool]) -> Iterator[slice]:
    """Yield the places of what is chosen, neighbours together."""
    places = [place for place, is_chosen in enumerate(chosen) if is_chosen]
    starts = [place for place in places if place - 1 not in places]
    ends = [place + 1 for place in places if place + 1 not in places]
    yield from map(slice, starts, ends)


_FROM_ROW = {name: _from_row(kind) for name, kind in KINDS.items()}


def record_of_row(kind: str, row: Values) -> Record:
    """Return a record of its row; ValueError or TypeError if it cannot have been written so.

    row : the values of RECORD_COLUMNS.
    """
    if kind not in _FROM_ROW:
        raise ValueError(f"found the kind {shown(kind)}")
    make, pick, unused, nothing, columns, usual, sound, fits, has_flag = _FROM_ROW[kind]
    values = pick(row)
    types = tuple(map(type, values))
    if types != usual and types not in sound:  # to compare is faster than to hash
        raise _unsound(columns, values)
    if unused(row) != nothing:
        raise _of_another_kind(kind, row)
    if not fits(*values):
        raise unfit(columns, values)
    if has_flag:
        flag = values[-2]
        return make(*values[:-2], flag if flag is None else flag != 0, values[-1])
    return make(*values)


def _of_another_kind(kind: str, row: Values) -> Exception:
    """Return the error that names the first value which no record of this kind has."""
    columns = _FROM_ROW[kind].columns
    for column, value in zip(RECORD_COLUMNS, row, strict=False):
        if column not in columns and value is not None:
            return ValueError(f"a {kind} has no {column}")
    raise AssertionError("all of them are NULL")


def _unsound(columns: Sequence[str], values: Sequence[object]) -> Exception:
    """Return the error that names the first value which cannot have been written so."""
    for column, value in zip(columns, values, strict=True):
        expected = _TYPES.get(column, float)
        if value is None and column not in _MAY_BE_ABSENT:
            return ValueError(f"{column} is missing")
        if value is not None and type(value) is not expected:
            return TypeError(f"{column} is no {expected.__name__}")
    raise AssertionError("all values are sound")

"""Records as rows of the ledger's table, and the hash of an excursion, both exact and canonical."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Mapping
from dataclasses import fields
from operator import attrgetter

from possmap.core.evidence import Geometry
from possmap.core.model import PARAMETERS, ErrorModel
from possmap.core.records import KIND_OF, KINDS, PartialMap, Record


def columns_of(kind: type[Record]) -> list[tuple[str, str]]:
    """Return attribute and column of each field of a kind of record."""
    return [(f.name, f.name.removesuffix("_deg")) for f in fields(kind)]


GEOMETRY = (
    "map_x", "map_y", "half_x", "half_y",
    "map_x2", "map_y2", "half_x2", "half_y2", "map_heading",
)  # fmt: skip
_FLAGS = frozenset({"followed", "hit"})
_MAY_BE_ABSENT = frozenset({"t", "upto"})
_TYPES: dict[str, type] = {
    "seq": int, "followed": int, "hit": int, "upto": int,
    "corner": str, "peer": str, "peer_excursion": str, "extra": str,
}  # fmt: skip
RECORD_COLUMNS = sorted({column for kind in KINDS.values() for _, column in columns_of(kind)})


def excursion_hash(excursion: PartialMap, model: ErrorModel) -> bytes:
    """Return SHA-256 of an excursion's names, model in force and records, in a canonical form.

    Doubles are hashed as 8 bytes, big-endian, and absent values by a mark of their own: the same
    log gives the same hash from every encoding.
    """
    digest = hashlib.sha256()

    def add(value: object) -> None:
        if isinstance(value, str):
            data = value.encode()
            digest.update(b"s" + struct.pack(">I", len(data)) + data)
        elif isinstance(value, float):
            digest.update(b"d" + struct.pack(">d", value))
        elif value is None:
            digest.update(b"-")
        else:
            digest.update(b"i" + struct.pack(">q", value))

    add(excursion.robot)
    add(excursion.excursion)
    for name in PARAMETERS:
        add(float(getattr(model, name)))
    for record in excursion.records:
        add(KIND_OF[type(record)])
        for value in _CONTENT[type(record)](record):
            add(value)
    return digest.digest()


_CONTENT = {
    kind: attrgetter(*(name for name, _ in columns_of(kind) if name != "extra"))
    for kind in KINDS.values()
}


def geometry_row(geometry: Mapping[int, Geometry], number: int) -> tuple[float | None, ...]:
    """Return the values of GEOMETRY's columns for a record; all None if it has no place yet."""
    at = geometry.get(number)
    if at is None:
        return (None,) * len(GEOMETRY)
    return (
        at.x, at.y, at.rect.half_x, at.rect.half_y,
        at.x2, at.y2, at.rect2.half_x, at.rect2.half_y, at.heading_deg,
    )  # fmt: skip


def record_of_row(kind: str, row: Mapping[str, object]) -> Record:
    """Return a record of its row; ValueError or TypeError if it cannot have been written so."""
    make: Callable[..., Record] = KINDS[kind]
    values: dict[str, object] = {}
    for name, column in columns_of(KINDS[kind]):
        value = row[column]
        if value is None and column not in _MAY_BE_ABSENT:
            raise ValueError(f"{column} is missing")
        if value is not None and type(value) is not _TYPES.get(column, float):
            raise TypeError(f"{column} is no {_TYPES.get(column, float).__name__}")
        values[name] = bool(value) if column in _FLAGS else value
    return make(**values)


def check_types(*values: tuple[object, type]) -> None:
    """Raise TypeError unless each value is exactly of its type."""
    for value, expected in values:
        if type(value) is not expected:
            raise TypeError(f"found a {type(value).__name__}, expected a {expected.__name__}")

"""The hash of an excursion: of its names, its model in force and its records (METHOD §3)."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Iterable
from functools import cache
from operator import attrgetter, itemgetter
from types import NoneType
from typing import Any, TypeAlias

from possmap.core.model import PARAMETERS, ErrorModel
from possmap.core.records import FIELDS, KIND_OF, KINDS, PartialMap, Record

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

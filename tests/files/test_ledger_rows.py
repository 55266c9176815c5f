"""Records as rows and as hashed bytes: the quick ways give what the plain ones say."""

from __future__ import annotations

import hashlib
import struct
from dataclasses import fields

from hypothesis import given
from hypothesis import strategies as st

from possmap.core.model import PARAMETERS, ErrorModel
from possmap.core.records import (
    CORNER_KINDS,
    KIND_OF,
    Beam,
    Corner,
    Meet,
    PartialMap,
    Pose,
    Record,
    Wall,
)
from possmap.grid.rows import LATER, RECORD_COLUMNS, excursion_hash, record_of_row, record_rows

numbers = st.floats(-1e6, 1e6)
halves = st.floats(0, 1e6)
seqs = st.integers(0, 2**53 - 1)
times = st.none() | st.floats(allow_nan=False, allow_infinity=False)
names = st.text("aZ0._:-", min_size=1, max_size=5)
lines = (seqs, times, numbers, numbers, numbers, numbers, st.booleans())

records: st.SearchStrategy[Record] = st.one_of(
    st.builds(Pose, seqs, times, numbers, numbers, numbers, halves, halves, halves),
    st.builds(Wall, *lines),
    st.builds(Beam, *lines),
    st.builds(Corner, seqs, times, numbers, numbers, st.sampled_from(CORNER_KINDS)),
    st.builds(Meet, seqs, times, names, names, st.none() | seqs),
)


def tagged(value: object) -> bytes:
    """Return a value as docs/grid-file.md says that it is hashed."""
    if isinstance(value, str):
        return b"s" + struct.pack(">I", len(value)) + value.encode()
    if isinstance(value, float):
        return b"d" + struct.pack(">d", value)
    return b"-" if value is None else b"i" + struct.pack(">q", value)


@given(st.lists(records, max_size=5))
def test_the_hash_is_of_every_value_behind_the_letter_of_its_type(listed: list[Record]) -> None:
    model = ErrorModel(scale=1.5)
    values: list[object] = [
        "r1",
        "a",
        *(getattr(model, one) for one in PARAMETERS if one not in LATER),
    ]
    for record in listed:
        values.append(KIND_OF[type(record)])
        values += [getattr(record, f.name) for f in fields(record) if f.name != "extra"]
        if isinstance(record, Pose) and record.turned is None:
            values.pop()
    expected = hashlib.sha256(b"".join(map(tagged, values))).digest()
    assert excursion_hash(PartialMap("r1", "a", (), tuple(listed)), model) == expected


@given(records)
def test_a_row_gives_back_the_record_that_it_was_made_of(record: Record) -> None:
    ((statement, (row,)),) = record_rows([(7, record)], {}).items()
    columns = [
        name.strip('" ') for name in statement.partition("(")[2].partition(")")[0].split(",")
    ]
    stored = {
        name: int(v) if isinstance(v, bool) else v
        for name, v in zip(columns, (3, *row), strict=True)
    }
    assert (stored["excursion"], stored["number"], stored["kind"]) == (3, 7, KIND_OF[type(record)])
    assert stored.keys() <= {"excursion", "number", "kind", *RECORD_COLUMNS}
    again = record_of_row(KIND_OF[type(record)], tuple(map(stored.get, RECORD_COLUMNS)))
    assert again == record
    assert [type(getattr(again, f.name)) for f in fields(again)] == [
        type(getattr(record, f.name)) for f in fields(record)
    ]

"""CSV and JSON recordings, their columns mapped (docs/convert.md, "Mappings")."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from collections.abc import Mapping as MappingABC
from dataclasses import dataclass, field
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from possmap.errors import RecordingError, shown
from possmap.lab.convert.samples import Floats, Samples
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.beams import BeamColumn, mounts_of, used_beams
from possmap.lab.recordings.clocks import Reader, stamps
from possmap.lab.recordings.csv_rows import CsvColumns, Dialect, csv_rows, dialect_of, missing
from possmap.lab.recordings.join import Join
from possmap.lab.recordings.json_stream import entries
from possmap.lab.recordings.mapping import Mapping, Table
from possmap.lab.recordings.readings import Interpreter, Readings
from possmap.lab.recordings.recording import BRIDGED, CHUNK_ROWS, Handling, Recording
from possmap.lab.recordings.stream import Progress

Row: TypeAlias = Any
Getter: TypeAlias = Callable[[Row], Any]
Rows: TypeAlias = Iterator[tuple[int, Row]]

KEY = "key"
"""Column of a JSON row that stands under a key: the key itself."""

_SKIPPED = "rows cut short or without numbers, skipped"
_STEPS = re.compile(r"([^.\[\]]+)|\[(-?[0-9]{1,6})\]")
_TRUTH = {"true": 1.0, "false": 0.0}


@dataclass(frozen=True, slots=True)
class _Plan:
    """How to read one table.

    beams : those used. roles : role -> getter. ranges : getters of the ranges used, then of servos.
    listed : getter of a list of ranges and which of them are used, or None.
    texts : of a CSV row with every field, those of roles and ranges, at once; or None.
    stamp : what makes seconds of a stamp that is no number. dialect : of CSV.
    """

    path: Path
    table: Table
    beams: tuple[BeamColumn, ...]
    roles: MappingABC[Any, Getter]
    ranges: tuple[Getter, ...]
    listed: tuple[Getter, tuple[int, ...]] | None = None
    texts: Callable[[Row], tuple[str, ...]] | None = None
    stamp: Reader | None = None
    dialect: Dialect = field(default_factory=Dialect)


def open_tables(
    paths: Sequence[Path],
    mapping: Mapping,
    wanted: Sequence[float],
    handling: Handling = BRIDGED,
    name: str = "",
    note: str = "",
) -> Recording:
    """Open a recording of one file for each table of the mapping.

    Parameters
    ----------
    wanted
        Angles of the beams used [rad].
    name
        Of the recording, if it is not that of the first file.
    note
        What a user should know of how it is read.

    Raises
    ------
    RecordingError
        If a file cannot be read, holds no rows, or lacks a column that the mapping names.
    """
    plans = [
        _plan(path, table, mapping, wanted)
        for path, table in zip(paths, mapping.tables, strict=True)
    ]
    widths, mounts = mounts_of([plan.beams for plan in plans])

    def samples(tally: Tally, progress: Progress | None) -> Iterator[Samples]:
        if note:
            tally.note(note)
        join = Join(str(paths[0]), mapping, widths, tally, patience=math.inf)
        sources = [_readings(plan, mapping, handling, tally, progress) for plan in plans]
        open_ones = set(range(len(sources)))
        while open_ones:
            behind = min(open_ones, key=join.reach)
            readings = next(sources[behind], None)
            if readings is None:
                open_ones.remove(behind)
                join.close(behind)
                continue
            join.feed(behind, readings)
            yield from join.samples()
        yield from join.samples(last=True)

    unused = [one for plan in plans for one in plan.table.beams if one not in plan.beams]
    size = sum(path.stat().st_size for path in paths)
    return Recording(
        name or paths[0].name, mounts, samples, size, tuple(one.angle for one in unused)
    )


def _plan(path: Path, table: Table, mapping: Mapping, wanted: Sequence[float]) -> _Plan:
    """Look at a file's first row, and find every column that the mapping names."""
    tally = Tally()
    if mapping.format == "csv":
        dialect = dialect_of(path, mapping, table)
        rows: Rows = csv_rows(path, mapping, dialect, tally, None)
    else:
        rows = _json_rows(path, mapping, tally, None)
    first = next(rows, None)
    if first is None:
        raise RecordingError(str(path), f"holds no rows, expected some{tally.explanation()}")
    line, row = first
    place = f"{path}:{line}"
    if mapping.format == "csv":
        header = mapping.header is not False
        columns = CsvColumns(place, row, header)
        sample = next(rows, (0, ()))[1] if header else row
        return _csv_plan(path, table, mapping, columns, sample, dialect, wanted)
    roles = {role: _by_path(place, row, column) for role, column in table.columns.items()}
    stamp = _stamp(roles, row, mapping)
    if table.scan is None:
        beams = used_beams(table.beams, wanted)
        named = [one.column for one in beams] + [one.servo for one in beams if one.servo]
        getters = tuple(_by_path(place, row, column) for column in named)
        return _Plan(path, table, tuple(beams), roles, getters, stamp=stamp)
    listed = _by_path(place, row, table.scan.column)
    ranges = listed(row)
    if not isinstance(ranges, list):
        problem = f"{table.scan.column}, found {shown(ranges)}, expected a list of ranges"
        raise RecordingError(place, problem)
    try:
        used, beams = table.scan.beams(len(ranges), wanted)
    except ValueError as error:
        raise RecordingError(place, f"{table.scan.column}, {error}") from None
    return _Plan(path, table, tuple(beams), roles, (), (listed, tuple(used)), stamp=stamp)


def _csv_plan(
    path: Path,
    table: Table,
    mapping: Mapping,
    find: CsvColumns,
    sample: Sequence[str],
    dialect: Dialect,
    wanted: Sequence[float],
) -> _Plan:
    roles = {role: find.index(column) for role, column in table.columns.items()}
    scan = table.scan
    if scan is None:
        beams = used_beams(table.beams, wanted)
        ranges = [find.index(one.column) for one in beams]
        ranges += [find.index(one.servo) for one in beams if one.servo]
    elif scan.count is None:
        raise RecordingError(str(path), "scan.count, found none, expected how many columns")
    else:
        used, beams = scan.beams(scan.count, wanted)
        ranges = [find.index(scan.column, index) for index in used]
    getters = {str(role): itemgetter(index) for role, index in roles.items()}
    every = (*roles.values(), *ranges)
    stamp = _stamp(getters, sample, mapping)
    plain = len(every) > 1 and stamp is None and not any(one.contact is not None for one in beams)
    return _Plan(
        path,
        table,
        tuple(beams),
        getters,
        tuple(map(itemgetter, ranges)),
        texts=itemgetter(*every) if plain else None,
        stamp=stamp,
        dialect=dialect,
    )


def _stamp(roles: MappingABC[Any, Getter], row: Row, mapping: Mapping) -> Reader | None:
    """Return what reads the stamps, if they are no plain numbers; by a row that has one."""
    try:
        text = roles["t"](row)
        return stamps(text, mapping.time_format) if isinstance(text, str) else None
    except (ValueError, IndexError, KeyError, TypeError):
        return None


def _by_path(place: str, first: Row, column: str) -> Getter:
    """Return what takes a value out of a JSON row, by a path such as ``pose.x`` or ``raw[0]``.

    Raises
    ------
    RecordingError
        If the first row has no such value, with those that it has.
    """
    if isinstance(first, dict) and column in first:
        return itemgetter(column)
    steps: list[str | int] = [name or int(index) for name, index in _STEPS.findall(column)]

    def get(row: Row) -> Any:
        for step in steps:
            row = row[step]
        return row

    try:
        get(first)
    except (KeyError, IndexError, TypeError):
        names = list(first) if isinstance(first, dict) else []
        raise missing(place, column, names, shown(first)) from None
    return get


def _json_rows(path: Path, mapping: Mapping, tally: Tally, progress: Progress | None) -> Rows:
    for line, key, value in entries(path, mapping.rows or "", tally, progress):
        if key and isinstance(value, dict):
            value[KEY] = key
        yield line, value


def _readings(
    plan: _Plan, mapping: Mapping, handling: Handling, tally: Tally, progress: Progress | None
) -> Iterator[Readings]:
    """Yield a table's readings, block by block.

    Of each row only the numbers are kept that are used: a row may be long.
    """
    told = Interpreter(str(plan.path), plan.table, mapping, plan.beams, tally, handling)
    block: list[list[float]] = []

    def finished() -> Readings:
        array: Floats = np.array(block, dtype=np.float64)
        block.clear()
        columns = dict(zip(plan.roles, array[:, 2:].T, strict=False))
        columns["row"] = array[:, 1]
        ranges = array[:, 2 + len(plan.roles) :] if plan.beams else None
        return told.read(columns, ranges, array[:, 0])

    if mapping.format == "csv":
        rows: Rows = csv_rows(plan.path, mapping, plan.dialect, tally, progress)
        if mapping.header is not False:
            next(rows, None)
        if plan.dialect.guessed:
            tally.note(f"{plan.dialect.guessed}, as it seems")
    else:
        rows = _json_rows(plan.path, mapping, tally, progress)
    for number, (line, row) in enumerate(rows):
        try:
            values = _values(plan, row)
        except (ValueError, IndexError, KeyError, TypeError, OverflowError):
            told.lose(_SKIPPED, line, partial(_fault, plan, row))
            continue
        block.append([line, number, *values])
        if len(block) == CHUNK_ROWS:
            yield finished()
    if block:
        yield finished()
    told.finish()


def _values(plan: _Plan, row: Row) -> list[float]:
    """Return the numbers of a row that are used: of its roles, then its ranges, then its servos.

    Raises
    ------
    ValueError, IndexError, KeyError, TypeError, OverflowError
        If one is missing, or is no number.
    """
    if plan.texts is not None:  # whole rows, which nearly all are, several times as quickly
        texts = plan.texts(row)
        if "_" not in "".join(texts):
            try:
                return list(map(float, texts))
            except ValueError:
                pass  # perhaps a range is missing
    values = [_role(plan, role, get(row)) for role, get in plan.roles.items()]
    if plan.listed is not None:
        get, used = plan.listed
        listed = get(row)
        return values + [_range(listed[index]) for index in used]
    for get, beam in zip(plan.ranges, plan.beams, strict=False):
        value = get(row)
        truth = None if beam.contact is None else _TRUTH.get(str(value).strip().lower())
        values.append(_range(value) if truth is None else truth)
    return values + [_range(get(row)) for get in plan.ranges[len(plan.beams) :]]


def _role(plan: _Plan, role: str, value: Any) -> float:
    if role == "t" and plan.stamp is not None:
        return plan.stamp(value)
    return _number(value)


def _fault(plan: _Plan, row: Row) -> str:
    """Return what is wrong with a row: the first role that is missing, or is no number."""
    for role, get in plan.roles.items():
        try:
            value = get(row)
        except (IndexError, KeyError, TypeError):
            return f"{role} is missing"
        try:
            _role(plan, role, value)
        except (ValueError, TypeError, OverflowError):
            expected = "a number, or a date as ISO 8601 has it (time_format)"
            expected = expected if role == "t" else "a number"
            return f"{role}, found {shown(value)}, expected {expected}"
    return "a range is missing, or is no number"


def _number(value: Any) -> float:
    """Return a number; true and 1_000 are none, though Python takes them."""
    if value is True or value is False or (isinstance(value, str) and "_" in value):
        raise ValueError
    return float(value)


def _range(value: Any) -> float:
    """Return a reading; an empty field or null is none."""
    if value is None or (isinstance(value, str) and not value.strip()):
        return math.nan
    return _number(value)

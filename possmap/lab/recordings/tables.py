"""CSV and JSON recordings, their columns mapped (docs/convert.md, "Mappings")."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from possmap.errors import RecordingError, shown
from possmap.lab.convert.samples import Mount, Samples
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.columns import CsvColumns, Getter, JsonPaths, Row, csv_rows
from possmap.lab.recordings.join import Join
from possmap.lab.recordings.json_stream import entries
from possmap.lab.recordings.mapping import Beam, Mapping, Table, chosen, of_scan
from possmap.lab.recordings.readings import Interpreter, Readings
from possmap.lab.recordings.recording import CHUNK_ROWS, Recording, left_out
from possmap.lab.recordings.stream import Progress

Rows: TypeAlias = Iterator[tuple[int, Row]]

KEY = "key"
"""Column of a JSON row that stands under a key: the key itself."""

_SKIPPED = "rows cut short or without numbers, skipped"


@dataclass(frozen=True, slots=True)
class _Plan:
    """How to read one table.

    roles : role -> getter. ranges : getters of the ranges used. listed : getter of a list of
    ranges and which of them are used, or None. mounts : of the ranges, in their order.
    texts : of a CSV row with every field, those of roles and ranges, at once; or None.
    """

    roles: dict[str, Getter]
    ranges: tuple[Getter, ...]
    listed: tuple[Getter, tuple[int, ...]] | None
    mounts: tuple[Mount, ...]
    texts: Callable[[Row], tuple[str, ...]] | None = None


def open_tables(
    paths: Sequence[Path], mapping: Mapping, wanted: Sequence[float], name: str = ""
) -> Recording:
    """Open a recording of one file for each table of the mapping.

    Parameters
    ----------
    wanted
        Angles of the beams used [rad].
    name
        Of the recording, if it is not that of the first file.

    Raises
    ------
    RecordingError
        If a file cannot be read, holds no rows, or lacks a column that the mapping names.
    """
    plans = [
        _plan(path, table, mapping, wanted)
        for path, table in zip(paths, mapping.tables, strict=True)
    ]
    mounts = tuple(mount for plan in plans for mount in plan.mounts)

    def samples(tally: Tally, progress: Progress | None) -> Iterator[Samples]:
        widths = [len(plan.mounts) for plan in plans]
        join = Join(str(paths[0]), mapping, widths, tally, patience=math.inf)
        sources = [
            _readings(path, table, plan, mapping, tally, progress)
            for path, table, plan in zip(paths, mapping.tables, plans, strict=True)
        ]
        open_ones = set(range(len(sources)))
        while open_ones:
            behind = min(open_ones, key=join.reach)
            readings = next(sources[behind], None)
            if readings is None:
                open_ones.remove(behind)
                join.close(behind)
                continue
            join.feed(behind, readings)
            found = join.samples()
            if found is not None:
                yield found
        found = join.samples(last=True)
        if found is not None:
            yield found

    size = sum(path.stat().st_size for path in paths)
    return Recording(name or paths[0].name, mounts, samples, size)


def _plan(path: Path, table: Table, mapping: Mapping, wanted: Sequence[float]) -> _Plan:
    """Look at a file's first row, and find every column that the mapping names."""
    tally = Tally()
    rows = csv_rows if mapping.format == "csv" else _json_rows  # a CSV's header is a row as well
    first = next(rows(path, mapping, tally, None), None)
    if first is None:
        raise RecordingError(str(path), left_out("holds no rows, expected some", tally))
    line, row = first
    if mapping.format == "csv":
        return _csv_plan(path, table, CsvColumns(path, line, row, mapping.header), wanted)
    find = JsonPaths(path, line, row)
    roles = {role: find(column) for role, column in table.columns.items()}
    scan = table.scan
    if scan is None:
        beams = _used(table, wanted)
        getters = tuple(find(beam.column) for beam in beams)
        return _Plan(roles, getters, None, tuple(beam.mount for beam in beams))
    listed = find(scan.column)
    ranges = listed(row)
    if not isinstance(ranges, list):
        problem = f"{scan.column}, found {shown(ranges)}, expected a list of ranges"
        raise RecordingError(f"{path}:{line}", problem)
    count = scan.count or len(ranges)
    if (count - 1) * abs(scan.step) >= math.tau - 1e-9:
        problem = f"{scan.column}, found {count} readings {math.degrees(scan.step):g} degrees apart"
        raise RecordingError(f"{path}:{line}", f"{problem}, expected the step_deg of this scan")
    used, mounts = of_scan(scan, count, wanted)
    return _Plan(roles, (), (listed, tuple(used)), tuple(mounts))


def _csv_plan(path: Path, table: Table, find: CsvColumns, wanted: Sequence[float]) -> _Plan:
    roles = {role: find.index(column) for role, column in table.columns.items()}
    scan = table.scan
    if scan is None:
        beams = _used(table, wanted)
        ranges = [find.index(beam.column) for beam in beams]
        mounts = [beam.mount for beam in beams]
    elif scan.count is None:
        raise RecordingError(str(path), "scan.count, found none, expected how many columns")
    else:
        used, mounts = of_scan(scan, scan.count, wanted)
        ranges = [find.index(scan.column, index) for index in used]
    every = (*roles.values(), *ranges)
    return _Plan(
        {role: itemgetter(index) for role, index in roles.items()},
        tuple(map(itemgetter, ranges)),
        None,
        tuple(mounts),
        itemgetter(*every) if len(every) > 1 else None,
    )


def _used(table: Table, wanted: Sequence[float]) -> list[Beam]:
    used = chosen([beam.mount.angle for beam in table.beams], wanted)
    return [table.beams[index] for index in used]


def _rows(path: Path, mapping: Mapping, tally: Tally, progress: Progress | None) -> Rows:
    if mapping.format == "json":
        return _json_rows(path, mapping, tally, progress)
    rows = csv_rows(path, mapping, tally, progress)
    if mapping.header:
        next(rows, None)
    return rows


def _json_rows(path: Path, mapping: Mapping, tally: Tally, progress: Progress | None) -> Rows:
    for line, key, value in entries(path, mapping.rows, tally, progress):
        if key and isinstance(value, dict):
            value[KEY] = key
        yield line, value


def _readings(
    path: Path,
    table: Table,
    plan: _Plan,
    mapping: Mapping,
    tally: Tally,
    progress: Progress | None,
) -> Iterator[Readings]:
    """Yield a table's readings, block by block.

    Of each row only the numbers are kept that are used: a row may be long.
    """
    told = Interpreter(str(path), table, mapping, tally)
    block: list[list[float]] = []

    def finished() -> Readings:
        array = np.array(block, dtype=np.float64)
        block.clear()
        columns = dict(zip(plan.roles, array[:, 2:].T, strict=False))
        columns["row"] = array[:, 1]
        ranges = array[:, 2 + len(plan.roles) :] if plan.mounts else None
        return told.read(columns, ranges, array[:, 0])

    for number, (line, row) in enumerate(_rows(path, mapping, tally, progress)):
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
    """Return the numbers of a row that are used: of its roles, then its ranges.

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
    values = [_number(get(row)) for get in plan.roles.values()]
    if plan.listed is not None:
        get, used = plan.listed
        listed = get(row)
        values += [_range(listed[index]) for index in used]
    else:
        values += [_range(get(row)) for get in plan.ranges]
    return values


def _fault(plan: _Plan, row: Row) -> str:
    """Return what is wrong with a row: the first role that is missing, or is no number."""
    for role, get in plan.roles.items():
        try:
            value = get(row)
        except (IndexError, KeyError, TypeError):
            return f"{role} is missing"
        try:
            _number(value)
        except (ValueError, TypeError, OverflowError):
            return f"{role}, found {shown(value)}, expected a number"
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

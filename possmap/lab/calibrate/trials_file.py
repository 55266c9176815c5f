"""Trials read from CSV: one row each, with a header (docs/calibrate.md)."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from possmap.errors import LogError, did_you_mean, printable, shown
from possmap.lab.calibrate.trials import LEAST_RUN_M, Trial
from possmap.logs.fields import NAME
from possmap.logs.text import read_text
from possmap.settings.limits import Limits

COLUMNS: Mapping[str, str] = {
    "robot": "whose trial it is",
    "manoeuvre": "what it is called",
    "distance": "asked for [m]",
    "turn": "asked for, before the run, left positive [deg]",
    "along": "true end minus asked end, ahead [m]",
    "across": "the same to the left [m]",
    "heading": "true minus asked heading at the end, left positive [deg]",
    "outing": "which trials were made in one go",
    "geometry": "how the robot was built or set up",
    "day": "which trials were made on one day",
}
REQUIRED = ("robot", "distance", "turn", "along", "across")
_WORDS = ("asked", "end", "error", "m", "deg")
_FARTHEST = 1e6

FARTHEST_DEG = 90.0
"""No robot errs by more: such a heading is itself told, not its error [deg]."""

MOST_FAR = 0.05
"""This share of ends may lie farther off than the robot ran: slips. More are of another unit."""

MOST, MOST_SHARE, CHANCE = 3, 0.1, 0.001
"""So many trials, or this share of all, may be like an earlier one, unless a coarse ruler says so
of more; which it does by chance so rarely."""


def read_trials(path: Path, limits: Limits | None = None) -> list[Trial]:
    """Read a file of trials.

    Names of columns may carry ``asked_``, ``end_``, ``error_`` before and ``_error``, ``_m``,
    ``_deg`` behind them. Empty errors mean: not measured.

    Raises
    ------
    LogError
        ``file:line: column, value found, what was expected``.
    """
    source = read_text(path, limits or Limits())
    if source.is_cut:
        raise LogError(source.name, "the file is cut short")
    rows = csv.reader(source.text.splitlines(), strict=True)
    found: list[Trial] = []
    columns: list[str] = []
    try:
        for row in rows:
            place = f"{source.name}:{rows.line_num}"
            if not row or (not "".join(row).strip()) or row[0].lstrip().startswith("#"):
                continue
            if not columns:
                columns = _header(row, place)
                continue
            if len(row) != len(columns):
                raise LogError(place, f"found {len(row)} fields, expected {len(columns)}")
            found.append(_trial(dict(zip(columns, map(str.strip, row), strict=True)), place))
    except csv.Error as error:
        raise LogError(f"{source.name}:{rows.line_num}", f"not CSV: {error}") from None
    if not columns:
        raise LogError(source.name, f"is empty, expected a header with {', '.join(REQUIRED)}")
    if not found:
        raise LogError(source.name, "holds no trials below its header")
    far = [one for one in found if one.is_run and abs(one.along) + abs(one.across) > one.distance]
    if len(far) > MOST_FAR * len(found):
        one = far[0]
        raise LogError(
            one.place,
            f"along and across, found {one.along:g} and {one.across:g}, expected an end no farther "
            f"off than the {one.distance:g} m that were run: metres?",
        )
    return found


def _header(row: list[str], place: str) -> list[str]:
    names = [_plain(name) for name in row]
    for given, name in zip(row, names, strict=True):
        if name not in COLUMNS:
            raise LogError(
                place,
                f"column {shown(given)} is unknown{did_you_mean(name, COLUMNS)}, expected some of "
                f"{', '.join(COLUMNS)}",
            )
    for name in COLUMNS:
        if names.count(name) > 1:
            raise LogError(place, f"column {name} is given twice")
        if name in REQUIRED and name not in names:
            raise LogError(
                place, f"column {name} is missing ({COLUMNS[name]}), expected {', '.join(REQUIRED)}"
            )
    return names


def _plain(name: str) -> str:
    parts = name.strip().lstrip("\ufeff").lower().replace(" ", "_").split("_")
    kept = [part for part in parts if part not in _WORDS]
    plain = "_".join(kept)
    return "manoeuvre" if plain == "maneuver" else plain


def _trial(fields: Mapping[str, str], place: str) -> Trial:
    for name in ("robot", "outing", "geometry"):
        text = fields.get(name, "")
        if (text or name == "robot") and not NAME.fullmatch(text):
            raise LogError(
                place,
                f"{name}, found {shown(text)}, expected 1 to 64 characters of A-Z a-z 0-9 . _ : -",
            )
    distance = _number(fields, "distance", place)
    turn = _number(fields, "turn", place)
    if distance < 0:
        raise LogError(place, f"distance, found {distance:g}, expected metres >= 0")
    along, across, heading = (
        _number(fields, name, place, optional=True) for name in ("along", "across", "heading")
    )
    if distance >= LEAST_RUN_M and math.isnan(along) != math.isnan(across):
        missing = "along" if math.isnan(along) else "across"
        raise LogError(place, f"{missing}, found nothing, expected both along and across, or none")
    if math.isnan(along) and math.isnan(heading):
        raise LogError(place, "found no error at all, expected along and across, or heading")
    if distance < LEAST_RUN_M and math.isnan(heading):
        raise LogError(
            place,
            f"heading, found nothing, expected it for a trial that runs less than {LEAST_RUN_M} m",
        )
    if abs(heading) > FARTHEST_DEG:
        raise LogError(
            place,
            f"heading, found {heading:g}, expected an error of at most {FARTHEST_DEG:g} degrees; "
            "write it as true minus asked, between -180 and 180",
        )
    robot, geometry = fields["robot"], fields.get("geometry", "")
    if geometry and not NAME.fullmatch(f"{robot}:{geometry}"):
        raise LogError(
            place,
            f"robot and geometry, found {shown(f'{robot}:{geometry}')}, expected at most 64 "
            "characters together: they name one robot in the model",
        )
    return Trial(
        robot=f"{robot}:{geometry}" if geometry else robot,
        outing=fields.get("outing") or place,
        distance=distance,
        turn=turn,
        along=along,
        across=across,
        heading=heading,
        manoeuvre=printable(fields.get("manoeuvre", "")),
        place=place,
        day=printable(fields.get("day", "")),
    )


def _number(fields: Mapping[str, str], name: str, place: str, optional: bool = False) -> float:
    text = fields.get(name, "")
    if optional and not text:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= _FARTHEST:
        what = "a number within ±1e6" + (", or nothing" if optional else "")
        raise LogError(place, f"{name}, found {shown(text)}, expected {what}")
    return value + 0.0


def repeated(trials: Sequence[Trial]) -> list[tuple[Trial, Trial]]:
    """Return trials that repeat an earlier one in all numbers, each behind that one.

    Empty if they are few, or if a coarse ruler explains them: values along, and those across or of
    headings, drawn independently, would then repeat as often.
    """
    from scipy import stats

    first: dict[tuple[object, ...], Trial] = {}
    found: list[tuple[Trial, Trial]] = []
    groups: dict[tuple[object, ...], list[tuple[str, str, str]]] = {}
    for one in trials:
        asked = (one.robot, one.manoeuvre, one.distance, one.turn)
        # As text, since NaN is not like itself.
        errors = (repr(one.along), repr(one.across), repr(one.heading))
        groups.setdefault(asked, []).append(errors)
        if (*asked, *errors) in first:
            found.append((first[*asked, *errors], one))
        else:
            first[*asked, *errors] = one
    if len(found) <= MOST and len(found) <= MOST_SHARE * len(trials):
        return []
    pairs, expected = 0, 0.0
    for rows in groups.values():
        every = math.comb(len(rows), 2)
        if every:
            pairs += _alike(rows)
            along, across, heading = (_alike(column) / every for column in zip(*rows, strict=True))
            # The same error of heading makes the same across: the two count as one.
            expected += every * along * min(across, heading)
    return found if float(stats.poisson.sf(pairs - 1, expected)) < CHANCE else []


def _alike(values: Sequence[object]) -> int:
    return sum(math.comb(count, 2) for count in Counter(values).values())

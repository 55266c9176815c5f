"""The order of rows: by their clock where it tells, by their lines where it does not."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime, time
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from possmap.errors import RecordingError
from possmap.lab.convert.samples import Flags, Floats
from possmap.lab.convert.tally import Tally

STUBBORN = 100
"""So many samples in a row behind the clock, and it has been set back for good."""

SAME_TIME = "rows of one time with the row before, ordered by their lines"

_STEP_S = 0.1  # between rows, where nothing else tells
_DAY_S = 86_400.0
_BACK, _AHEAD = "rows whose clock ran backwards", "rows whose clock jumped ahead and back"

Reader: TypeAlias = Callable[[str], float]
"""Makes seconds of a stamp's text; ValueError if it is none."""


class Clock:
    """Follows the clock of one table, block by block."""

    def __init__(self, name: str, tally: Tally) -> None:
        self._name = name
        self._tally = tally
        self._latest = -math.inf
        self._behind = 0
        self._before: tuple[float, Floats | None, Floats | None] | None = None
        self._given = -math.inf
        self._step = _STEP_S

    def forward(
        self, t: Floats, sound: Flags, lines: Floats, lose: Callable[[int, int], None]
    ) -> Flags:
        """Return which sound rows are not behind the clock, nor far ahead of those that follow.

        Parameters
        ----------
        lose
            Told how many are, and the line of the first.

        Raises
        ------
        RecordingError
            If it was set back for good.
        """
        ahead = sound & spikes(np.where(sound, t, np.nan))
        sound = sound & ~ahead
        times = np.where(sound, t, -math.inf)
        latest = np.maximum.accumulate(np.concatenate([[self._latest], times]))
        behind = sound & (t < latest[:-1])
        for what, which in ((_AHEAD, ahead), (_BACK, behind)):
            if which.any():
                first = int(lines[int(np.argmax(which))])
                self._tally.add(f"{what}, skipped", f"{self._name}:{first}", int(which.sum()))
                lose(int(which.sum()), first)
        if behind.any():
            self._check(t, behind, sound, latest, lines)
        elif sound.any():
            self._behind = 0
        self._latest = float(latest[-1])
        kept: Flags = sound & ~behind
        return kept

    def _check(self, t: Floats, behind: Flags, sound: Flags, latest: Floats, lines: Floats) -> None:
        for index in np.flatnonzero(sound).tolist():
            self._behind = self._behind + 1 if behind[index] else 0
            if self._behind == STUBBORN:
                raise RecordingError(
                    f"{self._name}:{int(lines[index])}",
                    f"the clock, found {t[index]:.3f} s after {latest[index]:.3f} s and "
                    f"{STUBBORN} rows without catching up, expected times that rise; "
                    "cut the recording where it was set back",
                )

    def ordered(
        self, t: Floats, told: Floats | None, ranges: Floats | None, lines: Floats
    ) -> Floats:
        """Return times in which rows of one time that contradict each other follow each other.

        They are spread until the next time; behind it, where none comes, as far apart as those
        before. Rows of one time that say different things may stay together.

        Parameters
        ----------
        told, ranges
            What each row says of the pose, and of ranges, (n, k); None: nothing.
        """
        if not len(t):
            return t
        same = np.diff(t, prepend=self._before[0] if self._before else np.nan) == 0
        other = self._contradict(told, ranges) if same.any() else same
        self._before = (
            float(t[-1]),
            None if told is None else told[-1],
            None if ranges is None else ranges[-1],
        )
        clash = same & other
        if clash.any():
            first = f"{self._name}:{int(lines[int(np.argmax(clash))])}"
            self._tally.add(SAME_TIME, first, int(clash.sum()))
        if clash.any() or t[0] < self._given:
            t = self._spread(t, clash, bool(same[0]))
        self._given = float(t[-1])
        return t

    def _contradict(self, told: Floats | None, ranges: Floats | None) -> Flags:
        """Return which rows say something else of a thing that the row before spoke of."""
        assert told is not None or ranges is not None
        known = self._before or (math.nan, None, None)
        found = np.zeros(len(told if told is not None else ranges), dtype=np.bool_)  # type: ignore[arg-type]
        if told is not None:
            found |= (np.diff(told, axis=0, prepend=_row(known[1], told)) != 0).any(axis=1)
        if ranges is not None:
            read = ~np.isnan(np.concatenate([_row(known[2], ranges), ranges]))
            found |= (read[1:] & read[:-1]).any(axis=1)
        return found

    def _spread(self, t: Floats, clash: Flags, goes_on: bool) -> Floats:
        """Return times of which those that clash lie evenly between theirs and the next.

        Parameters
        ----------
        goes_on
            Whether the first has the time of the row before it.
        """
        found = t.copy()
        starts = np.flatnonzero(np.diff(t, prepend=np.nan) != 0).tolist()
        for start, end in pairwise([*starts, len(t)]):
            places, begin = np.cumsum(clash[start:end]), float(t[start])
            if (goes_on and not start) or begin < self._given:
                begin, places = self._given, places + (begin < self._given and bool(start))
            last = int(places[-1])
            if last and end < len(t) and t[end] > begin:
                self._step = (float(t[end]) - begin) / (last + 1)
            found[start:end] = begin + self._step * places
            self._given = float(found[end - 1])
        return found


def _row(before: Floats | None, like: Floats) -> Floats:
    """Return the row before a block, NaN where there is none, (1, k)."""
    return np.full((1, like.shape[1]), np.nan) if before is None else before[None]


def spikes(t: Floats) -> Flags:
    """Return which times are later than those of all the next three rows, which go on as before.

    One stamp far in the future must not put every row behind it into the past.
    """
    found = np.zeros(len(t), dtype=np.bool_)
    if len(t) > 4:
        following = np.stack([t[2:-2], t[3:-1], t[4:]])
        with np.errstate(invalid="ignore"):
            found[1:-3] = (t[1:-3] > following.max(axis=0)) & (following.min(axis=0) >= t[:-4])
    return found


def stamps(sample: str, form: str | None) -> Reader | None:
    """Return what reads dates or times of day, as a sample has them; None for plain numbers.

    A date without a zone is one of UTC. Behind midnight times of day go on.

    Parameters
    ----------
    form
        As strptime has it; None: ISO 8601.

    Raises
    ------
    ValueError
        If the sample is neither.
    """
    if form is not None:
        return _once(lambda text: _seconds(datetime.strptime(text.strip(), form)), sample)
    try:
        float(sample)
    except ValueError:
        pass
    else:
        return None
    try:
        return _once(lambda text: _seconds(datetime.fromisoformat(text.strip())), sample)
    except ValueError:
        return _once(_TimesOfDay(), sample)


def _once(reader: Reader, sample: str) -> Reader:
    reader(sample)
    return reader


def _seconds(when: datetime) -> float:
    zoned = when if when.tzinfo is not None else when.replace(tzinfo=UTC)
    return zoned.timestamp()


class _TimesOfDay:
    """Reads times of day; one that is half a day behind the one before is of the next day."""

    def __init__(self) -> None:
        self._days, self._before = 0, 0.0

    def __call__(self, text: str) -> float:
        when = time.fromisoformat(text.strip())
        of_day = when.hour * 3600 + when.minute * 60 + when.second + when.microsecond * 1e-6
        if of_day < self._before - _DAY_S / 2:
            self._days += 1
        self._before = of_day
        return self._days * _DAY_S + of_day

"""Tables of different times joined to samples: places and headings interpolated at each reading."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from collections.abc import Mapping as MappingABC
from itertools import pairwise

import numpy as np

from possmap.errors import RecordingError, shown
from possmap.lab.convert.samples import Flags, Floats, Ints, Samples
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.mapping import Mapping
from possmap.lab.recordings.readings import Readings
from possmap.lab.recordings.roles import HEADINGS, PLACES, said

WITHOUT_POSE = "rows of ranges too far in time from a pose, dropped"
WITHOUT_HEADING = "rows of the place behind the last heading, dropped"
SAME_TIME = "rows of one time with another that says something else, dropped"

PATIENCE_S = 10.0
"""How long ranges may stay behind the places [s]; a topic may stop for good."""

MOST_WAITING = 2_000_000
"""Rows held back until another table catches up."""


class Join:
    """Takes in each table's readings as they come, and gives out samples as far as all reach.

    A sample stands for each row of the table with the place, and for each row with ranges. A row
    of ranges has the place and heading of its own moment, linearly between the two that enclose it.

    Parameters
    ----------
    name
        Of the recording, for messages.
    mapping
        Its tables are numbered in their order.
    widths
        How many beams, and how many of them on servos, each table has; samples have all beams side
        by side, then the angles of the servos.
    patience
        How long ranges are waited for when the places go on [s].
    """

    def __init__(
        self,
        name: str,
        mapping: Mapping,
        widths: Sequence[tuple[int, int]],
        tally: Tally,
        patience: float = PATIENCE_S,
    ) -> None:
        self._name = name
        self._tables = tables = mapping.tables
        self._done = -math.inf
        self._gap = mapping.gap
        self._patience = patience
        self._tally = tally
        said_by = [table.columns for table in tables]
        self._place = next(i for i, columns in enumerate(said_by) if said(PLACES, columns))
        self._yaw = next((i for i, one in enumerate(said_by) if said(HEADINGS, one)), self._place)
        self._columns = columns_of(widths)
        self._width = sum(map(len, self._columns.values()))
        self._held: dict[int, Readings] = {}
        self._reached = [-math.inf] * len(tables)
        self._end = math.inf
        self._beyond: set[int] = set()
        self._last_place: tuple[float, float] | None = None
        self._reckoned: tuple[float, float, float, float] | None = None
        self._piece = 0.0
        self._direction = 0.0

    def feed(self, table: int, readings: Readings) -> None:
        """Take in the next rows of a table."""
        if not len(readings):
            return
        self._reached[table] = float(readings.t[-1])
        held = self._held.get(table)
        self._held[table] = readings if held is None else held.followed_by(readings)
        if readings.t[-1] > self._end:
            self._drop_beyond(table)

    def close(self, table: int) -> None:
        """Take note that a table has ended: no other waits for it."""
        if table in (self._place, self._yaw):
            self._end = min(self._end, self._reached[table])
            for number in self._held:
                self._drop_beyond(number)
        self._reached[table] = math.inf

    @property
    def waiting(self) -> int:
        """How many rows are held."""
        return sum(len(readings) for readings in self._held.values())

    def reach(self, table: int) -> float:
        """Return up to when a table was fed [s]; infinity where it has ended."""
        return self._reached[table]

    def samples(self, last: bool = False) -> Iterator[Samples]:
        """Yield the samples up to where all tables reach, of each excursion apart.

        Parameters
        ----------
        last
            Whether nothing comes any more.

        Raises
        ------
        RecordingError
            If a table does not come forth with what the others wait for.
        """
        if last:
            for table in range(len(self._tables)):
                self.close(table)
        place, turning = self._held.get(self._place), self._held.get(self._yaw)
        if place is None or turning is None or not len(place) or not len(turning):
            self._check_waiting()
            return
        end = min(self._reached[self._place], self._reached[self._yaw])
        # Ranges that have stopped are not waited for.
        ranged = min((self._reached[number] for number in self._columns), default=math.inf)
        if ranged < end:
            end = max(ranged, end - self._patience)  # infinity less infinity is no maximum
        rows = self._moments(place, turning, end)
        times = np.unique(np.concatenate([t[np.isfinite(t)] for t in rows.values()]))
        if len(times):
            yield from self._at(times, rows, place, turning)
        self._forget(end)
        self._check_waiting()

    def _moments(self, place: Readings, turning: Readings, end: float) -> dict[int, Floats]:
        """Return the times of each table's rows that become samples, NaN for the others.

        A row at the very end waits: the next may be of the same time.
        """
        fresh = (place.t >= self._done) & (place.t < end) & (place.t <= self._end)
        rows = {self._place: np.where(fresh, place.t, np.nan)}
        for number in self._columns:
            if number in self._held and number != self._place:
                held = self._held[number]
                told = held.says_ranges & (held.t < end) & (held.t <= self._end)
                near = self._enclosed(held.t, place) & self._enclosed(held.t, turning)
                if number == self._yaw:  # its last row was given out, and is held for the next
                    told &= held.t >= self._done
                else:
                    near &= held.t >= self._done
                self._tally.add(WITHOUT_POSE, count=int((told & ~near).sum()))
                rows[number] = np.where(told & near, held.t, np.nan)
        return rows

    def _enclosed(self, t: Floats, known: Readings) -> Flags:
        """Return which moments lie between two known ones, one of them near enough in time."""
        after = np.searchsorted(known.t, t)
        inside = (after < len(known.t)) & (t >= known.t[0])
        after = np.clip(after, 0, len(known.t) - 1)
        exact = known.t[after] == t
        before = np.maximum(after - 1, 0)
        near = np.minimum(known.t[after] - t, t - known.t[before]) <= self._gap
        if known.piece is not None:
            near &= known.piece[after] == known.piece[before]
        found: Flags = inside & (exact | near)
        return found

    def _at(
        self, times: Floats, rows: dict[int, Floats], place: Readings, turning: Readings
    ) -> Iterator[Samples]:
        assert place.place is not None
        assert place.piece is not None
        yaw = None if turning.yaw is None else np.interp(times, turning.t, turning.yaw)
        parts = [np.interp(times, place.t, column) for column in place.place.T]
        if len(parts) == 1:
            assert yaw is not None
            measured = bool(said(HEADINGS, self._tables[self._yaw].columns))
            x, y = self._laid(parts[0], yaw, float(yaw[0]) if measured else 0.0)
        else:
            x, y = parts
        ranges = np.full((len(times), self._width), np.nan)
        for number, moments in rows.items():
            taken = np.flatnonzero(np.isfinite(moments))
            where = np.searchsorted(times, moments[taken])
            held = self._held[number].ranges
            read = np.empty((len(taken), 0))
            if number in self._columns and held is not None:
                read = held[taken]
                # Of several rows of one time each may have other beams.
                row, beam = np.nonzero(~np.isnan(read))
                ranges[where[row], self._columns[number][beam]] = read[row, beam]
            told = place.place[taken] if number == self._place else None
            self._count_same_time(where, read, told)
        piece = place.piece[np.searchsorted(place.t, times, side="right") - 1]
        starts = np.flatnonzero(np.diff(piece, prepend=self._piece)).tolist()
        self._piece = float(piece[-1])
        for start, stop in pairwise(sorted({0, *starts, len(times)})):
            cut, begins = slice(start, stop), start in starts
            if begins:
                self._last_place = None
            looks = self._travelled(x[cut], y[cut]) if yaw is None else yaw[cut]
            yield Samples(times[cut], x[cut], y[cut], looks, ranges[cut], begins)

    def _laid(self, way: Floats, yaw: Floats, first_yaw: float) -> tuple[Floats, Floats]:
        """Return x and y of a way of arcs, laid one behind the other from (0, 0) [m].

        Parameters
        ----------
        way, yaw
            How far the robot has come [m], and where it looks [rad], (n,).
        first_yaw
            Where it looked before the first of them [rad].
        """
        x, y, way_before, yaw_before = self._reckoned or (0.0, 0.0, 0.0, first_yaw)
        turn = np.diff(yaw, prepend=yaw_before)
        chord = np.diff(way, prepend=way_before) * np.sinc(turn / (2 * math.pi))
        middle = yaw - turn / 2
        xs, ys = x + np.cumsum(chord * np.cos(middle)), y + np.cumsum(chord * np.sin(middle))
        self._reckoned = float(xs[-1]), float(ys[-1]), float(way[-1]), float(yaw[-1])
        return xs, ys

    def _count_same_time(self, where: Ints, read: Floats, place: Floats | None) -> None:
        """Count the rows of a time that the next row has as well, and says something else of."""
        same = where[1:] == where[:-1]
        if same.any():
            other = (~np.isnan(read[1:]) & ~np.isnan(read[:-1])).any(axis=1)
            if place is not None:
                other |= (place[1:] != place[:-1]).any(axis=1)
            self._tally.add(SAME_TIME, count=int((same & other).sum()))

    def _travelled(self, x: Floats, y: Floats) -> Floats:
        """Return the direction of travel: the body's heading, where nobody measured it."""
        before = self._last_place or (float(x[0]), float(y[0]))
        dx, dy = np.diff(x, prepend=before[0]), np.diff(y, prepend=before[1])
        moved = np.hypot(dx, dy) > 1e-3
        angle = np.where(moved, np.arctan2(dy, dx), np.nan)
        angle = np.concatenate([[self._direction], angle])
        if self._last_place is None and moved.any():
            angle[0] = angle[1:][moved][0]
        known = np.maximum.accumulate(np.where(np.isfinite(angle), np.arange(len(angle)), 0))
        found: Floats = np.unwrap(angle[known])
        self._last_place = float(x[-1]), float(y[-1])
        self._direction = float(found[-1])
        return found[1:]

    def _forget(self, end: float) -> None:
        """Drop what was given out, but for the places and headings between which the next lie."""
        self._done = end
        for number, readings in self._held.items():
            used = int(np.searchsorted(readings.t, end))
            if number in (self._place, self._yaw):
                used = max(0, used - 1)
            self._held[number] = readings.part(used)

    def _drop_beyond(self, table: int) -> None:
        """Drop the rows of a table that lie behind the last place or heading.

        The first of them stays where the last moments before lie between it and another.
        """
        held = self._held[table]
        first = int(np.searchsorted(held.t, self._end, side="right"))
        keep = first + (table in (self._place, self._yaw))
        lost = np.ones(len(held), dtype=np.bool_) if table == self._place else held.says_ranges
        # One that has stayed was counted before.
        counted = first + (table in self._beyond)
        what = WITHOUT_HEADING if table == self._place else WITHOUT_POSE
        self._tally.add(what, count=int(lost[counted:].sum()))
        if first < min(keep, len(held)):
            self._beyond.add(table)
        self._held[table] = held.part(0, keep)

    def _check_waiting(self) -> None:
        if self.waiting > MOST_WAITING:
            behind = min(range(len(self._tables)), key=self._reached.__getitem__)
            raise RecordingError(
                self._name,
                f"{shown(self._tables[behind].source)} says nothing for {MOST_WAITING} rows of "
                "the others, expected tables of one time",
            )


def columns_of(widths: Sequence[tuple[int, int]]) -> MappingABC[int, Ints]:
    """Return by table where its beams, and behind them its servos, stand among all ranges.

    widths : how many of each a table has; those without any are left out.
    """
    beam, servo = 0, sum(beams for beams, _ in widths)
    found: dict[int, Ints] = {}
    for number, (beams, servos) in enumerate(widths):
        if beams:
            found[number] = np.array(
                [*range(beam, beam + beams), *range(servo, servo + servos)], dtype=np.int64
            )
        beam, servo = beam + beams, servo + servos
    return found

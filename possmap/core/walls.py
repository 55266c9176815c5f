"""The estimator ``walls`` (METHOD §1): a wall is a measurement of the heading, by a Kalman filter.

It keeps the mean m and the covariance P of six states: the place (x, y) [m]; c, true minus logged
heading [rad]; o, the over-turn per 45° beyond ``turn_bias`` [rad]; b, the drift beyond ``drift``
[rad/m]; s, the relative error of the present run's length. A wall that is followed, or seen, tells
the heading up to a quarter of a turn, and with it mends all that a heading error has done.

As in ``core/heading.py`` P is kept times ``factor`` squared: its entries are squared half-widths.
Plain lists, since matrices of NumPy take several times as long for six rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

from possmap.core.angles import HALF_TURN_TOLERANCE_DEG, wrap_degrees
from possmap.core.correction import CorrectedStretch
from possmap.core.model import ErrorModel
from possmap.core.propagation import RIGHT_ANGLE, ErrorRectangle, StretchErrors
from possmap.core.records import Pose, Wall
from possmap.core.settings import EvidenceSettings
from possmap.core.track import Stretch

X, Y, HEADING, OVERTURN, DRIFT, LENGTH = range(6)
"""Of m and P: METHOD's x, y, c, o, b and s."""

SAME_RUN_DEG = 1.0
"""A direction that differs by more from that of a run's first piece begins a run; so do turns."""
LEAST_LENGTH_M = 0.4
"""A shorter wall tells no heading."""
LEAST_SPREAD_DEG = 0.1
"""Half-width that a followed wall leaves in any case, beside ``alignment_spread``."""
MOST_OUTLIERS = 3
"""More outliers than this beyond the walls used: the building is not what ``axes`` says."""

Row: TypeAlias = list[float]


class Observations(NamedTuple):
    """What an excursion's walls have told of its heading.

    used, vague, outliers : how many told it, did not tell which of the axes they meant, and
        contradicted the rest.
    seen : those used that were seen in passing.
    residuals : sum of r/√V over those.
    """

    used: int = 0
    vague: int = 0
    outliers: int = 0
    seen: int = 0
    residuals: float = 0.0

    @property
    def bias(self) -> float:
        """Σ r/√V / √n of the walls seen: near 0 if the axes are right, beyond ±4 if not."""
        return self.residuals / math.sqrt(self.seen) if self.seen else 0.0


class Fit(NamedTuple):
    """How well walls fitted what an excursion's model expects.

    squares : sum of r²/V over those used, of each 9 at most, that a single slip counts no more; as
        large as their number if the model holds.
    overturn : o after the last of them [rad per 45°].
    residuals : r of all, also of vague ones and outliers [rad].
    """

    squares: float = 0.0
    overturn: float = 0.0
    residuals: tuple[float, ...] = ()


class FilteredError(NamedTuple):
    """What may be wrong with a pose at the end of a stretch, after its turn.

    rectangle : around the corrected place; heading_half : H [rad].
    """

    rectangle: ErrorRectangle
    heading_half: float


class WallFilter:
    """Goes along one excursion, stretch by stretch; METHOD's steps are its methods.

    Attributes
    ----------
    mean, covariance
        m, and P times ``factor`` squared.
    observations
        So far.
    began
        Whether the last stretch began a run.
    """

    def __init__(self, first: Pose, model: ErrorModel, settings: EvidenceSettings) -> None:
        self._model = model
        self._quarter = math.radians(90.0 if settings.orthogonal else 360.0)  # METHOD's Q
        self._sees, self._axes = settings.orthogonal, math.radians(settings.axes)
        self.mean: Row = [first.x, first.y, 0.0, 0.0, 0.0, 0.0]
        half_widths = (
            first.error_x,
            first.error_y,
            math.radians(first.error_heading_deg),
            math.radians(model.turn_spread),
            math.radians(model.drift_spread),
            0.0,
        )
        self.covariance: list[Row] = [
            [half**2 if row == column else 0.0 for column in range(6)]
            for row, half in enumerate(half_widths)
        ]
        self.observations = Observations()
        self.began = False
        self._squares = 0.0
        self._residuals: list[float] = []
        self._direction_deg: float | None = None  # of the first piece of the run so far
        self._followed = False
        self._turned_deg = 0.0  # since the last pair that ran
        self._knows_turns = True  # whether the log tells of all turns at standstill since then

    @property
    def fit(self) -> Fit:
        """How well the walls observed so far fitted the model."""
        return Fit(self._squares, self.mean[OVERTURN], tuple(self._residuals))

    @property
    def rectangle(self) -> ErrorRectangle:
        """Half-widths around the place; rounding may leave a variance a hair below 0."""
        p = self.covariance
        return ErrorRectangle(math.sqrt(max(0.0, p[X][X])), math.sqrt(max(0.0, p[Y][Y])))

    @property
    def heading_half(self) -> float:
        """H [rad], at most a right angle."""
        return min(RIGHT_ANGLE, math.sqrt(max(0.0, self.covariance[HEADING][HEADING])))

    @property
    def place(self) -> tuple[float, float]:
        """The corrected place [m]."""
        return self.mean[X], self.mean[Y]

    def advance(
        self, logged: Stretch, following: Stretch | None
    ) -> tuple[CorrectedStretch, StretchErrors]:
        """Lay one more stretch; ``following`` is the next, where there is one (METHOD §1)."""
        self.began = logged.is_run and self._begins(logged)
        if logged.is_run:
            if self.began:
                self._begin(logged)  # step 1
            if self.began and logged.is_followed:
                self._observe_followed()  # step 2
            elif self._sees and not logged.is_followed and logged.has_wall:
                self._observe_seen(logged)
        start, rectangle = self.place, self.rectangle  # step 3
        rotation = math.cos(self.mean[HEADING]), math.sin(self.mean[HEADING])
        along, length, stretch = self._run(logged) if logged.is_run else ((1.0, 0.0), 0.0, 1.0)
        end, at_end, heading_half = self.place, self.rectangle, self.heading_half  # step 4
        self._turn(logged, following)  # step 5
        heading_deg = logged.end.heading_deg + math.degrees(self.mean[HEADING])
        corrected = CorrectedStretch(
            logged,
            start,
            end,
            length,
            along,
            stretch,
            rotation,
            heading_deg,
        )
        after = FilteredError(at_end, self.heading_half)
        return corrected, StretchErrors(rectangle, at_end, heading_half, after)

    def _begins(self, logged: Stretch) -> bool:
        """Whether a run begins, or goes on with another piece; turns are those before it."""
        direction_deg = _direction_deg(logged)
        begins = (
            self._direction_deg is None
            or self._turned_deg > SAME_RUN_DEG
            or abs(wrap_degrees(direction_deg - self._direction_deg)) > SAME_RUN_DEG
            or logged.is_followed != self._followed
        )
        if begins:
            self._direction_deg, self._followed = direction_deg, logged.is_followed
        return begins

    def _begin(self, logged: Stretch) -> None:
        """Step 1: a new error of length; and what makes a straight run miss to the side."""
        self._reset(LENGTH, self._model.along**2)
        if not logged.is_followed:
            self.covariance[HEADING][HEADING] += self._model.across**2  # across read as radians

    def _reset(self, state: int, variance: float) -> None:
        """Forget what a state was and what it has to do with the others; s becomes 0."""
        if state == LENGTH:
            self.mean[LENGTH] = 0.0
        for row in self.covariance:
            row[state] = 0.0
        self.covariance[state] = [0.0] * 6
        self.covariance[state][state] = variance

    def _observe_followed(self) -> None:
        """Step 2: the robot has lined up with a wall, which stands along one of the axes."""
        spread, least = map(math.radians, (self._model.alignment_spread, LEAST_SPREAD_DEG))
        noise = spread**2 + least**2
        if not self._knows_turns:
            # Nobody knows which of the axes the robot thinks it has lined up with.
            self.mean[HEADING] = self._nearest_axis(self.mean[HEADING])
            self._reset(HEADING, noise)
            self.observations = self.observations._replace(used=self.observations.used + 1)
            return
        self._observe(0.0, -self._wrapped(self.mean[HEADING]), noise, is_seen=False)

    def _observe_seen(self, logged: Stretch) -> None:
        """Step 2: walls seen in passing stand along the axes, but for their noise and tilt."""
        half = logged.distance / 2
        noise, tilt = self._model.wall_noise, math.radians(self._model.wall_tilt)
        drift = math.radians(self._model.drift)
        for _, wall in logged.seen:
            if not isinstance(wall, Wall):
                continue
            step_x, step_y = wall.x2 - wall.x, wall.y2 - wall.y
            length = math.hypot(step_x, step_y)
            told = self.observations
            if length < LEAST_LENGTH_M or told.outliers > told.seen + MOST_OUTLIERS:
                continue
            heading = (
                self.mean[HEADING] + (drift + self.mean[DRIFT]) * half
            )  # in the middle of the run
            residual = -self._wrapped(math.atan2(step_y, step_x) - self._axes + heading)
            self._observe(half, residual, 2 * (noise / length) ** 2 + tilt**2, is_seen=True)

    def _observe(self, half: float, residual: float, noise: float, is_seen: bool) -> None:
        """Update m and P by one observation of c + half·b, unless it is vague or an outlier."""
        p, told = self.covariance, self.observations
        column = [row[HEADING] + half * row[DRIFT] for row in p]  # P·Hᵀ
        variance = column[HEADING] + half * column[DRIFT] + noise
        deviation = math.sqrt(max(0.0, variance)) / self._model.factor
        self._residuals.append(residual)
        if 3 * deviation > self._quarter / 2:
            self.observations = told._replace(vague=told.vague + 1)
            return
        if is_seen and abs(residual) > 3 * deviation:
            self.observations = told._replace(outliers=told.outliers + 1)
            return
        surprise = residual / deviation if deviation else 0.0
        self._squares += min(9.0, surprise**2)
        self.observations = told._replace(
            used=told.used + 1,
            seen=told.seen + is_seen,
            residuals=told.residuals + (surprise if is_seen else 0.0),
        )
        if not variance > 0:
            return  # both are known without any error: there is nothing to learn
        for state, (row, gained) in enumerate(zip(p, column, strict=True)):
            gain = gained / variance
            self.mean[state] += gain * residual
            for other in range(6):
                row[other] -= gain * column[other]

    def _run(self, logged: Stretch) -> tuple[tuple[float, float], float, float]:
        """Step 4: carry m and P along a run; return its direction, length and stretch."""
        m, p, d, followed = self.mean, self.covariance, logged.distance, logged.is_followed
        if followed:
            bend, angle = 0.0, self._nearest_axis(m[HEADING])  # a follower goes where the wall goes
        else:
            bend = (math.radians(self._model.drift) + m[DRIFT]) * d
            angle = m[HEADING] + bend / 2
        half = bend / 2
        chord = self._model.scale * d * (math.sin(half) / half if half else 1.0)
        length = chord * (1 + m[LENGTH])
        cos, sin = math.cos(angle), math.sin(angle)
        unit_x, unit_y = logged.unit
        along = (unit_x * cos - unit_y * sin, unit_x * sin + unit_y * cos)
        m[X] += length * along[0]
        m[Y] += length * along[1]
        m[HEADING] += bend
        # F·P·Fᵀ, F the identity but for these entries of its rows x, y and c.
        if followed:
            _mixed(p, X, ((LENGTH, chord * along[0]),))
            _mixed(p, Y, ((LENGTH, chord * along[1]),))
        else:
            aside_x, aside_y = -length * along[1], length * along[0]
            _mixed(p, X, ((LENGTH, chord * along[0]), (HEADING, aside_x), (DRIFT, d / 2 * aside_x)))
            _mixed(p, Y, ((LENGTH, chord * along[1]), (HEADING, aside_y), (DRIFT, d / 2 * aside_y)))
            _mixed(p, HEADING, ((DRIFT, d),))
        self._turned_deg, self._knows_turns = 0.0, True
        return along, abs(length), length / d

    def _turn(self, logged: Stretch, following: Stretch | None) -> None:
        """Step 5: the turn at the end of a stretch, which may only be a new belief."""
        t = logged.turn_deg
        if abs(t) <= HALF_TURN_TOLERANCE_DEG:
            return
        if is_relabelling(logged, following):
            self.mean[HEADING] -= math.radians(t)
            return
        model, parts = self._model, abs(t) / 45
        over_turn = math.radians(model.turn_bias) + self.mean[OVERTURN]
        self.mean[HEADING] += math.radians(model.turn_gain * t) + over_turn * parts
        _mixed(self.covariance, HEADING, ((OVERTURN, parts),))
        self.covariance[HEADING][HEADING] += math.radians(model.turn_noise) ** 2 * parts
        self._turned_deg += abs(t)
        self._knows_turns &= logged.is_run or is_told(logged)

    def _nearest_axis(self, angle: float) -> float:
        return self._quarter * math.floor(angle / self._quarter + 0.5)

    def _wrapped(self, angle: float) -> float:
        return angle - self._nearest_axis(angle)


def _mixed(p: list[Row], state: int, shares: Iterable[tuple[int, float]]) -> None:
    """Add shares of other states to one, in place: F·P·Fᵀ, F the identity but in one row."""
    row = p[state]
    for other, share in shares:
        for column, value in enumerate(p[other]):
            row[column] += share * value
    for each in p:
        each[state] += sum([share * each[other] for other, share in shares])


def _direction_deg(logged: Stretch) -> float:
    start, end = logged.start, logged.end
    return math.degrees(math.atan2(end.y - start.y, end.x - start.x))


def is_told(logged: Stretch) -> bool:
    """Whether the log tells of a turn at standstill if the robot turned."""
    start, end = logged.start, logged.end
    return end.turned is not None or (start.t is not None and end.t is not None)


def is_relabelling(logged: Stretch, following: Stretch | None) -> bool:
    """Whether the robot did not turn, but set its belief anew: it lined up in no time."""
    if logged.end.turned is not None:
        return not logged.end.turned
    t = logged.end.t
    in_no_time = not logged.is_run and t is not None and t == logged.start.t
    return in_no_time and following is not None and following.is_followed

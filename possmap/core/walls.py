"""The estimator ``walls`` (METHOD §1): a wall is a measurement of the heading, by a Kalman filter.

It keeps the mean m and the covariance P of six states: the place (x, y) [m]; c, true minus logged
heading [rad]; o, the over-turn per 45° beyond ``turn_bias`` [rad]; b, the drift beyond ``drift``
[rad/m]; s, the relative error of the present run's length. A wall that is followed, or seen, tells
the heading up to a quarter of a turn, and with it mends all that a heading error has done.

As in ``core/heading.py`` P is kept times ``factor`` squared: its entries are squared half-widths.
"""

from __future__ import annotations

import math

from possmap.core.correction import CorrectedStretch
from possmap.core.kalman import Gaussian, Step
from possmap.core.model import ErrorModel
from possmap.core.observations import Fit, Observations
from possmap.core.propagation import RIGHT_ANGLE, ErrorRectangle, FilteredError, StretchErrors
from possmap.core.records import Fix, Pose, Wall
from possmap.core.settings import EvidenceSettings
from possmap.core.track import HALF_TURN_TOLERANCE_DEG, Stretch, wrap_degrees

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
SURPRISING, SURPRISING_WITH_HEADING = 13.8, 16.3
"""rᵀV⁻¹r of a fix that chance exceeds once in a thousand times (χ² of two and of three)."""
LEAST_FIX = 1e-9
"""No fix is taken to be better [m, rad]: no double tells places of a site finer."""


class WallFilter:
    """Goes along one excursion, stretch by stretch; METHOD's steps are its methods.

    Parameters
    ----------
    keeps_steps
        Whether somebody will look back.

    Attributes
    ----------
    observations
        So far.
    began
        Whether the last stretch began a run.
    """

    def __init__(
        self,
        first: Pose,
        model: ErrorModel,
        settings: EvidenceSettings,
        keeps_steps: bool = False,
    ) -> None:
        self._model = model
        self._quarter = math.radians(90.0 if settings.orthogonal else 360.0)  # METHOD's Q
        self._sees, self._axes = settings.orthogonal, math.radians(settings.axes)
        half_widths = [
            first.error_x,
            first.error_y,
            math.radians(first.error_heading_deg),
            math.radians(model.turn_spread),
            math.radians(model.drift_spread),
            0.0,
        ]
        self._state = Gaussian([first.x, first.y, 0.0, 0.0, 0.0, 0.0], half_widths, keeps_steps)
        self._state.mark()
        self.observations = Observations()
        self.began = False
        self._squares = 0.0
        self._residuals: list[float] = []
        self._direction_deg: float | None = None  # of the first piece of the run so far
        self._followed = False
        self._turned_deg = 0.0  # since the last pair that ran
        self._knows_turns = True  # whether the log tells of all turns at standstill since then

    @property
    def steps(self) -> list[Step]:
        """All steps so far, with marks: one of the first pose, and three of each stretch."""
        return self._state.steps

    @property
    def fit(self) -> Fit:
        """How well the walls observed so far fitted the model."""
        return Fit(self._squares, self._state.mean[OVERTURN], tuple(self._residuals))

    @property
    def rectangle(self) -> ErrorRectangle:
        """Half-widths around the place."""
        return ErrorRectangle(self._state.half_width(X), self._state.half_width(Y))

    @property
    def heading_half(self) -> float:
        """H [rad], at most a right angle."""
        return min(RIGHT_ANGLE, self._state.half_width(HEADING))

    @property
    def place(self) -> tuple[float, float]:
        """The corrected place [m]."""
        return self._state.mean[X], self._state.mean[Y]

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
        state = self._state
        start, rectangle = self.place, self.rectangle  # step 3
        rotation = math.cos(state.mean[HEADING]), math.sin(state.mean[HEADING])
        state.mark()
        along, length, stretch = self._run(logged) if logged.is_run else ((1.0, 0.0), 0.0, 1.0)
        end, at_end, heading_half = self.place, self.rectangle, self.heading_half  # step 4
        state.mark()
        self._turn(logged, following)  # step 5
        state.mark()
        heading_deg = logged.end.heading_deg + math.degrees(state.mean[HEADING])
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

    def observe_fix(self, fix: Fix, pose: Pose) -> None:
        """Update m and P by where the robot truly was at a pose, the last (METHOD §7).

        Its coordinates are observed one after the other, which is the same as together: their
        errors are independent.
        """
        state, told = self._state, self.observations
        seen = [(X, fix.x - state.mean[X], fix.error_x), (Y, fix.y - state.mean[Y], fix.error_y)]
        most = SURPRISING
        if fix.heading_deg is not None and fix.error_heading_deg is not None:
            off = math.radians(pose.heading_deg - fix.heading_deg) + state.mean[HEADING]
            off -= 2 * math.pi * math.floor(off / (2 * math.pi) + 0.5)
            seen.append((HEADING, -off, math.radians(fix.error_heading_deg)))
            most = SURPRISING_WITH_HEADING
        before, surprise = state.mean[:], 0.0
        for at, residual, half in seen:
            left = residual - (state.mean[at] - before[at])
            column, variance = state.forecast(at, at, 0.0, max(half, LEAST_FIX) ** 2)
            surprise += left * left / variance * self._model.factor**2
            state.learn(at, at, 0.0, column, variance, left)
        self.observations = told._replace(
            fixes=told.fixes + 1,
            surprising=told.surprising + (surprise > most),
            surprise=max(told.surprise, surprise),
        )

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
        state = self._state
        state.mean[LENGTH] = 0.0
        state.forget(LENGTH, self._model.along**2)
        if not logged.is_followed:
            state.covariance[HEADING][HEADING] += self._model.across**2  # across read as radians

    def _observe_followed(self) -> None:
        """Step 2: the robot has lined up with a wall, which stands along one of the axes."""
        spread, least = map(math.radians, (self._model.alignment_spread, LEAST_SPREAD_DEG))
        noise, mean = spread**2 + least**2, self._state.mean
        if not self._knows_turns:
            # Nobody knows which of the axes the robot thinks it has lined up with.
            mean[HEADING] = self._nearest_axis(mean[HEADING])
            self._state.forget(HEADING, noise)
            self.observations = self.observations._replace(used=self.observations.used + 1)
            return
        self._observe(0.0, -self._wrapped(mean[HEADING]), noise, is_seen=False)

    def _observe_seen(self, logged: Stretch) -> None:
        """Step 2: walls seen in passing stand along the axes, but for their noise and tilt."""
        half = logged.distance / 2
        noise, tilt = self._model.wall_noise, math.radians(self._model.wall_tilt)
        drift, mean = math.radians(self._model.drift), self._state.mean
        for _, wall in logged.seen:
            if not isinstance(wall, Wall):
                continue
            step_x, step_y = wall.x2 - wall.x, wall.y2 - wall.y
            length = math.hypot(step_x, step_y)
            told = self.observations
            if length < LEAST_LENGTH_M or told.outliers > told.seen + MOST_OUTLIERS:
                continue
            heading = mean[HEADING] + (drift + mean[DRIFT]) * half  # in the middle of the run
            residual = -self._wrapped(math.atan2(step_y, step_x) - self._axes + heading)
            self._observe(half, residual, 2 * (noise / length) ** 2 + tilt**2, is_seen=True)

    def _observe(self, half: float, residual: float, noise: float, is_seen: bool) -> None:
        """Update m and P by one observation of c + half·b, unless it is vague or an outlier."""
        state, told = self._state, self.observations
        column, variance = state.forecast(HEADING, DRIFT, half, noise)
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
        state.learn(HEADING, DRIFT, half, column, variance, residual)

    def _run(self, logged: Stretch) -> tuple[tuple[float, float], float, float]:
        """Step 4: carry m and P along a run; return its direction, length and stretch."""
        state, d, followed = self._state, logged.distance, logged.is_followed
        m = state.mean
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
            state.mix(X, ((LENGTH, chord * along[0]),))
            state.mix(Y, ((LENGTH, chord * along[1]),))
        else:
            aside_x, aside_y = -length * along[1], length * along[0]
            state.mix(X, ((LENGTH, chord * along[0]), (HEADING, aside_x), (DRIFT, d / 2 * aside_x)))
            state.mix(Y, ((LENGTH, chord * along[1]), (HEADING, aside_y), (DRIFT, d / 2 * aside_y)))
            state.mix(HEADING, ((DRIFT, d),))
        self._turned_deg, self._knows_turns = 0.0, True
        return along, abs(length), length / d

    def _turn(self, logged: Stretch, following: Stretch | None) -> None:
        """Step 5: the turn at the end of a stretch, which may only be a new belief."""
        t = logged.turn_deg
        if abs(t) <= HALF_TURN_TOLERANCE_DEG:
            return
        if is_relabelling(logged, following):
            self._state.mean[HEADING] -= math.radians(t)
            return
        model, state, parts = self._model, self._state, abs(t) / 45
        over_turn = math.radians(model.turn_bias) + state.mean[OVERTURN]
        state.mean[HEADING] += math.radians(model.turn_gain * t) + over_turn * parts
        state.mix(HEADING, ((OVERTURN, parts),))
        state.covariance[HEADING][HEADING] += math.radians(model.turn_noise) ** 2 * parts
        self._turned_deg += abs(t)
        self._knows_turns &= logged.is_run or is_told(logged)

    def _nearest_axis(self, angle: float) -> float:
        return self._quarter * math.floor(angle / self._quarter + 0.5)

    def _wrapped(self, angle: float) -> float:
        return angle - self._nearest_axis(angle)


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

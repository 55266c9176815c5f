"""The heading from a building of right angles: its axes, and the error along the whole track.

A Kalman filter with two unknowns, the heading's error (a random walk over the way driven) and the
direction of the building's axes (constant); then Rauch, Tung and Striebel's backward smoother.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from possmap.lab.convert.samples import Floats, Samples

QUARTER = math.pi / 2
LEAST_LENGTH_M = 0.7
"""Shorter walls do not tell a heading."""

SUREST_LENGTH_M = 2.8
"""Longer walls are no surer: the heading changes while they are passed."""

GATE = math.radians(20)
"""A wall farther off every axis stands askew, and tells nothing."""

PROCESS = math.radians(1) ** 2 * 0.1
"""Variance that the heading's error gains per metre driven [rad²/m].

Taking it from the walls, by likelihood, was tried: walls that are not straight make it too large,
and repeated passes of one corridor then lie farther apart."""

WALL_SPREAD = math.radians(4)
"""Standard deviation of the direction of a wall of the least length [rad]."""

STEADY_DEG_PER_M = 0.2
"""A drift that the axes of a building should not have to take out [deg/m]."""

FEW_AGREE = 0.6
"""Below this share of walls near an axis, the building may not be one of right angles."""

_LOOK = np.array([1.0, 1.0])
"""What a wall shows: the heading's error and the axes' direction, together."""

_ANY = math.radians(45) ** 2
_START = 20.0  # metres of way from which the axes are guessed
_GRID = 180


@dataclass(frozen=True, slots=True)
class Bearing:
    """A fitted wall, as far as it tells a heading.

    leg : number of the excursion. way : where along it [m]. angle : of the wall [rad].
    length : [m].
    """

    leg: int
    way: float
    angle: float
    length: float

    @property
    def variance(self) -> float:
        """Of the direction [rad²]: a long wall is surer, up to a point."""
        return WALL_SPREAD**2 * LEAST_LENGTH_M / min(self.length, SUREST_LENGTH_M)


@dataclass(frozen=True, slots=True)
class Used:
    """What became of a bearing.

    off : from the nearest axis, after the correction [rad]. used : whether it told the heading.
    """

    bearing: Bearing
    off: float
    used: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """One wall in the filter. State: the heading's error and the axes' direction [rad].

    carried : what of the state was carried on from the wall before. ahead, ahead_cov : expected
    here. state, cov : with this wall. use : whether it was near enough to an axis.
    """

    carried: Floats
    ahead: Floats
    ahead_cov: Floats
    state: Floats
    cov: Floats
    use: bool


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """How wrong the heading was along the way.

    Attributes
    ----------
    axis
        Direction of the building's axes [rad], within a quarter turn.
    nodes
        By leg: way [m] and the heading's error there [rad], arrays of one length; between them
        it is linear.
    walls
        Each wall that is long enough, and whether it was used.
    spread
        Standard deviation of a wall's direction from what the other walls say [rad]; NaN where
        fewer than three were used.
    lean
        Within this 95 % of them lie, tails and all [rad]; NaN likewise.
    """

    axis: float
    nodes: dict[int, tuple[Floats, Floats]]
    walls: tuple[Used, ...]
    spread: float
    lean: float

    def error(self, leg: int, way: Floats) -> Floats:
        """Return the heading's error along a leg [rad]."""
        if leg not in self.nodes:
            return np.zeros(len(way))
        at, error = self.nodes[leg]
        found: Floats = np.interp(way, at, error)
        return found

    def error_at(self, leg: int, way: float) -> float:
        """Return the heading's error at one place of a leg [rad]."""
        return float(self.error(leg, np.array([way]))[0])

    def tells(self, angle: float, length: float) -> bool:
        """Whether a wall, its track corrected, tells the heading."""
        off = math.remainder(angle - self.axis, QUARTER)
        return length >= LEAST_LENGTH_M and abs(off) <= GATE

    @property
    def drift(self) -> float:
        """The steady part of the heading's error, as the model's ``drift`` [rad/m].

        True minus logged: of a robot that turns to the left without knowing, positive.
        """
        way = np.concatenate([at for at, _ in self.nodes.values()])
        error = np.concatenate([error for _, error in self.nodes.values()])
        square = float(way @ way)
        return -float(way @ error) / square if square else 0.0

    @property
    def is_doubtful(self) -> bool:
        """Whether so few long walls lie near an axis that they tell no heading."""
        return self.share < FEW_AGREE

    @property
    def is_steady(self) -> bool:
        """Whether most of the heading's error is a drift, which bends the axes found, too."""
        return abs(math.degrees(self.drift)) >= STEADY_DEG_PER_M

    @property
    def tells_axes(self) -> bool:
        """Whether the axes found are those of the building."""
        return not self.is_doubtful and not self.is_steady

    @property
    def share(self) -> float:
        """Share of the long walls that lie near an axis; 0 without any."""
        return sum(one.used for one in self.walls) / len(self.walls) if self.walls else 0.0


def align(bearings: Sequence[Bearing], start_spread: float = 0.0) -> Alignment | None:
    """Return the heading's error along the way; None if no wall is long enough to tell.

    Parameters
    ----------
    bearings
        In any order: beams see walls side by side.
    start_spread
        Standard deviation of the heading at each leg's start [rad].
    """
    told = sorted(
        (one for one in bearings if one.length >= LEAST_LENGTH_M),
        key=lambda one: (one.leg, one.way),
    )
    if not told:
        return None
    steps = _filtered(told, start_spread)
    return _summed_up(told, steps, _smoothed(steps))


def _filtered(told: Sequence[Bearing], start_spread: float) -> list[_Step]:
    """Return what the filter makes of each wall, going forward."""
    state, cov = np.array([0.0, _first_guess(told)]), np.diag([start_spread**2, _ANY])
    leg, way = told[0].leg, 0.0
    steps: list[_Step] = []
    for one in told:
        carried = np.eye(2)
        if one.leg != leg:  # only the building stays
            leg, way = one.leg, 0.0
            carried[0, 0] = 0.0
        noise = PROCESS * (one.way - way) + (0.0 if carried[0, 0] else start_spread**2)
        way = one.way
        ahead, ahead_cov = carried @ state, carried @ cov @ carried + np.diag([noise, 0.0])
        innovation = math.remainder(one.angle - float(_LOOK @ ahead), QUARTER)
        variance = float(_LOOK @ ahead_cov @ _LOOK) + one.variance
        use = abs(innovation) <= GATE
        gain = ahead_cov @ _LOOK / variance * use
        state = ahead + gain * innovation
        cov = (np.eye(2) - np.outer(gain, _LOOK)) @ ahead_cov
        steps.append(_Step(carried, ahead, ahead_cov, state, cov, use))
    return steps


def _first_guess(told: Sequence[Bearing]) -> float:
    """Return the axes that the first walls agree on best, before the heading has drifted."""
    first = [one for one in told if one.way <= told[0].way + _START]
    angles = np.array([one.angle for one in first])
    weights = np.array([one.length for one in first])
    grid = np.linspace(0, QUARTER, _GRID, endpoint=False)
    off = np.abs((angles[None, :] - grid[:, None] + QUARTER / 2) % QUARTER - QUARTER / 2)
    near = (weights * np.exp(-0.5 * (off / WALL_SPREAD) ** 2)).sum(axis=1)
    return float(grid[int(np.argmax(near))])


def _smoothed(steps: Sequence[_Step]) -> list[tuple[Floats, float]]:
    """Return the state at each wall, and the variance of what a wall there shows, given all."""
    state, cov = steps[-1].state, steps[-1].cov
    found = [(state, float(_LOOK @ cov @ _LOOK))]
    for here, then in zip(steps[-2::-1], steps[:0:-1], strict=True):
        gain = here.cov @ then.carried @ np.linalg.pinv(then.ahead_cov)
        state = here.state + gain @ (state - then.ahead)
        cov = here.cov + gain @ (cov - then.ahead_cov) @ gain.T
        found.append((state, float(_LOOK @ cov @ _LOOK)))
    return found[::-1]


def _summed_up(
    told: Sequence[Bearing], steps: Sequence[_Step], smoothed: Sequence[tuple[Floats, float]]
) -> Alignment:
    axis = float(smoothed[-1][0][1])
    nodes: dict[int, tuple[list[float], list[float]]] = {}
    walls, left_out = [], []
    for one, step, (state, variance) in zip(told, steps, smoothed, strict=True):
        way, errors = nodes.setdefault(one.leg, ([0.0], [0.0]))
        if one.way > way[-1]:
            way.append(one.way)
            errors.append(float(state[0]))
        off = math.remainder(one.angle - float(_LOOK @ state), QUARTER)
        walls.append(Used(one, off, step.use))
        if step.use:
            left_out.append(off / max(0.05, 1 - variance / one.variance))
    spread = lean = math.nan
    if len(left_out) >= 3:
        spread = 1.4826 * float(np.median(np.abs(left_out)))
        lean = float(np.quantile(np.abs(left_out), 0.95))
    return Alignment(
        math.remainder(axis, QUARTER),
        {leg: (np.array(way), np.array(listed)) for leg, (way, listed) in nodes.items()},
        tuple(walls),
        spread,
        lean,
    )


class Straightening:
    """Turns each step of a leg back by the heading's error there."""

    def __init__(self, alignment: Alignment, leg: int) -> None:
        self._alignment = alignment
        self._leg = leg
        self._before: tuple[float, float, float, float, float] | None = None

    def lay(self, samples: Samples, way: Floats) -> Samples:
        """Return the next samples, straightened.

        Parameters
        ----------
        way
            Driven in the leg up to each [m].
        """
        if self._before is None:
            first = float(samples.x[0]), float(samples.y[0])
            self._before = *first, *first, float(way[0])
        x0, y0, laid_x, laid_y, way0 = self._before
        dx, dy = np.diff(samples.x, prepend=x0), np.diff(samples.y, prepend=y0)
        middle = way - np.diff(way, prepend=way0) / 2
        turn = -self._alignment.error(self._leg, middle)
        cos, sin = np.cos(turn), np.sin(turn)
        x, y = laid_x + np.cumsum(dx * cos - dy * sin), laid_y + np.cumsum(dx * sin + dy * cos)
        self._before = (
            float(samples.x[-1]), float(samples.y[-1]), float(x[-1]), float(y[-1]), float(way[-1]),
        )  # fmt: skip
        return samples.moved(x, y, samples.yaw - self._alignment.error(self._leg, way))

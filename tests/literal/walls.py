"""METHOD section 1, estimator `walls`, read aloud: matrices as they are written, step by step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

_Vector = NDArray[np.float64]
_X, _Y, _C, _O, _B, _S = range(6)


@dataclass(frozen=True)
class Pair:
    """Two consecutive poses as logged, and the wall records between them.

    length, direction : of the displacement [m, rad]; turn : wrapped [deg].
    walls : (x, y, x2, y2, followed) in order of seq.
    """

    start: Mapping[str, Any]
    end: Mapping[str, Any]
    length: float
    direction: float
    turn: float
    walls: Sequence[tuple[float, float, float, float, bool]]
    fixes: Sequence[Mapping[str, Any]] = ()

    @property
    def runs(self) -> bool:
        """Whether the place differs."""
        return self.length > 0

    @property
    def followed(self) -> bool:
        """Whether it is a followed run (LOGS.md)."""
        return self.runs and any(followed for *_, followed in self.walls)


@dataclass(frozen=True)
class Laid:
    """A stretch as corrected.

    start, end : m and P there. correction : m_c before the turn, from the stretch's start [rad].
    direction, stretch : alpha and l'/d. after : c and P_cc once the turn is done.
    """

    start: tuple[_Vector, _Vector]
    end: tuple[_Vector, _Vector]
    direction: float
    stretch: float
    after: tuple[float, float]


@dataclass
class Counts:
    """What a ledger keeps per excursion."""

    used: int = 0
    vague: int = 0
    outliers: int = 0
    used_seen: int = 0
    residuals: float = 0.0
    surprises: list[float] = field(default_factory=list)


def filtered(
    pairs: Sequence[Pair],
    first: Mapping[str, Any],
    model: Mapping[str, float],
    orthogonal: bool,
    axes: float,
    first_fixes: Sequence[Mapping[str, Any]] = (),
) -> tuple[list[Laid], Counts]:
    """Go along the pairs of consecutive poses of one excursion; with fixes, look back over all."""
    f, rad = model["factor"], math.radians
    quarter = rad(90.0) if orthogonal else rad(360.0)  # Q
    counts = Counts()

    def turns_of(angle: float) -> float:
        return quarter * math.floor(angle / quarter + 0.5)

    m = np.array([first["x"], first["y"], 0, 0, 0, 0], dtype=float)
    errors = [
        first.get("error_x", 0.0), first.get("error_y", 0.0), rad(first.get("error_heading", 0.0)),
        rad(model["turn_spread"]), rad(model["drift_spread"]), 0.0,
    ]  # fmt: skip
    p = np.diag(np.array(errors) ** 2) / f**2
    joint = Joint(m, p)

    def cleared(state: int, variance: float) -> None:
        p[state, :] = p[:, state] = 0.0
        p[state, state] = variance
        transition, noises = np.eye(6), np.zeros(6)
        transition[state, state], noises[state] = 0.0, variance
        joint.moved(transition, m, m, noises)

    def observe(h: _Vector, r: float, noise: float, second_kind: bool) -> None:
        nonlocal m, p
        v = float(h @ p @ h) + noise
        if 3 * math.sqrt(v) > quarter / 2:
            counts.vague += 1
        elif second_kind and abs(r) > 3 * math.sqrt(v):
            counts.outliers += 1
        else:
            counts.used += 1
            if second_kind:
                counts.used_seen += 1
                counts.residuals += r / math.sqrt(v)
            joint.observed(h[None, :], np.array([r]), np.array([[noise]]), m)
            k = p @ h / v
            m = m + k * r
            p = p - np.outer(k, k) * v

    def fixed(fix: Mapping[str, Any], logged: float) -> None:
        nonlocal m, p
        rows, errors = [_X, _Y], [fix["error_x"], fix["error_y"]]
        off = [fix["x"] - m[_X], fix["y"] - m[_Y]]
        if "heading" in fix:
            angle = rad(logged - fix["heading"]) + m[_C]
            rows, errors = [*rows, _C], [*errors, rad(fix["error_heading"])]
            off.append(-(angle - 2 * math.pi * math.floor(angle / (2 * math.pi) + 0.5)))
        h, r = np.eye(6)[rows], np.array(off)
        noise = np.diag(np.array(errors) ** 2) / f**2
        v = h @ p @ h.T + noise
        counts.surprises.append(float(r @ np.linalg.solve(v, r)))
        joint.observed(h, r, noise, m)
        k = np.linalg.solve(v, h @ p).T
        m = m + k @ r
        p = p - k @ v @ k.T

    laid: list[Laid] = []
    run_direction: float | None = None  # of the first piece of the run so far
    run_followed = False
    turned, unknown_turn = 0.0, False  # since the last pair that ran
    moments = [joint.now]
    for fix in first_fixes:
        fixed(fix, first["heading"])
    lined_up = (rad(model["alignment_spread"]) ** 2 + rad(0.1) ** 2) / f**2
    for number, pair in enumerate(pairs):
        d, theta = pair.length, pair.direction
        alpha, stretch = 0.0, 1.0
        if pair.runs:
            # 1. The run begins.
            aside = 0.0
            if run_direction is not None:
                aside = abs(math.degrees(math.remainder(theta - run_direction, 2 * math.pi)))
            begins = (
                run_direction is None
                or turned > 1.0
                or aside > 1.0
                or pair.followed != run_followed
            )
            if begins:
                run_direction, run_followed = theta, pair.followed
                m[_S] = 0.0
                cleared(_S, (model["along"] / f) ** 2)
                if not pair.followed:
                    p[_C, _C] += (model["across"] / f) ** 2
                    joint.moved(np.eye(6), m, m, np.eye(6)[_C] * (model["across"] / f) ** 2)
            # 2. Observations.
            if pair.followed and begins and unknown_turn:
                counts.used += 1
                m[_C] -= m[_C] - turns_of(m[_C])
                cleared(_C, lined_up)
            elif pair.followed and begins:
                h = np.zeros(6)
                h[_C] = 1.0
                observe(h, -(m[_C] - turns_of(m[_C])), lined_up, False)
            elif orthogonal and not pair.followed:
                for x, y, x2, y2, _ in pair.walls:
                    length, phi = math.hypot(x2 - x, y2 - y), math.atan2(y2 - y, x2 - x)
                    if length < 0.4 or counts.outliers > counts.used_seen + 3:
                        continue
                    h = np.zeros(6)
                    h[_C], h[_B] = 1.0, d / 2
                    a = phi - rad(axes) + m[_C] + (rad(model["drift"]) + m[_B]) * d / 2
                    noise = 2 * (model["wall_noise"] / length) ** 2 + rad(model["wall_tilt"]) ** 2
                    observe(h, -(a - turns_of(a)), noise / f**2, True)
        # 3. The stretch starts.
        start = m.copy(), p.copy()
        moments.append(joint.now)
        if pair.runs:
            # 4. The run.
            delta = 0.0 if pair.followed else (rad(model["drift"]) + m[_B]) * d
            u = delta / 2
            line = model["scale"] * d * (math.sin(u) / u if u else 1.0)
            alpha = theta + (turns_of(m[_C]) if pair.followed else m[_C] + u)
            whole = line * (1 + m[_S])
            sin, cos = math.sin(alpha), math.cos(alpha)
            transition = np.eye(6)
            transition[_X, _S], transition[_Y, _S] = line * cos, line * sin
            if not pair.followed:
                transition[_X, _C], transition[_Y, _C] = -whole * sin, whole * cos
                transition[_X, _B], transition[_Y, _B] = -d * whole * sin / 2, d * whole * cos / 2
                transition[_C, _B] = d
            before = m
            m = m + np.array([whole * cos, whole * sin, delta, 0, 0, 0])
            p = transition @ p @ transition.T
            joint.moved(transition, before, m, np.zeros(6))
            stretch = whole / d
            turned, unknown_turn = 0.0, False
        end = m.copy(), p.copy()
        moments.append(joint.now)
        # 5. The turn at the end of the pair.
        t = pair.turn
        if abs(t) > 1e-6:
            following = pairs[number + 1] if number + 1 < len(pairs) else None
            before, m = m, m.copy()
            if _is_relabelling(pair, following):
                m[_C] -= rad(t)
                joint.moved(np.eye(6), before, m, np.zeros(6))
            else:
                parts = abs(t) / 45
                m[_C] += rad(model["turn_gain"] * t) + (rad(model["turn_bias"]) + m[_O]) * parts
                transition = np.eye(6)
                transition[_C, _O] = parts
                p = transition @ p @ transition.T
                noise_of_turn = (rad(model["turn_noise"]) / f) ** 2 * parts
                p[_C, _C] += noise_of_turn
                joint.moved(transition, before, m, np.eye(6)[_C] * noise_of_turn)
                turned += abs(t)
                if not pair.runs and "turned" not in pair.end:
                    unknown_turn |= "t" not in pair.start or "t" not in pair.end
        laid.append(Laid(start, end, alpha, stretch, (float(m[_C]), float(p[_C, _C]))))
        moments.append(joint.now)
        for fix in pair.fixes:
            fixed(fix, pair.end["heading"])
    if counts.surprises:
        return list(_looked_back(laid, pairs, joint, moments)), counts
    return laid, counts


class Joint:
    """All states that an excursion goes through, as one large Gaussian.

    Each is written as M·w + n, w all that is random, of the variances ``random``: the first state's
    own errors, then what every step adds. So what observations tell of any state is the
    conditioning of one Gaussian by another; no filter, no way back.
    """

    def __init__(self, mean: _Vector, covariance: _Vector) -> None:
        self.random = [*np.diag(covariance)]
        self.states: list[tuple[_Vector, _Vector]] = [(np.eye(6), mean.copy())]  # M and n
        self.told: list[tuple[_Vector, _Vector, _Vector]] = []  # H·M, what was seen less H·n, R

    @property
    def now(self) -> int:
        """The number of the last state."""
        return len(self.states) - 1

    def moved(self, transition: _Vector, before: _Vector, after: _Vector, noises: _Vector) -> None:
        """Take a step: its F, linear around what the filter believed, which becomes ``after``."""
        m, n = self.states[-1]
        self.random += noises.tolist()
        moved = np.hstack([transition @ m, np.eye(6)])
        self.states.append((moved, after + transition @ (n - before)))

    def observed(self, h: _Vector, r: _Vector, noise: _Vector, believed: _Vector) -> None:
        """Note that what was seen differs by r from what the filter believed to see."""
        m, n = self.states[-1]
        self.told.append((h @ m, h @ believed + r - h @ n, noise))

    def conditioned(self) -> list[tuple[_Vector, _Vector]]:
        """Return mean and covariance of every state, given all that was seen."""
        size = len(self.random)
        w = np.diag(self.random)
        h = np.vstack([_wide(rows, size) for rows, _, _ in self.told])
        seen = np.concatenate([values for _, values, _ in self.told])
        noise = np.diag(np.concatenate([np.diag(one) for _, _, one in self.told]))
        gain = np.linalg.solve(h @ w @ h.T + noise, h @ w).T
        mean, covariance = gain @ seen, w - gain @ h @ w
        found = []
        for m, n in self.states:
            wide = _wide(m, size)
            found.append((wide @ mean + n, wide @ covariance @ wide.T))
        return found


def _wide(rows: _Vector, columns: int) -> _Vector:
    return np.pad(rows, ((0, 0), (0, columns - rows.shape[1])))


def _looked_back(
    laid: Sequence[Laid], pairs: Sequence[Pair], joint: Joint, moments: Sequence[int]
) -> Iterator[Laid]:
    """Yield the first pose as a stretch of no length, then each stretch along its chord."""
    known = [joint.conditioned()[moment] for moment in moments]
    begin = known[0]
    after = float(begin[0][_C]), float(begin[1][_C, _C])
    yield Laid(begin, begin, 0.0, 1.0, after)
    for number, (one, pair) in enumerate(zip(laid, pairs, strict=True)):
        start, end, turned = known[3 * number + 1 : 3 * number + 4]
        x, y = end[0][:2] - start[0][:2]
        yield replace(
            one,
            start=start,
            end=end,
            direction=math.atan2(y, x),
            stretch=math.hypot(x, y) / pair.length if pair.runs else 1.0,
            after=(float(turned[0][_C]), float(turned[1][_C, _C])),
        )


def _is_relabelling(pair: Pair, following: Pair | None) -> bool:
    if "turned" in pair.end:
        return not pair.end["turned"]
    timed = "t" in pair.start and "t" in pair.end and pair.start["t"] == pair.end["t"]
    return not pair.runs and timed and following is not None and following.followed

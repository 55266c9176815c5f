"""Odometry and truth brought together: one clock, one unit, and where either jumps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from possmap.errors import RecordingError
from possmap.lab.calibrate.trials import Flags, Floats
from possmap.lab.convert.legs import Reference
from possmap.lab.convert.samples import Samples

TOLERANCE_M, TURN_TOLERANCE = 0.05, math.radians(15.0)
"""How runs are told from turns: as ``possmap convert`` does it."""

JUMP_M, JUMP_DEG, JUMP_DEVIATIONS = 0.2, 15.0, 10.0
"""From one sample to the next, truth and odometry never part by more than this, and by so many
robust deviations of all steps, unless one of the two jumps."""

MOST_LAG_S, LEAST_S, SURELY, BETTER = 30.0, 20.0, 0.5, 0.05
"""How late a truth is looked for, in a recording of so many seconds; and how well, and how much
better than without a lag, speeds must then go together for it to be one."""

MOST_STEPS = 20_000
"""Into which a long recording is laid out to look for a lag."""

UNITS = {1000.0: ("mm", "millimetres"), 100.0: ("cm", "centimetres"), 39.37: ("in", "inches"),
         3.281: ("ft", "feet")}  # fmt: skip
LIKE, UNLIKE, LEAST_MOVED = 2.0, 0.5, 0.3
"""Truth and odometry whose ways differ so many times, or whose turns go together so badly, are of
different units; where the odometry moved so far [m, rad] at least."""


class Paired(NamedTuple):
    """Odometry, and the truth at its stamps; n of each.

    breaks : whether a track ends behind a sample, since a truth is missing or one of the two jumps,
    (n - 1,). known : whether a truth stands near, (n,). notes : what was found, a sentence each.
    """

    samples: Samples
    true: Samples
    known: Flags
    breaks: Flags
    notes: list[str]


def paired(samples: Samples, true: Reference, lag: float | None, path: str) -> Paired:
    """Return odometry with its truth.

    lag : by how much the truth is late [s]; None: as found.

    Raises
    ------
    RecordingError
        If the two are of different units.
    """
    notes = []
    if lag is None:
        lag = lag_of(samples, true)
        if lag:
            notes.append(
                f"{path}: the truth is {abs(lag):.2f} s {'late' if lag > 0 else 'early'}: taken "
                f"out, as speeds go together best so; --lag {lag:.2f} says it, --lag 0 denies it"
            )
    true = replace(true, t=true.t - lag)
    samples = _at_stamps(samples, true)
    after = np.minimum(np.searchsorted(true.t, samples.t), len(true.t) - 1)
    before = np.maximum(after - 1, 0)
    exact = true.t[after] == samples.t
    inside = (samples.t >= true.t[0]) & (samples.t <= true.t[-1])
    known = inside & (exact | (true.t[after] - true.t[before] <= true.gap))
    missing = int((~known).sum())
    if missing:
        notes.append(f"{path}: {missing} of {len(samples)} samples have no truth, left out")
    x, y, yaw = (np.interp(samples.t, true.t, column) for column in (true.x, true.y, true.yaw))
    there = samples.moved(x, y, yaw)
    both = known[1:] & known[:-1]
    _refuse_units(samples, there, known, path)
    jumps = both & _jumps(samples, there, both)
    if jumps.any():
        first = float(samples.t[1:][jumps][0])
        notes.append(
            f"{path}: truth and odometry part in one step {int(jumps.sum())} times (first at "
            f"t = {first:.2f} s): a jump of one of them; trials end before and begin after it"
        )
    return Paired(samples, there, known, jumps | ~both, notes)


def lag_of(samples: Samples, true: Reference) -> float:
    """Return by how much the truth is late [s]: where speeds and turn rates go together best.

    0 where that is no clear matter, or a matter of single steps.
    """
    if min(len(samples), len(true.t)) < 10:
        return 0.0
    steps = [float(np.median(np.diff(np.unique(one)))) for one in (samples.t, true.t)]
    start, stop = max(samples.t[0], true.t[0]), min(samples.t[-1], true.t[-1])
    step = max(min(steps), (stop - start) / MOST_STEPS)
    if stop - start < LEAST_S or step > LEAST_S / 10:
        return 0.0
    most = int(min(MOST_LAG_S, (stop - start) / 4) / step)
    at = np.arange(start, stop, step)
    logged, there = (_rates(at, one.t, one.x, one.y, one.yaw) for one in (samples, true))
    scores = np.array([_together(logged, there, k) for k in range(-most, most + 1)])
    best = int(np.argmax(scores))
    if not scores[best] > max(SURELY, scores[most] + BETTER) or best in (0, 2 * most):
        return 0.0
    left, middle, right = scores[best - 1 : best + 2]
    top = 0.5 * (left - right) / min(left - 2 * middle + right, -1e-12)  # of a parabola
    lag = float(step * (best - most + top))
    return lag if abs(lag) > max(1.5 * step, max(steps) / 2) else 0.0


def _rates(at: Floats, t: Floats, x: Floats, y: Floats, yaw: Floats) -> Floats:
    """Return speed and turn rate from each time to the next, by the step; shape (2, n - 1)."""
    own, first = np.unique(t, return_index=True)
    dx, dy, turn = (np.diff(np.interp(at, own, column[first])) for column in (x, y, yaw))
    return np.stack([np.hypot(dx, dy), turn])


def _together(logged: Floats, true: Floats, steps: int) -> float:
    """Return the mean correlation of speeds and of turn rates, the truth's so many steps later."""
    here, there = slice(max(0, -steps), None if steps <= 0 else -steps), slice(max(0, steps), None)
    length = min(logged[:, here].shape[1], true[:, there].shape[1])
    found = []
    for one, other in zip(logged[:, here][:, :length], true[:, there][:, :length], strict=True):
        deviations = one.std() * other.std()
        if deviations > 0:
            found.append(float(((one - one.mean()) * (other - other.mean())).mean() / deviations))
    return float(np.mean(found)) if found else 0.0


def _refuse_units(logged: Samples, true: Samples, known: Flags, path: str) -> None:
    """Ask about the unit of a truth that goes, or turns, much farther or less than odometry."""
    step = max(1, len(logged) // 20)
    both = known[step:] & known[:-step]
    ways = [np.hypot(one.x[step:] - one.x[:-step], one.y[step:] - one.y[:-step])
            for one in (logged, true)]  # fmt: skip
    far = _ratio(ways, both)
    if not 1 / LIKE < far < LIKE:
        size = min(UNITS, key=lambda one: abs(abs(math.log(far)) - math.log(one)))
        which, (unit, name) = ("truth" if far > 1 else "odometry"), UNITS[size]
        raise RecordingError(
            path,
            f"the truth goes {far:.3g} times as far as the odometry: is the {which} in {name}? "
            f"expected metres in both; a mapping says units: {{length: {unit}}}",
        )
    turns = [(one.yaw[step:] - one.yaw[:-step])[both] for one in (logged, true)]
    if not len(turns[0]) or np.abs(turns[0]).max() < LEAST_MOVED:
        return
    like = (
        float(np.corrcoef(turns[0], turns[1])[0, 1]) if min(one.std() for one in turns) > 0 else 1.0
    )
    if like < UNLIKE:
        raise RecordingError(
            path,
            f"the truth's turns are not those of the odometry (correlation {like:.2f}): is one of "
            "the headings in degrees, or clockwise? expected radians, anticlockwise, in both; a "
            "mapping says units: {angle: deg}",
        )


def _ratio(some: Sequence[Floats], both: Flags) -> float:
    """Return how much larger the second are in the median, where either is large."""
    own, other = some
    large = both & ((own > 0.2 * own.max(initial=0.0)) | (other > 0.2 * other.max(initial=0.0)))
    middle = float(np.median(own[large])) if large.any() else 0.0
    return max(float(np.median(other[large])), 1e-9) / middle if middle > LEAST_MOVED else 1.0


def _at_stamps(samples: Samples, true: Reference) -> Samples:
    """Return the odometry at the truth's stamps, if it is the one of the two that knows more.

    Between stamps one interpolates; where the robot begins to turn that is wrong, and the less so
    the closer the stamps.
    """
    if len(samples) < 2 or len(true.t) < 2:
        return samples
    if np.median(np.diff(true.t)) <= 1.5 * np.median(np.diff(samples.t)):
        return samples
    own, which = np.unique(samples.t, return_index=True)
    t = np.unique(true.t[(true.t >= own[0]) & (true.t <= own[-1])])
    after = np.minimum(np.searchsorted(own, t), len(own) - 1)
    t = t[(own[after] == t) | (own[after] - own[np.maximum(after - 1, 0)] <= true.gap)]
    if len(t) < 2:
        return samples
    x, y, yaw = (np.interp(t, own, one[which]) for one in (samples.x, samples.y, samples.yaw))
    return Samples(t, x, y, yaw, np.empty((len(t), 0)))


def _jumps(samples: Samples, true: Samples, both: Flags) -> Flags:
    """Return after which samples truth and odometry part by more than they ever do."""
    apart = np.hypot(np.diff(true.x), np.diff(true.y))
    apart = apart - np.hypot(np.diff(samples.x), np.diff(samples.y))
    turned = np.degrees(np.diff(true.yaw) - np.diff(samples.yaw))
    found = np.zeros(len(apart), dtype=np.bool_)
    for values, least in ((apart, JUMP_M), (turned, JUMP_DEG)):
        if both.any():
            middle = np.median(values[both])
            spread = 1.4826 * np.median(np.abs(values[both] - middle))
            found |= np.abs(values - middle) > max(least, JUMP_DEVIATIONS * spread)
    return found

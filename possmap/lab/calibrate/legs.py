"""Whether rectangles hold on whole legs of a track, by the host's own code."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from possmap.core.estimators import estimate
from possmap.core.model import ErrorModel
from possmap.core.records import Pose
from possmap.core.settings import Estimator, EvidenceSettings
from possmap.core.track import stretches
from possmap.lab.calibrate.pieces import Outing
from possmap.lab.calibrate.results import LegScore
from possmap.lab.calibrate.trials import Floats

LENGTHS = (10.0, 20.0, 40.0)
"""Of legs [m]."""

Errors = tuple[float, float, float]
"""Half-widths of where a leg begins: x, y [m], heading [deg]."""


def held_legs(
    judged: Sequence[tuple[Outing, ErrorModel]],
    estimator: Estimator,
    length: float,
    start: Errors = (0.0, 0.0, 0.0),
    mount: float = 0.0,
) -> LegScore | None:
    """Hold legs of so many metres against the rectangles of models that have not seen them.

    Parameters
    ----------
    judged
        Tracks, each with its model.
    start
        How wrong the truth itself may be where a leg begins.
    mount
        Angle between the truth's heading and the way driven [deg].

    Returns
    -------
    LegScore or None
        None if no track is so long.
    """
    inside: list[Floats] = []
    halves: list[float] = []
    for outing, model in judged:
        for leg in _legs(outing, length):
            held, half = _one(leg, model, estimator, start, mount)
            inside.append(held)
            halves.append(half)
    if not inside:
        return None
    every = np.concatenate(inside)
    return LegScore(
        length, estimator, len(inside), len(every), float(every.mean()),
        float(np.mean([one[-1] for one in inside])), float(np.mean(halves)),
    )  # fmt: skip


def _legs(outing: Outing, length: float) -> Iterable[Outing]:
    """Yield whole legs, one after the other; what is left at the end is none."""
    way = outing.way
    start = 0
    while True:
        stop = int(np.searchsorted(way, way[start] + length))
        if stop >= len(way):
            return
        yield outing.part(start, stop + 1)
        start = stop


def _one(
    leg: Outing, model: ErrorModel, estimator: Estimator, start: Errors, mount: float
) -> tuple[Floats, float]:
    """Return which poses lie in their rectangles (the first is known), and the last half-width."""
    x0, y0, heading0 = leg.logged[0]
    turn = leg.true[0, 2] + mount - heading0
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    dx, dy = leg.logged[:, 0] - x0, leg.logged[:, 1] - y0
    x, y = leg.true[0, 0] + cos * dx - sin * dy, leg.true[0, 1] + sin * dx + cos * dy
    poses = [
        Pose(k, None, float(x[k]), float(y[k]), float(leg.logged[k, 2] + turn), *_errors(k, start))
        for k in range(len(x))
    ]
    settings = EvidenceSettings(estimator=estimator)
    _, track, errors, _ = estimate(poses[0], stretches(poses), model, settings)
    held = [
        abs(leg.true[k, 0] - one.end[0]) <= error.end.half_x + 1e-9
        and abs(leg.true[k, 1] - one.end[1]) <= error.end.half_y + 1e-9
        for k, (one, error) in enumerate(zip(track, errors, strict=True), 1)
    ]
    last = errors[-1].end
    return np.array(held, dtype=np.float64), (last.half_x + last.half_y) / 2


def _errors(pose: int, start: Errors) -> Errors:
    return start if pose == 0 else (0.0, 0.0, 0.0)

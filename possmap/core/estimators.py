"""The estimators by name: an excursion's track laid out, with its errors (METHOD §1)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import zip_longest
from types import MappingProxyType
from typing import NamedTuple

from possmap.core.correction import CorrectedStretch, correct
from possmap.core.heading import HeadingError
from possmap.core.linear import LinearError
from possmap.core.model import ErrorModel
from possmap.core.observations import Fit, Observations
from possmap.core.propagation import CarriedError, ErrorRectangle, StretchErrors, propagate
from possmap.core.records import Fix, Pose, Record
from possmap.core.refined import RefinedTrack, lay_refined
from possmap.core.settings import Estimator, EvidenceSettings
from possmap.core.smoothing import lay_smoothed, smoothed
from possmap.core.track import Stretch, fixes, stretches
from possmap.core.walls import WallFilter

_AT_START: Mapping[Estimator, Callable[[Pose], CarriedError]] = MappingProxyType(
    {"linear": LinearError.at_start, "heading": HeadingError.at_start}
)


class Estimate(NamedTuple):
    """Where the stretches of an excursion lie, and how far off they may be.

    start : the rectangle of the first pose.
    place, heading_deg : of the first pose, corrected [m, deg].
    stretches, errors : one each of a stretch.
    observations, fit : what walls told of the heading, and how well (estimator ``walls``).
    """

    start: ErrorRectangle
    place: tuple[float, float]
    heading_deg: float
    stretches: Sequence[CorrectedStretch]
    errors: Sequence[StretchErrors]
    observations: Observations = Observations()
    fit: Fit = Fit()


def estimate(
    records: Sequence[Record],
    model: ErrorModel,
    settings: EvidenceSettings,
    refined: RefinedTrack | None = None,
) -> Estimate:
    """Correct the track of records, and carry the first pose's own error along it.

    records : with a pose among them.
    refined : where its poses were found to have been (``possmap refine``), which says nothing of
        observations; None: nobody asked.
    """
    first = next(one for one in records if isinstance(one, Pose))
    track = stretches(records)
    if refined is not None:
        laid, refined_errors = lay_refined(track, refined)
        begin = refined[0]
        return Estimate(begin.rectangle, begin[:2], first.heading_deg, laid, refined_errors)
    if settings.estimator == "walls":
        return _by_walls(first, track, fixes(records), model, settings)
    start = at_start(first, settings.estimator)
    corrected = correct(track, model)
    return Estimate(
        start.rectangle,
        (first.x, first.y),
        first.heading_deg,
        corrected,
        propagate(start, corrected, model),
    )


def at_start(first: Pose, estimator: Estimator) -> CarriedError:
    """Return the first pose's own error, to be carried along a corrected track."""
    return _AT_START[estimator](first)


def is_smoothed(records: Iterable[Record], settings: EvidenceSettings) -> bool:
    """Whether records are a unit: what comes later changes where the earlier ones lie."""
    return settings.estimator == "walls" and any(isinstance(one, Fix) for one in records)


def _by_walls(
    first: Pose,
    track: Sequence[Stretch],
    fixed: Mapping[int, Sequence[Fix]],
    model: ErrorModel,
    settings: EvidenceSettings,
) -> Estimate:
    """Go along the track; and back again, if anybody knows where the robot truly was.

    fixed : the fixes after each pose, by its number.
    """
    now = WallFilter(first, model, settings, keeps_steps=bool(fixed))
    start, laid = now.rectangle, []
    for fix in fixed.get(0, ()):
        now.observe_fix(fix, first)
    for number, (one, following) in enumerate(zip_longest(track, track[1:]), 1):
        laid.append(now.advance(one, following))
        for fix in fixed.get(number, ()):
            now.observe_fix(fix, one.end)
    corrected, errors = [one for one, _ in laid], [error for _, error in laid]
    place, heading_deg = (first.x, first.y), first.heading_deg
    if fixed:
        begin, *known = smoothed(now.steps)
        start, place = begin.rectangle, begin.place
        heading_deg += math.degrees(begin.heading)
        corrected, errors = lay_smoothed(corrected, known)
    return Estimate(start, place, heading_deg, corrected, errors, now.observations, now.fit)

"""The estimators by name: an excursion's track laid out, with its errors (METHOD §1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from types import MappingProxyType
from typing import NamedTuple

from possmap.core.correction import CorrectedStretch, correct
from possmap.core.heading import HeadingError
from possmap.core.linear import LinearError
from possmap.core.model import ErrorModel
from possmap.core.propagation import CarriedError, ErrorRectangle, StretchErrors, propagate
from possmap.core.records import Pose
from possmap.core.refined import RefinedTrack, lay_refined
from possmap.core.settings import Estimator, EvidenceSettings
from possmap.core.track import Stretch
from possmap.core.walls import Fit, Observations, WallFilter

_AT_START: Mapping[Estimator, Callable[[Pose], CarriedError]] = MappingProxyType(
    {"linear": LinearError.at_start, "heading": HeadingError.at_start}
)


class Estimate(NamedTuple):
    """Where the stretches of an excursion lie, and how far off they may be.

    start : the rectangle of the first pose.
    stretches, errors : one each of a stretch.
    observations, fit : what walls told of the heading, and how well (estimator ``walls``).
    """

    start: ErrorRectangle
    stretches: Sequence[CorrectedStretch]
    errors: Sequence[StretchErrors]
    observations: Observations
    fit: Fit


def estimate(
    first: Pose,
    track: Sequence[Stretch],
    model: ErrorModel,
    settings: EvidenceSettings,
    refined: RefinedTrack | None = None,
) -> Estimate:
    """Correct a track, and carry the first pose's own error along it.

    refined : where its poses were found to have been (``possmap refine``); None: nobody asked.
    """
    if settings.estimator == "walls":
        found = _by_walls(first, track, model, settings)
        if refined is None:
            return found
        stretches, errors = lay_refined(track, refined)
        return found._replace(start=refined[0].rectangle, stretches=stretches, errors=errors)
    start = at_start(first, settings.estimator)
    corrected = correct(track, model)
    errors = propagate(start, corrected, model)
    return Estimate(start.rectangle, corrected, errors, Observations(), Fit())


def at_start(first: Pose, estimator: Estimator) -> CarriedError:
    """Return the first pose's own error, to be carried along a corrected track."""
    return _AT_START[estimator](first)


def _by_walls(
    first: Pose, track: Sequence[Stretch], model: ErrorModel, settings: EvidenceSettings
) -> Estimate:
    now = WallFilter(first, model, settings)
    start = now.rectangle
    laid = [now.advance(one, following) for one, following in zip_longest(track, track[1:])]
    stretches, errors = [one for one, _ in laid], [error for _, error in laid]
    return Estimate(start, stretches, errors, now.observations, now.fit)

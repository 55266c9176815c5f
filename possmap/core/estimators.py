"""The estimators by name (METHOD §1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from possmap.core.heading import HeadingError
from possmap.core.linear import LinearError
from possmap.core.propagation import PoseError
from possmap.core.records import Pose
from possmap.core.settings import Estimator

_AT_START: Mapping[Estimator, Callable[[Pose], PoseError]] = MappingProxyType(
    {"linear": LinearError.at_start, "heading": HeadingError.at_start}
)


def at_start(first: Pose, estimator: Estimator) -> PoseError:
    """Return the first pose's own error, to be carried along the track by an estimator."""
    return _AT_START[estimator](first)

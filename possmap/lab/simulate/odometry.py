"""What the robot believes: dead reckoning, corrected by what is known, and its error."""

from __future__ import annotations

import math
from dataclasses import dataclass

from possmap.core.correction import Believed, advance
from possmap.core.estimators import at_start
from possmap.core.model import ErrorModel
from possmap.core.propagation import CarriedError, after_stretch
from possmap.core.records import Pose, Sighting
from possmap.core.settings import Estimator
from possmap.core.track import Stretch


@dataclass(frozen=True, slots=True)
class Belief:
    """A robot's idea of where it is.

    logged : the last pose as it stands in its log.
    corrected : the same, corrected as the host will (METHOD §1).
    error : its own estimate of what may be wrong, by the host's propagation.
    """

    logged: Pose
    corrected: Believed
    error: CarriedError

    @property
    def heading(self) -> float:
        """The corrected heading [rad]."""
        return math.radians(self.logged.heading_deg + self.corrected.correction_deg)

    @property
    def worst(self) -> float:
        """The larger half-width of its error estimate [m]."""
        return max(self.error.rectangle.half_x, self.error.rectangle.half_y)

    def after(self, pose: Pose, seen: tuple[Sighting, ...], model: ErrorModel) -> Belief:
        """Return the belief at the next pose, given what was seen since the last."""
        numbered = tuple(enumerate(seen))
        stretch = Stretch.between(self.logged, pose, len(seen), numbered)
        corrected, laid = advance(self.corrected, stretch, model)
        error, _ = after_stretch(self.error, laid, model)
        return Belief(pose, corrected, error)


def setting_out(pose: Pose, estimator: Estimator = "linear") -> Belief:
    """Return the belief at the start of an excursion, and with it how its error is estimated."""
    return Belief(pose, Believed((pose.x, pose.y)), at_start(pose, estimator))

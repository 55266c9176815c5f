"""What walls and fixes told of an excursion's track (estimator ``walls``, METHOD §1 and §7)."""

from __future__ import annotations

import math
from typing import NamedTuple


class Observations(NamedTuple):
    """What an excursion's walls have told of its heading, and fixes of its place.

    used, vague, outliers : how many told it, did not tell which of the axes they meant, and
        contradicted the rest.
    seen : those used that were seen in passing.
    residuals : sum of r/√V over those.
    fixes, surprising : how many told the place, and how many of them surprised.
    surprise : rᵀV⁻¹r of the fix that surprised most.
    """

    used: int = 0
    vague: int = 0
    outliers: int = 0
    seen: int = 0
    residuals: float = 0.0
    fixes: int = 0
    surprising: int = 0
    surprise: float = 0.0

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

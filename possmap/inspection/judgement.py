"""Who stands out: an excursion, or a robot, beside those of the other robots (docs/audit.md)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from possmap.core.observations import Fit, Observations

LEAST_SHARE = 0.1
"""Of its cells others must have said something, or a side is not judged."""
LEAST_M2 = 1.0
"""And so large must those cells be together [m²]."""

ROBOT_STANDS_OUT = 3.0
"""A robot's spell stands out that lies so many spreads above those of the other robots."""
EXCURSION_STANDS_OUT = 8.0
"""An excursion stands out that lies so many spreads above those of the other robots."""
FEWEST = 5
"""So many values of others are needed to say how far values spread."""
LEAST_SPREAD = 0.02
"""No spread is taken for smaller: where nobody contradicts anybody, a trifle would stand out."""

_NORMAL = 1.4826
"""What makes a median absolute deviation a standard deviation, for a normal distribution."""

SURPRISING = 5.0
"""So many standard deviations above what the model expects, walls tell that it does not hold."""
FEWEST_WALLS = 10
"""Of fewer observations, chance surprises."""
OUTLIERS = 0.05
"""Of its walls so many may be outliers, more than of the other robots' ..."""
BY_CHANCE = 1e-3
"""... or so many that chance makes one such side in a thousand audits."""
USUAL_OUTLIERS = 0.01
"""Of the walls of sound robots, at least: three times what a normal distribution expects."""
SURPRISED, BY_CHANCE_FIXES = 1e-3, 1e-2
"""Which share of the fixes surprises by chance; and what chance makes so seldom stands out."""
STRAYS = 3.0
"""A heading strays that observations correct so many times as much as the other robots' ..."""
FEWEST_STRAYS = 30
"""... if so many do ..."""
FEWEST_STRAYING = 3
"""... against so many sides of others, at least ..."""
LEAST_STRAY_DEG = 0.5
"""... and no others stray less: where nobody does, a trifle would stand out."""


@dataclass(frozen=True, slots=True)
class Told:
    """What a side's own walls told of its heading, against what its model expects.

    observed : observations of the heading, of which ``seen`` are walls used in passing.
    outliers : walls left out since they contradicted all the rest.
    surprise : how far Σ r²/V over those used lies above their number, in standard deviations, as
        Wilson and Hilferty (1931) make a χ² normal.
    overturn_deg : over-turn per 45° beyond the model's, the median of its excursions.
    fixes, surprising : how often somebody said where it truly was, and how often that surprised.
    stray_deg : how far off observations find the heading, their median, whatever the model says.
    """

    observed: int
    seen: int
    outliers: int
    surprise: float
    overturn_deg: float
    stray_deg: float
    fixes: int = 0
    surprising: int = 0

    @property
    def share(self) -> float:
        """Which share of the walls were outliers."""
        return self.outliers / max(1, self.seen + self.outliers)

    @classmethod
    def of(cls, some: Sequence[tuple[Observations, Fit]]) -> Told:
        """Pool what excursions were told."""
        used = sum(one.used for one, _ in some)
        observed = sum(one.used + one.vague + one.outliers for one, _ in some)
        squares = sum(fit.squares for _, fit in some)
        overturn = [math.degrees(fit.overturn) for _, fit in some]
        strays = [abs(residual) for _, fit in some for residual in fit.residuals]
        return cls(
            observed=observed,
            seen=sum(one.seen for one, _ in some),
            outliers=sum(one.outliers for one, _ in some),
            surprise=_deviations(squares, used),
            overturn_deg=float(np.median(overturn)) if overturn else 0.0,
            stray_deg=math.degrees(np.median(strays)) if strays else 0.0,
            fixes=sum(one.fixes for one, _ in some),
            surprising=sum(one.surprising for one, _ in some),
        )

    def reasons(self, others: Sequence[Told]) -> Iterator[str]:
        """Yield what sets a side apart from those of the other robots, its own share its faults."""
        if not others:
            return
        usual = float(np.median([one.share for one in others]))
        expected = max(usual, USUAL_OUTLIERS) * (self.seen + self.outliers)
        by_chance = _at_least(self.outliers, expected) * len(others)
        if self.share >= usual + OUTLIERS and by_chance < BY_CHANCE:
            yield "outliers among its walls"
        surprise = max(0.0, float(np.median([one.surprise for one in others])))
        if self.observed >= FEWEST_WALLS and self.surprise >= SURPRISING + surprise:
            yield "its walls surprise its model"
        strays = [one.stray_deg for one in others if one.observed]
        if (
            self.observed >= FEWEST_STRAYS
            and len(strays) >= FEWEST_STRAYING
            and self.stray_deg >= STRAYS * max(LEAST_STRAY_DEG, float(np.median(strays)))
        ):
            yield "its heading strays"


@dataclass(frozen=True, slots=True)
class Side:
    """An excursion, or all excursions of a robot, beside those of the other robots.

    Attributes
    ----------
    robot, excursion
        Its name; no excursion: the robot.
    records
        How many it has.
    compared, share
        Cells of which it and the others say something, and their share of its cells.
    contradiction
        What contradicts, of all that both commit themselves on; 0 to 1.
    conflict
        Mean of Dempster's K over the cells compared: the sum of the next two.
    wall_free, free_wall
        Its walls where the others are free, and the reverse.
    worst
        x and y [m] of where it contradicts most, and K there.
    told
        What its own walls told.
    judged
        Whether enough was compared.
    above
        How far its contradiction lies above the median of the others, in their spreads; of a robot,
        its worst spell. None where that cannot be said.
    reasons
        Why somebody should look; empty: it does not stand out.
    since
        The first excursion of a robot's worst spell that does.
    """

    robot: str
    excursion: str | None
    records: int
    compared: int
    share: float
    contradiction: float
    conflict: float
    wall_free: float
    free_wall: float
    worst: tuple[float, float, float] | None
    told: Told
    judged: bool
    above: float | None = None
    reasons: tuple[str, ...] = ()
    since: str | None = None

    @property
    def stands_out(self) -> bool:
        """Whether somebody should look."""
        return bool(self.reasons)


def told_apart(side: Side, sides: Sequence[Side], limit: float = EXCURSION_STANDS_OUT) -> Side:
    """Say how far a side stands out from other robots' sides: its own share its faults."""
    others = [one for one in sides if one.robot != side.robot]
    reasons = []
    above = None
    judged = [one for one in others if one.judged]
    if side.judged and len(judged) >= FEWEST and len({one.robot for one in judged}) > 1:
        values = np.array([one.contradiction for one in judged])
        median = float(np.median(values))
        spread = max(LEAST_SPREAD, _NORMAL * float(np.median(np.abs(values - median))))
        above = (side.contradiction - median) / spread
        if above >= limit:
            reasons.append("contradicts the others")
    reasons += side.told.reasons([one.told for one in others])
    if _at_least(side.told.surprising, side.told.fixes * SURPRISED) < BY_CHANCE_FIXES:
        reasons.append("a fix surprises its model")
    return replace(side, above=above, reasons=tuple(reasons))


def rank(side: Side) -> tuple[bool, bool, float, str, str]:
    """Return what sorts sides: the most contradicting first, those not judged last."""
    return (
        not side.judged,
        not side.stands_out,
        -side.contradiction,
        side.robot,
        side.excursion or "",
    )


def _deviations(squares: float, number: int) -> float:
    """Return how many standard deviations a χ² of so many degrees of freedom lies too high."""
    if not number:
        return 0.0
    variance = 2 / (9 * number)
    return float((math.cbrt(squares / number) - 1 + variance) / math.sqrt(variance))


def _at_least(count: int, expected: float) -> float:
    """Return the probability of so many or more, by Poisson's distribution."""
    below = (
        math.exp(number * math.log(expected) - expected - math.lgamma(number + 1))
        for number in range(count)
    )
    return max(0.0, 1 - sum(below)) if count else 1.0

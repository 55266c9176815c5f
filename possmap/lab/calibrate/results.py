"""What a calibration found out: parameters with limits, tests, scores, and what is odd."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from possmap.core.settings import Estimator
from possmap.lab.calibrate.checks import Independence, Proportionality
from possmap.lab.calibrate.crossval import Validation
from possmap.lab.calibrate.model import Fit
from possmap.lab.calibrate.normality import Normality
from possmap.lab.calibrate.trials import Trial


@dataclass(frozen=True, slots=True)
class Estimate:
    """One parameter of METHOD §1, in its units.

    Attributes
    ----------
    value, low, high
        With 95 % limits. A spread is told as a half-width of 2.236 standard deviations of what
        truly varies; without what the trials leave open.
    model
        What goes into the model: for spreads, the factor for new runs, and with what is left open.
        None: it is left out.
    trials
        How many speak of it.
    detectable
        The smallest value that so many find four times out of five; None where it is no test.
    """

    value: float
    low: float
    high: float
    model: float | None
    trials: int
    detectable: float | None = None


@dataclass(frozen=True, slots=True)
class LegScore:
    """How rectangles fare on whole legs of a track that the model has not seen.

    Attributes
    ----------
    length
        Of a leg [m].
    legs, poses
        How many.
    coverage, end_coverage
        Share of the poses, and of the legs' ends, inside their rectangles.
    half_width
        Mean of (hx + hy)/2 at the ends [m].
    """

    length: float
    estimator: Estimator
    legs: int
    poses: int
    coverage: float
    end_coverage: float
    half_width: float


@dataclass(frozen=True, eq=False)
class RobotResult:
    """What the trials of one robot say, or of all robots together.

    Attributes
    ----------
    robot
        Its name; empty: of all together.
    trials
        Those used.
    fit
        The model with all terms, before any is left out.
    parameters
        The model: METHOD §1's parameters.
    estimates
        By parameter.
    left_out
        Terms that are not in the model though they could be estimated.
    paper
        The paper's model of the same trials, for comparison.
    along_normal, across_normal, independent, along_grows, across_grows
        Tests; None where there is too little to test.
    validation
        None for too few trials.
    legs
        Held-out legs, of recordings.
    leftover
        What no parameter stands for, by name.
    notes
        What is odd about the trials, a sentence each.
    """

    robot: str
    trials: Sequence[Trial]
    fit: Fit
    parameters: Mapping[str, float]
    estimates: Mapping[str, Estimate]
    left_out: tuple[str, ...]
    paper: Fit
    along_normal: Normality | None
    across_normal: Normality | None
    independent: Independence | None
    along_grows: Proportionality | None
    across_grows: Proportionality | None
    validation: Validation | None
    legs: tuple[LegScore, ...] = ()
    leftover: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a call found out.

    robots : one each. pooled : of all together; None for a single robot.
    refused : robots without a model, and why. notes : about the input.
    """

    robots: tuple[RobotResult, ...]
    pooled: RobotResult | None
    refused: Mapping[str, str]
    notes: tuple[str, ...]

"""What a calibration found out: parameters with limits, tests, scores, and what is odd."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from possmap.lab.calibrate.assumptions import Assumptions
from possmap.lab.calibrate.crossval import Validation
from possmap.lab.calibrate.estimates import ParameterEstimate
from possmap.lab.calibrate.model import Fit
from possmap.lab.calibrate.rectangles import LegScore
from possmap.lab.calibrate.trials import Trial


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
    tests
        Of the paper's assumptions.
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
    estimates: Mapping[str, ParameterEstimate]
    left_out: tuple[str, ...]
    tests: Assumptions
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

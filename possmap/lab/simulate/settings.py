"""The parameters of a mission: team, robot, errors, radio; the defaults are the paper's robot.

Names are flat, as in a mission file (docs/simulate.md); METHOD §5 says what the paper leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias, get_args

from possmap.core.ranges import Count, NotNegative, Positive, Share, whole

Behaviour: TypeAlias = Literal[
    "anxious-left", "normal-right", "routine-left",
    "anxious-right", "normal-left", "routine-right",
]  # fmt: skip
"""Temper and side: how often a robot turns at random, and where to at an obstacle."""
MOST_ROBOTS = 10_000


def _some(behaviours: tuple[Behaviour, ...]) -> tuple[Behaviour, ...]:
    if not behaviours:
        raise ValueError("expected one or more")
    return behaviours


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSettings:
    """Everything about a mission but its world; each field is a key of the mission file."""

    # The team
    robots: Annotated[int, whole(1, MOST_ROBOTS), "how many"] = 3
    seed: Annotated[int, whole(0), "of all random numbers"] = 1
    minutes: Annotated[Positive, "how long the mission lasts [min]"] = 20.0
    behaviours: Annotated[tuple[Behaviour, ...], _some, "dealt out in turn"] = get_args(Behaviour)
    anxious: Annotated[NotNegative, "random turns per metre, P1 > P2 > P3 [1/m]"] = 0.67
    normal: Annotated[NotNegative, "[1/m]"] = 0.25
    routine: Annotated[NotNegative, "[1/m]"] = 0.10
    left: Annotated[Share, "P4 of those that tend left: probability of a left turn at a wall"] = 0.7
    right: Annotated[Share, "the same of those that tend right"] = 0.3

    # The robot
    length: Annotated[Positive, "of the body [m]"] = 0.21
    width: Annotated[Positive, "of the body [m]"] = 0.15
    speed: Annotated[Positive, "[m/s]"] = 0.6
    turn_rate: Annotated[Positive, "[deg/s]"] = 90.0
    ir_range: Annotated[Positive, "of the five proximity sensors [m]"] = 0.5
    ir_noise: Annotated[NotNegative, "standard deviation of a reading [m]"] = 0.005
    gap: Annotated[NotNegative, "between the body and a wall that it follows [m]"] = 0.12
    odometry_step: Annotated[Positive, "what the wheels count in [m]"] = 0.002
    battery_minutes: Annotated[Positive, "[min]"] = 30.0
    memory_bytes: Annotated[Count, "for records, own and relayed"] = 1_000_000
    max_error: Annotated[Positive, "half-width of its own estimate at which it turns home [m]"] = (
        1.0
    )
    reach: Annotated[Positive, "how near to home it must truly end to be collected [m]"] = 2.0
    dock_error: Annotated[
        NotNegative, "half-width to which it is then known where it truly is; 0: nobody looks [m]"
    ] = 0.0
    rest_minutes: Annotated[NotNegative, "at home between two excursions [min]"] = 1.0

    # How it errs
    turn_bias: Annotated[NotNegative, "over-turn per 45°, its side drawn per robot [deg]"] = 2.0
    turn_bias_sd: Annotated[NotNegative, "how it differs from robot to robot [deg]"] = 0.3
    turn_noise: Annotated[NotNegative, "standard deviation of a turn of 45° [deg]"] = 0.3
    along: Annotated[NotNegative, "half-width of a run's length, per metre [m/m]"] = 1.25 / 120
    across: Annotated[NotNegative, "half-width of its end to the side, per metre [m/m]"] = 5.5 / 120
    factor: Annotated[Positive, "standard deviations in a half-width"] = 2.236
    alignment_spread: Annotated[
        NotNegative, "half-width of its heading when lined up with a wall [deg]"
    ] = 0.0
    drift: Annotated[NotNegative, "of straight runs, its side drawn per robot [deg/m]"] = 0.0
    scale_sd: Annotated[NotNegative, "standard deviation of true over logged distance"] = 0.0
    calibrated: Annotated[bool, "whether logs carry the measured errors as a model"] = True
    calibration_sd: Annotated[NotNegative, "error of the measured over-turn [deg]"] = 0.19

    # Meeting
    exchange: Annotated[bool, "whether robots that meet exchange maps"] = True
    radio_range: Annotated[NotNegative, "in line of sight [m]"] = 1.0
    radio_rate: Annotated[Positive, "[bytes/s]"] = 960.0
    radio_stop: Annotated[NotNegative, "longest stop for a transfer [s]"] = 8.0
    radio_pause: Annotated[NotNegative, "before the same two talk again [s]"] = 30.0
    radio_rest: Annotated[
        NotNegative, "before a robot stops for anybody again, or crowds stay [s]"
    ] = 10.0
    radio_loss: Annotated[Share, "probability that a meeting passes unheard"] = 0.1

    # Output
    log_ir: Annotated[bool, "whether each pose carries the five raw readings as x_ir"] = False

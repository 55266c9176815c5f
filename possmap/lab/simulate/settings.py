"""The parameters of a mission: team, robot, errors, radio; the defaults are the paper's robot.

Names are flat, as in a mission file (docs/simulate.md); METHOD §5 says what the paper leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

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
    robots: Annotated[int, whole(1, MOST_ROBOTS)] = 3
    """How many."""
    seed: Annotated[int, whole(0)] = 1
    """Of all random numbers."""
    minutes: Positive = 20.0
    """How long the mission lasts [min]."""
    behaviours: Annotated[tuple[Behaviour, ...], _some] = (
        "anxious-left", "normal-right", "routine-left",
        "anxious-right", "normal-left", "routine-right",
    )  # fmt: skip
    """One for each robot, again from the first if there are more robots."""
    anxious: NotNegative = 0.67
    """Random turns per metre, P1 > P2 > P3 [1/m]."""
    normal: NotNegative = 0.25
    """[1/m]."""
    routine: NotNegative = 0.10
    """[1/m]."""
    left: Share = 0.7
    """P4, the probability of turning left at an obstacle, of those that tend left."""
    right: Share = 0.3
    """The same of those that tend right."""

    # The robot
    length: Positive = 0.21
    """Of the body [m]."""
    width: Positive = 0.15
    """Of the body [m]."""
    speed: Positive = 0.6
    """[m/s]."""
    turn_rate: Positive = 90.0
    """[deg/s]."""
    ir_range: Positive = 0.5
    """Of the five proximity sensors [m]."""
    ir_noise: NotNegative = 0.005
    """Standard deviation of a reading [m]."""
    gap: NotNegative = 0.12
    """Between the body and a wall that it follows [m]."""
    odometry_step: Positive = 0.002
    """What the wheels count in [m]."""
    battery_minutes: Positive = 30.0
    """[min]."""
    memory_bytes: Count = 1_000_000
    """For records, own and relayed."""
    max_error: Positive = 1.0
    """Half-width of its own error estimate at which a robot turns home [m]."""
    reach: Positive = 2.0
    """How near to home it must truly end to be collected [m]."""
    rest_minutes: NotNegative = 1.0
    """At home between two excursions [min]."""

    # How it errs
    turn_bias: NotNegative = 2.0
    """Size of the systematic over-turn per 45°, its side drawn per robot [deg]."""
    turn_bias_sd: NotNegative = 0.3
    """How it differs from robot to robot [deg]."""
    turn_noise: NotNegative = 0.3
    """Standard deviation of a turn of 45° [deg]."""
    along: NotNegative = 1.25 / 120
    """Half-width of a run's length, per metre [m/m]."""
    across: NotNegative = 5.5 / 120
    """Half-width of its end across, per metre [m/m]: a heading error drawn as each run begins."""
    factor: Positive = 2.236
    """Standard deviations in a half-width."""
    alignment_spread: NotNegative = 0.0
    """Half-width of the heading after following a wall, against the wall's [deg]."""
    drift: NotNegative = 0.0
    """Of the wheels, to the left [deg/m]; its sign drawn per robot."""
    scale_sd: NotNegative = 0.0
    """Standard deviation of true over logged distance, from robot to robot."""
    calibrated: bool = True
    """Whether logs carry the robot's measured errors as their model."""
    calibration_sd: NotNegative = 0.19
    """Error of the measured over-turn [deg]."""

    # Meeting
    exchange: bool = True
    """Whether robots that meet exchange maps."""
    radio_range: NotNegative = 1.0
    """In line of sight [m]."""
    radio_rate: Positive = 960.0
    """[bytes/s]."""
    radio_stop: NotNegative = 8.0
    """Longest stop for a transfer [s]."""
    radio_pause: NotNegative = 30.0
    """Before the same two talk again [s]."""
    radio_rest: NotNegative = 10.0
    """Before a robot stops for anybody again [s]: or a crowd would never get away."""
    radio_loss: Share = 0.1
    """Probability that a meeting passes unheard."""

    # Output
    log_ir: bool = False
    """Whether each pose carries the five raw readings as ``x_ir``."""

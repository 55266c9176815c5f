"""The parameters of a mission: team, robot, errors, radio; the defaults are the paper's robot.

Names are flat, as in a mission file (docs/simulate.md); METHOD §5 says what the paper leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Temper: TypeAlias = Literal["anxious", "normal", "routine"]
Side: TypeAlias = Literal["left", "right"]
TEMPERS: tuple[Temper, ...] = ("anxious", "normal", "routine")
SIDES: tuple[Side, ...] = ("left", "right")


LARGEST = 1e9
MOST_ROBOTS = 10_000

_POSITIVE = (
    "length", "width", "speed", "turn_rate", "ir_range", "minutes", "factor", "odometry_step",
    "battery_minutes", "max_error", "reach", "radio_rate",
)  # fmt: skip
_NOT_NEGATIVE = (
    "anxious", "normal", "routine", "ir_noise", "gap", "rest_minutes", "turn_bias", "turn_bias_sd",
    "turn_noise", "along", "across", "drift", "scale_sd", "calibration_sd", "radio_range",
    "radio_stop", "radio_pause", "radio_rest", "seed",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSettings:
    """Everything about a mission but its world; each field is a key of the mission file.

    Raises
    ------
    ValueError
        ``name, found value, expected range``, for the first value that is out of range.
    """

    # The team
    robots: int = 3
    """How many."""
    seed: int = 1
    """Of all random numbers."""
    minutes: float = 20.0
    """How long the mission lasts [min]."""
    behaviours: tuple[str, ...] = (
        "anxious-left", "normal-right", "routine-left",
        "anxious-right", "normal-left", "routine-right",
    )  # fmt: skip
    """One for each robot, again from the first if there are more robots: temper-side."""
    anxious: float = 0.67
    """Random turns per metre, P1 > P2 > P3 [1/m]."""
    normal: float = 0.25
    """[1/m]."""
    routine: float = 0.10
    """[1/m]."""
    left: float = 0.7
    """P4, the probability of turning left at an obstacle, of those that tend left."""
    right: float = 0.3
    """The same of those that tend right."""

    # The robot
    length: float = 0.21
    """Of the body [m]."""
    width: float = 0.15
    """Of the body [m]."""
    speed: float = 0.6
    """[m/s]."""
    turn_rate: float = 90.0
    """[deg/s]."""
    ir_range: float = 0.5
    """Of the five proximity sensors [m]."""
    ir_noise: float = 0.005
    """Standard deviation of a reading [m]."""
    gap: float = 0.12
    """Between the body and a wall that it follows [m]."""
    odometry_step: float = 0.002
    """What the wheels count in [m]."""
    battery_minutes: float = 30.0
    """[min]."""
    memory_bytes: int = 1_000_000
    """For records, own and relayed."""
    max_error: float = 1.0
    """Half-width of its own error estimate at which a robot turns home [m]."""
    reach: float = 2.0
    """How near to home it must truly end to be collected [m]."""
    rest_minutes: float = 1.0
    """At home between two excursions [min]."""

    # How it errs
    turn_bias: float = 2.0
    """Size of the systematic over-turn per 45°, its side drawn per robot [deg]."""
    turn_bias_sd: float = 0.3
    """How it differs from robot to robot [deg]."""
    turn_noise: float = 0.3
    """Standard deviation of a turn of 45° [deg]."""
    along: float = 1.25 / 120
    """Half-width of a run's length, per metre [m/m]."""
    across: float = 5.5 / 120
    """Half-width of its end across, per metre [m/m]: a heading error drawn as each run begins."""
    factor: float = 2.236
    """Standard deviations in a half-width."""
    drift: float = 0.0
    """Of the wheels, to the left [deg/m]; its sign drawn per robot."""
    scale_sd: float = 0.0
    """Standard deviation of true over logged distance, from robot to robot."""
    calibrated: bool = True
    """Whether logs carry the robot's measured errors as their model."""
    calibration_sd: float = 0.19
    """Error of the measured over-turn [deg]."""

    # Meeting
    exchange: bool = True
    """Whether robots that meet exchange maps."""
    radio_range: float = 1.0
    """In line of sight [m]."""
    radio_rate: float = 960.0
    """[bytes/s]."""
    radio_stop: float = 8.0
    """Longest stop for a transfer [s]."""
    radio_pause: float = 30.0
    """Before the same two talk again [s]."""
    radio_rest: float = 10.0
    """Before a robot stops for anybody again [s]: or a crowd would never get away."""
    radio_loss: float = 0.1
    """Probability that a meeting passes unheard."""

    # Output
    log_ir: bool = False
    """Whether each pose carries the five raw readings as ``x_ir``."""

    def __post_init__(self) -> None:
        for name in ("robots", "memory_bytes"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}, found {getattr(self, name)}, expected at least 1")
        if self.robots > MOST_ROBOTS:
            raise ValueError(f"robots, found {self.robots}, expected at most {MOST_ROBOTS}")
        for name in _POSITIVE:
            if not 0 < getattr(self, name) <= LARGEST:
                raise ValueError(f"{name}, found {getattr(self, name)}, expected a number > 0")
        for name in _NOT_NEGATIVE:
            if not 0 <= getattr(self, name) <= LARGEST:
                raise ValueError(f"{name}, found {getattr(self, name)}, expected a number >= 0")
        for name in ("left", "right", "radio_loss"):
            if not 0 <= getattr(self, name) <= 1:
                found = getattr(self, name)
                raise ValueError(f"{name}, found {found}, expected a probability, 0 to 1")
        if not self.behaviours:
            raise ValueError("behaviours, found none, expected one or more")
        for behaviour in self.behaviours:
            temper, _, side = behaviour.partition("-")
            if temper not in TEMPERS or side not in SIDES:
                raise ValueError(
                    f"behaviours, found {behaviour}, expected one of {', '.join(TEMPERS)} with "
                    "-left or -right behind it"
                )

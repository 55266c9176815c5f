"""The error model of one robot: how dead reckoning goes wrong (METHOD §1, the paper's §3)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

from possmap.core import ranges
from possmap.core.ranges import LARGEST as LARGEST
from possmap.core.ranges import Range

NEVER_NEGATIVE = frozenset(
    {
        "along",
        "across",
        "turn_spread",
        "turn_noise",
        "drift_spread",
        "alignment_spread",
        "wall_noise",
        "wall_tilt",
        "sensor",
    }
)
POSITIVE = frozenset({"scale", "max_error", "factor"})


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorModel:
    """Parameters of METHOD §1, by its names and in its units; the defaults are the paper's robot.

    Angles are in degrees here, as users write them; the formulas turn them into radians.

    Raises
    ------
    ValueError
        ``name, value found, what was expected`` for a parameter outside its range.
    """

    along: float = 1.25 / 120
    """Half-width gained per metre run, in the direction of travel [m/m]."""
    across: float = 5.5 / 120
    """The same, perpendicular to the run [m/m]."""
    turn_bias: float = 0.0
    """Known over-turn to the left per 45° turned either way [deg]."""
    turn_gain: float = 0.0
    """Known over-turn in the direction of the turn, as a share of it."""
    turn_spread: float = 2.0
    """Half-width of the unknown over-turn per 45°, one value per excursion [deg]."""
    turn_noise: float = 0.0
    """Half-width of what changes from turn to turn, for 45° [deg]; ``linear`` ignores it."""
    drift: float = 0.0
    """Known turn to the left per metre run [deg/m]."""
    drift_spread: float = 0.0
    """Half-width of its unknown part [deg/m]."""
    scale: float = 1.0
    """True distance over logged distance."""
    alignment_spread: float = 0.0
    """Heading half-width left after lining up with a wall [deg]."""
    wall_noise: float = 0.045
    """Half-width of a seen wall's end across the wall [m]; estimator ``walls`` only."""
    wall_tilt: float = 4.5
    """Half-width of a seen wall's own deviation from the axes [deg]; ``walls`` only."""
    sensor: float = 0.0
    """Half-width of the range sensor's own error [m]."""
    max_error: float = 1.0
    """The half-width beyond which data is irrelevant [m]."""
    factor: float = 2.236
    """Standard deviations that a half-width stands for."""

    def __post_init__(self) -> None:
        for name in PARAMETERS:
            check_parameter(name, getattr(self, name))

    def with_own(self, own: Mapping[str, float]) -> ErrorModel:
        """Return this model with the given parameters in place of its own."""
        return dataclasses.replace(self, **own)


def range_of(name: str) -> Range:
    """Return the numbers allowed for the parameter ``name``."""
    if name in POSITIVE:
        return ranges.POSITIVE
    return ranges.NOT_NEGATIVE if name in NEVER_NEGATIVE else ranges.WITHIN


def check_parameter(name: str, value: float) -> None:
    """Raise ValueError unless ``value`` is allowed for the parameter ``name``."""
    allowed = range_of(name)
    if value not in allowed:
        raise ValueError(f"{name}, found {value}, expected {allowed.expected_for(value)}")


PARAMETERS: tuple[str, ...] = tuple(f.name for f in dataclasses.fields(ErrorModel))

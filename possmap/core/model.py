"""The error model of one robot: how dead reckoning goes wrong (METHOD §1, the paper's §3)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, get_type_hints

from possmap.core.ranges import LARGEST as LARGEST
from possmap.core.ranges import NotNegative, Number, Positive, Range


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorModel:
    """Parameters of METHOD §1, by its names and in its units; the defaults are the paper's robot.

    Angles are in degrees here, as users write them; the formulas turn them into radians.

    Raises
    ------
    ValueError
        ``name, value found, what was expected`` for a parameter outside its range.
    """

    along: Annotated[NotNegative, "half-width gained along a run [m per m]"] = 1.25 / 120
    across: Annotated[NotNegative, "half-width gained across a run [m per m]"] = 5.5 / 120
    turn_bias: Annotated[Number, "known over-turn to the left per 45° [deg]"] = 0.0
    turn_gain: Annotated[Number, "known over-turn, as a share of the turn"] = 0.0
    turn_spread: Annotated[NotNegative, "half-width of the unknown over-turn per 45° [deg]"] = 2.0
    turn_noise: Annotated[
        NotNegative, "what changes from turn to turn [deg]; linear ignores it"
    ] = 0.0
    drift: Annotated[Number, "known turn to the left per metre run [deg/m]"] = 0.0
    drift_spread: Annotated[NotNegative, "half-width of its unknown part [deg/m]"] = 0.0
    scale: Annotated[Positive, "true distance over logged distance"] = 1.0
    alignment_spread: Annotated[
        NotNegative, "heading half-width after lining up with a wall [deg]"
    ] = 0.0
    wall_noise: Annotated[NotNegative, "half-width of a seen wall's end across it [m] (walls)"] = (
        0.045
    )
    wall_tilt: Annotated[
        NotNegative, "half-width of a wall's deviation from the axes [deg] (walls)"
    ] = 4.5
    sensor: Annotated[NotNegative, "half-width of the range sensor's error [m]"] = 0.0
    max_error: Annotated[Positive, "half-width beyond which data is irrelevant [m]"] = 1.0
    factor: Annotated[Positive, "standard deviations that a half-width stands for"] = 2.236
    frame_x: Annotated[Number, "where the origin of the robot's logs lies in the site [m]"] = 0.0
    frame_y: Annotated[Number, "the same, along y [m]"] = 0.0
    frame_heading: Annotated[Number, "where the x axis of its logs points there [deg]"] = 0.0

    def __post_init__(self) -> None:
        for name in PARAMETERS:
            check_parameter(name, getattr(self, name))

    def with_own(self, own: Mapping[str, float]) -> ErrorModel:
        """Return this model with the given parameters in place of its own."""
        return dataclasses.replace(self, **own)


PARAMETERS: tuple[str, ...] = tuple(f.name for f in dataclasses.fields(ErrorModel))
FRAME = ("frame_x", "frame_y", "frame_heading")
"""Those that say where the robot's own frame lies, and nothing of its errors."""
RANGES: Mapping[str, Range] = {
    name: next(note for note in hint.__metadata__ if isinstance(note, Range))
    for name, hint in get_type_hints(ErrorModel, include_extras=True).items()
}
"""The numbers allowed for each parameter."""


def check_parameter(name: str, value: float) -> None:
    """Raise ValueError unless ``value`` is allowed for the parameter ``name``."""
    allowed = RANGES[name]
    if value not in allowed:
        raise ValueError(f"{name}, found {value}, expected {allowed.expected_for(value)}")

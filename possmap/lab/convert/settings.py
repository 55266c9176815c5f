"""How a recording is turned into a log: every tolerance, with its default (docs/convert.md)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from possmap.core.model import ErrorModel


@dataclass(frozen=True, slots=True, kw_only=True)
class ConvertSettings:
    """What the options of ``possmap convert`` say.

    Attributes
    ----------
    tolerance
        How far the simplified track may stray from the recorded one [m].
    turn_tolerance
        How far the body's heading may stray from what lies between two poses [rad].
    reach
        What is farther off is out of sight, as for a cheap robot's sensors [m].
    echo, echo_s
        A reading this near to the robot's own track, within so many seconds, is its echo [m, s];
        0 turns it off.
    wall_error
        How far a reading may lie off a wall that it belongs to [m].
    wall_length
        No shorter wall is fitted [m].
    wall_hits
        Nor one of fewer readings.
    misses
        Whether beams that saw nothing are kept, thinned.
    orthogonal
        Whether the building's right angles correct the heading.
    align
        Whether the log's model turns its frame onto them, and says how far walls lean.
    legs
        Length of the excursions that a recording is cut into [m]; None: one.
    known
        Whose ``drift``, ``turn_gain`` and ``scale`` are applied.
    """

    tolerance: float = 0.05
    turn_tolerance: float = math.radians(15)
    reach: float = 2.0
    echo: float = 0.25
    echo_s: float = 6.0
    wall_error: float = 0.06
    wall_length: float = 0.3
    wall_hits: int = 4
    misses: bool = False
    orthogonal: bool = False
    align: bool = False
    legs: float | None = None
    known: ErrorModel = field(default_factory=ErrorModel)

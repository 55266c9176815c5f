"""One trial: what a robot was asked to do, and how wrong it ended (the paper's §3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]

UNIT_TURN_DEG = 45.0
"""Over-turn, its spread and its noise are told for a turn of this size (METHOD §1)."""

LEAST_RUN_M = 0.2
"""A shorter run says nothing of a direction: a millimetre would be a third of a degree."""

FEW = 20
"""The paper's number of trials of a manoeuvre; with fewer the result says how much is open."""

LEAST_TURN_DEG = 9.0
"""A smaller turn is none that anyone asked for."""


@dataclass(frozen=True, slots=True)
class Trial:
    """First a turn on the spot, then a straight run; either may be nothing.

    Attributes
    ----------
    robot, outing
        Whose; and of which outing, if several trials belong to one.
    distance
        Asked for, or logged [m].
    turn
        Before the run, left positive [deg].
    along, across
        True end minus asked end, in the frame of the asked run, left positive [m].
    heading
        True minus asked heading at the end, left positive [deg]; NaN if nobody measured it.
    bend
        What the robot itself noticed of its turning during the run [deg]; recordings have it.
    manoeuvre, place
        What it is called, and where it stands, for messages.
    track
        Of which track it was cut, right behind the trial before it; empty: of none.
    exact
        Whether its truth is exact, as that of a simulation is.
    day
        On which day, or in which recording: from one to the next a robot is another (its tyres,
        floor, battery). Of robots pooled, which robot.
    """

    robot: str
    outing: str
    distance: float
    turn: float
    along: float = math.nan
    across: float = math.nan
    heading: float = math.nan
    bend: float = 0.0
    manoeuvre: str = ""
    place: str = ""
    track: str = ""
    exact: bool = False
    day: str = ""

    @property
    def is_run(self) -> bool:
        """Whether its end tells a direction."""
        return self.distance >= LEAST_RUN_M and not math.isnan(self.along + self.across)

    @property
    def is_turn(self) -> bool:
        """Whether it tells anything of turning."""
        return abs(self.turn) + abs(self.bend) >= LEAST_TURN_DEG


@dataclass(frozen=True, eq=False)
class TrialTable:
    """Trials as columns, shape (n,) each.

    Attributes
    ----------
    run, turns, told
        Whether a trial ran, turned, and whether its heading was measured.
    distance, turn, turned
        [m], [deg], and how far it turned before the run in units of 45°.
    direction, stretch
        Of the true end, seen from the start: its direction against the asked run [deg], and true
        over asked length of the straight line to it; NaN without a run.
    heading
        Error at the end [deg].
    turn_told, turned_told
        As ``turn`` and ``turned``, with what the robot noticed during a run of which the heading
        was measured.
    angle, reach
        What tells of the heading: its error, or the direction of the end where nobody measured it
        [deg], and how far a drift has had its effect on that [m].
    """

    run: Flags
    turns: Flags
    told: Flags
    distance: Floats
    turn: Floats
    turned: Floats
    direction: Floats
    stretch: Floats
    heading: Floats
    turn_told: Floats
    turned_told: Floats
    angle: Floats
    reach: Floats

    @classmethod
    def of(cls, trials: Sequence[Trial]) -> TrialTable:
        """Return the columns of trials."""
        run = np.array([one.is_run for one in trials], dtype=np.bool_)
        distance, turn, along, across, heading, bend = (
            np.array([getattr(one, name) for one in trials], dtype=np.float64)
            for name in ("distance", "turn", "along", "across", "heading", "bend")
        )
        told = ~np.isnan(heading)
        bend = np.where(told, bend, 0.0)
        ahead, aside = np.where(run, distance + along, np.nan), np.where(run, across, np.nan)
        direction = np.degrees(np.arctan2(aside, ahead))
        ran = np.where(run, distance, 0.0)
        return cls(
            run=run,
            turns=np.array([one.is_turn for one in trials], dtype=np.bool_),
            told=told,
            distance=ran,
            turn=turn,
            turned=np.abs(turn) / UNIT_TURN_DEG,
            direction=direction,
            stretch=np.hypot(ahead, aside) / np.where(run, distance, 1.0),
            heading=heading,
            turn_told=turn + bend,
            turned_told=(np.abs(turn) + np.abs(bend)) / UNIT_TURN_DEG,
            angle=np.where(told, heading, direction),
            reach=ran * np.where(told, 1.0, 0.5),  # a drift turns an end by half
        )

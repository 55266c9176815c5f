"""What is odd about trials, and what of their errors no parameter stands for."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from possmap.lab.calibrate.heading import LEAST
from possmap.lab.calibrate.model import Fit, directions, lengths
from possmap.lab.calibrate.outliers import far_off
from possmap.lab.calibrate.trials import Trial, TrialTable

FEW = 20
"""The paper's number of trials of a manoeuvre; with fewer the result says how much is open."""

COARSE = 5
"""Fewer different values among many trials: the ruler was coarser than the robot."""


def leftover(full: Fit, trials: Sequence[Trial]) -> dict[str, float]:
    """Return what no parameter stands for: how far ends and headings disagree, and the like."""
    found: dict[str, float] = {}
    table = TrialTable.of(trials)
    both = table.run & table.told
    if both.sum() >= LEAST and full.heading.runs >= LEAST:
        off, _ = directions(table, full.heading)
        known = full.heading.known(table.turned_told, table.turn_told, table.distance)
        rest = (table.heading - known)[both]
        apart = off[both[table.run]] - rest
        found["heading_minus_direction_deg"] = float(apart.std(ddof=1))
        if apart.std() > 0 and rest.std() > 0 and off.std() > 0:
            found["direction_and_heading"] = float(np.corrcoef(off[both[table.run]], rest)[0, 1])
    if full.excess > 1:
        found["ends_scatter_times"] = full.excess
    spins = [
        math.hypot(one.along, one.across) for one in trials if one.is_turn and not one.distance
    ]
    moved = [one for one in spins if not math.isnan(one)]
    if len(moved) >= LEAST:
        found["turn_moves_m"] = float(np.median(moved))
    return found


def notes(trials: Sequence[Trial], full: Fit) -> Iterator[str]:
    """Yield what is odd about the trials, a sentence each."""
    heading = full.heading
    for count, what in ((heading.runs, "runs"), (heading.turns, "turns")):
        if 0 < count < FEW:
            yield (
                f"only {count} {what}, the paper had {FEW} of each kind: limits are wide, and "
                f"half-widths widened to match"
                + ("; too few for a model of it" if count < LEAST else "")
            )
    if not heading.turns:
        yield "no turns: turn_bias, turn_gain and turn_noise are unknown, the defaults stay"
    elif heading.turns >= LEAST and not heading.sides:
        yield (
            "turns to one side only: the same-side part and the part in the turn's direction "
            "cannot be told apart, and stand together as turn_bias"
        )
    if heading.turns >= LEAST and heading.runs >= LEAST and "drift" not in heading.effects:
        yield (
            "all trials turned and ran alike: over-turn and drift cannot be told apart, and stand "
            "together as the over-turn; drift and drift_spread are left out; add straight runs"
        )
    if heading.runs < LEAST:
        yield "too few runs: along, across, drift and scale are unknown, the defaults stay"
    table = TrialTable.of(trials)
    runs = [one for one in trials if one.is_run]
    if heading.runs >= LEAST:
        stretched = lengths(table, heading.effect("drift"))
        off, _ = directions(table, heading)
        for name, values in (("along", stretched), ("across", off)):
            yield from far_off(name, values, runs)
        for name in ("along", "across"):
            written = [round(getattr(one, name), 9) for one in runs]
            if len(runs) >= 2 * COARSE and len(Counter(written)) < COARSE:
                yield (
                    f"{name} takes only {len(Counter(written))} values in {len(runs)} trials: the "
                    "ruler is coarser than the robot, and spreads are too small or too large"
                )
    if full.excess > 1:
        yield (f"ends scatter {full.excess:.1f} times more across than the headings explain")

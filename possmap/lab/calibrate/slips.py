"""Slips: single trials that lie far off what all others say are named, and left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from possmap.lab.calibrate.heading import LEAST, fit_heading
from possmap.lab.calibrate.model import directions, lengths
from possmap.lab.calibrate.trials import Floats, Trial, TrialTable

FAR = 6.0
"""Robust deviations beyond which an error is no draw of what draws the others."""

LEAST_TRIALS = 10
"""Of fewer nobody knows what is far."""

MOST_SHARE = 0.05
"""If more lie so far off, that is how the robot errs, and none is left out."""

_ROUNDS = 5


def without_slips(trials: Sequence[Trial]) -> tuple[list[Trial], list[str]]:
    """Return trials without slips, and notes that name them.

    A slip is found in the heading, in the direction of the end, or in the distance to it. One may
    hide behind a larger one, so it is asked again without those found.
    """
    kept = list(trials)
    found: dict[Trial, str] = {}
    for _ in range(_ROUNDS):
        far = {k: told for k, told in enumerate(_far(kept)) if told is not None}
        if not far:
            break
        found |= {kept[k]: told for k, told in far.items()}
        kept = [one for k, one in enumerate(kept) if k not in far]
    few = len(found) <= max(1, MOST_SHARE * len(trials))
    names = [f"{one.place or one.manoeuvre or 'one'} ({told})" for one, told in found.items()]
    if not names:
        return kept, []
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    note = (
        f"{len(names)} of {len(trials)} trials far off all others: {', '.join(names[:3])}{more}: "
    )
    if few:
        return kept, [note + "slips, or something unlogged; left out (--keep-slips keeps them)"]
    return list(trials), [note + "too many for slips, this is how the robot errs; kept"]


def _far(trials: Sequence[Trial]) -> list[str | None]:
    """Tell of each trial what of it lies how far off; None: nothing."""
    told: list[str | None] = [None] * len(trials)
    table = TrialTable.of(trials)
    fit = fit_heading(trials)
    turned = table.turned_told
    known = fit.known(turned, table.turn_told, table.distance)
    said = np.sqrt(fit.spread(table.run, turned, table.distance))
    off = table.heading - known
    ones = np.ones(len(trials))
    groups = [("heading", table.told & ~table.run & table.turns, table.heading, off, said, "deg")]
    if fit.runs >= LEAST:
        ends, of_ends = (np.full(len(trials), np.nan) for _ in range(2))
        ends[table.run], of_ends[table.run] = directions(table, fit)
        stretched = np.full(len(trials), np.nan)
        stretched[table.run] = lengths(table, fit.effect("drift"))
        groups += [
            ("heading", table.told & table.run, table.heading, off, said, "deg"),
            ("end aside", table.run, table.direction, ends, of_ends, "deg"),
            ("distance", table.run, 100 * table.stretch - 100, stretched, ones, "%"),
        ]
    for what, which, raw, values, deviation, unit in groups:
        at = np.flatnonzero(which)
        if len(at) >= LEAST_TRIALS:
            far = _robust(values[at], deviation[at])
            for k in np.flatnonzero(far > FAR):
                told[at[k]] = told[at[k]] or f"{what} {raw[at[k]]:+.3g} {unit}"
    return told


def _robust(values: Floats, deviation: Floats) -> Floats:
    """Return how many robust deviations each lies off; 0 where all agree."""
    scaled = values / deviation if deviation.min() > 0 else values
    middle = float(np.median(scaled))
    apart = np.abs(scaled - middle)
    spread = 1.4826 * float(np.median(apart))
    return apart / spread if spread > 0 else np.zeros(len(values))

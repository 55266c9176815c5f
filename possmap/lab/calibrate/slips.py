"""Headings far off: named, and single turns among them left out of the estimate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from possmap.lab.calibrate.heading import HeadingFit, fit_heading
from possmap.lab.calibrate.trials import Floats, Table, Trial

FAR = 6.0
"""Robust deviations beyond which a heading is no draw of what draws the others."""

LEAST_TURNS = 10
"""Of fewer nobody knows what is far."""

MOST_SHARE = 0.05
"""If more turns lie so far off, that is how the robot errs, and none is left out."""


def without_slips(trials: Sequence[Trial]) -> tuple[list[Trial], list[str]]:
    """Return trials without single turns whose headings are far off, and notes that name them.

    A single turn is one without a run. Runs with headings far off are named, and kept.
    """
    kept, notes = list(trials), []
    table = Table.of(trials)
    spin = table.told & ~table.run & np.array([one.is_turn for one in trials], dtype=np.bool_)
    for which, what in ((spin, "turns"), (table.told & table.run, "runs")):
        at = np.flatnonzero(which)
        if len(at) < LEAST_TURNS:
            continue
        far = _far(fit_heading(trials), table, at)
        odd = at[far > FAR]
        if not len(odd):
            continue
        worst = trials[at[int(np.argmax(far))]]
        drop = what == "turns" and len(odd) <= max(1, MOST_SHARE * len(at))
        notes.append(
            f"headings of {len(odd)} of {len(at)} {what} lie more than {FAR:g} robust deviations "
            f"off, the worst {far.max():.0f}{f' ({worst.place})' if worst.place else ''}: "
            + ("a slip, or something unlogged; left out" if drop
               else "a slip, a jump of the truth, or no normal errors; kept")
        )  # fmt: skip
        if drop:
            gone = set(odd.tolist())
            kept = [one for k, one in enumerate(trials) if k not in gone]
    return kept, notes


def _far(fit: HeadingFit, table: Table, at: NDArray[np.intp]) -> Floats:
    """Return how many robust deviations headings lie off, shape (k,); 0 where they all agree."""
    bend = np.where(np.isnan(table.bend), 0.0, table.bend)
    turned = (table.turned + np.abs(bend) / 45)[at]
    known = (
        fit.effect("turn_bias") * turned
        + fit.effect("turn_gain") * (table.turn + bend)[at]
        + fit.effect("drift") * table.distance[at]
    )
    variance = (
        fit.variance("run") * table.run[at]
        + fit.variance("turn") * turned
        + fit.variance("outing_turn") * turned**2
        + fit.variance("outing_drift") * table.distance[at] ** 2
    )
    if not variance.min() > 0:
        variance = np.maximum(turned, 1e-6)
    off = (table.heading[at] - known) / np.sqrt(variance)
    apart: Floats = np.abs(off - np.median(off))
    spread = 1.4826 * float(np.median(apart))
    return apart / spread if spread > 0 else np.zeros(len(at))

"""Trials far off: named, and single turns among them left out of the estimate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from possmap.lab.calibrate.heading import HeadingFit, fit_heading
from possmap.lab.calibrate.trials import Floats, Trial, TrialTable

ODD = 5.0
"""Robust deviations beyond which a trial of twenty is called odd."""

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
    table = TrialTable.of(trials)
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


def _far(fit: HeadingFit, table: TrialTable, at: NDArray[np.intp]) -> Floats:
    """Return how many robust deviations headings lie off, shape (k,); 0 where they all agree."""
    turned, distance = table.turned_told[at], table.distance[at]
    known = fit.known(turned, table.turn_told[at], distance)
    variance = fit.spread(table.run[at], turned, distance)
    if not variance.min() > 0:
        variance = np.maximum(turned, 1e-6)
    off = (table.heading[at] - known) / np.sqrt(variance)
    apart: Floats = np.abs(off - np.median(off))
    spread = 1.4826 * float(np.median(apart))
    return apart / spread if spread > 0 else np.zeros(len(at))


def far_off(name: str, values: Floats, trials: Sequence[Trial]) -> Iterator[str]:
    """Yield a sentence that names trials whose values lie far off, if some do."""
    middle = np.median(values)
    spread = 1.4826 * np.median(np.abs(values - middle))
    if not spread > 0:
        return
    far = np.abs(values - middle) / spread
    # Of many normal errors some lie far out; the limit grows with their number.
    limit = ODD + max(0.0, math.log10(len(values) / 20))
    which = np.flatnonzero(far > limit)
    if len(which):
        worst = int(np.argmax(far))
        at = trials[worst].place
        yield (
            f"{len(which)} of {len(values)} trials lie more than {limit:.1f} robust deviations off "
            f"{name}, the worst {far[worst]:.0f}{f' ({at})' if at else ''}: a jump of the truth, a "
            "slip, or no normal errors; kept"
        )

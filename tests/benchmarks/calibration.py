"""How often a calibration's limits and rectangles hold, in 200 repetitions of simulated trials.

``python tests/benchmarks/calibration.py`` prints the table of docs/calibrate.md; two minutes.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from calibrated import PAPER, SPINS, Faults, hold, trials

from possmap.lab.calibrate.estimates import estimates
from possmap.lab.calibrate.model import fit_model

REPETITIONS = 200
VARYING = Faults(turn_spread=1.5, drift_spread=0.8)
PLANS: dict[str, tuple[Faults, dict[str, Any]]] = {
    "paper's trials, 20 of each": (Faults(), {}),
    "the same, ends only": (Faults(), {"heading": False}),
    "5 of each": (Faults(), {"times": 5}),
    "with spins": (Faults(), {"plan": PAPER + SPINS}),
    "20 outings of a varying robot": (VARYING, {"plan": PAPER + SPINS, "outings": True}),
}


def main() -> None:
    """Print a line for each plan."""
    for name, (faults, plan) in PLANS.items():
        rng, held, told = np.random.default_rng(11), Counter[str](), Counter[str]()
        heading, linear = [], []
        for _ in range(REPETITIONS):
            fit = fit_model(trials(faults, rng, **plan))
            for parameter, found in estimates(fit, fit).items():
                if math.isfinite(found.value):
                    told[parameter] += 1
                    held[parameter] += found.low <= getattr(faults, parameter) <= found.high
            new = trials(faults, rng, **(plan | {"times": 5}))
            heading.append(hold(new, fit.model, "heading").score.coverage)
            linear.append(hold(new, fit.model, "linear").score.coverage)
        shares = ", ".join(f"{one} {held[one] / told[one]:.1%}" for one in told)
        ends = f"heading {np.mean(heading):.1%}, linear {np.mean(linear):.1%}"
        sys.stdout.write(f"{name}: {shares}; ends of new trials inside: {ends}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()

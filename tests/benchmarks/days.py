"""How models of some days hold another day's trials: OptiOdom, where it is there.

``python tests/benchmarks/days.py FOLDER`` (OptiOdom's ``ivanjko``) prints a line for each number of
days; half a minute. Figures stand in docs/calibrate.md.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import numpy as np

from possmap.core.model import ErrorModel
from possmap.lab.calibrate.held_out import hold
from possmap.lab.calibrate.recordings import RecordingsRequest, of_recordings
from possmap.lab.calibrate.robots import Unusable, calibrate_robot
from possmap.lab.calibrate.trials import Trial
from possmap.lab.recordings import Source, find_mapping, read_mapping


def main(root: Path) -> None:
    """Print a line for each geometry of several days, and number of days."""
    own, truth = (
        Source(mapping=read_mapping(find_mapping(f"optiodom-{name}")))
        for name in ("ticks", "truth")
    )
    days: dict[str, list[list[Trial]]] = {}
    for folder in sorted(root.iterdir()):
        runs = sorted(folder.glob("*_run-*.csv"))
        trials = of_recordings(runs, RecordingsRequest(source=own, truth_source=truth)).trials
        days.setdefault(trials[0].robot, []).append(trials)
    for robot, several in days.items():
        for count in range(1, min(4, len(several))):
            ends, headings = [], []
            for some in itertools.combinations(range(len(several)), count):
                try:
                    own_trials = [trial for k in some for trial in several[k]]
                    found = calibrate_robot(robot, own_trials, np.random.default_rng(1))
                except Unusable:  # a folder of three trials
                    continue
                model = ErrorModel(**found.parameters)
                for k in set(range(len(several))) - set(some):
                    score = hold(several[k], [(None, model)], "heading").score
                    ends.append(score.coverage)
                    headings.append(score.heading_coverage)
            told = (f"{np.median(one):.0%}, {np.mean(one):.0%}" for one in (ends, headings))
            sys.stdout.write(
                f"{robot}: {count} days, {len(ends)} pairs: ends inside, median and mean: "
                f"{'; headings: '.join(told)}\n"
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]))

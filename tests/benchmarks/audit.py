"""How often `possmap audit` finds a broken robot, and how often it suspects an honest one.

Drives teams of 4 to 8 robots through two shipped missions, breaks the odometry of one robot, or of
one of its excursions, in the logs that came home (tests/broken.py), fuses and audits. Prints the
tables of docs/audit.md.

    python tests/benchmarks/audit.py [--seeds 12] [--jobs 2]
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # for broken.py

from broken import FAULTS

from possmap.fusing.fuse import fuse
from possmap.inspection.audit import audit
from possmap.inspection.judgement import Side
from possmap.lab.simulate.run import simulate
from possmap.settings.request import Request
from possmap.settings.setting_table import parse_setting

MISSIONS = Path(__file__).parents[2] / "configs" / "missions"
NAMES = ("figure8", "office")
PROFILES = ("paper", "robust")
FIRST_SEED = 100  # the rules of the audit were chosen on seeds below
RESOLUTION = "0.1"
HONEST = "none"

Log = dict[str, Any]


@dataclass(frozen=True)
class Trial:
    """One audit of a team.

    place : of the broken robot, or excursion, in the ranking, from 1; 0 if it was not judged.
    place_by_k : the same by mean K.
    suspected : whether it stands out.
    robots, excursions : whether one stands out that is not broken, nor of a broken robot.
    seconds : of the audit.
    """

    profile: str
    fault: str
    whole_robot: bool
    place: int
    place_by_k: int
    suspected: bool
    robots: bool
    excursions: bool
    seconds: float
    sides: int


def trials(mission: str, seed: int) -> list[Trial]:
    """Drive a team, break it in every way, and audit each."""
    rng = np.random.default_rng(seed)
    robots = 4 + seed % 5
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        given = {"robots": str(robots), "seed": str(seed), "exchange": "false"}
        simulate(MISSIONS / f"{mission}.yaml", folder / "out", given)
        paths = sorted((folder / "out/logs").iterdir())
        logs: list[Log] = [json.loads(path.read_text()) for path in paths]
        broken = str(rng.choice(sorted({log["robot"] for log in logs})))
        outing = str(rng.choice([log["excursion"] for log in logs if log["robot"] == broken]))
        found = []
        for profile in PROFILES:
            found.append(_trial(folder, profile, logs, HONEST, True, ("", "")))
            for fault, retell in FAULTS.items():
                for whole in (True, False):
                    mine = [
                        log["robot"] == broken and (whole or log["excursion"] == outing)
                        for log in logs
                    ]
                    told = [
                        retell(log) if bad else log for log, bad in zip(logs, mine, strict=True)
                    ]
                    found.append(_trial(folder, profile, told, fault, whole, (broken, outing)))
        return found


def _trial(
    folder: Path,
    profile: str,
    logs: Sequence[Log],
    fault: str,
    whole: bool,
    broken: tuple[str, str],
) -> Trial:
    paths = [folder / f"{number}.json" for number in range(len(logs))]
    for path, log in zip(paths, logs, strict=True):
        path.write_text(json.dumps(log))
    grid = folder / "site.possmap"
    grid.unlink(missing_ok=True)
    given = {"resolution": parse_setting("resolution", RESOLUTION, "the study")}
    summary = fuse([str(path) for path in paths], grid, Request(profile, None, given))
    assert summary.count("fused") == len(logs)
    begin = time.process_time()
    told = audit(grid)
    seconds = time.process_time() - begin
    sides = told.robots if whole else told.excursions
    name = (broken[0], None if whole else broken[1])
    by_k = sorted(sides, key=lambda one: -one.conflict)
    return Trial(
        profile=profile,
        fault=fault,
        whole_robot=whole,
        place=_place(sides, name),
        place_by_k=_place(by_k, name),
        suspected=any(one.stands_out for one in sides if (one.robot, one.excursion) == name),
        robots=any(one.stands_out for one in told.robots if one.robot != broken[0]),
        excursions=any(one.stands_out for one in told.excursions if one.robot != broken[0]),
        seconds=seconds,
        sides=len(told.excursions),
    )


def _place(sides: Sequence[Side], name: tuple[str, str | None]) -> int:
    judged = [(one.robot, one.excursion) for one in sides if one.judged]
    return judged.index(name) + 1 if name in judged else 0


def share(values: Sequence[bool]) -> str:
    return f"{sum(values)}/{len(values)}"


def table(some: Sequence[Trial]) -> Iterator[str]:
    """Yield a table of faults, or of what came of honest teams."""
    yield "| fault | ranked first | first two | by mean K first | stands out | others suspected |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for fault in (*FAULTS, None):
        of = [one for one in some if fault in (None, one.fault)]
        cells = (
            share([one.place == 1 for one in of]),
            share([one.place in (1, 2) for one in of]),
            share([one.place_by_k == 1 for one in of]),
            share([one.suspected for one in of]),
            share([one.robots or one.excursions for one in of]),
        )
        yield f"| {fault or 'all'} | {' | '.join(cells)} |"


def report(found: Sequence[Trial]) -> Iterator[str]:
    kinds: Mapping[bool, str] = {True: "every excursion of one robot", False: "one excursion"}
    for profile in PROFILES:
        mine = [one for one in found if one.profile == profile]
        for whole, what in kinds.items():
            yield f"\nprofile {profile}, broken: {what}\n"
            yield from table(
                [one for one in mine if one.whole_robot is whole and one.fault != HONEST]
            )
        honest = [one for one in mine if one.fault == HONEST]
        yield (
            f"\nprofile {profile}, honest teams: a robot stands out in "
            f"{share([one.robots for one in honest])}, an excursion in "
            f"{share([one.excursions for one in honest])}, either in "
            f"{share([one.robots or one.excursions for one in honest])}"
        )
    each = [1000 * one.seconds / one.sides for one in found]
    yield f"\nCPU time of an audit: median {statistics.median(each):.1f} ms an excursion"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + asked.seeds)
    with ProcessPoolExecutor(asked.jobs) as pool:
        waiting = [pool.submit(trials, name, seed) for name in NAMES for seed in seeds]
        found = [trial for done in waiting for trial in done.result()]
    sys.stdout.write("\n".join(report(found)) + "\n")


if __name__ == "__main__":
    main()

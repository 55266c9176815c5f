"""What `possmap refine` is worth: tracks, walls and maps before and after, on eleven worlds.

Drives teams through the worlds of quality.py, fuses under `robust`, refines, and holds both grids
against the truth. Prints, as Markdown, the tables of docs/refine.md: means over missions.

    python tests/benchmarks/refining.py [--seeds 10] [--worlds maze ...] [--uncalibrated]
        [--set KEY=VALUE ...]                     # of the missions: ir_noise=0.03
    python tests/benchmarks/refining.py --worlds thick    # the variants of quality.py, too
    python tests/benchmarks/refining.py --grid SITE.possmap --truth truth.json
        # one grid: of many nights, say, as quality.py --nights --keep leaves it; CPU time, memory
    python tests/benchmarks/refining.py --passes SITE.possmap ...
        # of one flight each, without a truth: as repeated_passes.py, before and after

A sighting is wrongly associated if, laid out from the true track, it lies more than 6 cm from the
median of its wall's sightings.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean

import numpy as np
from quality import PLANS, TUNED, VARIANTS, WORLDS, World, drive, request
from repeated_passes import ranges_of

from possmap.budget import Budget
from possmap.core.records import PartialMap, Pose, Record, Wall
from possmap.core.track import stretches
from possmap.fusing.fuse import fuse
from possmap.fusing.refine import refine
from possmap.grid.grid import Grid
from possmap.lab.evaluate.results import Evaluation
from possmap.lab.evaluate.run import Question, evaluate
from possmap.lab.evaluate.tracks import matched
from possmap.refining.cutting import cut
from possmap.refining.fitting import fit
from possmap.refining.problem import TrackProblem
from possmap.settings.limits import Limits
from possmap.truth.truth import Truth, read_truth

WRONG_M = 0.06


@dataclass(frozen=True)
class Tracks:
    """rms per axis, coverage of both axes, and mean half-width [m]."""

    rms: float
    coverage: float
    half: float


def tracks_of(grid: Path, truth: Truth) -> Tracks:
    """Hold the poses of a grid's ledger against the true tracks."""
    errors, halves = [], []
    with Grid(grid) as site:
        for entry in site.ledger.entries():
            track = truth.tracks.get(entry.name)
            if track is None:
                continue
            version, laid = site.ledger.version(entry), site.ledger.geometry(entry)
            for index, row in matched(version, track).items():
                at = laid[index]
                errors.append(track[row, 1:3] - (at.x, at.y))
                halves.append(at.rect)
    error, half = np.array(errors), np.array(halves)
    inside = (np.abs(error) <= half + 1e-3).all(axis=1)
    return Tracks(float(np.sqrt((error**2).mean())), float(inside.mean()), float(half.mean()))


def wrong_of(grid: Path, truth: Truth) -> tuple[int, int]:
    """Return how many associated sightings are wrong, and of how many that can be said."""
    with Grid(grid) as site:
        settings = site.settings
        cuts = [
            cut(site.ledger.version(entry), entry.model, settings)
            for entry in sorted(site.ledger.entries(), key=lambda one: one.name)
        ]
    excursions = [one for one in cuts if one is not None]
    problem = TrackProblem(excursions)
    found = fit(excursions, problem, ())
    true = []
    for one in excursions:
        track = truth.tracks.get(one.version.name)
        rows = {} if track is None else matched(one.version, track)
        index = {id(record): number for number, record in enumerate(one.version.records)}
        of_record = {
            number: (stretch, index[id(stretch.start)])
            for stretch in stretches(one.version.records)
            for number, _ in stretch.seen
        }
        for sighting in one.sightings:
            stretch, start = of_record[sighting.record]
            if track is None or start not in rows or stretch.end_index not in rows:
                true.append(np.nan)
                continue
            here, there = (complex(*track[rows[i], 1:3]) for i in (start, stretch.end_index))
            wall = one.version.records[sighting.record]
            first = one.version.records[start]
            assert isinstance(first, Pose)
            x, y = (wall.x + wall.x2) / 2, (wall.y + wall.y2) / 2  # type: ignore[union-attr]
            off = complex(x - first.x, y - first.y) / complex(*stretch.unit)
            at = here + off * (there - here) / max(1e-9, abs(there - here))
            true.append(np.nan if abs(there - here) < 0.02 else (at.real, at.imag)[sighting.normal])
    at = np.array(true)
    wrong = known = 0
    for number in range(len(found.walls)):
        mine = at[found.wall_of == number]
        mine = mine[np.isfinite(mine)]
        wrong += int((np.abs(mine - np.median(mine)) > WRONG_M).sum()) if len(mine) else 0
        known += len(mine)
    return wrong, known


def broken_bins(found: Evaluation) -> Iterator[str]:
    """Yield the bins of Bel whose walls are fewer, within the local rectangle, than it says."""
    for one in found.grids["possmap"].lower_validity:
        if one.cells >= 100 and one.wall_local < one.mean:
            yield f"{one.low:g}: {one.wall_local:.2f} < {one.mean:.2f} ({one.cells})"


def judged(
    before: Path, after: Path, truth_file: Path, moved: float, seconds: float
) -> dict[str, object]:
    """Return a row of the table."""
    truth = read_truth(truth_file, Limits())
    was, now = tracks_of(before, truth), tracks_of(after, truth)
    old = evaluate(before, truth_file, Question()).methods["possmap"]
    found = evaluate(after, truth_file, Question(baselines=TUNED))
    new = found.methods["possmap"]
    rivals = [one for name, one in found.methods.items() if name.startswith("bayes")]
    wrong, known = wrong_of(before, truth)
    return {
        "rms before [m]": was.rms, "rms": now.rms,
        "coverage before": was.coverage, "coverage": now.coverage,
        "half-width before [m]": was.half, "half-width": now.half,
        "F1 15 cm before": old.f1_15cm, "F1 15 cm": new.f1_15cm,
        "log-odds 15 cm": max(one.f1_15cm for one in rivals),
        "F1 5 cm before": old.f1_5cm, "F1 5 cm": new.f1_5cm,
        "log-odds 5 cm": max(one.f1_5cm for one in rivals),
        "wrong": wrong, "known": known, "moved": moved, "seconds": seconds,
        "invalid": list(broken_bins(found)),
    }  # fmt: skip


def one_mission(world: World, seed: int, options: argparse.Namespace) -> dict[str, object] | None:
    """Drive, fuse, refine and judge; None if nobody came home."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "out"
        told = {"seed": str(seed), "calibrated": str(not options.uncalibrated).lower()}
        if not drive(world, folder, told | dict(one.split("=", 1) for one in options.set)):
            return None
        before, after = Path(name) / "before.possmap", Path(name) / "after.possmap"
        fuse([str(folder / "logs")], before, request("robust", "walls"))
        start = time.perf_counter()
        done = refine(before, after)
        seconds = time.perf_counter() - start
        moved = mean(not one.alone for one in done.found.outings)
        return judged(before, after, folder / "truth.json", moved, seconds)


COLUMNS = (
    "rms before [m]", "rms", "coverage before", "coverage", "half-width before [m]", "half-width",
    "F1 15 cm before", "F1 15 cm", "log-odds 15 cm", "F1 5 cm before", "F1 5 cm", "log-odds 5 cm",
    "moved", "wrong", "seconds",
)  # fmt: skip


def averaged(rows: Sequence[Mapping[str, object]]) -> dict[str, float]:
    """Return the mean of every column; wrong associations as a share of all."""
    found = {}
    for title in COLUMNS:
        found[title] = mean(float(row[title]) for row in rows)  # type: ignore[arg-type]
    known = sum(int(row["known"]) for row in rows)  # type: ignore[call-overload]
    wrong = sum(int(row["wrong"]) for row in rows)  # type: ignore[call-overload]
    found["wrong"] = wrong / max(1, known)
    return found


def worlds_study(options: argparse.Namespace) -> None:
    """Print a row for each world, and one over all."""
    say(f"| world | {' | '.join(COLUMNS)} |", f"|{' --- |' * (len(COLUMNS) + 1)}")
    every = []
    for world in (*WORLDS, *VARIANTS) if options.worlds else WORLDS:
        if options.worlds and not any(one in world.name for one in options.worlds):
            continue
        if world.plan and not (PLANS / world.plan).exists():
            continue
        seeds = range(options.first_seed, options.first_seed + options.seeds)
        rows = [one for seed in seeds if (one := one_mission(world, seed, options)) is not None]
        if not rows:
            continue
        every.append(averaged(rows))
        say(line(world.name, every[-1]))
        for seed, row in zip(seeds, rows, strict=False):
            if row["invalid"]:
                say(f"<!-- seed {seed}: Bel beyond its bin: {row['invalid']} -->")
    say(line("**all**", {title: mean(one[title] for one in every) for title in COLUMNS}))


def one_grid(before: Path, truth_file: Path) -> None:
    """Print what refining makes of one grid, what it costs, and how its tracks fare."""
    truth = read_truth(truth_file, Limits())
    with tempfile.TemporaryDirectory() as name:
        after = Path(name) / "after.possmap"
        start = time.process_time()
        done = refine(before, after, budget=Budget(4096))
        seconds = time.process_time() - start
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
        moved = sum(not one.alone for one in done.found.outings)
        say(
            f"{moved} of {len(done.found.outings)} excursions moved, "
            f"{len(done.found.walls)} walls; {seconds:.1f} s of CPU time, {most} MB",
            f"before {tracks_of(before, truth)}",
            f"after  {tracks_of(after, truth)}",
            f"wrong {' of '.join(map(str, wrong_of(before, truth)))}",
        )


def laid_out(grid: Path) -> PartialMap:
    """Return the one excursion of a grid with poses and walls where they lie on the map."""
    with Grid(grid) as site:
        (entry,) = site.ledger.entries()
        version, places = site.ledger.version(entry), site.ledger.geometry(entry)
    records: list[Record] = []
    for number, record in enumerate(version.records):
        at = places.get(number)
        if at is not None and isinstance(record, Wall):
            records.append(replace(record, x=at.x, y=at.y, x2=at.x2, y2=at.y2))
        elif at is not None and isinstance(record, Pose):
            records.append(replace(record, x=at.x, y=at.y))
        else:
            records.append(record)
    return replace(version, records=tuple(records))


def passes_study(grids: Sequence[Path]) -> None:
    """Print how far apart the walls of one corridor lie on repeated passes."""
    for before in grids:
        with tempfile.TemporaryDirectory() as name:
            after = Path(name) / "after.possmap"
            (told,) = refine(before, after).found.outings
            for title, grid in (("before", before), ("after", after)):
                ranges = list(ranges_of(laid_out(grid)))
                apart = mean(one for one, _ in ranges)
                say(f"{before.stem} {title}: {apart:.3f} m, {len(ranges)} walls {told.alone}")


def line(name: str, told: Mapping[str, float]) -> str:
    """Return a row of a table."""
    return f"| {name} | {' | '.join(f'{told[title]:.3f}' for title in COLUMNS)} |"


def say(*lines: str) -> None:
    """Print lines at once."""
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stdout.flush()


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--worlds", nargs="*", help="only worlds whose names hold one of these")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=101)
    parser.add_argument("--uncalibrated", action="store_true")
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE", help="of missions")
    parser.add_argument("--grid", type=Path)
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--passes", type=Path, nargs="*")
    options = parser.parse_args()
    if options.grid:
        one_grid(options.grid, options.truth)
    elif options.passes:
        passes_study(options.passes)
    else:
        worlds_study(options)


if __name__ == "__main__":
    main()

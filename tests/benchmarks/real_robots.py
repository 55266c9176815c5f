"""Real recordings converted, fused and judged: coverage of the rectangles, and F1 of the map.

    python tests/benchmarks/real_robots.py [--data ../shared/realdata] [--only intel]
        [--half first] [--fix M] [--set NAME=VALUE ...]

Intel is as recorded: raw odometry, the corrected poses of the same scans for truth. freiburg-079
and aces have real scans at corrected poses; the odometry error is ours (see ``spoilt``). Each is
cut into legs of 10, 20 and 40 m that begin at corrected poses. On the first half of the recording
drift, turn_gain and scale are fitted by least squares, the building's axes are found, and the
spreads are chosen, one choice for all lengths: the smallest rectangles that hold 96 % of the first
half's poses. What is printed is of the second half, fused under the profile robust, ``max_error``
1: once with the estimator ``walls``, which chooses along, across and wall_tilt, and once with
``heading`` on logs of ``convert --orthogonal``, which chooses along, across and alignment_spread.
Walls never tell the heading twice.

With ``--fix M`` each leg ends with a fix: the corrected pose there, to M metres. Spreads are chosen
with it, and half-widths are means over all poses.

With ``--half first`` the first half is judged instead: for choosing settings of the profile.
"""

from __future__ import annotations

import argparse
import cmath
import gzip
import itertools
import json
import math
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from possmap.core.estimators import estimate
from possmap.core.model import ErrorModel
from possmap.core.records import Fix, PartialMap, Wall
from possmap.core.settings import EvidenceSettings
from possmap.core.track import stretches
from possmap.core.walls import LEAST_LENGTH_M
from possmap.fusing.fuse import fuse
from possmap.lab.convert.legs import KnownPlace
from possmap.lab.convert.request import ConvertRequest, Models
from possmap.lab.convert.run import convert_recordings
from possmap.lab.convert.settings import ConvertSettings
from possmap.lab.evaluate.run import Question, evaluate
from possmap.lab.recordings import Source, find_mapping, open_recordings, read_mapping
from possmap.logs import read_log
from possmap.settings.limits import Limits
from possmap.settings.request import ConvertRequest as FuseRequest
from possmap.settings.setting_table import parse_setting

LEGS = (10.0, 20.0, 40.0)
BEAMS = (-90.0, 0.0, 90.0)
HELD = 0.96
ACROSS = (0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.13, 0.16)
ALONG = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
ALIGNMENT = (3, 6, 9, 12)
TILT = (4.5, 9, 15, 20)
TURN_NOISE = 0.7
"""As the profile robust has it [deg]."""
CELL_M = 0.05


@dataclass(frozen=True)
class Data:
    """One recording: how to read it, and the truth; poses are rows of t, x, y, yaw [s, m, rad].

    start_errors : half-widths of the true poses themselves [m, m, deg].
    """

    name: str
    path: Path
    source: Source
    reference: Path
    reference_source: Source
    poses: np.ndarray
    true: np.ndarray
    ends: np.ndarray
    start_errors: tuple[float, float, float]


def poses_of(path: Path, source: Source) -> np.ndarray:
    """Return every pose of a recording."""
    from possmap.lab.convert.tally import Tally

    (recording,) = open_recordings([path], source)
    parts = list(recording.samples(Tally(), None))
    return np.concatenate([np.column_stack([p.t, p.x, p.y, p.yaw]) for p in parts])


def end_points(poses: np.ndarray, scans: Sequence[np.ndarray], first: float) -> np.ndarray:
    """Return the cells' centres where scans at true poses end: what counts as wall."""
    points = []
    for (_, x, y, yaw), ranges in zip(poses, scans, strict=True):
        step = math.pi / len(ranges)
        angle = yaw + first + step * np.arange(len(ranges))
        near = (ranges > 0.05) & (ranges < 79)
        ends = np.column_stack([x + ranges * np.cos(angle), y + ranges * np.sin(angle)])
        points.append(ends[near])
    cells = np.unique(np.floor(np.concatenate(points) / CELL_M).astype(int), axis=0)
    found: np.ndarray = (cells + 0.5) * CELL_M
    return found


def intel(folder: Path) -> Data:
    """Return Intel's raw odometry with its corrected poses."""
    mapping = read_mapping(find_mapping("intel-json"))
    source = Source(mapping=mapping, beams=tuple(np.radians(BEAMS)))
    raw, corrected = (folder / "intel" / f"intel-{name}.json" for name in ("raw", "corrected"))
    rows = json.loads(corrected.read_text())["map"]
    scans = [np.array(rows[key]["range"]) for key in sorted(rows, key=float)]
    true = poses_of(corrected, source)
    ends = end_points(true, scans, -math.pi / 2)
    errors = (0.1, 0.1, 3.0)  # scans match no better
    return Data("intel", raw, source, corrected, source, poses_of(raw, source), true, ends, errors)


def spoilt(folder: Path, name: str, work: Path) -> Data:
    """Return a corrected CARMEN log whose odometry drives 1 deg/m to the left and wanders.

    Added to each step: 1 deg/m of drift, 2 % of the turn, 1 % of the way; and at random 0.5 deg
    per square root of a metre of heading and 2 % of the way.
    """
    rng = np.random.default_rng(1)
    lines, true, scans = [], [], []
    believed = before = None
    with gzip.open(folder / "carmen" / f"{name}-corrected.log.gz", "rt") as stream:
        for line in stream:
            words = line.split()
            if not words or words[0] != "FLASER":
                continue
            count = int(words[1])
            x, y, yaw = map(float, words[2 + count : 5 + count])
            if before is None or believed is None:
                believed = [x, y, yaw]
            else:
                dx, dy = x - before[0], y - before[1]
                way = math.hypot(dx, dy)
                turn = math.remainder(yaw - before[2], 2 * math.pi)
                told = believed[2] - before[2]
                more = math.radians(1) * way + 0.02 * turn
                more += math.radians(0.5) * math.sqrt(way) * rng.standard_normal()
                longer = 1.01 + 0.02 * rng.standard_normal()
                cos, sin = math.cos(told), math.sin(told)
                believed[0] += longer * (dx * cos - dy * sin)
                believed[1] += longer * (dx * sin + dy * cos)
                believed[2] += turn + more
            before = x, y, yaw
            words[5 + count : 8 + count] = [f"{value:.6f}" for value in believed]
            lines.append(" ".join(words))
            true.append((float(words[8 + count]), x, y, yaw))
            scans.append(np.array(words[2 : 2 + count], dtype=float))
    path = work / f"{name}.log"
    path.write_text("\n".join(lines) + "\n")
    source = Source(beams=tuple(np.radians(BEAMS)))
    known = Source(beams=source.beams, pose_of="laser")
    poses = np.array(true)
    ends = end_points(poses, scans, -math.pi / 2)
    return Data(
        name, path, source, path, known, poses_of(path, source), poses, ends, (0.01, 0.01, 0.3)
    )


def known_errors(data: Data) -> dict[str, float]:
    """Fit drift, turn_gain and scale to the first half's steps."""
    half = len(data.poses) // 2
    logged, true = data.poses[:half], data.true[:half]
    way = np.hypot(np.diff(logged[:, 1]), np.diff(logged[:, 2]))
    true_way = np.hypot(np.diff(true[:, 1]), np.diff(true[:, 2]))
    turn, true_turn = (np.diff(np.unwrap(rows[:, 3])) for rows in (logged, true))
    more = (true_turn - turn + math.pi) % (2 * math.pi) - math.pi
    (drift, gain), *_ = np.linalg.lstsq(np.column_stack([way, turn]), more, rcond=None)
    return {
        "drift": round(math.degrees(drift), 3),
        "turn_gain": round(float(gain), 4),
        "scale": round(float(true_way.sum() / way.sum()), 4),
        "turn_spread": 0.0,
    }


def convert(
    data: Data,
    length: float,
    orthogonal: bool,
    model: Mapping[str, float],
    path: Path,
    fix: float | None = None,
) -> list[PartialMap]:
    """Convert a recording into legs, each perhaps with a fix at its end, and return them."""
    settings = ConvertSettings(legs=length, orthogonal=orthogonal)
    request = ConvertRequest(
        source=data.source,
        settings=settings,
        models=Models(model),
        robot=data.name,
        errors=data.start_errors,
        fixes=() if fix is None else (KnownPlace(fix),),
        reference=data.reference,
        reference_source=data.reference_source,
    )
    convert_recordings([data.path], path, request, overwrite=True)
    return [delivery.version for delivery in read_log(path, Limits()).deliveries]


def true_at(data: Data, t: Sequence[float]) -> np.ndarray:
    """Return true x, y, yaw at some times."""
    yaw = np.unwrap(data.true[:, 3])
    columns = (data.true[:, 1], data.true[:, 2], yaw)
    return np.column_stack([np.interp(t, data.true[:, 0], column) for column in columns])


def carried_by(orthogonal: bool, axes: float) -> EvidenceSettings:
    """Return how errors are carried: walls that convert has used tell the heading no more."""
    if orthogonal:
        return EvidenceSettings(estimator="heading")
    return EvidenceSettings(estimator="walls", orthogonal=True, axes=axes)


def held(
    data: Data, legs: Sequence[PartialMap], model: ErrorModel, settings: EvidenceSettings
) -> tuple[float, float]:
    """Return the share of poses within their rectangles, and the legs' mean last half-width.

    Of legs that end with a fix it is the mean of all half-widths.
    """
    inside, last = [], []
    for leg in legs:
        track = stretches(leg.records)
        if not track:
            continue
        found = estimate(leg.records, model, settings)
        true = true_at(data, [one.end.t or 0.0 for one in track])
        off = np.abs(np.array([one.end for one in found.stretches]) - true[:, :2])
        halves = np.array([(one.end.half_x, one.end.half_y) for one in found.errors])
        inside.append((off <= halves + 1e-3).all(axis=1))
        known = any(isinstance(one, Fix) for one in leg.records)  # then the end tells nothing
        last.append(float(halves.mean() if known else halves[-1].mean()))
    return float(np.concatenate(inside).mean()), float(np.mean(last))


def found_axes(legs: Sequence[PartialMap]) -> float:
    """Return the direction along which most metres of wall lie, as ``check`` proposes it [deg]."""
    along = 0j
    for wall in (record for leg in legs for record in leg.records if isinstance(record, Wall)):
        run = complex(wall.x2 - wall.x, wall.y2 - wall.y)
        along += run**4 / abs(run) ** 3 if abs(run) >= LEAST_LENGTH_M else 0
    return round(math.degrees(cmath.phase(along)) / 4, 1)


def spreads(
    data: Data, halves: Mapping[float, Sequence[PartialMap]], settings: EvidenceSettings
) -> dict[str, float]:
    """Choose along, across and a third spread on the first half of the legs."""
    best: tuple[float, dict[str, float]] = math.inf, {}
    walls = settings.estimator == "walls"
    name, values = ("wall_tilt", TILT) if walls else ("alignment_spread", ALIGNMENT)
    for along, across, third in itertools.product(ALONG, ACROSS, values):
        given = {"along": along, "across": across, name: float(third)}
        model = ErrorModel(**given, turn_spread=0.0, turn_noise=TURN_NOISE)
        size = 0.0
        for length, legs in halves.items():
            share, width = held(data, legs, model, settings)
            size += width / length
            if share < HELD or size >= best[0]:
                break
        else:
            best = size, given
    return best[1]


def judged(
    data: Data,
    legs: Sequence[PartialMap],
    path: Path,
    model: Mapping[str, float],
    given: Mapping[str, str],
) -> Iterator[str]:
    """Yield the cells of one row: of the legs that are judged, fused under some settings."""
    names = {leg.name for leg in legs}
    chosen = path.with_name("half.jsonl")
    keep = False
    robots: list[dict[str, Any]] = []
    with path.open() as stream, chosen.open("w") as out:
        for line in stream:
            record = json.loads(line)
            if "possmap_log" in record:
                keep = (record["robot"], record["excursion"]) in names
                record["model"] = {k: v for k, v in model.items() if k not in APPLIED}
                robots += [{**record, "fate": "home", "why": "", "track": []}] if keep else []
            elif keep and record["kind"] == "pose":
                x, y, yaw = true_at(data, [record["t"]])[0].tolist()
                believed = record["x"], record["y"], record["heading"]
                robots[-1]["track"].append([record["t"], x, y, math.degrees(yaw), *believed])
            if keep:
                out.write(json.dumps(record) + "\n")
    walls = [[x, y, x, y] for x, y in data.ends.round(4).tolist()]
    home = data.true[0, 1:3].tolist()
    truth = {"possmap_truth": 1, "walls": walls, "home": home, "robots": robots, "meetings": []}
    path.with_name("truth.json").write_text(json.dumps(truth))
    grid = path.with_name("site.possmap")
    grid.unlink(missing_ok=True)
    parsed = {name: parse_setting(name, text, "--set") for name, text in given.items()}
    summary = fuse([str(chosen)], grid, FuseRequest(profile="robust", overrides=parsed))
    if summary.count("refused"):
        raise SystemExit(str(summary.logs[0].error))
    found = evaluate(grid, path.with_name("truth.json"), Question())
    for method in ("possmap", "bayes", "bayes-smeared"):
        yield f"{found.methods[method].f1_15cm:.3f}"
    yield f"{found.all_wall_f1_15cm:.3f}"
    yield f"{found.true_pose_f1_15cm:.3f}"


APPLIED = ("drift", "turn_gain", "scale")


def report(
    data: Data, work: Path, first_half: bool, given: Mapping[str, str], fix: float | None
) -> None:
    """Print a recording's table."""
    known = known_errors(data)
    told = {name: value for name, value in known.items() if name in APPLIED}
    say(f"\n**{data.name}** (fitted: {', '.join(f'{k} {v:g}' for k, v in told.items())})\n")
    say(
        "| legs | estimator | along, across, tilt or alignment | held, 1st half | held, 2nd half | "
        "half-width at the end [m] | F1 possmap | bayes | smeared | all wall | true poses |"
    )
    say("|" + " --- |" * 11)
    for orthogonal in (False, True):
        paths = {length: work / f"{length:g}.jsonl" for length in LEGS}
        legs = {n: convert(data, n, orthogonal, known, path, fix) for n, path in paths.items()}
        first = {length: some[: (len(some) + 1) // 2] for length, some in legs.items()}
        axes = 0.0 if orthogonal else found_axes(first[LEGS[0]])
        settings = carried_by(orthogonal, axes)
        chosen = spreads(data, first, settings)
        if not chosen:
            say(f"no choice holds {HELD:.0%} of the first half, orthogonal {orthogonal}")
            continue
        model = ErrorModel(turn_spread=0.0, turn_noise=TURN_NOISE, **chosen)
        carried = {"estimator": settings.estimator, "axes": f"{axes:g}", "max_error": "1"}
        for length, some in legs.items():
            second = some[(len(some) + 1) // 2 :]
            before, _ = held(data, first[length], model, settings)
            share, width = held(data, second, model, settings)
            asked = first[length] if first_half else second
            row = judged(
                data, asked, paths[length], {**chosen, "turn_spread": 0.0}, {**carried, **given}
            )
            name = "heading, --orthogonal" if orthogonal else f"walls, axes {axes:g}°"
            say(
                f"| {length:g} m, {len(asked)} | {name} | "
                f"{' '.join(f'{value:g}' for value in chosen.values())} | {before:.3f} | "
                f"{share:.3f} | {width:.2f} | {' | '.join(row)} |"
            )


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    shared = Path(__file__).parents[3] / "shared/realdata"
    parser.add_argument("--data", type=Path, default=shared, help="the folder of recordings")
    parser.add_argument("--only", choices=["intel", "freiburg-079", "aces"])
    parser.add_argument("--half", choices=["first", "second"], default="second")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", dest="given")
    parser.add_argument("--fix", type=float, metavar="M", help="legs end at known poses, to M")
    options = parser.parse_args()
    if not options.data.is_dir():
        raise SystemExit(f"{options.data}: not here; these recordings are not part of possmap")
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        for one in ("intel", "freiburg-079", "aces"):
            if options.only in (None, one):
                data = intel(options.data) if one == "intel" else spoilt(options.data, one, work)
                given = dict(one.split("=") for one in options.given)
                report(data, work, options.half == "first", given, options.fix)


if __name__ == "__main__":
    main()

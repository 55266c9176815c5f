"""How true maps are: profiles and log-odds grids on the same logs and the same geometry.

Drives teams through worlds, fuses what comes home under each profile and estimator, and holds all
maps against the truth, as `possmap evaluate --beside` does. Prints, as Markdown, the tables of
docs/quality.md: medians over seeds.

    python tests/benchmarks/quality.py [--seeds 20] [--jobs 2] [--worlds maze ...]
        [--geometry walls heading] [--profiles robust paper]
    python tests/benchmarks/quality.py --variants [--seeds 4]
    python tests/benchmarks/quality.py --nights 60 [--house office] [--broken 25] [--keep DIR]

With --variants one office is judged as it is, with worse sensors, thick or slanted walls, and
fused under wrong axes. With --nights three robots go out every night in one house, all into one
grid; --broken breaks the wheels of r3 from that night on, and --keep leaves the grids there, for
`possmap audit`. Worlds
marked * had a say in choosing settings. Floor plans are taken from ../shared where it is there,
and left out where it is not.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from possmap.fusing.fuse import fuse
from possmap.lab.evaluate.bayes import LogOddsSettings
from possmap.lab.evaluate.distance import squared_distances
from possmap.lab.evaluate.methods import Baselines
from possmap.lab.evaluate.results import Evaluation
from possmap.lab.evaluate.run import Question, evaluate
from possmap.lab.simulate.run import simulate
from possmap.settings.request import Request
from possmap.settings.setting_table import parse_setting
from possmap.truth.plans import read_image

ROOT = Path(__file__).parents[2]
MISSIONS = ROOT / "configs" / "missions"
PLANS = ROOT.parent / "shared" / "realdata" / "worlds"
PIXEL_M = 0.05
CLEAR_M = 1.0
"""Between home and the nearest wall of a floor plan."""


@dataclass(frozen=True)
class World:
    """Where a team drives.

    mission : a shipped one, which also says how many robots; more : keys that differ.
    plan : the image of a floor plan that takes the place of the mission's world.
    thickness : its walls are drawn so thick, as an image [m]; None leaves them lines.
    slant : and its horizontal walls rise by so much per metre.
    settings : of fuse.
    """

    name: str
    mission: str
    more: tuple[tuple[str, str], ...] = ()
    plan: str = ""
    thickness: float | None = None
    slant: float = 0.0
    settings: tuple[tuple[str, str], ...] = ()


WORLDS = (
    World("figure8 *", "figure8"),
    World("office *", "office"),
    World("office, seed 21 *", "office", (("world.seed", "21"), ("world.size", "[24, 24]"))),
    World("maze", "maze"),
    World("drops", "drops"),
    World("office, seed 8", "office", (("world.seed", "8"), ("world.size", "[40, 25]"))),
    World("office, seed 9", "office", (("world.seed", "9"), ("world.size", "[25, 16]"))),
    World("plan Freiburg79", "office", plan="Freiburg79_scan.png"),
    World("plan lab_c", "office", plan="lab_c_scan.png"),
    World("plan office_a", "office", plan="office_a.png"),
    World("plan NLB", "office", plan="NLB.png"),
)

OFFICE = (("world.seed", "9"), ("world.size", "[25, 16]"))
VARIANTS = (
    World("as it is", "office", OFFICE),
    World("IR noise of 3 cm", "office", (*OFFICE, ("ir_noise", "0.03"))),
    World("lining up off by 2°", "office", (*OFFICE, ("alignment_spread", "2"))),
    World(
        "the same, said", "office", (*OFFICE, ("alignment_spread", "2")),
        settings=(("alignment_spread", "2"),),
    ),
    World("axes off by 1°", "office", OFFICE, settings=(("axes", "1"),)),
    World("walls 0.05 m thick", "office", OFFICE, thickness=0.05),
    World("walls 0.1 m thick", "office", OFFICE, thickness=0.1),
    World("walls 0.15 m thick", "office", OFFICE, thickness=0.15),
    World("half of the walls slanted by 3°", "office", OFFICE, thickness=0.1, slant=0.0524),
    World("half of the walls slanted by 10°", "office", OFFICE, thickness=0.1, slant=0.176),
)  # fmt: skip

GEOMETRIES: Mapping[str, Mapping[str, str]] = {
    "walls": {"estimator": "walls", "orthogonal": "true", "turn_noise": "0.7"},
    "heading": {"estimator": "heading", "turn_noise": "0.7"},
}
PROFILES = ("robust", "paper")
TUNED = Baselines(smeared=LogOddsSettings(free=0.2))
"""Of hit 0.4, 0.85, 1.7 and free 0.1 to 0.8 what ranked best on the worlds marked *."""

MEASURES = {
    "F1 15 cm": "f1_15cm", "F1 5 cm": "f1_5cm", "AUC": "auc", "walls called free": "dangerous_free",
    "floor called free": "called_free", "at equal floor": "dangerous_at_equal_floor",
}  # fmt: skip
OF_GRIDS = ("rectangles hold", "half-width [m]", "contested")

Scores = dict[str, dict[str, float]]
"""By method, such as ``robust, walls``, and measure."""


def request(profile: str, geometry: str, more: Mapping[str, str] | None = None) -> Request:
    """Return what to ask of fuse."""
    given = {**GEOMETRIES[geometry], **(more or {})}
    parsed = {name: parse_setting(name, text, "--set") for name, text in given.items()}
    return Request(profile=profile, overrides=parsed)


def home_of(plan: Path) -> tuple[float, float]:
    """Return a place of a plan with room around it, as near to its middle as can be."""
    free = read_image(plan, PIXEL_M).free
    reach = round(CLEAR_M / PIXEL_M)
    roomy = np.argwhere(squared_distances(~np.pad(free, reach), reach) > reach**2) - reach
    middle = roomy.mean(axis=0)
    row, column = roomy[np.argmin(((roomy - middle) ** 2).sum(axis=1))].tolist()
    return (column + 0.5) * PIXEL_M, (row + 0.5) * PIXEL_M


def drawn(world: World, image: Path) -> str:
    """Draw a world with thick or slanted walls; return it as a mission's ``world``."""
    with tempfile.TemporaryDirectory() as name:
        simulate(
            MISSIONS / f"{world.mission}.yaml",
            Path(name) / "out",
            {**dict(world.more), "minutes": "0.1"},
        )
        told = json.loads((Path(name) / "out" / "truth.json").read_text())
    walls = np.array(told["walls"]).reshape(-1, 2, 2)
    walls[..., 1] += world.slant * walls[..., 0]
    low = walls.min(axis=(0, 1)) - 1.0
    columns, rows = np.ceil((walls.max(axis=(0, 1)) + 1.0 - low) / PIXEL_M).astype(int).tolist()
    plan = Image.new("L", (columns, rows), 255)
    thick = max(1, round((world.thickness or PIXEL_M) / PIXEL_M))
    for pixels in np.floor((walls - low) / PIXEL_M).tolist():
        (x0, y0), (x1, y1) = pixels
        ImageDraw.Draw(plan).line([x0, rows - 1 - y0, x1, rows - 1 - y1], fill=0, width=thick)
    plan.save(image)
    (x, y) = told["home"]
    home = [x, y + world.slant * x]
    return f"{{image: {image}, resolution: {PIXEL_M}, origin: {low.tolist()}, home: {home}}}"


def drive(world: World, folder: Path, given: Mapping[str, str]) -> int:
    """Drive a mission into a folder; return how many excursions came home."""
    mission, given = MISSIONS / f"{world.mission}.yaml", {**dict(world.more), **given}
    plan = ""
    if world.thickness is not None:
        plan = drawn(world, folder.with_suffix(".png"))
        given = {key: value for key, value in given.items() if not key.startswith("world.")}
    elif world.plan:
        x, y = home_of(PLANS / world.plan)
        plan = f"{{image: {PLANS / world.plan}, resolution: {PIXEL_M}, home: [{x}, {y}]}}"
    if plan:
        lines = {"robots": "6", **given, "world": plan}
        mission, given = folder.with_suffix(".yaml"), {}
        mission.write_text("".join(f"{key}: {value}\n" for key, value in lines.items()))
    return simulate(mission, folder, given).home


def scores_of(found: Evaluation, names: Sequence[str], geometry: str) -> Scores:
    """Return every method's scores; the grids by their names, the baselines by their own."""
    scores: Scores = {}
    called = dict(zip(found.grids, names, strict=True))
    for key, method in found.methods.items():
        name = f"{called.get(key, key)}, {geometry}"
        told = {title: getattr(method, field) for title, field in MEASURES.items()}
        grid = found.grids.get(key)
        if grid is not None:
            told["contested"] = grid.contested
            if grid.rectangles is not None:
                told["rectangles hold"] = grid.rectangles.coverage
                told["half-width [m]"] = grid.rectangles.mean_half_width
        scores[name] = {title: value for title, value in told.items() if value is not None}
    return scores


def one_mission(
    world: World,
    calibrated: bool,
    geometries: Sequence[str],
    profiles: Sequence[str],
    seed: int,
) -> Scores:
    """Drive, fuse and judge one mission; empty if nobody came home."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "out"
        told = {"seed": str(seed), "calibrated": str(calibrated).lower()}
        if not drive(world, folder, told):
            return {}
        scores: Scores = {}
        for geometry in geometries:
            grids = [Path(name) / f"{profile}-{geometry}.possmap" for profile in profiles]
            for profile, grid in zip(profiles, grids, strict=True):
                fuse([str(folder / "logs")], grid, request(profile, geometry, dict(world.settings)))
            question = Question(beside=tuple(grids[1:]), baselines=TUNED)
            found = evaluate(grids[0], folder / "truth.json", question)
            scores |= scores_of(found, profiles, geometry)
        return scores


def medians(outcomes: Sequence[Scores]) -> Scores:
    """Return the median over missions of every measure; rectangles count by the mean."""
    found: Scores = {}
    for method in outcomes[0]:
        columns: dict[str, list[float]] = {}
        for outcome in outcomes:
            for title, value in outcome.get(method, {}).items():
                columns.setdefault(title, []).append(value)
        found[method] = {
            title: (statistics.mean if title == "rectangles hold" else statistics.median)(values)
            for title, values in columns.items()
        }
    return found


def table(first: str, rows: Iterable[tuple[str, Mapping[str, float]]]) -> Iterator[str]:
    """Yield the lines of a table, a row for each method, world or night."""
    titles = (*MEASURES, *OF_GRIDS)
    yield f"| {first} | {' | '.join(titles)} |"
    yield f"|{' --- |' * (len(titles) + 1)}"
    for name, told in rows:
        cells = (f"{told[title]:.3f}" if title in told else "" for title in titles)
        yield f"| {name} | {' | '.join(cells)} |"
    yield ""


def worlds_study(options: argparse.Namespace) -> None:
    """Print a table for each world, and one over all of them."""
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    with ProcessPoolExecutor(options.jobs) as pool:
        for calibrated in (True, False):
            say(f"## Robots {'' if calibrated else 'not '}calibrated", "")
            every: dict[str, Scores] = {}
            for world in VARIANTS if options.variants else WORLDS:
                if options.worlds and not any(one in world.name for one in options.worlds):
                    continue
                if world.plan and not (PLANS / world.plan).exists():
                    say(f"**{world.name}**: left out, since ../shared is not there", "")
                    continue
                study = partial(one_mission, world, calibrated, options.geometry, options.profiles)
                outcomes = list(pool.map(study, seeds))
                outcomes = [one for one in outcomes if one]
                if not outcomes:
                    continue
                every[world.name] = medians(outcomes)
                say(f"**{world.name}**: {len(outcomes)} missions, medians", "")
                say(*table("method", every[world.name].items()))
            if every:
                say("**All worlds**: means of their medians", "")
                say(*table("method", means(list(every.values())).items()))
                say(*winners(every, options.geometry))


def means(worlds: Sequence[Scores]) -> Scores:
    """Return the mean over worlds of every measure."""
    return {
        method: {
            title: statistics.mean(one[method][title] for one in worlds if title in one[method])
            for title in told
        }
        for method, told in worlds[0].items()
    }


def winners(every: Mapping[str, Scores], geometries: Sequence[str]) -> Iterator[str]:
    """Yield on how many worlds robust is first among the methods of each geometry."""
    for geometry in geometries:
        for title in ("F1 15 cm", "AUC"):
            behind = {}
            for world, scores in every.items():
                rivals = [
                    told[title]
                    for method, told in scores.items()
                    if method.startswith("bayes") and method.endswith(geometry)
                ]
                gap = max(rivals) - scores[f"robust, {geometry}"][title]
                if gap > 0:
                    behind[world] = gap
            told_gaps = ", ".join(f"{world} by {gap:.3f}" for world, gap in behind.items())
            yield (
                f"- {title} on {geometry}' geometry: robust is first on "
                f"{len(every) - len(behind)} of {len(every)} worlds"
                + (f", behind on {told_gaps}" if behind else "")
            )
    yield ""


def nights_study(options: argparse.Namespace) -> None:
    """Print how a map fares that grows night by night."""
    (house,) = (world for world in WORLDS if world.name.rstrip(" *") == options.house)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(options.keep or name)
        folder.mkdir(parents=True, exist_ok=True)
        grids = {geometry: folder / f"{geometry}.possmap" for geometry in options.geometry}
        truth: dict[str, object] = {"possmap_truth": 1, "walls": [], "robots": [], "meetings": []}
        rows: dict[str, list[tuple[str, Mapping[str, float]]]] = {}
        for night in range(1, options.nights + 1):
            logs = folder / f"night-{night:02d}"
            one_night(house, night, logs, truth, options)
            for geometry, grid in grids.items():
                fuse([str(logs)], grid, request("robust", geometry))
            if night not in (1, 10, 30, 45, 60, options.nights):
                continue
            (folder / "truth.json").write_text(json.dumps(truth))
            for geometry, grid in grids.items():
                found = evaluate(grid, folder / "truth.json", Question(baselines=TUNED))
                for method, told in scores_of(found, ["robust"], geometry).items():
                    rows.setdefault(method, []).append((f"{night}", told))
                if options.keep:
                    shutil.copy(grid, folder / f"{geometry}-after-{night}.possmap")
        for method, told_rows in rows.items():
            say(f"**{method}**, {house.name}", "", *table("night", told_rows))


def one_night(
    house: World, night: int, logs: Path, truth: dict[str, object], options: argparse.Namespace
) -> None:
    """Drive one night's mission; write its logs, and add what is true to the truth.

    Excursions are named after the night. The broken robot's come from a mission of the same seed
    in which all wheels are as worn as its own.
    """
    broken = options.broken is not None and night >= options.broken
    robots: list[object] = truth["robots"]  # type: ignore[assignment]
    logs.mkdir()
    for worn in (False, True) if broken else (False,):
        with tempfile.TemporaryDirectory() as name:
            out = Path(name) / "out"
            given = {"seed": str(options.first_seed + night), "robots": "3", "exchange": "false"}
            if not options.calibrated:
                given["calibrated"] = "false"
            drive(house, out, {**given, **({"drift": "4.0", "turn_noise": "3.0"} if worn else {})})
            told = json.loads((out / "truth.json").read_text())
            truth.update(walls=told["walls"], home=told["home"])
            for path in sorted((out / "logs").iterdir()):
                log = json.loads(path.read_text())
                if not broken or (log["robot"] == "r3") == worn:
                    log["excursion"] = f"n{night:02d}-{log['excursion']}"
                    (logs / f"{log['robot']}-{path.name}").write_text(json.dumps(log))
            for one in told["robots"]:
                if not broken or (one["robot"] == "r3") == worn:
                    robots.append({**one, "excursion": f"n{night:02d}-{one['excursion']}"})


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
    parser.add_argument("--variants", action="store_true", help="one office, and what is odd")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=101)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--nights", type=int, help="the study of so many nights in one house")
    parser.add_argument("--house", default="office", help="where, one of the worlds")
    parser.add_argument("--geometry", nargs="*", default=["walls"], choices=[*GEOMETRIES])
    parser.add_argument("--profiles", nargs="*", default=["robust"], choices=PROFILES)
    parser.add_argument("--broken", type=int, metavar="NIGHT", help="r3's wheels from then on")
    parser.add_argument("--calibrated", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--keep", help="a new folder for the grids and logs of the nights")
    options = parser.parse_args()
    (nights_study if options.nights else worlds_study)(options)


if __name__ == "__main__":
    main()

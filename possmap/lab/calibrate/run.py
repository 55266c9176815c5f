"""``possmap calibrate``: how wrong robots are, from trials, and the model that says so."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from possmap.atomic import check_output, replacing_all
from possmap.core.model import ErrorModel
from possmap.errors import MissingExtra, OutputError, PossmapError, printable
from possmap.lab.calibrate.cutting import TrueTrack, cut, turned
from possmap.lab.calibrate.heading import TERMS
from possmap.lab.calibrate.inputs import TRUTH, Material, of_simulation, of_tables
from possmap.lab.calibrate.model import fit_model
from possmap.lab.calibrate.outliers import without_slips
from possmap.lab.calibrate.recordings import RecordingsRequest, of_recordings
from possmap.lab.calibrate.rectangles import Errors, LegScore, held_legs
from possmap.lab.calibrate.results import Calibration, RobotResult
from possmap.lab.calibrate.robots import calibrate
from possmap.lab.calibrate.variance_ratio import for_tracks
from possmap.release import version
from possmap.settings.settings_yaml import model_yaml


class CalibrationError(PossmapError):
    """Trials of which nothing can be made."""


@dataclass(frozen=True, kw_only=True)
class CalibrationRequest:
    """What ``possmap calibrate`` is asked for.

    Attributes
    ----------
    recordings
        How the inputs are read, if they are recordings; None: trials, or a simulated team's folder.
    seed
        Of folds and of Lilliefors' table.
    lengths
        Of the legs that recordings are held against [m].
    start_error
        How wrong the truth may be where a leg begins: half-widths x, y [m], heading [deg].
    """

    recordings: RecordingsRequest | None = None
    seed: int = 1
    lengths: tuple[float, ...] = (10.0, 20.0, 40.0)
    start_error: Errors = (0.0, 0.0, 0.0)


def calibrate_files(
    paths: Sequence[Path],
    output: Path,
    request: CalibrationRequest | None = None,
    *,
    picture: Path | None = None,
    overwrite: bool = False,
    progress: Callable[[int, str], Any] | None = None,
) -> Calibration:
    """Calibrate robots, write their model, and draw a report if a picture is asked for.

    Raises
    ------
    MissingExtra
        Without SciPy.
    LogError, RecordingError, SettingsError
        If an input cannot be read.
    CalibrationError
        If no robot has enough trials.
    OutputError
        If an output exists, or cannot be written.
    """
    request = request or CalibrationRequest()
    if importlib.util.find_spec("scipy") is None:
        raise MissingExtra("possmap calibrate", "calibrate")
    _check(output, picture, overwrite)
    _refuse_twice(paths)
    material = _material(paths, request, progress)
    rng = np.random.default_rng(request.seed)
    found = calibrate(material.trials, rng, material.notes, material.pool)
    if not found.robots:
        reasons = "; ".join(f"{robot}: {why}" for robot, why in found.refused.items())
        raise CalibrationError(f"{printable(str(paths[0]))}: {reasons or 'gave no trials'}")
    found = _with_tracks(found, material, request)
    with replacing_all([output] if picture is None else [output, picture], overwrite) as streams:
        streams[0].write(as_yaml(found, paths).encode())
        if picture is not None:
            from possmap.lab.calibrate.report import sheet
            from possmap.pictures.palettes import write_png

            write_png(sheet(found), streams[1], {"Software": f"possmap {version()}"})
    return found


def _check(output: Path, picture: Path | None, overwrite: bool) -> None:
    """Refuse outputs that cannot be written, before the work and not after it."""
    if output.suffix.lower() not in (".yaml", ".yml"):
        raise OutputError(f"{printable(str(output))}: expected a name that ends in .yaml")
    check_output(output, overwrite)
    if picture is not None:
        if picture.suffix.lower() != ".png":
            raise OutputError(f"{printable(str(picture))}: expected a name that ends in .png")
        check_output(picture, overwrite)


def _refuse_twice(paths: Sequence[Path]) -> None:
    """Refuse an input that is given twice: its trials would count twice, and limits be narrow."""
    seen: set[Path] = set()
    for path in paths:
        real = path.resolve()
        if real in seen:
            raise CalibrationError(f"{printable(str(path))}: is given twice, expected it once")
        seen.add(real)


def _material(
    paths: Sequence[Path], request: CalibrationRequest, progress: Callable[[int, str], Any] | None
) -> Material:
    if request.recordings is not None:
        return of_recordings(paths, request.recordings, progress)
    folders = [path for path in paths if path.is_dir()]
    for folder in folders:
        if not (folder / TRUTH).is_file():
            raise CalibrationError(
                f"{printable(str(folder))}: is a folder without {TRUTH}, expected one that "
                "possmap simulate wrote"
            )
    tables = [path for path in paths if not path.is_dir()]
    for path in tables:
        if path.suffix.lower() not in (".csv", ".gz", ".txt"):
            raise CalibrationError(
                f"{printable(str(path))}: expected trials (.csv), a folder of possmap simulate, or "
                "recordings with --mapping or --truth-recording"
            )
    parts = [of_simulation(folder) for folder in folders]
    parts += [of_tables(tables)] if tables else []
    whole = Material([])
    for part in parts:
        whole.trials.extend(part.trials)
        whole.walls.update(part.walls)
        whole.notes.extend(part.notes)
    return whole


def _with_tracks(
    found: Calibration, material: Material, request: CalibrationRequest
) -> Calibration:
    """Add what only tracks and walls tell: held-out legs, the sensor, how robots line up."""
    robots = []
    for one in found.robots:
        walls = material.walls.get(one.robot, {})
        mount = material.mounts.get(one.robot, 0.0)
        leftover = dict(one.leftover) | ({"mount_deg": mount} if mount else {})
        parameters = dict(one.parameters) | {
            name: told.model for name, told in walls.items() if told.model is not None
        }
        outings = [outing for outing in material.outings if outing.robot == one.robot]
        robots.append(
            replace(
                one,
                parameters=parameters,
                estimates=dict(one.estimates) | walls,
                leftover=leftover,
                legs=tuple(_legs(one, outings, mount, request)),
            )
        )
    pooled = found.pooled
    if pooled is not None and material.walls:
        # One sensor stands for all: the worst, since nobody knows which robot comes next.
        parameters = dict(pooled.parameters)
        for name in ("sensor", "alignment_spread"):
            models = [one.parameters[name] for one in robots if name in one.parameters]
            if models:
                parameters[name] = max(models)
        pooled = replace(pooled, parameters=parameters)
    return replace(found, robots=tuple(robots), pooled=pooled)


def _legs(
    robot: RobotResult,
    outings: Sequence[TrueTrack],
    mount: float,
    request: CalibrationRequest,
) -> Iterable[LegScore]:
    """Hold each half of the way against a model of the other half."""
    blocks = _halves(outings)
    if len(blocks) < 2:
        return
    terms = frozenset(TERMS) - set(robot.left_out)
    whole = robot.parameters.keys()
    judged: list[tuple[TrueTrack, ErrorModel]] = []
    for number, block in enumerate(blocks):
        others = [one for k, part in enumerate(blocks) if k != number for one in part]
        trials, _ = without_slips(turned([t for one in others for t in cut(one)], mount))
        fit, _ = for_tracks(fit_model(trials, terms), trials)
        if not {"along", "across"} <= fit.parameters.keys() or not fit.parameters.keys() <= whole:
            return
        judged += [(one, fit.model) for one in block]
    for length in request.lengths:
        for estimator in ("heading", "linear"):
            told = held_legs(judged, estimator, length, request.start_error, mount)
            if told is not None:
                yield told


def _halves(outings: Sequence[TrueTrack]) -> list[list[TrueTrack]]:
    """Return tracks in two halves of about the same way; one that lies across is cut."""
    total = sum(float(one.way[-1]) for one in outings)
    first: list[TrueTrack] = []
    second: list[TrueTrack] = []
    gone = 0.0
    for one in outings:
        way = one.way
        middle = int(np.searchsorted(way, total / 2 - gone))
        if middle >= len(way) - 1:
            first.append(one)
        elif middle < 1:
            second.append(one)
        else:
            first.append(one.part(0, middle + 1))
            second.append(one.part(middle, len(way)))
        gone += float(way[-1])
    return [part for part in (first, second) if part]


def as_yaml(found: Calibration, paths: Sequence[Path]) -> str:
    """Return the model as a settings file."""
    general: Mapping[str, float] = {}
    first = "Nothing is said of robots that are not named below."
    if found.pooled is not None:
        general = found.pooled.parameters
        first = "What stands first is for robots not named below: all calibrated ones, pooled."
    elif len(found.robots) == 1:
        general = found.robots[0].parameters
        first = "What stands first is for robots not named below: as if they were this one."
    names = ", ".join(printable(path.name) for path in paths[:5])
    more = f" and {len(paths) - 5} more" if len(paths) > 5 else ""
    comments = [
        f"Made by possmap calibrate {version()} from {names}{more}.",
        "Use it with: possmap fuse LOG... -g SITE.possmap --config THIS_FILE",
        "Known parts are true minus logged; half-widths hold 95 % of new runs (docs/calibrate.md).",
        first,
    ]
    robots = {one.robot: one.parameters for one in found.robots}
    return model_yaml(general, robots, comments)

"""``possmap calibrate``: how wrong robots are, from trials, and the model that says so."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from possmap.atomic import check_output, replacing_all
from possmap.core.model import ErrorModel
from possmap.errors import MissingExtra, OutputError, PossmapError, SettingsError, printable
from possmap.lab.calibrate.cutting import TrueTrack, cut, turned
from possmap.lab.calibrate.estimates import for_tracks
from possmap.lab.calibrate.heading import TERMS
from possmap.lab.calibrate.held_out import Errors, LegScore, Score, held_legs, hold
from possmap.lab.calibrate.inputs import TRUTH, Material, add_simulation, add_tables
from possmap.lab.calibrate.model import fit_model
from possmap.lab.calibrate.odd import without_slips
from possmap.lab.calibrate.recordings import RecordingsRequest, of_recordings
from possmap.lab.calibrate.robots import Calibration, RobotResult, calibrate
from possmap.lab.convert.request import models_of
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
    leave_out
        Places of trials that are not to count, as messages name them, or their ends.
    keep_slips
        Whether trials far off all others count like any.
    """

    recordings: RecordingsRequest | None = None
    seed: int = 1
    lengths: tuple[float, ...] = (10.0, 20.0, 40.0)
    start_error: Errors = (0.0, 0.0, 0.0)
    leave_out: tuple[str, ...] = ()
    keep_slips: bool = False


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
    for path, suffixes in ((output, (".yaml", ".yml")), (picture, (".png",))):
        if path is not None:  # before the work and not after it
            if path.suffix.lower() not in suffixes:
                name = printable(str(path))
                raise OutputError(f"{name}: expected a name that ends in {suffixes[0]}")
            check_output(path, overwrite)
    material = _material(paths, request, progress)
    rng = np.random.default_rng(request.seed)
    found = calibrate(material.trials, rng, material.pool, request.keep_slips)
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


class Judgement(NamedTuple):
    """How a model fares on trials of one robot that it has not seen.

    heading, linear : under each estimator. legs : of recordings.
    """

    robot: str
    heading: Score
    linear: Score
    legs: tuple[LegScore, ...]


def check_files(
    model: Path,
    paths: Sequence[Path],
    request: CalibrationRequest | None = None,
    progress: Callable[[int, str], Any] | None = None,
) -> tuple[list[Judgement], list[str]]:
    """Hold trials, or recordings beside their truth, against an existing model.

    Returns
    -------
    judgements, notes
        One of each robot; and what is odd about the inputs.

    Raises
    ------
    MissingExtra, LogError, RecordingError, SettingsError, CalibrationError
        As ``calibrate_files``; and if the model cannot be read.
    """
    request = request or CalibrationRequest()
    models = models_of(model, {})
    material = _material(paths, request, progress)
    found = []
    for robot in dict.fromkeys(one.robot for one in material.trials):
        own = ErrorModel(**models.of(robot))
        if models.is_silent_on(robot):
            material.notes.append(
                f"{printable(str(model))}: says nothing of {robot}, so the defaults are judged; "
                f"expected --robot with one of {', '.join(models.robots)}"
            )
        trials = [one for one in material.trials if one.robot == robot]
        tracks = [(one, own) for one in material.outings if one.robot == robot]
        legs = held_legs(
            tracks, request.lengths, request.start_error, material.mounts.get(robot, 0.0)
        )
        heading, linear = (hold(trials, [(None, own)], one).score for one in ("heading", "linear"))
        found.append(Judgement(robot, heading, linear, tuple(legs)))
    return found, material.notes


def _material(
    paths: Sequence[Path], request: CalibrationRequest, progress: Callable[[int, str], Any] | None
) -> Material:
    """Read the inputs, and leave out what is asked to be."""
    if importlib.util.find_spec("scipy") is None:
        raise MissingExtra("possmap calibrate", "calibrate")
    seen: set[Path] = set()
    for path in paths:  # or its trials would count twice, and limits be narrow
        if path.resolve() in seen:
            raise CalibrationError(f"{printable(str(path))}: is given twice, expected it once")
        seen.add(path.resolve())
    if request.recordings is not None:
        found = of_recordings(paths, request.recordings, progress)
    else:
        found = Material()
        for path in paths:
            name = printable(str(path))
            if path.is_dir() and not (path / TRUTH).is_file():
                raise CalibrationError(
                    f"{name}: is a folder without {TRUTH}, expected one that possmap simulate wrote"
                )
            if not path.is_dir() and path.suffix.lower() not in (".csv", ".gz", ".txt"):
                raise CalibrationError(
                    f"{name}: expected trials (.csv), a folder of possmap simulate, or recordings "
                    "with --mapping or --truth-recording"
                )
        for path in filter(Path.is_dir, paths):
            add_simulation(found, path)
        add_tables(found, [path for path in paths if not path.is_dir()])
    for name in request.leave_out:
        ends = (f":{name}", f"/{name}", f" {name}")
        which = [one for one in found.trials if one.place == name or one.place.endswith(ends)]
        if not which:
            some = ", ".join(one.place for one in found.trials[:2])
            raise SettingsError(
                f"--leave-out, found {printable(name)}, which names no trial, expected one such as "
                f"{printable(some)}"
            )
        found.trials[:] = [one for one in found.trials if one not in which]
        found.notes.append(f"left out: {', '.join(one.place for one in which)}")
    return found


def _with_tracks(
    found: Calibration, material: Material, request: CalibrationRequest
) -> Calibration:
    """Add what only tracks and walls tell: held-out legs, the sensor, how robots line up."""
    robots = []
    for one in found.robots:
        walls = material.walls.get(one.robot, {})
        told = {name: own.model for name, own in walls.items() if own.model is not None}
        mount = material.mounts.get(one.robot, 0.0)
        outings = [outing for outing in material.outings if outing.robot == one.robot]
        judged = _halves_judged(one, outings, mount, request.keep_slips)
        robots.append(
            replace(
                one,
                parameters={**one.parameters, **told},
                estimates={**one.estimates, **walls},
                mount=mount,
                legs=tuple(held_legs(judged, request.lengths, request.start_error, mount)),
            )
        )
    pooled = found.pooled
    if pooled is not None and material.walls:
        # One sensor stands for all: the worst, since nobody knows which robot comes next.
        parameters = dict(pooled.parameters)
        for name in ("sensor", "alignment_spread"):
            models = [one.parameters[name] for one in robots if name in one.parameters]
            parameters |= {name: max(models)} if models else {}
        pooled = replace(pooled, parameters=parameters)
    notes = (*material.notes, *found.notes)
    return replace(found, robots=tuple(robots), pooled=pooled, notes=notes)


def _halves_judged(
    robot: RobotResult, outings: Sequence[TrueTrack], mount: float, keep_slips: bool
) -> list[tuple[TrueTrack, ErrorModel]]:
    """Return the tracks of each half of the way, with a model of the other half's."""
    halves = list(_halves(outings))
    terms = frozenset(TERMS) - set(robot.dropped)
    judged: list[tuple[TrueTrack, ErrorModel]] = []
    for block, others in (halves, halves[::-1]):
        trials = turned([trial for one in others for trial in cut(one)], mount)
        if not trials or not block:
            return []
        trials = trials if keep_slips else without_slips(trials)[0]
        fit, _ = for_tracks(fit_model(trials, terms), trials)
        if not {"along", "across"} <= fit.parameters.keys() <= robot.parameters.keys():
            return []
        judged += [(one, fit.model) for one in block]
    return judged


def _halves(outings: Sequence[TrueTrack]) -> tuple[list[TrueTrack], list[TrueTrack]]:
    """Return tracks in two halves of about the same way; one that lies across is cut."""
    left = sum(float(one.way[-1]) for one in outings) / 2
    first: list[TrueTrack] = []
    second: list[TrueTrack] = []
    for one in outings:
        middle = int(np.searchsorted(one.way, left))
        whole = middle >= len(one.way) - 1
        if whole or middle >= 1:
            first.append(one if whole else one.part(0, middle + 1))
        if not whole:
            second.append(one.part(max(0, middle), len(one.way)))
        left -= float(one.way[-1])
    return first, second


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
    robots = {one.robot: dict(one.parameters) for one in found.robots}
    for one in found.robots if found.pooled is not None else ():
        # What a robot does not have is said, or the pooled robots' would be taken for it.
        robots[one.robot] |= {name: float(name == "scale") for name in one.dropped}
    return model_yaml(general, robots, comments)

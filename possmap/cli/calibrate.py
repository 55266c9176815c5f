"""``possmap calibrate``."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.lab.calibrate.estimates import ParameterEstimate
    from possmap.lab.calibrate.held_out import LegScore, Score
    from possmap.lab.calibrate.robots import Calibration, RobotResult
    from possmap.lab.calibrate.run import CalibrationRequest, Judgement

UNITS = {
    "along": "m/m", "across": "m/m", "turn_bias": "deg/45", "turn_gain": "", "turn_noise": "deg/45",
    "turn_spread": "deg/45", "drift": "deg/m", "drift_spread": "deg/m", "scale": "",
    "sensor": "m", "alignment_spread": "deg",
}  # fmt: skip


def _floats(text: str, count: int | None, what: str) -> tuple[float, ...]:
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    sound = all(0 <= value <= 1e6 for value in found)
    if not found or not sound or (count is not None and len(found) != count):
        raise click.BadParameter(f"found {text!r}, expected {what}")
    return found


@click.command(epilog="Example: possmap calibrate data/trials.csv -o model.yaml")
@click.argument(
    "trials", nargs=-1, required=True, metavar="TRIALS...",
    type=click.Path(exists=True, path_type=Path),
)  # fmt: skip
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="MODEL.yaml",
    help="The model, for fuse --config.",
)  # fmt: skip
@click.option(
    "--check", "model", type=options.EXISTING_FILE, metavar="MODEL.yaml",
    help="Make no model: hold TRIALS, or recordings, against this one.",
)  # fmt: skip
@click.option(
    "--picture", type=click.Path(path_type=Path), metavar="OUT.png", help="Draw a report."
)
@click.option(
    "--mapping", metavar="FILE|NAME",
    help="Recordings: which columns are the odometry; a YAML file, or one that possmap ships.",
)  # fmt: skip
@click.option(
    "--pose", "pose_of", type=click.Choice(["odometry", "laser"]), default="odometry",
    show_default=True, help="Recordings of CARMEN: which pose is the odometry.",
)  # fmt: skip
@click.option(
    "--truth-recording", "truth", multiple=True, metavar="FILE",
    type=click.Path(exists=True, path_type=Path),
    help="Where the robot truly was: one for all recordings, or one for each.  "
    "[default: the recording itself]",
)  # fmt: skip
@click.option("--truth-mapping", metavar="FILE|NAME", help="Which of its columns are the truth.")
@click.option(
    "--truth-pose", type=click.Choice(["odometry", "laser"]), help="Its pose, if it is of CARMEN."
)
@click.option("--robot", metavar="NAME", help="Whose the recordings are.  [default: the file's]")
@click.option(
    "--legs", default="10,20,40", show_default=True, metavar="M,...",
    callback=lambda ctx, param, value: _floats(value, None, "metres parted by commas"),
    help="Recordings: hold legs so long against a model that has not seen them.",
)  # fmt: skip
@click.option(
    "--start-error", default="0,0,0", show_default=True, metavar="X,Y,DEG",
    callback=lambda ctx, param, value: _floats(value, 3, "X,Y,DEG, half-widths"),
    help="How wrong the truth may be where a leg begins.",
)  # fmt: skip
@click.option(
    "--lag", type=click.FloatRange(-1e6, 1e6), metavar="S",
    help="Recordings: by how many seconds the truth's clock is late.  [default: as found]",
)  # fmt: skip
@click.option(
    "--leave-out", multiple=True, metavar="PLACE",
    help="A trial that is not to count, as messages name it (FILE:LINE or its end); again",
)  # fmt: skip
@click.option("--keep-slips", is_flag=True, help="Let trials far off all others count.")
@click.option(
    "--seed", type=click.IntRange(0, 2**32), default=1, show_default=True,
    help="Of the lots that tests and folds are drawn by.",
)  # fmt: skip
@options.as_json
@options.overwrite
@click.pass_context
def calibrate(
    ctx: click.Context,
    /,
    trials: tuple[Path, ...],
    output: Path | None,
    model: Path | None,
    picture: Path | None,
    as_json: bool,
    overwrite: bool,
    **given: Any,
) -> None:
    """Say how wrong robots are, and write the model that fuse takes.

    TRIALS are CSV files with a row for each trial (robot, manoeuvre, asked distance and turn, and
    the end's error along, across and in heading), folders that possmap simulate wrote, or
    recordings of odometry with a truth beside it. Trials are cut from folders and recordings.
    Needs the extra calibrate. docs/calibrate.md says how to run trials, and what each number
    means.
    """
    from possmap.cli.progress import bytes_read
    from possmap.lab.calibrate.odd import doubts
    from possmap.lab.calibrate.run import calibrate_files, check_files

    if (output is None) == (model is None):
        raise click.UsageError("expected -o MODEL.yaml to make a model, or --check MODEL.yaml")
    request = _request(**given)
    told: dict[str, Any]
    refused: Mapping[str, str] = {}
    scores: Mapping[str, Score | None]
    if model is not None:
        judged, notes = check_files(model, trials, request, bytes_read)
        told = {"model": str(model), "robots": {one.robot: one for one in judged}, "notes": notes}
        scores = {one.robot: one.heading for one in judged}
        lines = [line for one in judged for line in judgement_lines(one)]
    else:
        assert output is not None
        found = calibrate_files(
            trials, output, request, picture=picture, overwrite=overwrite, progress=bytes_read
        )
        notes, refused = list(found.notes), found.refused
        told = to_json(found, output)
        scores = {one.robot: one.heading for one in found.everyone}
        verbose = ctx.obj["verbose"] > 0
        lines = [line for one in found.everyone for line in report_lines(one, found, verbose)]
        lines.append(f"{output}: written")
    if as_json:
        click.echo(to_text(told))
    elif not ctx.obj["quiet"]:
        click.echo("\n".join(lines))
    for note in notes:
        click.echo(f"note: {note}", err=True)
    if as_json or ctx.obj["quiet"]:
        for name, score in scores.items():
            for doubt in doubts(score):
                click.echo(f"{name or 'all together'}: {doubt}", err=True)
    for robot, why in refused.items():
        click.echo(f"possmap: {robot}: {why}", err=True)
    if refused:
        ctx.exit(1)


def _request(
    mapping: str | None,
    pose_of: Any,
    truth: tuple[Path, ...],
    truth_mapping: str | None,
    truth_pose: Any,
    robot: str | None,
    lag: float | None,
    legs: tuple[float, ...],
    **rest: Any,
) -> CalibrationRequest:
    """Return what the options ask for.

    Raises
    ------
    click.UsageError
        For a name that is none.
    """
    from possmap.lab.calibrate.recordings import RecordingsRequest
    from possmap.lab.calibrate.run import CalibrationRequest
    from possmap.lab.recordings import Source, find_mapping, read_mapping
    from possmap.logs.fields import NAME

    if robot is not None and not NAME.fullmatch(robot):
        raise click.BadParameter(
            f"found {robot!r}, expected 1 to 64 characters of A-Z a-z 0-9 . _ : -",
            param_hint="--robot",
        )
    recordings = None
    if mapping or truth or truth_mapping or truth_pose:
        if not truth and not truth_mapping and not truth_pose:
            raise click.UsageError(
                "recordings need a truth, expected --truth-recording, --truth-mapping or "
                "--truth-pose"
            )
        own, of_truth = (
            read_mapping(find_mapping(name)) if name else None
            for name in (mapping, truth_mapping or (mapping if truth else None))
        )
        raw = Source(max_speed=math.inf)  # where the two part in a jump, trials end themselves
        recordings = RecordingsRequest(
            source=dataclasses.replace(raw, mapping=own, pose_of=pose_of),
            truth_source=dataclasses.replace(raw, mapping=of_truth, pose_of=truth_pose or pose_of),
            truth=truth,
            robot=robot,
            lag=lag,
        )
    return CalibrationRequest(recordings=recordings, lengths=legs, **rest)


def to_json(found: Calibration, output: Path) -> dict[str, Any]:
    """Return a calibration as JSON holds it."""
    return {
        "output": str(output),
        "robots": {one.robot: _robot(one) for one in found.robots},
        "pooled": found.pooled and _robot(found.pooled),
        "refused": found.refused,
        "notes": found.notes,
    }


def _robot(one: RobotResult) -> dict[str, Any]:
    from possmap.lab.calibrate.odd import notes
    from possmap.lab.calibrate.words import findings, leftover, plain

    validation = one.validation
    return {
        "trials": len(one.trials),
        "runs": one.fit.heading.runs,
        "turns": one.fit.heading.turns,
        "days": one.fit.days,
        "factor": one.parameters.get("factor"),
        "model": one.parameters,
        "estimates": one.estimates,
        "left_out": one.dropped,
        "tests": one.tests,
        "held_out": validation
        and {
            "heading": one.heading,
            "linear": one.linear,
            "paper": validation.paper,
            "all_terms": validation.full,
            "without": {
                name: worth.without._asdict()
                | {"gain": worth.gain, "error": worth.error, "earned": worth.earned}
                for name, worth in validation.worth.items()
            },
        },
        "legs": one.legs,
        "left_over": leftover(one),
        "plain": plain(one),
        "verdict": tuple(findings(one)),
        "notes": tuple(notes(one)),
    }


def to_text(value: Any) -> str:
    """Return a value as JSON; what JSON has no word for, or is not known, is null."""

    def plain(value: Any) -> Any:
        if dataclasses.is_dataclass(value):
            value = {part.name: getattr(value, part.name) for part in dataclasses.fields(value)}
        elif hasattr(value, "_asdict"):
            value = value._asdict()
        if isinstance(value, Mapping):
            return {key: plain(one) for key, one in value.items()}
        if isinstance(value, list | tuple):
            return [plain(one) for one in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return json.dumps(plain(value))


def report_lines(one: RobotResult, found: Calibration, verbose: bool) -> Iterator[str]:
    """Yield what a robot's trials say: plain words, parameters, tests, and what they mean."""
    from possmap.lab.calibrate.odd import notes, of_robots
    from possmap.lab.calibrate.words import findings, plain, test_words

    heading = one.fit.heading
    factor = one.parameters.get("factor")
    counted = f"{len(one.trials)} trials, {heading.runs} with a run, {heading.turns} with a turn"
    days = f", of {one.fit.days} days" if one.fit.days > 1 and one.robot else ""
    width = "" if factor is None else f"; factor {factor:.3f}"
    yield f"{one.robot or 'all together'}: {counted}{days}{width}"
    yield f"  {plain(one)}"
    yield f"  {'parameter':<17}{'estimate':>10}  {'95 % limits':^21}  {'model':>10}  detects"
    yield from (_row(name, told) for name, told in one.estimates.items())
    yield from (f"  {name:<17} {words}" for name, words in test_words(one))
    yield from (_leg_line(leg, f" ({leg.estimator})") for leg in one.legs if verbose)
    yield from (f"  - {sentence}" for sentence in findings(one))
    yield from (f"  ! {note}" for note in notes(one))
    if not one.robot:
        yield from (f"  ! {note}" for note in of_robots(found.robots))


def judgement_lines(one: Judgement) -> Iterator[str]:
    """Yield how a model fares on trials that it has not seen."""
    from possmap.lab.calibrate.odd import doubts

    for name, score in (("heading", one.heading), ("linear", one.linear)):
        said = []
        if score.trials:
            said.append(
                f"{score.coverage:.0%} of {score.trials} ends inside (asked: 95 %), "
                f"{score.size:.3f} m half-wide"
            )
        if score.headings and name == "heading":
            said.append(
                f"{score.heading_coverage:.0%} of {score.headings} headings within "
                f"±{score.heading_half:.1f} deg (asked: 97 %)"
            )
        if said:
            yield f"{one.robot}: {name}: {', '.join(said)}"
    yield from (_leg_line(leg, "") for leg in one.legs if leg.estimator == "heading")
    yield from (f"  ! {doubt}" for doubt in doubts(one.heading))


def _leg_line(leg: LegScore, more: str) -> str:
    return (
        f"  {f'legs of {leg.length:g} m':<17} {leg.coverage:.0%} of {leg.poses} poses and "
        f"{leg.end_coverage:.0%} of {leg.legs} ends inside, {leg.half_width:.2f} m half-wide "
        f"at the end{more}"
    )


def _row(name: str, told: ParameterEstimate) -> str:
    between = f"[{_number(told.low)}, {_number(told.high)}]"
    row = f"  {name:<17}{_number(told.value):>10}  {between:^21}  {_number(told.model):>10}"
    if told.detectable is not None:
        row += f"  {told.detectable:.2g}"
    return f"{row}  {UNITS[name]}".rstrip()


def _number(value: float | None) -> str:
    if value is None:
        return "left out"
    return "-" if not math.isfinite(value) else f"{value:.4g}"

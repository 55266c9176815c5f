"""``possmap calibrate``."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.lab.calibrate.estimates import ParameterEstimate
    from possmap.lab.calibrate.results import Calibration, RobotResult
    from possmap.lab.calibrate.run import CalibrationRequest

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
    "-o", "--output", required=True, type=click.Path(path_type=Path), metavar="MODEL.yaml",
    help="The model, for fuse --config.",
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
    output: Path,
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
    from possmap.lab.calibrate.run import calibrate_files

    found = calibrate_files(
        trials, output, _request(**given), picture=picture, overwrite=overwrite, progress=bytes_read
    )
    if as_json:
        click.echo(json.dumps(to_json(found, output)))
    elif not ctx.obj["quiet"]:
        report(found, verbose=ctx.obj["verbose"] > 0)
        click.echo(f"{output}: written")
    for note in found.notes:
        click.echo(f"note: {note}", err=True)
    for robot, why in found.refused.items():
        click.echo(f"possmap: {robot}: {why}", err=True)
    if found.refused:
        ctx.exit(1)


def _request(
    mapping: str | None,
    pose_of: Any,
    truth: tuple[Path, ...],
    truth_mapping: str | None,
    truth_pose: Any,
    robot: str | None,
    legs: tuple[float, ...],
    start_error: tuple[float, float, float],
    seed: int,
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
        of_truth = truth_mapping or (mapping if truth else None)
        recordings = RecordingsRequest(
            source=Source(
                mapping=read_mapping(find_mapping(mapping)) if mapping else None, pose_of=pose_of
            ),
            truth_source=Source(
                mapping=read_mapping(find_mapping(of_truth)) if of_truth else None,
                pose_of=truth_pose or pose_of,
            ),
            truth=truth,
            robot=robot,
        )
    return CalibrationRequest(
        recordings=recordings, seed=seed, lengths=legs, start_error=start_error
    )


def to_json(found: Calibration, output: Path) -> dict[str, Any]:
    """Return a calibration as JSON holds it; what is not known is null."""
    whole: dict[str, Any] = _plain(
        {
            "output": str(output),
            "robots": {one.robot: _robot(one) for one in found.robots},
            "pooled": found.pooled and _robot(found.pooled),
            "refused": dict(found.refused),
            "notes": list(found.notes),
        }
    )
    return whole


def _robot(one: RobotResult) -> dict[str, Any]:
    from possmap.lab.calibrate.words import findings

    validation = one.validation
    tests = {
        "normal_along": one.tests.along_normal, "normal_across": one.tests.across_normal,
        "independent": one.tests.independent, "along_proportional": one.tests.along_grows,
        "across_proportional": one.tests.across_grows,
    }  # fmt: skip
    return {
        "trials": len(one.trials),
        "runs": one.fit.heading.runs,
        "turns": one.fit.heading.turns,
        "factor": one.parameters.get("factor"),
        "model": dict(one.parameters),
        "estimates": {name: dataclasses.asdict(told) for name, told in one.estimates.items()},
        "left_out": list(one.left_out),
        "tests": {name: test and dataclasses.asdict(test) for name, test in tests.items()},
        "held_out": validation
        and {
            "heading": dataclasses.asdict(validation.heading),
            "linear": dataclasses.asdict(validation.linear),
            "paper": dataclasses.asdict(validation.paper),
            "all_terms": dataclasses.asdict(validation.full),
            "without": {
                name: dataclasses.asdict(worth.without)
                | {"gain": worth.gain, "error": worth.error, "earned": worth.earned}
                for name, worth in validation.worth.items()
            },
        },
        "legs": [dataclasses.asdict(leg) for leg in one.legs],
        "left_over": dict(one.leftover),
        "verdict": list(findings(one)),
        "notes": list(one.notes),
    }


def _plain(value: Any) -> Any:
    """Return a value without what JSON has no word for."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def report(found: Calibration, verbose: bool) -> None:
    """Print a calibration: parameters, tests, and what they mean."""
    everyone = [*found.robots, *([found.pooled] if found.pooled else [])]
    for one in everyone:
        _report_one(one, verbose)


def _report_one(one: RobotResult, verbose: bool) -> None:
    from possmap.lab.calibrate.words import findings, test_words

    heading = one.fit.heading
    factor = one.parameters.get("factor")
    counted = f"{len(one.trials)} trials, {heading.runs} with a run, {heading.turns} with a turn"
    click.echo(
        f"{one.robot or 'all together'}: {counted}"
        + ("" if factor is None else f"; factor {factor:.3f}")
    )
    click.echo(f"  {'parameter':<17}{'estimate':>10}  {'95 % limits':^21}  {'model':>10}  detects")
    for name, told in one.estimates.items():
        click.echo(_row(name, told))
    for name, words in test_words(one.tests) if heading.runs else ():
        click.echo(f"  {name:<17} {words}")
    for leg in one.legs if verbose else ():
        click.echo(
            f"  {f'legs of {leg.length:g} m':<17} {leg.coverage:.0%} of {leg.poses} poses and "
            f"{leg.end_coverage:.0%} of {leg.legs} ends inside, {leg.half_width:.2f} m half-wide "
            f"at the end ({leg.estimator})"
        )
    for sentence in findings(one):
        click.echo(f"  - {sentence}")
    for note in one.notes:
        click.echo(f"  ! {note}")


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

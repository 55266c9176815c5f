"""``possmap convert``."""

from __future__ import annotations

import json
import math
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.lab.convert.request import ConvertRequest
    from possmap.lab.recordings import Mapping


class _Range(click.FloatRange):
    """Numbers in a range; click lets NaN, which is in none, pass."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = float(super().convert(value, param, ctx))
        if math.isnan(number):
            self.fail(f"{number} is not in the range {self._describe_range()}.", param, ctx)
        return number


def _numbers(text: str, count: int | None, what: str) -> tuple[float, ...]:
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if (
        not found
        or (count is not None and len(found) != count)
        or not all(abs(value) <= 1e6 for value in found)
    ):
        raise click.BadParameter(f"found {text!r}, expected {what}")
    return found


def _errors(ctx: click.Context, param: click.Parameter, value: str) -> Any:
    return _numbers(value, 3, "X,Y,DEGREES")


def _starts(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> Any:
    found = [_errors(ctx, param, one) for one in value]
    return tuple((x, y, math.radians(heading)) for x, y, heading in found)


def _fixes(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> Any:
    from possmap.lab.convert.legs import KnownPlace

    found = []
    for text in value:
        where, _, said = text.partition("=")
        place, _, half = said.replace("±", "").rpartition(",")
        first, _, second = place.partition(",")
        try:
            error = float(half)
            match where.strip().lower(), place:
                case "end", "reference":
                    known = KnownPlace(error)
                case "end", _:
                    known = KnownPlace(error, place=(float(first), float(second)))
                case "columns", _ if first and second:
                    known = KnownPlace(error, columns=(first.strip(), second.strip()))
                case _:
                    raise ValueError
            if not (0 < error <= 1e6 and all(abs(one) <= 1e6 for one in known.place or ())):
                raise ValueError
        except ValueError:
            expected = "end=X,Y,±M, end=reference,±M or columns=X,Y,±M with M > 0"
            raise click.BadParameter(f"found {text!r}, expected {expected}") from None
        found.append(known)
    return tuple(found)


def _radians(ctx: click.Context, param: click.Parameter, value: float) -> float:
    return math.radians(value)


def _angles(ctx: click.Context, param: click.Parameter, value: str) -> Any:
    found = _numbers(value, None, "degrees parted by commas")
    return tuple(math.radians(angle) for angle in found)


@click.command(epilog="Example: possmap convert data/recordings/hall.log -o hall.jsonl")
@click.argument(
    "sources", nargs=-1, required=True, metavar="SOURCE...",
    type=click.Path(exists=True, path_type=Path),
)  # fmt: skip
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), metavar="LOG",
    help="A log (.json, .jsonl, .csv, each also .gz), or a folder of logs.",
)  # fmt: skip
@click.option(
    "--format", type=click.Choice(["carmen", "ros", "csv", "json"]),
    help="Of the sources.  [default: told by what is inside]",
)  # fmt: skip
@click.option(
    "--mapping", metavar="FILE|NAME",
    help="Which columns mean what: a YAML file, or one that possmap ships.",
)  # fmt: skip
@click.option(
    "--topic", "topics", multiple=True, metavar="TOPIC[:ROLE=FIELD,...]",
    help="Bags: a topic to use; how its sensor sits (angle, at_x, at_y), or the fields of messages "
    "that are not of a standard type.",
)  # fmt: skip
@click.option(
    "--clock", type=click.Choice(["header", "bag"]), default="header", show_default=True,
    help="Bags: the time in the messages, or that of the recorder.",
)  # fmt: skip
@click.option(
    "--pose", "pose_of", type=click.Choice(["odometry", "laser"]), default="odometry",
    show_default=True, help="CARMEN: which pose of a laser line to believe.",
)  # fmt: skip
@click.option(
    "--beams", default="-90,0,90", show_default=True, metavar="DEG,...", callback=_angles,
    help="Beams to use, against the heading, left positive.",
)  # fmt: skip
@click.option(
    "--reach", type=_Range(0, 1000, min_open=True), default=2.0, show_default=True,
    metavar="M", help="What is farther off is out of sight.",
)  # fmt: skip
@click.option("--misses/--no-misses", default=False, help="Keep beams that saw nothing, thinned.")
@click.option("--robot", metavar="NAME", help="The robot's name.  [default: the file's]")
@options.places
@click.option("--excursion", metavar="NAME", help="The excursion's name.  [default: 1]")
@click.option(
    "--start", "starts", multiple=True, metavar="X,Y,DEG", callback=_starts,
    help="Where a recording begins, in metres and degrees; once for each source.",
)  # fmt: skip
@click.option(
    "--start-error", "errors", default="0,0,0", show_default=True, metavar="X,Y,DEG",
    callback=_errors, help="How wrong a start may be: half-widths.",
)  # fmt: skip
@click.option(
    "--fix", "fixes", multiple=True, metavar="end=X,Y,±M", callback=_fixes,
    help="Where a recording truly ended, to M metres; once for each source. end=reference,±M: each "
    "excursion ends where the reference has it. columns=X,Y,±M: two columns of the recording say "
    "where the robot truly was, in some rows.",
)  # fmt: skip
@click.option(
    "--reference", type=click.Path(exists=True, path_type=Path), metavar="FILE",
    help="A recording of known poses: excursions begin at them.",
)  # fmt: skip
@click.option("--reference-mapping", metavar="FILE|NAME", help="Its columns, if it has some.")
@click.option(
    "--reference-pose", type=click.Choice(["odometry", "laser"]), default="odometry",
    show_default=True, help="Its pose, if it is of CARMEN.",
)  # fmt: skip
@click.option(
    "--legs", type=_Range(0, 1e6, min_open=True), metavar="M",
    help="Cut into excursions of so many metres.",
)  # fmt: skip
@click.option(
    "--orthogonal", is_flag=True, help="Correct the heading by the building's right angles."
)
@click.option(
    "--align", is_flag=True,
    help="Turn the log's frame onto the building's axes, and say in its model how far walls lean.",
)  # fmt: skip
@click.option(
    "--model", "model_file", type=options.EXISTING_FILE,
    help="A YAML file of error-model parameters; drift, turn_gain and scale are applied.",
)  # fmt: skip
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE",
    help="One parameter of the error model, such as drift=-3.4; again for more.",
)  # fmt: skip
@click.option(
    "--tolerance", type=_Range(0.001, 100), default=0.05, show_default=True,
    metavar="M", help="How far the track of the log may stray.",
)  # fmt: skip
@click.option(
    "--turn-tolerance", type=_Range(0.1, 180), default=15.0, show_default=True,
    metavar="DEG", callback=_radians, help="How far the body's heading may stray between poses.",
)  # fmt: skip
@click.option(
    "--guard", type=_Range(0, 1e6), metavar="M",
    help="Replace steps that differ more from the velocity, if a column has one; 0: never."
    "  [default: 0.05]",
)  # fmt: skip
@click.option(
    "--jump", type=click.Choice(["bridge", "drop", "split"]), default="bridge", show_default=True,
    help="Steps that no robot can make: go on from before, leave out rows until one fits, or begin "
    "an excursion.",
)  # fmt: skip
@click.option(
    "--max-speed", type=_Range(0, 1e6, min_open=True), metavar="M/S",
    help="What is faster is such a step.  [default: what stands out of the recording]",
)  # fmt: skip
@click.option(
    "--echo", type=_Range(0, 1000), default=0.25, show_default=True, metavar="M",
    help="Drop readings this near to the robot's own track within 6 s; 0: never.",
)  # fmt: skip
@click.option(
    "--wall-error", type=_Range(0.001, 10), default=0.06, show_default=True,
    metavar="M", help="How far a reading may lie off its wall.",
)  # fmt: skip
@click.option(
    "--wall-length", type=_Range(0.01, 1000), default=0.3, show_default=True,
    metavar="M", help="The shortest wall.",
)  # fmt: skip
@click.option(
    "--wall-hits", type=click.IntRange(3, 1000), default=4, show_default=True,
    help="The fewest readings on a wall.",
)  # fmt: skip
@options.overwrite
@options.as_json
@click.pass_context
def convert(ctx: click.Context, /, sources: tuple[Path, ...], output: Path, **given: Any) -> None:
    """Turn recordings of robots into logs that fuse takes.

    A SOURCE is a CARMEN log, a ROS 1 or ROS 2 bag (needs the extra ros), or CSV or JSON whose
    columns a mapping names. The track becomes straight runs and turns, and what a few short
    beams saw becomes walls, corners and single readings. What is skipped, replaced or dropped
    is counted. docs/convert.md says how.
    """
    from possmap.cli.convert_report import report, to_json
    from possmap.cli.progress import bytes_read
    from possmap.lab.convert.run import convert_recordings

    as_json, overwrite = given.pop("as_json"), given.pop("overwrite")
    found = convert_recordings(
        sources, output, _request(given), overwrite=overwrite, progress=bytes_read
    )
    if as_json:
        click.echo(json.dumps(to_json(found, output)))
    elif not ctx.obj["quiet"]:
        report(found, output, verbose=ctx.obj["verbose"] > 0)


def _request(given: dict[str, Any]) -> ConvertRequest:
    """Return what the options ask for; they have the names of what takes them.

    Raises
    ------
    click.UsageError
        For an option whose text is not what it should be.
    """
    from possmap.errors import SettingsError
    from possmap.lab.convert.request import ConvertRequest, models_of
    from possmap.lab.convert.settings import ConvertSettings
    from possmap.lab.recordings import Source, find_mapping, read_mapping
    from possmap.lab.recordings.rosbag.topics import mapping_of
    from possmap.logs.fields import NAME

    mapping, topics = given.pop("mapping"), given.pop("topics")
    if mapping and topics:
        raise click.UsageError("--topic and --mapping say the same thing, expected one of them")
    if given["reference"] is not None and given["starts"]:
        raise click.UsageError("--reference says where excursions begin, expected no --start")
    for name, option in (("places", "--place"), ("fixes", "--fix")):
        if given["align"] and given[name]:
            raise click.UsageError(f"{option} says where the frame lies, expected no --align")
    for name in ("robot", "excursion"):
        if given[name] is not None and not NAME.fullmatch(given[name]):
            raise click.BadParameter(
                f"found {given[name]!r}, expected 1 to 64 characters of A-Z a-z 0-9 . _ : -",
                param_hint=f"--{name}",
            )
    if min(given["errors"]) < 0:
        raise click.BadParameter("expected half-widths >= 0", param_hint="--start-error")
    model_file = given.pop("model_file")
    try:
        columns = mapping_of(topics) if topics else None
        sets, places = given.pop("sets"), given.pop("places")
        models = models_of(model_file, dict(map(options.pair, sets)), map(options.place, places))
    except SettingsError as error:
        if model_file is not None and not str(error).startswith("--"):
            raise
        raise click.UsageError(str(error)) from None

    def read(name: str | None) -> Mapping | None:
        return read_mapping(find_mapping(name)) if name else None

    known = Source(
        mapping=read(given.pop("reference_mapping")),
        pose_of=given.pop("reference_pose"),
        clock=given["clock"],
        max_speed=math.inf,  # what is known is not to be mended
    )

    def taken(kind: type) -> dict[str, Any]:
        return {one.name: given.pop(one.name) for one in fields(kind) if one.name in given}

    return ConvertRequest(
        source=Source(mapping=read(mapping) or columns, **taken(Source)),
        settings=ConvertSettings(**taken(ConvertSettings)),
        models=models,
        reference_source=known,
        **given,
    )

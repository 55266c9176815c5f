"""``possmap evaluate``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.lab.evaluate.reliability import Bin
    from possmap.lab.evaluate.results import Evaluation, MethodScore

MEASURES = ("auc", "f1_5cm", "f1_15cm", "precision_15cm", "recall_15cm")


@click.command(epilog="Example: possmap evaluate site.possmap --truth data/truth.json")
@options.grid_argument
@click.option(
    "--truth",
    type=options.EXISTING_FILE,
    required=True,
    metavar="TRUTH",
    help="A truth file, a ROS map.yaml, or the image of a floor plan.",
)
@click.option(
    "--truth-resolution",
    type=click.FloatRange(min=0, min_open=True),
    metavar="M",
    help="Metres per pixel, of an image.",
)
@click.option(
    "--truth-origin",
    metavar="X,Y",
    callback=lambda ctx, param, value: _origin(value),
    help="Lower left corner of an image, in metres.  [default: 0,0]",
)
@click.option(
    "--beside",
    type=options.EXISTING_FILE,
    multiple=True,
    metavar="OTHER.possmap",
    help="Judge another grid of the same logs on the same cells; again for more.",
)
@options.window
@options.base_rate
@click.option(
    "--picture", type=click.Path(path_type=Path), metavar="OUT.png", help="Draw a report."
)
@options.as_json
@options.overwrite
def evaluate(
    grid: Path,
    truth: Path,
    truth_resolution: float | None,
    truth_origin: tuple[float, float] | None,
    beside: tuple[Path, ...],
    window: tuple[float, float, float, float] | None,
    config: Path | None,
    base_rate: float | None,
    picture: Path | None,
    as_json: bool,
    overwrite: bool,
) -> None:
    """Say how true a grid is: hold it against the true walls and tracks.

    Beside it stand two log-odds grids made of the same records, as one would make them without
    possmap: bayes, which takes each pose for true, and bayes-smeared, which spreads each record
    over where it may belong. All are judged on the same cells: those that any of them touched, but
    for the insides of walls.
    """
    from possmap.lab.evaluate.run import Question
    from possmap.lab.evaluate.run import evaluate as judge

    question = Question(
        beside=beside,
        base_rate=options.chosen_base_rate(config, base_rate),
        window_m=window,
        truth_resolution=truth_resolution,
        truth_origin=truth_origin,
    )
    found = judge(grid, truth, question, picture, overwrite)
    if as_json:
        click.echo(json.dumps(_as_json(found)))
    else:
        click.echo("\n".join(_as_text(found)))
    for note in found.notes:
        click.echo(f"note: {note}", err=True)


def _origin(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"found {text!r}, expected X,Y in metres") from None
    if not (abs(x) <= 1e6 and abs(y) <= 1e6):
        raise click.BadParameter(f"found {text!r}, expected metres within ±1e6")
    return x, y


def _as_json(found: Evaluation) -> dict[str, Any]:
    first = next(iter(found.methods))
    rectangles, explored = found.rectangles[first], found.explored[first]
    return {
        "mask_cells": found.mask_cells,
        "wall_cells": found.wall_cells,
        "base_rate": found.base_rate,
        "resolution": found.resolution,
        "methods": {
            name: _method(score) | (_interval(found, name) if name in found.intervals else {})
            for name, score in found.methods.items()
        },
        "rectangles": {
            "coverage": rectangles and rectangles.coverage,
            "coverage_by_length": rectangles and rectangles.coverage_by_length,
            "mean_half_width": rectangles and rectangles.mean_half_width,
            "poses": rectangles.poses if rectangles else 0,
        },
        "explored": {"free": explored.free, "wall": explored.wall},
        "reference": {
            "all_wall_f1_15cm": found.reference.all_wall_f1_15cm,
            "true_pose_f1_15cm": found.reference.true_pose_f1_15cm,
        },
        "notes": list(found.notes),
    }


def _method(score: MethodScore) -> dict[str, Any]:
    return {name: getattr(score, name) for name in MEASURES} | {
        "brier": score.brier.score,
        "brier_calibration": score.brier.calibration,
        "brier_refinement": score.brier.refinement,
        "log_score": score.log_score.score,
        "log_score_calibration": score.log_score.calibration,
        "log_score_refinement": score.log_score.refinement,
        "dangerous_free": score.dangerous_free,
    }


def _interval(found: Evaluation, name: str) -> dict[str, Any]:
    one = found.intervals[name]
    return {
        "auc_necessity": one.auc_necessity,
        "sharpness": one.sharpness,
        "contradicted": one.contradicted,
        "mean_conflict": one.mean_conflict,
        "lower_validity": [_bin(part) for part in one.lower_validity],
        "upper_validity": [_bin(part) for part in one.upper_validity],
    }


def _bin(part: Bin) -> dict[str, float]:
    names = {"low": "from", "high": "to"}
    return {names.get(field.name, field.name): getattr(part, field.name) for field in fields(part)}


def _as_text(found: Evaluation) -> Iterator[str]:
    from possmap.errors import printable

    share = found.wall_cells / found.mask_cells
    yield (
        f"judged on {found.mask_cells} cells of {found.resolution:g} m, "
        f"{found.wall_cells} of them wall ({share:.1%})"
    )
    width = max(13, *(len(printable(name)) for name in found.methods))
    columns = (
        "AUC", "F1 5cm", "F1 15cm", "precision", "recall", "Brier", "log score", "danger. free",
    )  # fmt: skip
    yield ""
    yield f"{'':{width}}  " + "  ".join(f"{column:>9}" for column in columns)
    for name, score in found.methods.items():
        values = [getattr(score, measure) for measure in MEASURES]
        values += [score.brier.score, score.log_score.score, score.dangerous_free]
        row = "  ".join(
            f"{_number(value):>{max(9, len(column))}}"
            for value, column in zip(values, columns, strict=True)
        )
        yield f"{printable(name):{width}}  {row}"
    reference = found.reference
    yield (
        f"for scale: calling every cell wall has F1 15cm {_number(reference.all_wall_f1_15cm)}, "
        f"the same records at their true poses {_number(reference.true_pose_f1_15cm)}"
    )
    for name in found.intervals:
        yield ""
        yield from _of_grid(found, name)


def _of_grid(found: Evaluation, name: str) -> Iterator[str]:
    """Say what only a map of N and Π has to answer for."""
    from possmap.errors import printable

    one, explored = found.intervals[name], found.explored[name]
    yield printable(name)
    yield (
        f"  left open {one.sharpness:.3f} of 1 on average, contradicted {one.contradicted:.1%} of "
        f"the cells, mean conflict {one.mean_conflict:.4f}, AUC of N alone "
        f"{_number(one.auc_necessity)}"
    )
    rectangles = found.rectangles[name]
    if rectangles is not None:
        by_length = rectangles.coverage_by_length
        yield (
            f"  rectangles hold the true place at {rectangles.coverage:.1%} of "
            f"{rectangles.poses} poses"
            + (f", {by_length:.1%} of the way" if by_length is not None else "")
            + f"; mean half-width {rectangles.mean_half_width:.2f} m"
        )
    free = "" if explored.free is None else f"{explored.free:.1%} of the floor, "
    yield f"  explored {free}{_percent(explored.wall)} of the walls"
    head = "     cells    mean  a wall in it  10 cm  30 cm  within its rectangle"
    yield f"  where N is{head}"
    yield from (_row(part, part.wall_local < part.mean) for part in one.lower_validity)
    yield f"  where Pi is{head[1:]}"
    yield from (_row(part, False) for part in one.upper_validity)


def _row(part: Bin, claims_too_much: bool) -> str:
    """Return a bin's line; marked where N claims more than is there."""
    span = f"{part.low:.1f}-{part.high:.1f}" if part.high > part.low else f"{part.low:.0f}"
    return (
        f"    {span:<8}{part.cells:>8}{part.mean:>8.3f}{part.wall:>14.3f}{part.wall_10cm:>7.3f}"
        f"{part.wall_30cm:>7.3f}{part.wall_local:>8.3f}" + (" < N" if claims_too_much else "")
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.1%}"

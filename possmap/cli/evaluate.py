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
    from possmap.grid.selection import Selection
    from possmap.lab.evaluate.results import Evaluation
    from possmap.lab.evaluate.validity import Bin

MEASURES = {
    "auc": "AUC", "f1_5cm": "F1 5cm", "f1_15cm": "F1 15cm", "precision_15cm": "precision",
    "recall_15cm": "recall", "brier": "Brier", "log_score": "log score",
    "dangerous_free": "walls free", "called_free": "floor free",
    "dangerous_at_equal_floor": "at equal floor",
}  # fmt: skip
"""Of every method, with the titles of their columns."""

OF_GRIDS = ("auc_necessity", "sharpness", "contested", "contradicted", "mean_conflict")


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
@options.selection
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
    selection: Selection,
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
        selection=selection,
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
    first = next(iter(found.grids.values()))
    rectangles = first.rectangles
    methods: dict[str, dict[str, Any]] = {}
    for name, score in found.methods.items():
        methods[name] = {measure: getattr(score, measure) for measure in MEASURES}
        one = found.grids.get(name)
        if one is not None:
            methods[name] |= {measure: getattr(one, measure) for measure in OF_GRIDS}
            methods[name]["lower_validity"] = [_bin(part) for part in one.lower_validity]
            methods[name]["upper_validity"] = [_bin(part) for part in one.upper_validity]
    return {
        "mask_cells": found.mask_cells,
        "wall_cells": found.wall_cells,
        "base_rate": found.base_rate,
        "resolution": found.resolution if found.methods else None,
        "methods": methods,
        "rectangles": {
            "coverage": rectangles and rectangles.coverage,
            "mean_half_width": rectangles and rectangles.mean_half_width,
            "poses": rectangles.poses if rectangles else 0,
        },
        "explored": {"free": first.explored_free, "wall": first.explored_wall},
        "reference": {
            "all_wall_f1_15cm": found.all_wall_f1_15cm,
            "true_pose_f1_15cm": found.true_pose_f1_15cm,
        },
        "notes": list(found.notes),
    }


def _bin(part: Bin) -> dict[str, float]:
    names = {"low": "from", "high": "to"}
    return {names.get(field.name, field.name): getattr(part, field.name) for field in fields(part)}


def _as_text(found: Evaluation) -> Iterator[str]:
    from possmap.errors import printable
    from possmap.lab.evaluate.report import grid_words, number_words, rectangle_words

    if not found.methods:  # a truth of tracks alone
        for name, one in found.grids.items():
            if one.rectangles is not None:
                yield f"{printable(name)}: " + ", ".join(rectangle_words(one.rectangles))
        return
    share = found.wall_cells / found.mask_cells
    yield (
        f"judged on {found.mask_cells} cells of {found.resolution:g} m, "
        f"{found.wall_cells} of them wall ({share:.1%})"
    )
    width = max(13, *(len(printable(name)) for name in found.methods))
    yield ""
    yield f"{'':{width}}" + "".join(f"  {title:>7}" for title in MEASURES.values())
    for name, score in found.methods.items():
        values = ((number_words(getattr(score, key)), title) for key, title in MEASURES.items())
        row = "".join(f"  {value:>{max(7, len(title))}}" for value, title in values)
        yield f"{printable(name):{width}}{row}"
    yield (
        f"for scale: calling every cell wall has F1 15cm {number_words(found.all_wall_f1_15cm)}, "
        f"the same records at their true poses {number_words(found.true_pose_f1_15cm)}"
    )
    for name, one in found.grids.items():
        yield ""
        yield printable(name)
        yield from (f"  {words}" for words in grid_words(one))
        head = "    cells    mean  a wall in it  10 cm  30 cm  within its rectangle"
        yield f"  where Bel is{head}"
        yield from (_row(part, part.wall_local < part.mean) for part in one.lower_validity)
        yield f"  where Pl is {head}"
        yield from (_row(part, False) for part in one.upper_validity)


def _row(part: Bin, claims_too_much: bool) -> str:
    """Return a bin's line; marked where Bel claims more than is there."""
    span = f"{part.low:.1f}-{part.high:.1f}" if part.high > part.low else f"{part.low:.0f}"
    return (
        f"    {span:<8}{part.cells:>9}{part.mean:>8.3f}{part.wall:>14.3f}{part.wall_10cm:>7.3f}"
        f"{part.wall_30cm:>7.3f}{part.wall_local:>8.3f}" + (" < Bel" if claims_too_much else "")
    )

"""``possmap refine``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.budget import Budget
    from possmap.fusing.refine import RefineSummary
    from possmap.refining.refine import MovedOuting

MOST_LISTED = 20
"""Rivals that the text lists; --json has all."""


@click.command(epilog="Example: possmap refine site.possmap -o refined.possmap")
@options.grid_argument
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="REFINED.possmap",
    help="The new grid; it appears when it is whole.",
)
@click.option(
    "--robots", multiple=True, metavar="R", help="Move tracks of this robot only; again for more."
)
@options.overwrite
@options.memory
@options.as_json
def refine(
    grid: Path,
    output: Path,
    robots: tuple[str, ...],
    overwrite: bool,
    budget: Budget,
    as_json: bool,
) -> None:
    """Make a new grid in which one wall is one wall, whoever saw it.

    Tracks are moved so that sightings of the same wall agree, by least squares over the whole
    ledger. The old grid is not changed; the new one says what it was made of, and takes no logs.
    """
    from possmap.cli.progress import bar
    from possmap.fusing.refine import refine as move

    done = move(grid, output, robots=robots, overwrite=overwrite, budget=budget, progress=bar)
    click.echo(json.dumps(_as_json(done)) if as_json else "\n".join(_as_text(done)))


def _as_json(done: RefineSummary) -> dict[str, Any]:
    found = done.found
    return {
        "grid": str(done.grid),
        "made_of": done.made_of,
        "digest": done.digest,
        "sightings": sum(one.sightings for one in found.outings),
        "used": sum(one.used for one in found.outings),
        "ambiguous": sum(one.ambiguous for one in found.outings),
        "walls": [asdict(one) for one in found.walls],
        "excursions": [asdict(one) for one in found.outings],
        "rivals": [asdict(one) for one in found.rivals],
    }


def _as_text(done: RefineSummary) -> Iterator[str]:
    from possmap.errors import brief, plural, printable

    found = done.found
    used, all_of_them = (
        sum(getattr(one, name) for one in found.outings) for name in ("used", "sightings")
    )
    ambiguous = sum(one.ambiguous for one in found.outings)
    moved = [one for one in found.outings if not one.alone]
    yield (
        f"{printable(str(done.grid))}: {plural(len(found.walls), 'wall')}, {used} of "
        f"{plural(all_of_them, 'sighting')} used, {ambiguous} ambiguous; {len(moved)} of "
        f"{plural(len(found.outings), 'excursion')} moved"
    )
    yield "robot      excursion        moved   most    ±before ±after  walls  off    left alone"
    yield from map(_row, found.outings)
    for one in found.rivals[:MOST_LISTED]:
        x0, y0, x1, y1 = one.line
        names = ", ".join(f"{brief(robot)} {brief(name)}" for robot, name in one.by[:3])
        more = f" and {len(one.by) - 3} more" if len(one.by) > 3 else ""
        yield (
            f"a wall at ({x0:.2f}, {y0:.2f})-({x1:.2f}, {y1:.2f}) m, seen by {names}{more}, stands "
            f"{one.apart:.2f} m from where {plural(one.others, 'other excursion')} saw one"
        )
    if len(found.rivals) > MOST_LISTED:
        yield f"and {len(found.rivals) - MOST_LISTED} more such walls (--json lists them)"


def _row(one: MovedOuting) -> str:
    from possmap.errors import brief

    doubtful = f"; seq {', '.join(map(str, one.doubtful[:5]))} doubtful" if one.doubtful else ""
    return (
        f"{brief(one.robot, 10):<10} {brief(one.excursion, 16):<16} {one.moved:5.3f}   "
        f"{one.most_moved:5.3f}   {one.half_before:5.3f}   {one.half_after:5.3f}   "
        f"{one.used:>3}/{one.sightings:<3} {one.residual:4.2f}σ  {one.alone or ''}{doubtful}"
    ).rstrip(" ")

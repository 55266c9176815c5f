"""``possmap export``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.grid.selection import Selection

FARTHEST = 1e8
"""No reference system in metres has a place farther off."""


def _layers() -> tuple[str, ...]:
    from possmap.exports.job import LAYERS

    return LAYERS


def _offset(
    ctx: click.Context, param: click.Parameter, text: str | None
) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        x, y = map(float, text.split(","))
    except ValueError:
        x = y = float("nan")
    if not (abs(x) <= FARTHEST and abs(y) <= FARTHEST):
        raise click.BadParameter(f"found {text!r}, expected X,Y within ±1e8")
    return x, y


@click.command(epilog="Example: possmap export site.possmap -o site.npz")
@options.grid_argument
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="OUT",
    help="What to write; its suffix says how: .npz, .yaml, .mcap, .geojson, .csv, .png, .svg,"
    " .dxf, .bt or .ot.",
)
@options.window
@click.option(
    "--mode",
    type=click.Choice(["trinary", "scale", "raw"]),
    help="How map_server reads a .yaml's image, or what cells of a .mcap are.  [default: trinary]",
)
@click.option(
    "--occupied",
    type=click.FloatRange(0, 1, min_open=True),
    metavar="N",
    help="A cell is occupied where its belief reaches this (.yaml, .mcap, .geojson, .svg,"
    " .dxf, .bt).  [default: 0.5]",
)
@click.option(
    "--free",
    type=click.FloatRange(0, 1, max_open=True),
    metavar="P",
    help="Else it is free where its plausibility is not above this (.yaml, .mcap, .geojson, .bt)."
    "  [default: 0.5]",
)
@click.option(
    "--layer",
    type=options.Named("layer", _layers),
    metavar="NAME",
    help="What a .png shows: a view, or points.  [default: belief]",
)
@click.option(
    "--epsg",
    type=click.IntRange(1024, 32767),
    metavar="CODE",
    help="The reference system in which a .geojson's coordinates are, such as 32633.",
)
@click.option(
    "--offset",
    callback=_offset,
    metavar="X,Y",
    help="Where the site's (0, 0) lies in it, in metres (.geojson, .png).",
)
@options.base_rate
@options.selection
@options.overwrite
@click.pass_context
def export(
    ctx: click.Context,
    /,
    grid: Path,
    output: Path,
    window: tuple[float, float, float, float] | None,
    config: Path | None,
    base_rate: float | None,
    selection: Selection,
    overwrite: bool,
    **more: Any,
) -> None:
    """Write a grid in a format that other programs read.

    \b
    .npz      arrays of the readouts of every cell (Python)
    .yaml     a ROS map, with its image .pgm (--mode scale: .png) beside it
    .mcap     map and tracks for ROS 2; needs: pip install 'possmap[ros]'
    .geojson  tracks, walls with their error, corners, the map's outline (GIS)
    .csv      a line for each cell that holds evidence
    .png      one layer in 16 bits, with its world file .pgw beside it (GIS)
    .svg      walls, sightings and tracks as a drawing
    .dxf      the same for CAD; needs: pip install 'possmap[dxf]'
    .bt, .ot  a sheet of OctoMap voxels; needs: pip install 'possmap[octomap]'

    .npz holds float32 arrays necessity, possibility, belief, plausibility and pignistic_logit of
    shape (rows, columns), row 0 at the lowest y; origin, the (x, y) in metres of the lower left
    corner of cell [0, 0]; and resolution, metres per cell. docs/export.md describes the others.
    """  # noqa: D301 (click's own mark: keep these lines apart)
    from possmap.errors import printable
    from possmap.exports.export import export as write
    from possmap.exports.export import strange_options
    from possmap.exports.job import Choices

    given = {name: value for name, value in more.items() if value is not None}
    asked = given if base_rate is None else {**given, "base_rate": base_rate}
    for name, suffixes in strange_options(output, asked):
        raise click.UsageError(
            f"--{name.replace('_', '-')} belongs to {', '.join(suffixes)}, not to {output.suffix}."
        )
    try:
        choices = Choices(**given, base_rate=options.chosen_base_rate(config, base_rate))
    except ValueError as error:  # NaN lies in every range
        raise click.UsageError(str(error)) from error
    done = write(grid, output, window, overwrite, choices, selection)
    if not ctx.obj["quiet"]:
        x, y = done.origin
        names = " and ".join(printable(str(path)) for path in done.outputs)
        click.echo(
            f"{names}: {done.rows} rows × {done.columns} columns "
            f"of {done.resolution:g} m, from ({x:.2f}, {y:.2f})"
        )
        for path in done.leftovers:
            told = f"{printable(str(path))} is left from an export that was stopped: remove it"
            click.echo(f"possmap: {told}", err=True)

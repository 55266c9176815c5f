"""``possmap export``."""

from __future__ import annotations

from pathlib import Path

import click

from possmap.cli import options


@click.command(epilog="Example: possmap export site.possmap -o site.npz")
@options.grid_argument
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="OUT",
    help="What to write; its suffix says how: .npz.",
)
@options.window
@options.overwrite
@click.pass_context
def export(
    ctx: click.Context,
    /,
    grid: Path,
    output: Path,
    window: tuple[float, float, float, float] | None,
    overwrite: bool,
) -> None:
    """Write a grid in a format that other programs read.

    .npz holds float32 arrays necessity and possibility of shape (rows, columns), row 0 at the
    lowest y; origin, the (x, y) in metres of the lower left corner of cell [0, 0]; and resolution,
    metres per cell.
    """
    from possmap.app.export import export as write
    from possmap.errors import printable

    done = write(grid, output, window, overwrite)
    if not ctx.obj["quiet"]:
        x, y = done.origin
        click.echo(
            f"{printable(str(done.output))}: {done.rows} rows × {done.columns} columns "
            f"of {done.resolution:g} m, from ({x:.2f}, {y:.2f})"
        )

"""``possmap render``."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.pictures.film import By
    from possmap.pictures.render import Look

LAYERS = (
    "map", "belief", "plausibility", "contested", "ignorance", "pignistic", "probability",
    "necessity", "possibility", "conflict", "contradicted", "points", "coverage",
)  # fmt: skip
PALETTES = {
    "viridis": "purple to yellow; the map: brown walls, blue paths (the default)",
    "magma": "black to cream; the map as with viridis",
    "gray": "black to white; the map: the greys of the paper's Figure 8",
}


_LAYER = options.Named("layer", lambda: LAYERS)


def _palette(ctx: click.Context, _: click.Parameter, name: str) -> str:
    if name == "list" and not ctx.resilient_parsing:
        for known, meaning in PALETTES.items():
            click.echo(f"{known:<10}{meaning}")
        ctx.exit()
    return str(options.Named("palette", lambda: PALETTES)(name, _, ctx))


def _panels(ctx: click.Context, param: click.Parameter, names: str | None) -> list[str] | None:
    return None if names is None else [_LAYER(name, param, ctx) for name in names.split(",")]


@click.command(epilog="Example: possmap render site.possmap -o site.png")
@options.grid_argument
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="OUT.png", help="What to write."
)
@click.option(
    "--layer",
    type=_LAYER,
    metavar="NAME",
    help=f"One of {', '.join(LAYERS)}.  [default: map]",
)
@click.option("--panels", metavar="A,B,...", callback=_panels, help="Several layers side by side.")
@click.option(
    "--palette",
    default="viridis",
    show_default=True,
    is_eager=True,
    callback=_palette,
    metavar="NAME",
    help="Colours of values; list prints them all.",
    shell_complete=lambda ctx, param, begun: [n for n in PALETTES if n.startswith(begun)],
)
@click.option("--bare", is_flag=True, help="Only the cells: one pixel each, times --scale.")
@click.option("--scale", type=click.IntRange(min=1), help="Pixels per cell.")
@click.option(
    "--max-size",
    type=click.IntRange(min=1),
    metavar="PIXELS",
    help="The map's longer side at most; blocks of cells shrink, and thin walls survive.",
)
@options.window
@click.option("--tracks", is_flag=True, help="Draw the robots' tracks.")
@click.option("--truth", type=options.EXISTING_FILE, help="Draw the walls of a truth file.")
@click.option("--title", help="Above the picture.  [default: the grid's name]")
@click.option(
    "--animate",
    type=click.Choice(["excursion", "record"]),
    help="A film of how the map grew: .png (APNG), .gif or .webp.",
)
@click.option("--frames", type=click.IntRange(min=1), help="Frames of the film, at most.")
@click.option("--frame-ms", type=click.IntRange(10, 60000), help="Time of a frame.  [default: 400]")
@click.option("--show", is_flag=True, help="Print a preview in the terminal; -o is not needed.")
@options.base_rate
@options.selection
@options.overwrite
@click.pass_context
def render(
    ctx: click.Context,
    /,
    grid: Path,
    output: Path | None,
    layer: str | None,
    panels: list[str] | None,
    window: tuple[float, float, float, float] | None,
    animate: By | None,
    frames: int | None,
    frame_ms: int | None,
    show: bool,
    config: Path | None,
    base_rate: float | None,
    overwrite: bool,
    **more: Any,
) -> None:
    """Draw a grid as a picture.

    The map shows walls (the lighter, the smaller the belief in them), free space (the darker, the
    smaller the plausibility of a wall), what is contested, what is unknown, corners and home.
    Layers show one value in every cell, on a scale from 0 to 1.

    With --bare --palette gray a pixel of a layer is round(255 x value) and the first row of pixels
    the highest y, so that a program can read the values back; of coverage it is the count.
    """
    from possmap.errors import plural, printable
    from possmap.pictures.render import Look

    if output is None and not show:
        raise click.UsageError("Give -o OUT.png for a picture, or --show for a preview.")
    if layer and panels:
        raise click.UsageError("Give --layer or --panels, not both.")
    if animate is None and (frames is not None or frame_ms is not None):
        raise click.UsageError("--frames and --frame-ms belong to --animate.")
    if animate is not None and output is None:
        raise click.UsageError("--animate needs -o OUT.gif, OUT.webp or OUT.png.")
    if more["bare"] and (more["tracks"] or more["truth"] or more["title"] is not None):
        raise click.UsageError("--bare draws cells only: no --tracks, --truth or --title.")
    if panels and more["bare"]:
        raise click.UsageError("--bare draws one layer: give --layer, not --panels.")
    look = Look(
        layers=panels or [layer or "map"],
        window_m=window,
        base_rate=options.chosen_base_rate(config, base_rate),
        **more,
    )
    if show:
        _show(grid, look)
    if output is None:
        return
    if animate is not None:
        from possmap.cli.progress import bar
        from possmap.pictures.film import animate as draw_film

        done = draw_film(
            grid, output, look, animate, frames=frames, frame_ms=frame_ms or 400,
            overwrite=overwrite, progress=bar,
        )  # fmt: skip
    else:
        from possmap.pictures.render import render as draw

        done = draw(grid, output, look, overwrite)
    if not ctx.obj["quiet"]:
        counted = f", {plural(done.frames, 'frame')}" if animate else ""
        click.echo(f"{printable(str(done.output))}: {done.width} x {done.height} pixels{counted}")


def _show(grid: Path, look: Look) -> None:
    from possmap.pictures.terminal import Depth, preview

    size = shutil.get_terminal_size((80, 24))
    is_terminal = sys.stdout.isatty()
    colour = is_terminal and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    full = os.environ.get("COLORTERM") in ("truecolor", "24bit")
    lines = max(8, size.lines - 2)
    depth: Depth = ("24 bits" if full else "256") if colour else "none"
    click.echo(preview(grid, look, size.columns, lines, depth), color=colour or None)

"""``possmap demo``."""

from __future__ import annotations

from pathlib import Path

import click

from possmap.cli import options


@click.command(epilog="Example: possmap demo figure8")
@click.argument(
    "folder", type=click.Path(path_type=Path), default=Path("possmap-demo"), metavar="[DIR]"
)
@click.option("--seed", type=click.IntRange(min=0), help="Of all random numbers.")
@options.overwrite
@click.pass_context
def demo(ctx: click.Context, /, folder: Path, seed: int | None, overwrite: bool) -> None:
    """Simulate three robots, fuse their logs, and draw the map, all into DIR.

    The mission is modelled on the paper's Figure 8. DIR is possmap-demo unless given.
    """
    from possmap.cli.progress import clock
    from possmap.cli.simulate import report
    from possmap.demo import demo as show
    from possmap.errors import plural, printable

    with clock() as tell:
        done = show(folder, seed, overwrite, tell)
    if ctx.obj["quiet"]:
        return
    report(done.mission)
    name = printable(str(done.folder))
    fused = (
        f"{plural(done.fused.count('fused'), 'log')}, {plural(done.fused.records_new, 'record')}"
    )
    click.echo(f"{name}/site.possmap: {fused}")
    click.echo(f"{name}/site.png: the map, with the true walls and the robots' tracks")

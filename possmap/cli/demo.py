"""``possmap demo``."""

from __future__ import annotations

from pathlib import Path

import click

from possmap.cli import options


@click.command(epilog="Example: possmap demo maze maze-demo")
@click.argument("what", nargs=-1, metavar="[MISSION] [DIR]")
@click.option("--seed", type=click.IntRange(min=0), help="Of all random numbers.")
@options.overwrite
@click.pass_context
def demo(ctx: click.Context, /, what: tuple[str, ...], seed: int | None, overwrite: bool) -> None:
    """Simulate a team of robots, fuse their logs, and draw the map, all into DIR.

    MISSION is one that possmap ships, or a YAML file; without, it is figure8, modelled on the
    paper's Figure 8. DIR is possmap-demo unless given.
    """
    from possmap.cli.progress import clock
    from possmap.cli.simulate import report
    from possmap.demo import MISSION
    from possmap.demo import demo as show
    from possmap.errors import plural, printable
    from possmap.settings.shipped import shipped_names

    given = list(what)
    named = given and (given[0] in shipped_names("missions") or given[0].endswith(".yaml"))
    mission = options.mission_of(given.pop(0) if named else MISSION)
    if len(given) > 1:
        raise click.UsageError(f"Got unexpected extra argument ({given[1]})")
    folder = Path(given[0] if given else "possmap-demo")
    with clock() as tell:
        done = show(mission, folder, seed, overwrite, tell)
    if ctx.obj["quiet"]:
        return
    report(done.mission)
    name = printable(str(done.folder))
    fused = (
        f"{plural(done.fused.count('fused'), 'log')}, {plural(done.fused.records_new, 'record')}"
    )
    click.echo(f"{name}/site.possmap: {fused}")
    click.echo(f"{name}/site.png: the map, with the true walls and the robots' tracks")

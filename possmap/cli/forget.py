"""``possmap forget``."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.fusing.forget import ForgetSummary, Target
    from possmap.grid.forgotten import Forgotten
    from possmap.grid.selection import Selection


@click.command(epilog="Example: possmap forget site.possmap --robot r3")
@options.grid_argument
@click.option("--robot", metavar="R", help="Forget what this robot recorded, whoever brought it.")
@click.option("--excursion", metavar="E", help="Only this excursion of it.")
@click.option(
    "--brought-by",
    metavar="LOG",
    help="Forget what only this file brought: its name as possmap info shows it, or how that "
    "ends, or how its SHA-256 begins, or a file of the same bytes.",
)
@click.option("--once", is_flag=True, help="Keep no memory of it: it may come again.")
@click.option(
    "--recall", is_flag=True, help="Let it in again; its logs must then be fused once more."
)
@click.option("--dry-run", is_flag=True, help="Say what would go, and change nothing.")
@options.selection
@options.as_json
@click.pass_context
def forget(
    ctx: click.Context,
    /,
    grid: Path,
    robot: str | None,
    excursion: str | None,
    brought_by: str | None,
    once: bool,
    recall: bool,
    dry_run: bool,
    selection: Selection,
    as_json: bool,
) -> None:
    """Take evidence out of a grid, as if it had never come.

    The grid is then the one that fusing the same logs without it would make, and has its digest.
    What a forgotten robot carried for others stays. The grid remembers what was forgotten, and
    fuse does not let it in until --recall says so; with --once it may come again at any time.
    Of a selection (--since, --last, ...; --robot R then counts as --robots R) it remembers the
    excursions, one by one.
    """
    from possmap.cli.progress import bar
    from possmap.fusing.forget import Target
    from possmap.fusing.forget import forget as take_out
    from possmap.fusing.forget import recall as let_in

    for option, value in (("robot", robot), ("excursion", excursion), ("brought-by", brought_by)):
        if value == "":
            raise click.UsageError(f"--{option} is empty, expected a name")
    if once and recall:
        raise click.UsageError("--once and --recall exclude each other")
    if selection and (brought_by or excursion or recall):
        raise click.UsageError(
            "--brought-by, --excursion and --recall exclude --since, --until, --last, --excursions "
            "and --robots"
        )
    if selection:
        what: Target | Selection = replace(
            selection, robots=(*selection.robots, *([robot] if robot else []))
        )
    else:
        if (robot is None) == (brought_by is None):
            raise click.UsageError("expected either --robot or --brought-by, or a selection")
        if excursion is not None and robot is None:
            raise click.UsageError("--excursion needs --robot")
        what = Target(robot, excursion, brought_by)
    if recall:
        assert isinstance(what, Target)
        _say(ctx, as_json, *_recalled(grid, let_in(grid, what)))
    else:
        done = take_out(grid, what, once=once, dry_run=dry_run, progress=bar)
        _say(ctx, as_json, *_forgotten(done))


def _say(ctx: click.Context, as_json: bool, told: dict[str, Any], lines: list[str]) -> None:
    if as_json:
        click.echo(json.dumps(told))
    elif not ctx.obj["quiet"]:
        click.echo("\n".join(lines))


def _recalled(grid: Path, what: Forgotten) -> tuple[dict[str, Any], list[str]]:
    from possmap.errors import printable

    line = f"{printable(str(grid))}: {what.title} may come in again: fuse the logs that hold it"
    return {"grid": str(grid), "recalled": as_told(what)}, [line]


def _forgotten(done: ForgetSummary) -> tuple[dict[str, Any], list[str]]:
    from possmap.errors import plural, printable

    told_of = [as_told(one) for one in done.notes]
    told = {
        "grid": str(done.grid),
        "forgotten": told_of[0] if len(told_of) == 1 else told_of,
        "once": done.once,
        "dry_run": done.dry_run,
        "excursions": [asdict(one) for one in done.excursions],
        "records": done.records,
        "tiles": done.tiles,
        "digest": done.digest,
    }
    name = printable(str(done.grid))
    if not done.is_new:
        since = printable(done.notes[0].forgotten_at)
        line = f"{done.title} is forgotten since {since}, and nothing of it is here"
        return told, [f"{name}: {line}"]
    did = "would forget" if done.dry_run else "forgot"
    lines = [
        f"{name}: {did} {done.title}: {plural(done.records, 'record')} of "
        f"{plural(len(done.excursions), 'excursion')}, {plural(done.tiles, 'tile')} changed"
    ]
    for one in done.excursions:
        stays = "nothing stays" if one.vanished else f"{one.kept} stay, which others brought"
        lines.append(
            f"  {printable(one.robot)} {printable(one.excursion)}: "
            f"{plural(one.lost, 'record')}; {stays}"
        )
    return told, [*lines, f"digest {done.digest}"]


def as_told(what: Forgotten) -> dict[str, Any]:
    """Return what was forgotten as JSON tells it."""
    return {
        "robot": what.robot,
        "excursion": what.excursion,
        "source": what.source,
        "sha256": what.sha256,
        "excursions": what.excursions,
        "records": what.records,
        "forgotten_at": what.forgotten_at,
        "version": what.version,
    }

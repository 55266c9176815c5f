"""``possmap check``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.fusing.check import Inspection


def _print_schema(ctx: click.Context, _: click.Parameter, asked: bool) -> None:
    if asked and not ctx.resilient_parsing:
        from possmap.logs.schema import text

        click.echo(text(), nl=False)
        ctx.exit()


@click.command(epilog="Example: possmap check data/json")
@options.logs
@options.settings
@options.allow_truncated
@options.as_json
@click.option(
    "--schema",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_schema,
    help="Print the JSON Schema of the log format.",
)
@click.pass_context
def check(
    ctx: click.Context,
    /,
    logs: tuple[str, ...],
    allow_truncated: bool,
    as_json: bool,
    **settings: Any,
) -> None:
    """Validate LOGs and say what is in them; change nothing.

    The logs are judged one by one and against each other, as fuse would. The settings decide how
    the error rectangle grows.
    """
    from possmap.cli.progress import bar
    from possmap.errors import printable
    from possmap.fusing.check import check as inspect
    from possmap.fusing.reach import doubts_axes, reach_line

    summary = inspect(
        logs, options.request(**settings), allow_truncated=allow_truncated, progress=bar
    )
    for one in summary.files:
        for message in (one.error, one.note):
            if message:
                click.echo(f"possmap: {message}", err=True)
        if not as_json and one.error is None:
            click.echo(printable(one.path))
            for inspection in one.excursions:
                click.echo("\n".join(_as_text(inspection)))
    if not as_json:
        for line in reach_line(summary.reach):
            click.echo(line)
        if doubts_axes(summary.reach) and summary.axes_deg is not None:
            click.echo(f"most metres of wall lie along: --set axes={summary.axes_deg:.1f}")
    if as_json:
        click.echo(json.dumps({"logs": [asdict(one) for one in summary.files]}))
    if summary.refused:
        ctx.exit(1)


def _as_text(one: Inspection) -> Iterator[str]:
    from possmap.errors import plural

    carried = f", carried by {' '.join(one.carried_by)}" if one.carried_by else ""
    yield f"  {one.robot} {one.excursion}{carried}"
    kinds = ", ".join(f"{count} {kind}" for kind, count in one.kinds.items())
    yield f"    records   {sum(one.kinds.values())}{f': {kinds}' if kinds else ''}"
    time = "no times" if one.seconds is None else f"{one.seconds:.1f} s"
    turns = f"{plural(one.turns, 'turn')} of {one.turned_deg:.0f}° in all"
    yield f"    track     {one.distance:.2f} m, {turns}, {time}"
    if one.half_x is not None:
        yield (
            f"    ends in   ±{one.half_x:.3f} m in x, ±{one.half_y:.3f} m in y, "
            f"±{one.heading_half_deg:.1f}°"
        )
    if one.waiting:
        verb = "yields" if one.waiting == 1 else "yield"
        some = plural(one.waiting, "record")
        yield f"    waiting   {some} {verb} nothing until a pose follows"
    if one.fixes_ignored:
        verb = "is" if one.fixes_ignored == 1 else "are"
        yield (
            f"    ignored   {plural(one.fixes_ignored, 'fix')} {verb} ignored: only the estimator "
            "walls looks back"
        )

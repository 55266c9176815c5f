"""``possmap query``."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from possmap.cli import options


def _coordinate(ctx: click.Context, param: click.Parameter, value: float) -> float:
    if not abs(value) <= 1e6:  # phrased so that NaN is refused too
        raise click.BadParameter(f"found {value}, expected metres within ±1e6")
    return value


class _WithNumbers(click.Command):
    """A command whose arguments may be negative numbers, and whose options are still known ones."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        known = [name for param in self.get_params(ctx) for name in param.opts]
        for arg in args[: args.index("--")] if "--" in args else args:
            name = arg.partition("=")[0]
            if name.startswith("--") and name not in known:
                raise click.NoSuchOption(name, ctx=ctx)
        return super().parse_args(ctx, args)


@click.command(
    cls=_WithNumbers,
    epilog="Example: possmap query site.possmap 1.0 -0.9",
    context_settings={"ignore_unknown_options": True},  # -0.9 is a number, not an option
)
@options.grid_argument
@click.argument("x", type=float, callback=_coordinate)
@click.argument("y", type=float, callback=_coordinate)
@click.option(
    "--top",
    type=click.IntRange(min=1),
    default=20,
    show_default=True,
    metavar="N",
    help="How many records to list, those that say most; --json has all.",
)
@options.base_rate
@options.as_json
def query(
    grid: Path,
    x: float,
    y: float,
    top: int,
    config: Path | None,
    base_rate: float | None,
    as_json: bool,
) -> None:
    """Say what is known of the point (X, Y), in metres, and which records say so.

    Belief and plausibility weigh what speaks for a wall and against it together; necessity and
    possibility are what each side says alone. N does not mean that this very cell is wall, but that
    a wall lies within the error rectangle of this cell.
    """
    from possmap.errors import brief
    from possmap.inspection.query import query as ask

    report = ask(grid, x, y, options.chosen_base_rate(config, base_rate))
    if as_json:
        click.echo(json.dumps(asdict(report)))
        return
    views = report.views
    belief, plausibility = views["belief"], views["plausibility"]
    click.echo(f"cell            row {report.row}, column {report.column}, ", nl=False)
    click.echo(f"centre ({report.x:.3f}, {report.y:.3f}) m")
    words = _in_words(belief, plausibility, views["contested"])
    click.echo(f"wall            belief {belief:.4f}, plausibility {plausibility:.4f}: {words}")
    for name, value in views.items():
        if name not in ("belief", "plausibility", "points"):
            click.echo(f"{name:<16}{value:.4f}")
    click.echo(f"point           necessity {report.views['points']:.4f}")
    click.echo(f"records         {len(report.witnesses) or 'none'}")
    for one in report.witnesses[:top]:
        record = f"{brief(one.robot)} {brief(one.excursion)} seq {one.seq} ({one.kind})"
        click.echo(f"  {record}: {one.says} {one.value:.4f}")
    if len(report.witnesses) > top:
        click.echo(f"  and {len(report.witnesses) - top} more, which say less")


def _in_words(belief: float, plausibility: float, contested: float) -> str:
    if belief == 0 and plausibility == 1:
        return "unknown"
    told = f"P(wall) between {belief:.4f} and {plausibility:.4f}"
    return f"{told}, contested" if contested > 0.5 else told

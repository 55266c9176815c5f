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


@click.command(
    epilog="Example: possmap query site.possmap 1.0 -0.9",
    context_settings={"ignore_unknown_options": True},  # -0.9 is a number, not an option
)
@options.grid_argument
@click.argument("x", type=float, callback=_coordinate)
@click.argument("y", type=float, callback=_coordinate)
@click.option(
    "--base-rate",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.5,
    show_default=True,
    help="Probability of a wall where nothing is known.",
)
@options.as_json
def query(grid: Path, x: float, y: float, base_rate: float, as_json: bool) -> None:
    """Say what is known of the point (X, Y), in metres, and which records say so.

    N, the necessity of a wall, does not mean that this very cell is wall, but that a wall lies
    within the error rectangle of this cell.
    """
    from possmap.app.query import query as ask

    report = ask(grid, x, y, base_rate)
    if as_json:
        click.echo(json.dumps(asdict(report)))
        return
    n, p = report.views["necessity"], report.views["possibility"]
    click.echo(f"cell          row {report.row}, column {report.column}, ", nl=False)
    click.echo(f"centre ({report.x:.3f}, {report.y:.3f}) m")
    click.echo(f"wall          necessity {n:.4f}, possibility {p:.4f}: {_in_words(n, p)}")
    others = ("ignorance", "conflict", "mass_wall", "mass_free", "mass_unknown", "probability")
    for name in others:
        click.echo(f"{name:<14}{report.views[name]:.4f}")
    click.echo(f"point         necessity {report.views['points']:.4f}")
    click.echo(f"records       {len(report.witnesses) or 'none'}")
    for one in report.witnesses:
        click.echo(
            f"  {one.robot} {one.excursion} seq {one.seq} ({one.kind}): {one.says} {one.value:.4f}"
        )


def _in_words(necessity: float, possibility: float) -> str:
    if necessity > possibility:
        return "contradicted"
    if necessity == 0 and possibility == 1:
        return "unknown"
    return f"P(wall) between {necessity:.2f} and {possibility:.2f}"

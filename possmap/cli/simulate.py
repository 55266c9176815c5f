"""``possmap simulate``."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.lab.simulate.summary import Summary


def overrides_of(seed: int | None, robots: int | None, sets: tuple[str, ...]) -> dict[str, str]:
    """Return what the options ask for, ``--set`` the strongest."""
    given: dict[str, str] = {}
    if seed is not None:
        given["seed"] = str(seed)
    if robots is not None:
        given["robots"] = str(robots)
    given |= dict(map(options.pair, sets))
    return given


@click.command(epilog="Example: possmap simulate figure8 -o troupe")
@click.argument(
    "mission", metavar="MISSION", callback=lambda ctx, param, value: options.mission_of(value)
)
@click.option(
    "-o", "--output", "folder", required=True, type=click.Path(path_type=Path), metavar="DIR",
    help="A folder to make: logs/, truth.json and summary.json.",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), help="Of all random numbers.")
@click.option("--robots", type=click.IntRange(min=1), help="How many.")
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE", help="Any key of the mission file."
)
@click.option(
    "--picture", type=click.Path(path_type=Path), metavar="OUT.png",
    help="Draw the world, the true tracks and the meetings.",
)  # fmt: skip
@options.overwrite
@options.as_json
@click.pass_context
def simulate(
    ctx: click.Context,
    /,
    mission: Path,
    folder: Path,
    seed: int | None,
    robots: int | None,
    sets: tuple[str, ...],
    picture: Path | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Drive a team of robots through a world, by real kinematics and with real errors.

    MISSION is a YAML file, or the name of a mission that possmap ships.

    logs/ holds what the host receives, one log for each excursion that came home, sorted by
    return; truth.json what truly happened. One seed gives one set of bytes.
    """
    from possmap.cli.progress import clock
    from possmap.errors import plural, printable
    from possmap.lab.simulate.run import simulate as drive

    with clock() as tell:
        summary = drive(
            mission, folder, overrides_of(seed, robots, sets),
            picture=picture, overwrite=overwrite, progress=tell,
        )  # fmt: skip
    if as_json:
        click.echo(json.dumps(asdict(summary)))
    elif not ctx.obj["quiet"]:
        report(summary)
        logs = plural(summary.home, "log")
        click.echo(f"{printable(str(folder))}: {logs}, truth.json, summary.json")


def report(summary: Summary) -> None:
    """Print a summary as a table."""
    from possmap.errors import plural

    head = ("excursion", "fate", "min", "run m", "far m", "records", "known")
    click.echo("{:<10}{:<6}{:>7}{:>8}{:>7}{:>9}{:>7}".format(*head))
    for one in summary.excursions:
        line = (
            f"{one.excursion:<10}{one.fate:<6}{one.minutes:>7.1f}{one.distance:>8.1f}"
            f"{one.farthest:>7.1f}{one.records:>9}{one.known:>7}"
        )
        click.echo(f"{line}  {one.why}".rstrip())
    click.echo(
        f"{summary.home} of {len(summary.excursions)} excursions came home; "
        f"{plural(summary.meetings, 'meeting')}; "
        f"of the lost the host knows {plural(summary.records_known_of_lost, 'record')}; "
        f"{summary.explored:.0%} of the walls explored"
    )

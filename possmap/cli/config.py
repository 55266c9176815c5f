"""``possmap config``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from possmap.cli import options


@click.command(epilog="Example: possmap config --set turn_spread=0.5 > site.yaml")
@options.settings
@click.option(
    "-g",
    "--grid",
    type=options.EXISTING_FILE,
    metavar="SITE.possmap",
    help="Those of a grid, which keeps what shapes its evidence.",
)
@options.as_json
def config(grid: Path | None, as_json: bool, **settings: Any) -> None:
    """Print the settings in force, as YAML to edit and give back with --config.

    --set beats --resolution beats --config beats --profile beats the default. A log's own error
    model beats them all, unless accept_models is false.
    """
    from possmap.grid.grid import Grid
    from possmap.settings.request import in_force
    from possmap.settings.settings import flat
    from possmap.settings.settings_yaml import to_yaml

    given = options.request(**settings).given()
    if grid is None:
        found = in_force(given)
    else:
        with Grid(grid) as known:
            found = in_force(given, known.stored_settings(), grid)
    if as_json:
        robots = {robot: dict(parameters) for robot, parameters in found.robots.items()}
        click.echo(json.dumps({**flat(found), "robots": robots}))
    else:
        click.echo(to_yaml(found), nl=False)

"""``possmap verify``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from possmap.cli import options


@click.command(epilog="Example: possmap verify site.possmap")
@options.grid_argument
@click.option("--full", is_flag=True, help="Fuse every tile again, not a sample of 64.")
@options.as_json
@click.pass_context
def verify(ctx: click.Context, /, grid: Path, full: bool, as_json: bool) -> None:
    """Look whether a grid file is whole, and whether its tiles are what its ledger says.

    SQLite's structure, the hash of every tile and of every excursion are looked at, and a sample of
    tiles is fused again from the ledger, or all of them. Every fault is one line; the exit status
    is 1 if there is one. The file is not changed; possmap repair makes a new one.
    """
    from possmap.cli.progress import bar
    from possmap.errors import plural, printable
    from possmap.grid.verify import verify as look

    found = look(grid, full=full, progress=bar)
    name = printable(str(grid))
    if as_json:
        click.echo(
            json.dumps(
                {
                    "grid": str(grid),
                    "sound": found.is_sound,
                    "digest": found.digest,
                    "excursions": found.excursions,
                    "tiles": found.tiles,
                    "fused_again": found.remade,
                    "faults": list(found.faults),
                }
            )
        )
    elif found.is_sound:
        click.echo(
            f"{name}: sound: {plural(found.excursions, 'excursion')}, "
            f"{plural(found.tiles, 'tile')}, {found.remade} of them fused again\n"
            f"digest {found.digest}"
        )
    if not found.is_sound:
        for fault in found.faults:
            click.echo(f"possmap: {name}: {fault}", err=True)
        ctx.exit(1)

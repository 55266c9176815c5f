"""``possmap repair``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from possmap.cli import options


@click.command(epilog="Example: possmap repair site.possmap -o saved.possmap")
@options.grid_argument
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="NEW.possmap",
    help="The new grid; it appears when it is whole.",
)
@options.overwrite
@options.as_json
@click.pass_context
def repair(
    ctx: click.Context,
    /,
    grid: Path,
    output: Path,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Make a new grid from the ledger of a damaged one, tiles and all.

    Every excursion whose records are whole is fused again, under the settings and the model that it
    had. What cannot be saved is named, and the exit status is then 1. The old file is not changed.
    """
    from possmap.cli.progress import bar
    from possmap.errors import plural, printable
    from possmap.fusing.repair import repair as mend

    made = mend(grid, output, overwrite=overwrite, progress=bar)
    for one in made.lost:
        click.echo(f"possmap: {printable(str(grid))}: lost: {one}", err=True)
    if as_json:
        click.echo(
            json.dumps(
                {
                    "grid": str(output),
                    "excursions": made.excursions,
                    "records": made.records,
                    "tiles": made.tiles,
                    "lost": list(made.lost),
                    "digest": made.digest,
                    "same_digest": made.same,
                }
            )
        )
    else:
        same = "the digest of the old one" if made.same else "another digest than the old one"
        click.echo(
            f"{printable(str(output))}: {plural(made.excursions, 'excursion')}, "
            f"{plural(made.records, 'record')}, {plural(made.tiles, 'tile')}; {same}"
        )
    if made.lost:
        ctx.exit(1)

"""``possmap fuse``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from possmap.cli import options


@click.command(epilog="Example: possmap fuse data/json -g site.possmap")
@options.logs
@click.option(
    "-g",
    "--grid",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="SITE.possmap",
    help="The grid file; made if it does not exist.",
)
@options.settings
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Processes that stamp tiles; worth it for many logs.",
)
@click.option("--strict", is_flag=True, help="The first refused log ends the run, nothing is kept.")
@click.option("--dry-run", is_flag=True, help="Read and judge the logs, write nothing.")
@options.allow_truncated
@options.as_json
@click.pass_context
def fuse(
    ctx: click.Context,
    /,
    logs: tuple[str, ...],
    grid: Path,
    jobs: int,
    strict: bool,
    dry_run: bool,
    allow_truncated: bool,
    as_json: bool,
    **settings: Any,
) -> None:
    """Fuse LOGs into a grid.

    A LOG is a file (.json, .jsonl, .ndjson, .csv, each also .gz), a folder of such files, - for
    JSON Lines on stdin, or another grid, whose ledger is fused anew under the settings of this
    one. Each record counts once, however often and by whomever it is delivered. A refused log
    changes nothing; the others are fused, and the exit status is 1.

    The settings of the first fuse belong to the grid; later calls need none.
    """
    from possmap.app.fuse import fuse as fuse_logs
    from possmap.cli.progress import bar
    from possmap.errors import plural, printable

    try:
        summary = fuse_logs(
            logs,
            grid,
            options.request(**settings),
            strict=strict,
            dry_run=dry_run,
            allow_truncated=allow_truncated,
            jobs=jobs,
            progress=bar,
        )
    except KeyboardInterrupt:
        stays = "nothing was kept" if strict else "the grid holds whole logs only"
        click.echo(f"possmap: stopped; {stays}, and the same command completes the job", err=True)
        ctx.exit(1)
    for log in summary.logs:
        for message in (log.error, log.note):
            if message:
                click.echo(f"possmap: {message}", err=True)
    if as_json:
        click.echo(
            json.dumps(
                {
                    "grid": str(grid),
                    "logs": [
                        {
                            "path": log.path,
                            "status": log.status,
                            "records_new": log.records_new,
                            "records_known": log.records_known,
                            "error": log.error,
                        }
                        for log in summary.logs
                    ],
                    "records_new": summary.records_new,
                    "records_known": summary.records_known,
                    "seconds": round(summary.seconds, 3),
                }
            )
        )
    elif not ctx.obj["quiet"]:
        would = "would fuse" if dry_run else "fused"
        line = (
            f"{printable(str(grid))}: {would} {plural(summary.count('fused'), 'log')} "
            f"({plural(summary.records_new, 'new record')}), {summary.count('known')} known, "
            f"{summary.count('refused')} refused"
        )
        click.echo(line)
    if summary.count("refused"):
        ctx.exit(1)

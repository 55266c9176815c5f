"""``possmap fuse``."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.budget import Budget


class _Log(click.Path):
    """A log, a folder of logs, ``-`` or a grid, which exist; or a URL, of which nobody knows."""

    name = "log"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return value if "://" in value else super().convert(value, param, ctx)


def _dask(ctx: click.Context, param: click.Parameter, address: str | None) -> str | None:
    if address is None:
        return None
    known = r"local(:[1-9][0-9]{0,3})?|(tcp|tls)://.+:(?P<port>[0-9]+)"
    found = re.fullmatch(known, address)
    if found is None:
        raise click.BadParameter(f"found {address!r}, expected tcp://HOST:PORT, local or local:N")
    port = found["port"]
    if port is not None and not (len(port) <= 5 and 1 <= int(port) <= 65535):
        raise click.BadParameter(f"found the port {port[:20]}, expected 1 to 65535")
    return address


@click.command(epilog="Example: possmap fuse data/json -g site.possmap")
@click.argument(
    "logs",
    nargs=-1,
    required=True,
    type=_Log(exists=True, allow_dash=True),
    metavar="LOG...",
)
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
    help="Processes that do the work; worth it for some hundreds of logs.",
)
@click.option(
    "--dask",
    metavar="CLUSTER",
    callback=_dask,
    help="Let a cluster of dask do that: the scheduler's tcp://HOST:PORT, or local or local:N to "
    "start N workers here; needs the extra cluster (docs/cluster.md).",
)
@options.memory_of(4096, ", and each process of --jobs,")
@click.option("--strict", is_flag=True, help="The first refused log ends the run, nothing is kept.")
@click.option("--dry-run", is_flag=True, help="Read and judge the logs, write nothing.")
@click.option("--recursive", is_flag=True, help="Take the logs of folders within folders, too.")
@click.option(
    "--tolerate-refused",
    is_flag=True,
    help="Exit with 0 though logs were refused; they are named and counted all the same.",
)
@options.allow_truncated
@options.as_json
@click.pass_context
def fuse(
    ctx: click.Context,
    /,
    logs: tuple[str, ...],
    grid: Path,
    jobs: int,
    dask: str | None,
    budget: Budget,
    strict: bool,
    dry_run: bool,
    recursive: bool,
    tolerate_refused: bool,
    allow_truncated: bool,
    as_json: bool,
    **settings: Any,
) -> None:
    """Fuse LOGs into a grid.

    A LOG is a file (.json, .jsonl, .ndjson, .csv, each also .gz), a folder of such files, - for
    JSON Lines on stdin, or another grid, whose ledger is fused anew under the settings of this
    one; with the extra cluster also a URL, such as s3://BUCKET/LOG.json. Each record counts once,
    however often and by whomever it is delivered. A refused log changes nothing; the others are
    fused, and the exit status is 1, or with --tolerate-refused 0: then 1 says that something else
    is wrong.

    The settings of the first fuse belong to the grid; later calls need none.
    """
    from possmap.cli.progress import bar
    from possmap.errors import plural, printable
    from possmap.fusing.fuse import fuse as fuse_logs
    from possmap.fusing.reach import reach_line

    if dask is not None and jobs > 1:
        raise click.UsageError("--dask and --jobs exclude each other")
    try:
        summary = fuse_logs(
            logs,
            grid,
            options.request(**settings),
            strict=strict,
            dry_run=dry_run,
            allow_truncated=allow_truncated,
            recursive=recursive,
            jobs=jobs,
            dask=dask,
            budget=budget,
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
        for told in reach_line(summary.reach, summary.undecided):
            click.echo(told)
    if summary.count("refused") and not (tolerate_refused and not strict):
        ctx.exit(1)

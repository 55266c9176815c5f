"""The command ``possmap``: finds the subcommand, and turns errors of the input into one line."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import signal
import sys
from importlib import import_module
from typing import Any

import click

from possmap.budget import collect_seldom
from possmap.errors import PossmapError, did_you_mean
from possmap.release import version

COMMANDS = {
    "fuse": "Fuse robots' logs into a grid.",
    "render": "Draw a grid: a map to look at, or a layer to read back.",
    "simulate": "Drive a team of robots through a world, and write its logs.",
    "convert": "Turn recordings of robots into logs.",
    "demo": "Simulate a shipped mission, fuse its logs and draw them.",
    "evaluate": "Say how true a grid is, beside grids of log-odds.",
    "calibrate": "Say how wrong robots are, and write the model that fuse takes.",
    "info": "Say what a grid holds: size, settings, robots, digest.",
    "query": "Say what is known of one point, and which records say so.",
    "diff": "Say in what two grids differ, and draw it.",
    "audit": "Say which robots and excursions contradict the others most.",
    "refine": "Make a grid in which one wall is one wall: moves tracks.",
    "forget": "Take evidence out of a grid, as if it had never come.",
    "export": "Write a grid in a format that other programs read.",
    "verify": "Look whether a grid file is whole and what its ledger says.",
    "repair": "Make a new grid from the ledger of a damaged one.",
    "check": "Validate logs and say what is in them.",
    "config": "Print the settings in force, as YAML to edit and give back.",
}
"""Each command, its module's name and its line in the help: no module is imported to list them."""


class _Lazy(click.Group):
    """Imports a command's module only when it runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = getattr(import_module(f"possmap.cli.{cmd_name}"), cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and not args[0].startswith("-") and args[0] not in COMMANDS:
            guess = did_you_mean(args[0], COMMANDS)
            ctx.fail(f"No such command {args[0]!r}{guess}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        # Before NumPy is imported. Its threads for linear algebra have nothing to do here, and each
        # takes a core for 0.1 s while it waits for work: a third of what a short fuse costs.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # A process that is asked to end still takes its half-written files with it.
        with contextlib.suppress(ValueError):  # not the main thread
            signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
            hangup = getattr(signal, "SIGHUP", None)  # the terminal went away
            if hangup is not None and signal.getsignal(hangup) is signal.SIG_DFL:  # no nohup
                signal.signal(hangup, lambda *_: sys.exit(129))
        collect_seldom()
        try:
            result = super().invoke(ctx)
            if sys.stdout is not None:  # None where it was closed before we began
                sys.stdout.flush()
        except PossmapError as error:
            click.echo(f"possmap: {error}", err=True)
            ctx.exit(1)
        except OSError as error:
            if error.errno != errno.ENOSPC or error.filename is not None:
                raise
            click.echo(f"possmap: the output cannot be written: {error.strerror}", err=True)
            ctx.exit(1)
        return result


def _print_version(ctx: click.Context, _: click.Parameter, asked: bool) -> None:
    if asked and not ctx.resilient_parsing:
        click.echo(f"possmap {version()}")
        if ctx.params.get("verbose"):
            from possmap.core.kernel import description  # imports NumPy

            click.echo(f"kernel: {description()}")
        ctx.exit()


@click.command(
    cls=_Lazy,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Example: possmap fuse data/json -g site.possmap",
)
# Eager, so that --version knows of it wherever it stands.
@click.option("-v", "--verbose", count=True, is_eager=True, help="Say more on stderr.")
@click.option("-q", "--quiet", is_flag=True, help="Say only what is wrong.")
@click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    callback=_print_version,
    help="Print the version; with -v, also which kernel runs.",
)
@click.pass_context
def main(ctx: click.Context, verbose: int, quiet: bool) -> None:
    """Turn the logs of robots that only know their wheels into one honest map."""
    ctx.obj = {"quiet": quiet, "verbose": verbose}
    level = (
        logging.ERROR if quiet else [logging.WARNING, logging.INFO, logging.DEBUG][min(verbose, 2)]
    )
    logging.basicConfig(level=level, format="possmap: %(message)s")

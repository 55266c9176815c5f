"""The commands that let something out of a grid, or into it again, as a message names them."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

from possmap.errors import GridError, brief, printable
from possmap.grid.forgotten import SHORT, Forgotten
from possmap.grid.grid import Grid


def refuse_refined(grid: Grid, instead: str) -> None:
    """Raise GridError for a grid that was refined: it changes only with what it was made of.

    instead : what is to be done to that grid.
    """
    making = None if grid.is_new else grid.ledger.tracks.making()
    if making is not None:
        raise GridError(
            f"{grid.database.name}: is refined, and is not changed; {instead} the grid that it was "
            f"made of (digest {brief(making.made_of, 12)}), and refine that anew"
        )


def how_to_forget(grid: Path, name: tuple[str, str]) -> str:
    """Return the command that takes out one excursion, and lets it come again.

    name : robot and excursion.
    """
    robot, excursion = map(word, name)
    return f"possmap forget {word(str(grid))} --robot {robot} --excursion {excursion} --once"


def how_to_recall(grid: Path | None, bar: Forgotten) -> str:
    """Return why something was not let in, with the command that lets it in again."""
    command = f"possmap forget {word(str(grid or 'SITE.possmap'))} {_options(bar)} --recall"
    when = printable(bar.forgotten_at)
    return f"{bar.title} was forgotten, {when}; {command} lets it in again"


def word(text: str) -> str:
    """Return a text as one word of a shell's command, and as a terminal may show it.

    What has control characters becomes ``$'...'``, which bash, zsh and POSIX of 2024 read.
    """
    if text == printable(text):
        return shlex.quote(text)
    return f"$'{''.join(_escaped(one) for one in text)}'"


def _escaped(one: str) -> str:
    if one.isprintable():
        return f"\\{one}" if one in "\\'" else one
    return "".join(f"\\{byte:03o}" for byte in os.fsencode(one))


def _options(bar: Forgotten) -> str:
    """Return what names it on a command line, whoever wrote it into the grid."""
    if bar.robot is None:
        return f"--brought-by {word((bar.sha256 or '')[:SHORT])}"
    if bar.excursion is None:
        return f"--robot {word(bar.robot)}"
    return f"--robot {word(bar.robot)} --excursion {word(bar.excursion)}"

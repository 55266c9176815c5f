"""What is not let into a grid because it was forgotten, and how to let it in (docs/trust.md)."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from itertools import islice, zip_longest
from pathlib import Path
from typing import NamedTuple

from possmap.errors import LogError, plural, printable
from possmap.fusing.stages import LaidOut
from possmap.grid.forgotten import SHORT, Bans, Forgotten
from possmap.logs import Delivery, LogFile

MOST_NAMED = 20
"""Of what keeps a log out; more of it would be no line that anybody reads."""


class Sifted(NamedTuple):
    """What of a log is let in, each delivery with what was laid out of it.

    note : what was not, for the user.
    """

    deliveries: list[tuple[Delivery, LaidOut | None]]
    note: str | None


class Admission:
    """Keeps out of a grid what was forgotten there.

    grid : its file, for messages.
    """

    def __init__(self, forgotten: Sequence[Forgotten], grid: Path | None) -> None:
        self._bans, self._grid = Bans(forgotten) if forgotten else None, grid

    def sift(self, log: LogFile, foreseen: Sequence[LaidOut | None]) -> Sifted:
        """Part what may come in from what may not.

        Raises
        ------
        LogError
            If nothing may.
        """
        all_of_it = list(zip_longest(log.deliveries, foreseen[: len(log.deliveries)]))
        if self._bans is None:
            return Sifted(all_of_it, None)
        let_in: list[tuple[Delivery, LaidOut | None]] = []
        barred: dict[Forgotten, set[tuple[str, str]]] = {}
        for delivery, laid_out in all_of_it:
            bar = self._bans.on(delivery.parcel.name, delivery.origin.sha256)
            if bar is None:
                let_in.append((delivery, laid_out))
            else:
                barred.setdefault(bar, set()).add(delivery.parcel.name)
        if not barred:
            return Sifted(all_of_it, None)
        why = "; ".join(self._why(bar) for bar in islice(barred, MOST_NAMED))
        if len(barred) > MOST_NAMED:
            why += f"; and {len(barred) - MOST_NAMED} more that possmap info lists"
        if not let_in:
            raise LogError(log.origin.name, f"not let in: {why}")
        count = plural(len(set().union(*barred.values())), "excursion")
        return Sifted(let_in, f"{printable(log.origin.name)}: {count} left out: {why}")

    def _why(self, bar: Forgotten) -> str:
        grid = word(str(self._grid or "SITE.possmap"))
        command = f"possmap forget {grid} {_options(bar)} --recall"
        when = printable(bar.forgotten_at)
        return f"{bar.title} was forgotten, {when}; {command} lets it in again"


def how_to_forget(grid: Path, name: tuple[str, str]) -> str:
    """Return the command that takes out one excursion, and lets it come again.

    name : robot and excursion.
    """
    robot, excursion = map(word, name)
    return f"possmap forget {word(str(grid))} --robot {robot} --excursion {excursion} --once"


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

"""What is not let into a grid because it was forgotten, and how to let it in (docs/trust.md)."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from possmap.app.stages import LaidOut
from possmap.errors import LogError, plural, printable
from possmap.files.gridfile.forgotten import SHORT, Forgotten
from possmap.files.logs import Delivery, LogFile, Origin


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
        self._forgotten, self._grid = forgotten, grid

    def sift(self, log: LogFile, foreseen: Sequence[LaidOut | None]) -> Sifted:
        """Part what may come in from what may not.

        Raises
        ------
        LogError
            If nothing may.
        """
        all_of_it = list(zip_longest(log.deliveries, foreseen[: len(log.deliveries)]))
        if not self._forgotten:
            return Sifted(all_of_it, None)
        let_in: list[tuple[Delivery, LaidOut | None]] = []
        barred: dict[Forgotten, set[tuple[str, str]]] = {}
        for delivery, laid_out in all_of_it:
            bar = self._bar(delivery)
            if bar is None:
                let_in.append((delivery, laid_out))
            else:
                barred.setdefault(bar, set()).add(delivery.parcel.name)
        if not barred:
            return Sifted(all_of_it, None)
        why = "; ".join(self._why(bar) for bar in barred)
        if not let_in:
            raise LogError(log.origin.name, f"not let in: {why}")
        count = plural(len(set().union(*barred.values())), "excursion")
        return Sifted(let_in, f"{printable(log.origin.name)}: {count} left out: {why}")

    def _bar(self, delivery: Delivery) -> Forgotten | None:
        for one in self._forgotten:
            if one.bars(delivery.parcel.name, delivery.origin.sha256):
                return one
        return None

    def _why(self, bar: Forgotten) -> str:
        command = f"possmap forget {_word(self._grid)} {bar.options} --recall"
        return f"{bar.title} was forgotten, {bar.forgotten_at}; {command} lets it in again"


def how_to_forget(grid: Path, origin: Origin, others: Iterable[tuple[str, str, str]]) -> str:
    """Return the command that takes out what a file brought.

    others : name and hash of files that the grid knows, and when they came.
    """
    alike = any(name == origin.name and sha256 != origin.sha256 for name, sha256, _ in others)
    plain = origin.name == printable(origin.name)
    which = shlex.quote(origin.name) if plain and not alike else origin.sha256[:SHORT]
    return f"possmap forget {_word(grid)} --brought-by {which}"


def _word(grid: Path | None) -> str:
    return shlex.quote(printable(str(grid or "SITE.possmap")))

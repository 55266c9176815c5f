"""The errors that lie in the input or the machine, not in the program: one root, one line each."""

from __future__ import annotations

import json
from collections.abc import Iterable

_LONGEST_WORD = 64


class PossmapError(Exception):
    """Root of every error that a user can mend; the command line prints it in one line."""


class SettingsError(PossmapError):
    """A setting that is unknown, out of range, or contradicts those of the grid."""


class LogError(PossmapError):
    """A place in a log or a recording that cannot be trusted.

    Parameters
    ----------
    place
        ``file:line``, or the file alone where no line is to blame.
    problem
        Field, value found, what was expected.
    """

    def __init__(self, place: str, problem: str) -> None:
        super().__init__(f"{printable(place)}: {problem}")
        self.place = place
        self.problem = problem

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.place, self.problem)  # as it goes from one process to another


class ConflictError(LogError):
    """A version of an excursion that disagrees with one already known (METHOD §3, Versions)."""


class RecordingError(LogError):
    """A place in somebody's recording that cannot be used."""


class GridError(PossmapError):
    """A grid file that is not one, is damaged, newer than this program, or in use."""


class TileError(GridError):
    """A stored tile that is damaged, said by who does not know of which grid it is."""


class BudgetError(PossmapError):
    """Something that does not fit into the memory allowed (``--memory``)."""


class WorkerError(PossmapError):
    """A process of ``--jobs``, or a worker of ``--dask``, that ended before its work did."""


class MissingExtra(PossmapError):
    """A package that only some commands need, and that is not installed.

    Parameters
    ----------
    what
        What needs it.
    extra
        The extra of possmap that brings it.
    """

    def __init__(self, what: str, extra: str) -> None:
        super().__init__(f"{what} needs the extra {extra}: pip install 'possmap[{extra}]'")


class OutputError(PossmapError):
    """A result that cannot be written, or would be too large."""


def shown(value: object, limit: int = 60) -> str:
    """Return ``value`` as a message may quote it: ASCII, one line, no terminal codes, short."""
    if isinstance(value, str):
        value = value[: limit + 1]  # a hostile one may be long
    try:
        text = json.dumps(value)
    except (TypeError, ValueError, RecursionError):
        text = f"a {type(value).__name__}"
    return text if len(text) <= limit else text[: limit - 1] + "..."


def printable(text: str) -> str:
    """Return a file name as a terminal may show it: control characters escaped, letters kept."""
    return "".join(ch if ch.isprintable() else ascii(ch)[1:-1] for ch in text)


def brief(name: str, limit: int = 80) -> str:
    """Return a name out of a file of somebody else as ``printable`` does, but not at any length."""
    text = printable(name[: limit + 1])  # a hostile one may be long
    return text if len(text) <= limit else text[: limit - 3] + "..."


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return ``, did you mean "…"?`` for the closest of ``known``, or an empty string."""
    import difflib  # nobody needs it who makes no mistake

    close = difflib.get_close_matches(word[:_LONGEST_WORD], list(known), n=1)
    return f", did you mean {shown(close[0], _LONGEST_WORD)}?" if close else ""


def plural(count: int, word: str) -> str:
    """Return a count with its word: ``1 record``, ``2 records``, ``2 fixes``."""
    return f"{count} {word}" if count == 1 else f"{count} {word}{'es' if word[-1] == 'x' else 's'}"

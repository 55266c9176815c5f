"""From what the user names on the command line to logs: folders, files, URLs, other grids."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from possmap.budget import Budget
from possmap.errors import BudgetError, GridError, LogError, printable
from possmap.fusing import urls
from possmap.fusing.layout import LaidOut, Version, lay_out
from possmap.fusing.ledger_log import read_ledger
from possmap.logs import SUFFIXES, LogFile, encoding_of, read_log, read_stdin
from possmap.settings.limits import Limits
from possmap.settings.settings import Settings

STDIN = "-"
GRID_SUFFIX = ".possmap"
TIMES_COMPRESSED = 12
"""How much more text than bytes there is in a compressed log, about."""


def expand(inputs: Iterable[str], recursive: bool = False) -> Iterator[str]:
    """Yield the files that the inputs stand for, a folder's by name.

    recursive : those of folders within folders, too, folder by folder.

    A folder without a log yields itself, so that reading it says what is wrong.

    Raises
    ------
    MissingExtra
        For a URL, if what reads URLs is not installed.
    """
    for name in inputs:
        if urls.is_url(name):
            yield from urls.expand(name)
            continue
        logs = [] if name == STDIN else _logs_in(Path(name), recursive)
        yield from logs or [name]


def _logs_in(path: Path, recursive: bool) -> list[str]:
    """Return the logs in a folder by name; none if it is no folder or may not be read."""
    try:
        if not path.is_dir():
            return []
        here = sorted(path.iterdir())
        logs = [str(one) for one in here if encoding_of(one) is not None and not one.is_dir()]
        if recursive:
            # A link may lead back to where it is.
            folders = [one for one in here if one.is_dir() and not one.is_symlink()]
            logs += [log for folder in folders for log in _logs_in(folder, recursive)]
    except OSError:
        return []  # reading it says why
    return logs


def is_grid(name: str) -> bool:
    """Whether a name is that of a grid, whose ledger is read."""
    is_file = name != STDIN and not urls.is_url(name)
    return is_file and Path(name).suffix.lower() == GRID_SUFFIX


def size_of(name: str) -> int:
    """Return the size of a file [bytes]; 0 if it has none to tell, a guess for a URL."""
    if urls.is_url(name):
        return urls.TYPICAL_SIZE  # to ask takes as long as to read it
    try:
        return 0 if name == STDIN else Path(name).stat().st_size
    except OSError:
        return 0  # reading it says why


def text_of(name: str) -> int:
    """Return about how much text a file holds [bytes], which a compressed one does not show."""
    return size_of(name) * (TIMES_COMPRESSED if name.lower().endswith(".gz") else 1)


@dataclass(frozen=True, slots=True)
class How:
    """How to read logs.

    budget : memory that reading one of them, and all that follows, may take.
    folder : in which relative names are looked up; None: this process's.
    """

    settings: Settings
    allow_truncated: bool
    budget: Budget
    folder: str | None


@dataclass(frozen=True, slots=True)
class Read:
    """A log as read, or why it could not be.

    laid_out : what versions say that were laid out so far.
    """

    path: str
    log: LogFile | None
    error: str | None = None
    laid_out: list[tuple[Version, LaidOut]] = field(default_factory=list)

    def laid_out_of(self, version: Version) -> LaidOut | None:
        """Return what a version says, if just that was laid out."""
        for one, made in self.laid_out:
            if one.map is version.map and one.in_grid == version.in_grid:
                return made
        return None


def read_logs(names: Sequence[str], how: How, at_once: bool) -> list[Read]:
    """Read and check logs, or ledgers; what is wrong with one is noted beside its name.

    at_once : whether to lay out each robot's own excursion, as if the grid did not know it.
    """
    return [_read(name, how, at_once) for name in names]


def _read(name: str, how: How, at_once: bool) -> Read:
    shown = urls.public(name)
    # What is compressed, or streamed, shows its size only when it is read.
    limits = how.settings.limits
    most = min(limits.limit_file_mib, how.budget.log_bytes / 2**20)
    try:
        if not is_grid(name):
            how.budget.check_log(name, size_of(name))
        log = read(name, replace(limits, limit_file_mib=most), how.allow_truncated, how.folder)
    except (LogError, GridError, BudgetError) as error:
        by_budget = most < limits.limit_file_mib
        setting = f"(--memory {how.budget.mib})" if by_budget else "(setting limit_file_mib)"
        return Read(shown, None, str(error).replace("(setting limit_file_mib)", setting))
    except MemoryError:
        return Read(shown, None, f"{printable(shown)}: takes more memory than there is")
    return Read(shown, log, None, list(_laid_out(log, how.settings)) if at_once else [])


def _laid_out(log: LogFile, settings: Settings) -> Iterator[tuple[Version, LaidOut]]:
    """Lay out a robot's own excursion; what was carried home, others will deliver too."""
    for one in log.deliveries:
        if one.carrier is None:
            model = settings.model_in_force(one.whole.robot, one.whole.model)
            version = Version(one.version, model, 0, one.place)
            try:
                yield version, lay_out(version, settings.evidence, settings.limits)
            except LogError:
                continue  # it may be known, or forgotten: else it is laid out again, and refused


def read(name: str, limits: Limits, allow_truncated: bool, folder: str | None = None) -> LogFile:
    """Read one log, or the ledger of a grid as one.

    folder : in which a relative name is looked up; None: this process's.

    Raises
    ------
    LogError
        For a log that cannot be trusted, or a folder without logs.
    GridError
        For a grid that cannot be read, or whose ledger cannot be trusted.
    """
    if name == STDIN:
        return read_stdin(sys.stdin.buffer, limits, allow_truncated)
    if urls.is_url(name):
        return urls.read(name, limits, allow_truncated)
    path = Path(folder or "", name)
    try:
        is_folder = path.is_dir()
        if is_folder:
            next(path.iterdir(), None)  # says so if the folder may not be read
    except OSError as error:
        raise LogError(name, f"cannot be read: {error.strerror or error}") from error
    if is_folder:
        raise LogError(name, f"the folder holds no logs, expected files of {', '.join(SUFFIXES)}")
    if is_grid(name):
        return read_ledger(path, limits)
    return read_log(Path(name), limits, allow_truncated, Path(folder or ""))

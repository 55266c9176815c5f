"""What workers do with files: read some logs, and lay out what is in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from possmap.budget import Budget
from possmap.core.records import PartialMap
from possmap.errors import BudgetError, GridError, LogError, printable
from possmap.fusing import inputs, urls
from possmap.fusing.layout import LaidOut, Version, lay_out
from possmap.logs import Delivery, LogFile
from possmap.settings.settings import Settings


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

    laid_out : of each delivery, or None, what a grid would hold that did not know it.
    """

    path: str
    log: LogFile | None
    error: str | None = None
    laid_out: tuple[LaidOut | None, ...] = ()

    def laid_out_of(self, version: Version) -> LaidOut | None:
        """Return what a version says, if just that was laid out."""
        for one, done in zip(self.log.deliveries if self.log else (), self.laid_out, strict=False):
            is_meant = done is not None and one.name == version.map.name and version.in_grid == 0
            if is_meant and _has_extras_of(version.map, one.whole):
                return done
        return None


def _has_extras_of(one: PartialMap, other: PartialMap) -> bool:
    """Whether two versions that agree are equal to the last ``x_`` key."""
    return one is other or (
        one.extra == other.extra
        and [record.extra for record in one.records] == [record.extra for record in other.records]
    )


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
        if not inputs.is_grid(name):
            how.budget.check_log(name, inputs.size_of(name))
        log = inputs.read(
            name, replace(limits, limit_file_mib=most), how.allow_truncated, how.folder
        )
    except (LogError, GridError, BudgetError) as error:
        by_budget = most < limits.limit_file_mib
        setting = f"(--memory {how.budget.mib})" if by_budget else "(setting limit_file_mib)"
        return Read(shown, None, str(error).replace("(setting limit_file_mib)", setting))
    except MemoryError:
        return Read(shown, None, f"{printable(shown)}: takes more memory than there is")
    if not at_once:
        return Read(shown, log)
    return Read(shown, log, None, tuple(_laid_out(one, how.settings) for one in log.deliveries))


def _laid_out(one: Delivery, settings: Settings) -> LaidOut | None:
    """Lay out a robot's own excursion; what was carried home, others will deliver too."""
    if one.carrier is not None:
        return None
    model = settings.model_in_force(one.whole.robot, one.whole.model)
    try:
        return lay_out(
            Version(one.version, model, 0, one.place), settings.evidence, settings.limits
        )
    except LogError:
        return None  # it may be known, or forgotten: else it is laid out again, and refused

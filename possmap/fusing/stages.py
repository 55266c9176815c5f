"""The work of ``fuse``, cut so that any process can do it: read, lay out, stamp (docs/scale.md).

Every function here is pure but for the file that it reads, and takes and returns what can be sent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from possmap.budget import Budget
from possmap.core.evidence import Findings, Layer, findings
from possmap.core.fusion import fuse_tile
from possmap.core.lattice import TileKey
from possmap.core.model import ErrorModel
from possmap.core.plan import ExcursionPlan, TileWork, plan_excursion
from possmap.core.settings import EvidenceSettings
from possmap.errors import BudgetError, GridError, LogError, printable
from possmap.fusing import inputs
from possmap.fusing.work import might_be_lost, most_work, works_of
from possmap.grid.encoding import EncodedTile, encode, unpacked
from possmap.grid.rows import ExcursionRows, excursion_rows
from possmap.logs import Delivery, LogFile, Parcel
from possmap.settings.limits import Limits
from possmap.settings.settings import Settings


class ReadTask(NamedTuple):
    """Logs to read.

    budget : memory that reading one of them, and all that follows, may take.
    foresee : settings under which to lay out each robot's own excursion at once, as if the grid
        did not know it, which it seldom does; None: not yet.
    """

    names: tuple[str, ...]
    limits: Limits
    allow_truncated: bool
    budget: Budget
    foresee: Settings | None = None


class Read(NamedTuple):
    """A log as read, or why it could not be.

    foreseen : of each delivery, what was laid out at once, if it was.
    """

    path: str
    log: LogFile | None
    error: str | None = None
    foreseen: tuple[LaidOut | None, ...] = ()


class LayoutTask(NamedTuple):
    """An excursion of which the grid does not hold everything.

    known_records : how many of its records, from the first, the grid holds.
    """

    parcel: Parcel
    model: ErrorModel
    known_records: int
    settings: EvidenceSettings


class Elsewhere(NamedTuple):
    """A plan that stays with whoever made it (``possmap.fusing.cluster.crew``).

    held : stands for what was made there in one go; digest : the excursion's hash, its name there.
    """

    held: Any
    digest: bytes


class LaidOut(NamedTuple):
    """What the ledger notes of an excursion, and what it says in which tiles."""

    rows: ExcursionRows
    plan: ExcursionPlan | Elsewhere


class TileTask(NamedTuple):
    """A tile, what to stamp into it, and what it holds, as it is stored."""

    work: TileWork
    stored: Mapping[Layer, EncodedTile]
    settings: EvidenceSettings


class TileResult(NamedTuple):
    """The layers of a tile that changed, as they are stored."""

    key: TileKey
    layers: Mapping[Layer, EncodedTile]


def read_logs(task: ReadTask) -> list[Read]:
    """Read and check logs, or ledgers; what is wrong with one is noted beside its name."""
    return [_read(name, task) for name in task.names]


def _read(name: str, task: ReadTask) -> Read:
    # What is compressed, or streamed, shows its size only when it is read.
    most = min(task.limits.limit_file_mib, task.budget.log_bytes / 2**20)
    try:
        if not inputs.is_grid(name):
            task.budget.check_log(name, inputs.size_of(name))
        log = inputs.read(name, replace(task.limits, limit_file_mib=most), task.allow_truncated)
    except (LogError, GridError, BudgetError) as error:
        by_budget = most < task.limits.limit_file_mib
        setting = f"(--memory {task.budget.mib})" if by_budget else "(setting limit_file_mib)"
        return Read(name, None, str(error).replace("(setting limit_file_mib)", setting))
    except MemoryError:
        return Read(name, None, f"{printable(name)}: takes more memory than there is")
    if task.foresee is None or inputs.is_grid(name):
        return Read(name, log)
    return Read(name, log, None, tuple(_foreseen(one, task.foresee) for one in log.deliveries))


def _foreseen(delivery: Delivery, settings: Settings) -> LaidOut | None:
    """Lay out a robot's own excursion; what was carried home, others will deliver too."""
    parcel, model = delivery.parcel, settings.model_in_force(*delivery.parcel.terms)
    lost = might_be_lost(parcel.span, parcel.count, model, settings.evidence.resolution)
    if delivery.carrier is not None or lost:
        return None
    limits, task = settings.limits, LayoutTask(parcel, model, 0, settings.evidence)
    most = most_work(parcel.span, parcel.count, model, settings.evidence)
    found = None
    if most.of_record > limits.limit_record_cells or most.of_excursion > limits.limit_file_cells:
        found = findings(parcel.version, model, settings.evidence)
        works = works_of(found, settings.evidence).values()
        record = max((one.of_record for one in works), default=0)
        whole = sum(one.of_file for one in works)
        if record > limits.limit_record_cells or whole > limits.limit_file_cells:
            return None  # to be refused, or too much to foresee
    return _laid_out(task, found)


def lay_out(tasks: list[LayoutTask]) -> list[LaidOut]:
    """Correct, propagate and lay out excursions, and cut what they say at the borders of tiles."""
    return [_laid_out(task) for task in tasks]


def _laid_out(task: LayoutTask, found: Findings | None = None) -> LaidOut:
    version = task.parcel.version
    found = found or findings(version, task.model, task.settings)
    plan = plan_excursion(found, task.known_records, task.settings)
    rows = excursion_rows(
        version, task.model, task.known_records, found.geometry, plan.touched(), found.observations
    )
    return LaidOut(rows, plan)


def stamp_tile(task: TileTask) -> TileResult:
    """Stamp everything new into one tile.

    Raises
    ------
    TileError
        If the stored tile is damaged.
    """
    key = task.work.key
    changed = fuse_tile(task.work, unpacked(key, task.stored), task.settings)
    return TileResult(key, {layer: encode(layer, key, array) for layer, array in changed.items()})

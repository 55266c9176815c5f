"""Joining versions: what a log adds to what is known, and what it contradicts (METHOD §3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeAlias

from possmap.core.model import ErrorModel
from possmap.core.records import Difference, PartialMap, first_difference
from possmap.errors import ConflictError, LogError, plural, printable
from possmap.fusing.advice import how_to_forget, how_to_recall
from possmap.fusing.layout import LaidOut, Version
from possmap.grid.arrivals import with_news
from possmap.grid.forgotten import Bans, Forgotten
from possmap.grid.ledger import Ledger
from possmap.logs import Delivery, LogFile, Origin
from possmap.settings.settings import Settings

MOST_NAMED = 20
"""Of what keeps a log out; more of it would be no line that anybody reads."""

Name: TypeAlias = tuple[str, str]
"""Robot and excursion."""

LayOut: TypeAlias = Callable[[Sequence[Version]], Iterable[LaidOut]]


class Bringer(NamedTuple):
    """What brought the records before ``end`` that no bringer before it did."""

    end: int
    place: str
    origin: Origin


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of an excursion, in the grid or joined since.

    version : all records known; of one that the grid knows, no more than had to be looked at.
    in_grid : how many the grid holds already.
    brought : by what the others came.
    """

    version: PartialMap
    model: ErrorModel
    in_grid: int
    brought: tuple[Bringer, ...] = ()


class Joined(NamedTuple):
    """What a log added: new records, and those known before; what of it was left out, and why."""

    records_new: int
    records_known: int
    is_new: bool
    note: str | None


@dataclass
class Joining:
    """Joins logs, one by one, to what the grid knows and to each other; writes nothing.

    Attributes
    ----------
    ledger
        The grid's; None if there is no grid yet.
    grid
        Its file, for messages that say what to do with it.
    strict
        Whether nothing is kept unless everything is.
    laid_out
        Of every excursion of which something is new: what the grid is to hold of it.
    came
        Every delivery that was let in, in the order of arrival.
    """

    settings: Settings
    ledger: Ledger | None = None
    grid: Path | None = None
    strict: bool = False
    laid_out: dict[Name, LaidOut] = field(default_factory=dict)
    came: list[Delivery] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._known: dict[Name, Known] = {}
        forgotten = self.ledger.forgotten.all() if self.ledger else ()
        self._bans = Bans(forgotten) if forgotten else None

    def join(self, log: LogFile, lay_out: LayOut) -> Joined:
        """Join a log file, whole.

        lay_out : lays out, one after the other, the versions that grew.

        Raises
        ------
        ConflictError
            If a version in it disagrees with one known, or with another in the same file.
        LogError
            If it is more work than the limits allow, cannot be laid out, or all that it holds was
            forgotten.
        """
        let_in, note = self._not_forgotten(log)
        longest: dict[Name, int] = {}
        for one in let_in:
            longest[one.name] = max(one.count, longest.get(one.name, 0))
        growing = {name: _Growing(self._what_is_known(name, longest[name])) for name in longest}
        for one in let_in:
            difference = growing[one.name].difference(one)
            if difference is not None:
                raise self._conflict(one, growing[one.name].known(), difference)
            growing[one.name].add(one, self.settings)
        grown = {name: one.known() for name, one in growing.items() if one.has_grown}
        versions = [
            Version(one.version, one.model, one.in_grid, one.brought[-1].place)
            for one in grown.values()
        ]
        laid_out = dict(zip(grown, self._bounded(log, lay_out(versions)), strict=True))
        self._known |= grown
        self.laid_out |= laid_out
        self.came += let_in
        new = sum(growing[name].new for name in grown)
        return Joined(new, sum(longest.values()) - new, bool(grown), note)

    def undo(self) -> None:
        """Forget all that was joined."""
        self._known.clear()
        self.let_go()

    def let_go(self) -> None:
        """Keep only what further logs are to be held against."""
        self.laid_out.clear()
        self.came.clear()

    def _not_forgotten(self, log: LogFile) -> tuple[Sequence[Delivery], str | None]:
        """Return what may come in, and what is to be said of the rest; LogError if nothing may."""
        if self._bans is None:
            return log.deliveries, None
        let_in: list[Delivery] = []
        barred: dict[Forgotten, set[Name]] = {}
        for one in log.deliveries:
            bar = self._bans.on(one.name, one.origin.sha256)
            if bar is None:
                let_in.append(one)
            else:
                barred.setdefault(bar, set()).add(one.name)
        if not barred:
            return let_in, None
        why = "; ".join(how_to_recall(self.grid, bar) for bar in list(barred)[:MOST_NAMED])
        if len(barred) > MOST_NAMED:
            why += f"; and {len(barred) - MOST_NAMED} more that possmap info lists"
        if not let_in:
            raise LogError(log.origin.name, f"not let in: {why}")
        count = plural(len(set().union(*barred.values())), "excursion")
        return let_in, f"{printable(log.origin.name)}: {count} left out: {why}"

    def _what_is_known(self, name: Name, longest: int) -> Known | None:
        """Return what is known of an excursion, of whose versions in a log the longest is given."""
        if name in self._known:
            return self._known[name]
        entry = self.ledger.entry(name) if self.ledger else None
        if entry is None or self.ledger is None:
            return None
        return Known(self.ledger.version(entry, longest), entry.model, entry.records)

    def _bounded(self, log: LogFile, laid_out: Iterable[LaidOut]) -> Iterable[LaidOut]:
        """Refuse a log of which all together is too much work, as soon as it is."""
        most, work = self.settings.limits.limit_file_cells, 0.0
        for one in laid_out:
            work += one.work
            if work > most and not log.is_ledger:  # each of a ledger's came in a log of its own
                raise LogError(
                    log.origin.name,
                    f"its records take {work:.3g} cells of work and more, expected at most "
                    f"{most:.3g} (setting limit_file_cells)",
                )
            yield one

    def _conflict(self, one: Delivery, known: Known, difference: Difference) -> ConflictError:
        """Return the error that says which file brought what is contradicted, and what to do."""
        robot, excursion = one.name
        source, can_go = self._blamed(one, known, difference.record)
        way_in = ""
        if can_go and self.grid is not None:
            command = how_to_forget(self.grid, one.name)
            way_in = f"; if the other version is false, {command} makes room for this one"
        return ConflictError(
            one.place,
            f"excursion {excursion} of robot {robot} disagrees with the version from {source}: "
            f"{difference.what}; another outing needs another excursion name{way_in}",
        )

    def _blamed(self, one: Delivery, known: Known, record: int | None) -> tuple[str, bool]:
        """Return what brought a record, or the model, and whether that can be forgotten."""
        number = record or 0
        if self.ledger is not None and number < max(1, known.in_grid):
            for arrival, first in with_news(self.ledger.came.of(one.name)):
                if first is not None and number < max(1, arrival.records):
                    name = printable(arrival.origin.name)
                    return f"{name}, fused {printable(arrival.fused_at)}", True
        for brought in known.brought:
            if number < max(1, brought.end):
                # What one file says of itself, or what will not be kept, cannot be forgotten.
                return printable(brought.place), brought.origin != one.origin and not self.strict
        return "the grid", False


class _Growing:
    """What is known of an excursion while the deliveries of one log are joined to it.

    The ledger of a grid delivers beginnings of the same records, perhaps thousands of them. So of
    what is delivered as the beginning of one whole no record is looked at or copied twice.
    """

    def __init__(self, known: Known | None) -> None:
        self._known = known
        self._whole: PartialMap | None = None  # what was delivered last
        self._agreed = 0  # so many of its records were compared
        self._longer: Delivery | None = None  # of the same whole: what continues what is known
        self._brought: list[Bringer] = []
        self.before = 0 if known is None else max(known.in_grid, len(known.version.records))
        self.has_grown = False

    @property
    def new(self) -> int:
        """How many records were added."""
        return len(self.known().version.records) - self.before

    def difference(self, one: Delivery) -> Difference | None:
        """Return where a delivery disagrees with what is known; None lets it be added."""
        if self._known is None:
            return None
        if one.whole is not self._whole:
            self._known, self._longer = self.known(), None
            self._brought.clear()
            found = first_difference(self._known.version, one.version)
            self._whole, self._agreed = one.whole, one.count
            return found
        # What continues what is known is of the same whole, and needs no look.
        mine = self._known.version.records
        here = slice(self._agreed, min(one.count, len(mine)))
        if here.start < here.stop and mine[here] != one.whole.records[here]:
            return first_difference(self._known.version, one.version)
        self._agreed = max(self._agreed, one.count)
        return None

    def add(self, one: Delivery, settings: Settings) -> None:
        """Add what does not disagree."""
        bringer = Bringer(one.count, one.place, one.origin)
        if self._known is None:
            model = settings.model_in_force(one.whole.robot, one.whole.model)
            self._known = Known(one.version, model, 0, (bringer,))
            self._whole, self._agreed, self.has_grown = one.whole, one.count, True
            return
        known = (
            self._longer.count
            if self._longer
            else max(self._known.in_grid, len(self._known.version.records))
        )
        if one.count > known:
            self._longer, self.has_grown = one, True
            self._brought.append(bringer)

    def known(self) -> Known:
        """Return what is known now."""
        assert self._known is not None
        if self._longer is None:
            return self._known
        return Known(
            self._known.version.continued_by(self._longer.version),
            self._known.model,
            self._known.in_grid,
            (*self._known.brought, *self._brought),
        )

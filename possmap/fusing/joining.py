"""Joining versions: what a log adds to what is known, and what it contradicts (METHOD §3)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple, TypeAlias

from possmap.core.model import FRAME, ErrorModel
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

    @property
    def count(self) -> int:
        """How many records are known."""
        return max(self.in_grid, len(self.version.records))


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
            If it is more work than the limits allow, cannot be laid out, is placed elsewhere by the
            host, or all that it holds was forgotten.
        """
        let_in, note = self._not_forgotten(log)
        before: dict[Name, Known | None] = {}
        after: dict[Name, Known] = {}
        longest = _longest(let_in)
        for one in _wholes(let_in):
            if one.name not in before:
                before[one.name] = self._what_is_known(one.name, longest[one.name])
            after[one.name] = self._joined(one, after.get(one.name, before[one.name]))
        known_before = {name: one.count if one else 0 for name, one in before.items()}
        grown = {
            name: one
            for name, one in after.items()
            if before[name] is None or one.count > known_before[name]
        }
        versions = [
            Version(one.version, one.model, one.in_grid, one.brought[-1].place)
            for one in grown.values()
        ]
        laid_out = dict(zip(grown, self._bounded(log, lay_out(versions)), strict=True))
        self._known |= grown
        self.laid_out |= laid_out
        self.came += let_in
        new = sum(one.count - known_before[name] for name, one in grown.items())
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

    def _joined(self, one: Delivery, known: Known | None) -> Known:
        """Return what is known with a delivery; ConflictError if it disagrees."""
        version, bringer = one.version, Bringer(one.count, one.place, one.origin)
        if known is None:
            return Known(version, self._model(one), 0, (bringer,))
        difference = first_difference(known.version, version)
        if difference is not None:
            raise self._conflict(one, known, difference)
        if one.count <= known.count:
            return known
        longer = known.version.continued_by(version)
        return replace(known, version=longer, brought=(*known.brought, bringer))

    def _model(self, one: Delivery) -> ErrorModel:
        """Return the model of an excursion not yet known; LogError if it lies in two places."""
        robot = one.whole.robot
        model = self.settings.model_in_force(robot, one.whole.model)
        for name, told in self.settings.robots.get(robot, {}).items():
            if name in FRAME and getattr(model, name) != told:
                raise LogError(
                    one.place,
                    f"model.{name}: found {getattr(model, name):g}, where the host places robot "
                    f"{robot} with {told:g} (--place); expected one of them, or the same",
                )
        return model

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


def _longest(deliveries: Sequence[Delivery]) -> dict[Name, int]:
    """Return how many records of each excursion were delivered, at most."""
    longest: dict[Name, int] = {}
    for one in deliveries:
        longest[one.name] = max(one.count, longest.get(one.name, 0))
    return longest


def _wholes(deliveries: Sequence[Delivery]) -> Iterable[Delivery]:
    """Return the longest beginning that was delivered of each whole.

    The ledger of a grid delivers beginnings of the same records, perhaps thousands of them.
    """
    longest: dict[int, Delivery] = {}
    for one in deliveries:
        if one.count >= longest.get(id(one.whole), one).count:
            longest[id(one.whole)] = one
    return longest.values()

"""Judging logs one by one: what is new, and whether it agrees with what is known (METHOD §3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from possmap.core.evidence import Findings, findings
from possmap.core.lattice import TileKey
from possmap.core.pyramid import FARTHEST
from possmap.core.records import PartialMap
from possmap.errors import ConflictError, LogError, printable
from possmap.fusing.admission import Admission, how_to_forget
from possmap.fusing.known import Growing, Known, Part
from possmap.fusing.stages import LaidOut
from possmap.fusing.work import TILE_WORK, most_work, tiles_of, works_of
from possmap.grid.arrivals import Arrival, with_news
from possmap.grid.ledger import Ledger
from possmap.logs import Delivery, LogFile, Origin, Parcel
from possmap.settings.settings import Settings

__all__ = ["Judge", "Known", "Verdict"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a log file adds: new records, and those known before.

    note : what of it was not let in.
    """

    records_new: int
    records_known: int
    is_new: bool
    note: str | None = None


@dataclass
class Judge:
    """Holds what was accepted and not yet written; judges the next log against it and the grid.

    Attributes
    ----------
    ledger
        None if there is no grid yet.
    grid
        The grid's file, for messages that say what to do with it.
    strict
        Whether nothing is kept unless everything is accepted.
    accepted
        Excursions with something that the grid does not hold.
    arrived
        All that files held, in the order of arrival.
    """

    settings: Settings
    ledger: Ledger | None = None
    grid: Path | None = None
    strict: bool = False
    accepted: dict[tuple[str, str], Known] = field(default_factory=dict)
    arrived: list[Arrival] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._admission = Admission(self.ledger.forgotten.all() if self.ledger else (), self.grid)

    def take(self, log: LogFile, foreseen: Sequence[LaidOut | None] = ()) -> Verdict:
        """Accept a log file whole.

        foreseen : of its deliveries, what was laid out as if nobody knew them.

        Raises
        ------
        ConflictError
            If a version in it disagrees with one known, or with another in the same file.
        LogError
            If one of its records, or all together, are more work than the limits allow, or all that
            it holds was forgotten.
        """
        growing: dict[tuple[str, str], Growing] = {}
        before: dict[tuple[str, str], Known | None] = {}
        let_in = self._admission.sift(log, foreseen)
        longest: dict[tuple[str, str], int] = {}
        for delivery, _ in let_in.deliveries:
            name, records = delivery.parcel.name, delivery.parcel.count
            longest[name] = max(records, longest.get(name, 0))
        for delivery, laid_out in let_in.deliveries:
            name = delivery.parcel.name
            if name not in growing:
                known = before[name] = self._known(name, longest[name])
                if known is None:
                    known = self._new(delivery, laid_out)
                growing[name] = Growing(known, is_first=before[name] is None)
            self._joined(growing[name], delivery)
        found = {name: one.known() for name, one in growing.items()}
        new = {name: known for name, known in found.items() if known is not before[name]}
        self._check_work(list(new.values()), at_once=not log.is_ledger)
        self.arrived += [
            Arrival(one.parcel.name, one.parcel.count, one.origin, one.carrier)
            for one, _ in let_in.deliveries
        ]
        self.accepted.update(new)
        added = sum(known.parcel.count - _count(before[name]) for name, known in new.items())
        return Verdict(added, sum(longest.values()) - added, bool(new), let_in.note)

    def forget(self) -> None:
        """Forget what was accepted."""
        self.accepted.clear()
        self.arrived.clear()

    def _known(self, name: tuple[str, str], longest: int) -> Known | None:
        """Return what is known of an excursion.

        longest : of its versions in a log; of a longer one in the grid no more is read.
        """
        if name in self.accepted:
            return self.accepted[name]
        entry = self.ledger.entry(name) if self.ledger else None
        if entry is None or self.ledger is None:
            return None
        version = self.ledger.version(entry, longest)
        return Known(Parcel(version), entry.model, entry.records)

    def _new(self, delivery: Delivery, laid_out: LaidOut | None) -> Known:
        """Return what is known by the first delivery of an excursion."""
        parcel = delivery.parcel
        model = self.settings.model_in_force(*parcel.terms)
        part = Part(0, parcel.count, delivery.origin)
        return Known(parcel, model, 0, (part,), (delivery.place,), laid_out)

    def _joined(self, growing: Growing, delivery: Delivery) -> Part | None:
        """Join a delivery to what is known; return what it brings, None if nothing."""
        difference = growing.difference(delivery.parcel)
        if difference is not None:
            robot, excursion = delivery.parcel.name
            place, way_in = self._blamed(growing.known(), difference.record, delivery.origin)
            raise ConflictError(
                delivery.place,
                f"excursion {excursion} of robot {robot} disagrees with the "
                f"version from {place}: {difference.what}; "
                f"another outing needs another excursion name{way_in}",
            )
        return growing.add(delivery)

    def _blamed(self, known: Known, record: int | None, mine: Origin) -> tuple[str, str]:
        """Return what brought a record, for a message, and what to do if that is what is false."""
        way_in = self._way_in(known.version)
        if self.ledger is not None:
            for arrival, first in with_news(self.ledger.came.of(known.version.name)):
                if first is not None and (record is None or first <= record < arrival.records):
                    name = printable(arrival.origin.name)
                    return f"{name}, fused {printable(arrival.fused_at)}", way_in
        for part, place in zip(known.parts, known.places, strict=True):
            if record is None or part.holds(record):
                # What one file says of itself, or what will not be kept, cannot be forgotten.
                lasts = part.origin != mine and not self.strict
                return printable(place), way_in if lasts else ""
        return "the grid", ""

    def _way_in(self, version: PartialMap) -> str:
        """Return the advice that always works, and takes no other excursion from anybody."""
        if self.grid is None:
            return ""
        command = how_to_forget(self.grid, version.name)
        return f"; if the other version is false, {command} makes room for this one"

    def _check_work(self, new: Sequence[Known], at_once: bool) -> None:
        """Refuse what is more work than the limits allow, before any is done.

        at_once : whether the file as a whole is bounded, or, as each came in one, the excursions.
        """
        if not at_once:
            for one in new:
                self._check_work([one], at_once=True)
            return
        limits, settings = self.settings.limits, self.settings.evidence
        most = [most_work(one.parcel.span, one.parcel.count, one.model, settings) for one in new]
        record, in_all = max((one.of_record for one in most), default=0), limits.limit_file_cells
        whole = sum(one.of_excursion for one in most) + TILE_WORK * sum(
            len(known.foreseen.rows.touched) if known.foreseen else one.tiles
            for known, one in zip(new, most, strict=True)
        )
        if record <= limits.limit_record_cells and whole <= in_all:
            return
        exact, tiles = 0.0, set[TileKey]()
        for known in new:
            found = findings(known.version, known.model, settings)
            self._check_places(known, found)
            exact += self._work(known, found)
            if exact <= in_all:  # else there may be too many to list
                tiles |= tiles_of(found, settings)
        exact += TILE_WORK * len(tiles)
        if exact > in_all:
            raise LogError(
                new[-1].places[-1].rpartition(":")[0],
                f"its records take {exact:.3g} cells of work, expected at most {in_all:.3g} "
                "(setting limit_file_cells)",
            )

    def _check_places(self, known: Known, found: Findings) -> None:
        """Refuse a record that the correction takes off every lattice."""
        most = FARTHEST * self.settings.evidence.resolution
        for number, at in found.geometry.items():
            away = max(abs(at.x), abs(at.y), abs(at.x2), abs(at.y2))
            if not away < most:
                raise LogError(
                    known.places[-1],
                    f"seq {known.version.records[number].seq} of excursion "
                    f"{known.version.excursion} of robot {known.version.robot} lies, corrected, "
                    f"{away:.3g} m from the origin, expected less than {most:.3g}",
                )

    def _work(self, known: Known, found: Findings) -> float:
        """Return the work of an excursion, but for its tiles; refuse a record of too much."""
        works = works_of(found, self.settings.evidence)
        limit = self.settings.limits.limit_record_cells
        for number, work in sorted(works.items()):
            if work.of_record > limit:
                raise LogError(
                    known.places[-1],
                    f"seq {known.version.records[number].seq} of excursion "
                    f"{known.version.excursion} of robot {known.version.robot} takes "
                    f"{work.of_record:.3g} cells of work, expected at most "
                    f"{limit:.3g} (setting limit_record_cells)",
                )
        return sum(work.of_file for work in works.values())


def _count(known: Known | None) -> int:
    return 0 if known is None else known.parcel.count

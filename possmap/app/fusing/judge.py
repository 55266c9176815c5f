"""Judging logs one by one: what is new, and whether it agrees with what is known (METHOD §3)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from possmap.app.fusing.admission import Admission, how_to_forget
from possmap.app.fusing.stages import LaidOut
from possmap.core.evidence import Findings, findings
from possmap.core.model import ErrorModel
from possmap.core.pyramid import FARTHEST, most_cells, swept_cells
from possmap.core.records import PartialMap, first_difference
from possmap.errors import ConflictError, LogError, printable
from possmap.files.gridfile.arrivals import Again, Part
from possmap.files.gridfile.ledger import Ledger
from possmap.files.logs import Delivery, LogFile, Origin, Parcel
from possmap.files.settings import Settings


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of an excursion, in the grid or accepted since.

    parcel : all records known.
    model : in force.
    in_grid : how many records the grid holds already.
    parts : what brought those that it does not hold.
    places : of each part accepted since, for messages.
    foreseen : what it says, if that was laid out when it was read.
    """

    parcel: Parcel
    model: ErrorModel
    in_grid: int
    parts: tuple[Part, ...] = ()
    places: tuple[str, ...] = ()
    foreseen: LaidOut | None = None

    @property
    def version(self) -> PartialMap:
        """All records known, unpacked."""
        return self.parcel.version


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
        Their parts, and what came once more by another file, in the order of arrival.
    """

    settings: Settings
    ledger: Ledger | None = None
    grid: Path | None = None
    strict: bool = False
    accepted: dict[tuple[str, str], Known] = field(default_factory=dict)
    arrived: list[tuple[tuple[str, str], Part | Again]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._admission = Admission(self.ledger.forgotten.all() if self.ledger else (), self.grid)
        self._held: dict[tuple[tuple[str, str], str], int] = {}

    def take(self, log: LogFile, foreseen: Sequence[LaidOut | None] = ()) -> Verdict:
        """Accept a log file whole.

        foreseen : of its deliveries, what was laid out as if nobody knew them.

        Raises
        ------
        ConflictError
            If a version in it disagrees with one known, or with another in the same file.
        LogError
            If one of its records touches more cells than the limit allows, or all that it holds
            was forgotten.
        """
        found: dict[tuple[str, str], Known] = {}
        before: dict[tuple[str, str], Known | None] = {}
        arrived: list[tuple[tuple[str, str], Part | Again]] = []
        let_in = self._admission.sift(log, foreseen)
        for delivery, laid_out in let_in.deliveries:
            name = delivery.parcel.name
            if name not in before:
                before[name] = self._known(name)
            known = found.get(name) or before[name]
            if known is None:
                found[name] = self._new(delivery, laid_out)
            else:
                found[name] = self._joined(known, delivery)
            if found[name] is not known:
                arrived.append((name, found[name].parts[-1]))
        new = {name: known for name, known in found.items() if known is not before[name]}
        self._check_cells(list(new.values()), at_once=not log.is_ledger)
        arrived += self._again((delivery for delivery, _ in let_in.deliveries), arrived)
        self.arrived += arrived
        self._held.update(((name, what.origin.sha256), what.end) for name, what in arrived)
        self.accepted.update(new)
        added = sum(known.parcel.count - _count(before[name]) for name, known in new.items())
        delivered: dict[tuple[str, str], int] = {}
        for delivery, _ in let_in.deliveries:
            name, records = delivery.parcel.name, delivery.parcel.count
            delivered[name] = max(records, delivered.get(name, 0))
        return Verdict(added, sum(delivered.values()) - added, bool(new), let_in.note)

    def forget(self) -> None:
        """Forget what was accepted."""
        self.accepted.clear()
        self.arrived.clear()
        self._held.clear()

    def _again(
        self,
        deliveries: Iterable[Delivery],
        arrived: Sequence[tuple[tuple[str, str], Part | Again]],
    ) -> list[tuple[tuple[str, str], Part | Again]]:
        """Return what came once more, by files that nobody has yet seen to hold as much."""
        noted = {(name, what.origin.sha256) for name, what in arrived}
        found: dict[tuple[tuple[str, str], str], Again] = {}
        for delivery in deliveries:
            key = delivery.parcel.name, delivery.origin.sha256
            again = Again(delivery.parcel.count, delivery.origin, delivery.carrier)
            if key in noted or (key in found and found[key].end >= again.end):
                continue
            found[key] = again
        return [(key[0], again) for key, again in found.items() if again.end > self._seen(*key)]

    def _seen(self, name: tuple[str, str], sha256: str) -> int:
        """Return how many records a file is known to have held, in the grid or accepted since."""
        found = self._held.get((name, sha256))
        if found is None and self.ledger is not None:
            found = self.ledger.came.held(name, sha256)
        return -1 if found is None else found

    def _known(self, name: tuple[str, str]) -> Known | None:
        if name in self.accepted:
            return self.accepted[name]
        entry = self.ledger.entry(name) if self.ledger else None
        if entry is None or self.ledger is None:
            return None
        return Known(Parcel(self.ledger.version(entry)), entry.model, entry.records)

    def _new(self, delivery: Delivery, laid_out: LaidOut | None) -> Known:
        """Return what is known by the first delivery of an excursion."""
        parcel = delivery.parcel
        model = self.settings.model_in_force(*parcel.terms)
        part = Part(0, parcel.count, delivery.origin, delivery.carrier)
        return Known(parcel, model, 0, (part,), (delivery.place,), laid_out)

    def _joined(self, known: Known, delivery: Delivery) -> Known:
        """Return what is known with the delivery; ``known`` itself if it brings nothing new."""
        version = delivery.version
        difference = first_difference(known.version, version)
        if difference is not None:
            place, way_in = self._blamed(known, difference.record, delivery.origin)
            raise ConflictError(
                delivery.place,
                f"excursion {version.excursion} of robot {version.robot} disagrees with the "
                f"version from {place}: {difference.what}; "
                f"another outing needs another excursion name{way_in}",
            )
        first = len(known.version.records)
        if len(version.records) <= first:
            return known
        part = Part(first, len(version.records) - first, delivery.origin, delivery.carrier)
        return replace(
            known,
            parcel=Parcel(known.version.continued_by(version)),
            parts=(*known.parts, part),
            places=(*known.places, delivery.place),
            foreseen=None,
        )

    def _blamed(self, known: Known, record: int | None, mine: Origin) -> tuple[str, str]:
        """Return what brought a record, for a message, and what to do if that is what is false."""
        way_in = self._way_in(known.version)
        if self.ledger is not None:
            for arrival in self.ledger.arrivals(known.version.name):
                if record is None or arrival.part.holds(record):
                    name = printable(arrival.part.origin.name)
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

    def _check_cells(self, new: Sequence[Known], at_once: bool) -> None:
        """Refuse what touches more cells than the limits allow, before any is touched.

        at_once : whether the file as a whole is bounded, or, as each came in one, the excursions.
        """
        if not at_once:
            for one in new:
                self._check_cells([one], at_once=True)
            return
        limits, resolution = self.settings.limits, self.settings.evidence.resolution
        most = [most_cells(one.parcel.span, one.parcel.count, one.model, resolution) for one in new]
        whole = sum(one.parcel.count * cells for one, cells in zip(new, most, strict=True))
        in_all = limits.limit_file_cells
        if max(most, default=0) <= limits.limit_record_cells and whole <= in_all:
            return
        exact = sum(self._cells_touched(known) for known in new)
        if exact > in_all:
            raise LogError(
                new[-1].places[-1].rpartition(":")[0],
                f"its records touch up to {exact:.3g} cells, expected at most {in_all:.3g} "
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

    def _cells_touched(self, known: Known) -> int:
        """Return an upper bound of the cells that an excursion touches, each record's by itself."""
        settings, limit = self.settings.evidence, self.settings.limits.limit_record_cells
        found = findings(known.version, known.model, settings)
        self._check_places(known, found)
        cells: dict[int, int] = {}
        for one in found.evidence:
            for segment in one.segments:
                swept = swept_cells(segment, settings.resolution, found.model.max_error)
                cells[segment.record] = cells.get(segment.record, 0) + swept
        for number, count in sorted(cells.items()):
            if count > limit:
                raise LogError(
                    known.places[-1],
                    f"seq {known.version.records[number].seq} of excursion "
                    f"{known.version.excursion} of robot {known.version.robot} touches up to "
                    f"{count:.3g} cells, expected at most {limit:.3g} "
                    "(setting limit_record_cells)",
                )
        return sum(cells.values())


def _count(known: Known | None) -> int:
    return 0 if known is None else known.parcel.count

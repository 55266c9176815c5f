"""Judging logs one by one: what is new, and whether it agrees with what is known (METHOD §3)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from possmap.core.evidence import Findings, findings
from possmap.core.model import ErrorModel
from possmap.core.pyramid import swept_cells
from possmap.core.records import PartialMap, first_difference
from possmap.errors import ConflictError, LogError, printable
from possmap.files.gridfile.ledger import Ledger, Part
from possmap.files.logs.delivery import Delivery, LogFile
from possmap.files.settings import Settings


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of an excursion, in the grid or accepted since.

    version : all records known.
    model : in force.
    in_grid : how many records the grid holds already.
    parts : what brought those that it does not hold.
    places : of each part accepted since, for messages.
    """

    version: PartialMap
    model: ErrorModel
    in_grid: int
    parts: tuple[Part, ...] = ()
    places: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a log file adds: new records, and those known before."""

    records_new: int
    records_known: int
    is_new: bool


@dataclass
class Judge:
    """Holds what was accepted and not yet written; judges the next log against it and the grid.

    Attributes
    ----------
    ledger
        None if there is no grid yet.
    accepted
        Excursions with something that the grid does not hold.
    laid_out
        What these say.
    arrived
        Their parts, in the order of arrival.
    """

    settings: Settings
    ledger: Ledger | None = None
    accepted: dict[tuple[str, str], Known] = field(default_factory=dict)
    laid_out: dict[tuple[str, str], Findings] = field(default_factory=dict)
    arrived: list[tuple[tuple[str, str], Part]] = field(default_factory=list)

    def take(self, log: LogFile) -> Verdict:
        """Accept a log file whole.

        Raises
        ------
        ConflictError
            If a version in it disagrees with one known, or with another in the same file.
        LogError
            If one of its records touches more cells than the limit allows.
        """
        found: dict[tuple[str, str], Known] = {}
        before: dict[tuple[str, str], Known | None] = {}
        arrived: list[tuple[tuple[str, str], Part]] = []
        for delivery in log.deliveries:
            name = delivery.version.name
            if name not in before:
                before[name] = self._known(name)
            known = found.get(name) or before[name]
            found[name] = self._joined(known, delivery)
            if found[name] is not known:
                arrived.append((name, found[name].parts[-1]))
        new = {name: known for name, known in found.items() if known is not before[name]}
        laid_out = {name: self._laid_out(known) for name, known in new.items()}
        self.arrived += arrived
        self.accepted.update(new)
        self.laid_out.update(laid_out)
        added = sum(
            len(known.version.records) - _count(before[name]) for name, known in new.items()
        )
        delivered: dict[tuple[str, str], int] = {}
        for delivery in log.deliveries:
            records = len(delivery.version.records)
            delivered[delivery.version.name] = max(records, delivered.get(delivery.version.name, 0))
        return Verdict(added, sum(delivered.values()) - added, bool(new))

    def forget(self) -> None:
        """Forget what was accepted."""
        self.accepted.clear()
        self.laid_out.clear()
        self.arrived.clear()

    def _known(self, name: tuple[str, str]) -> Known | None:
        if name in self.accepted:
            return self.accepted[name]
        entry = self.ledger.entry(name) if self.ledger else None
        if entry is None or self.ledger is None:
            return None
        return Known(self.ledger.version(entry), entry.model, entry.records)

    def _joined(self, known: Known | None, delivery: Delivery) -> Known:
        """Return what is known with the delivery; ``known`` itself if it brings nothing new."""
        version = delivery.version
        if known is None:
            model = self.settings.evidence.model_in_force(
                version.model, self.settings.robots.get(version.robot, {})
            )
            part = Part(0, len(version.records), delivery.origin, delivery.carrier)
            return Known(version, model, 0, (part,), (delivery.place,))
        difference = first_difference(known.version, version)
        if difference is not None:
            raise ConflictError(
                delivery.place,
                f"excursion {version.excursion} of robot {version.robot} disagrees with the "
                f"version from {self._source(known, difference.record)}: {difference.what}; "
                "another outing needs another excursion name",
            )
        first = len(known.version.records)
        if len(version.records) <= first:
            return known
        part = Part(first, len(version.records) - first, delivery.origin, delivery.carrier)
        return replace(
            known,
            version=known.version.continued_by(version),
            parts=(*known.parts, part),
            places=(*known.places, delivery.place),
        )

    def _source(self, known: Known, record: int | None) -> str:
        """Return what brought a record, for a message."""
        if self.ledger is not None:
            for arrival in self.ledger.arrivals(known.version.name):
                if record is None or arrival.part.holds(record):
                    return f"{printable(arrival.part.origin.name)}, fused {arrival.fused_at}"
        for part, place in zip(known.parts, known.places, strict=True):
            if record is None or part.holds(record):
                return printable(place)
        return "the grid"

    def _laid_out(self, known: Known) -> Findings:
        found = findings(known.version, known.model, self.settings.evidence)
        _check_cells(found, known, self.settings)
        return found


def _count(known: Known | None) -> int:
    return 0 if known is None else len(known.version.records)


def _check_cells(found: Findings, known: Known, settings: Settings) -> None:
    """Refuse a record that touches more cells than the limit allows, before any is touched."""
    resolution = settings.evidence.resolution
    cells: dict[int, int] = {}
    for one in found.evidence:
        for segment in one.segments:
            swept = swept_cells(segment, resolution, found.model.max_error)
            cells[segment.record] = cells.get(segment.record, 0) + swept
    limit = settings.limits.limit_record_cells
    for number, count in sorted(cells.items()):
        if count > limit:
            seq = known.version.records[number].seq
            raise LogError(
                known.places[-1],
                f"seq {seq} of excursion {known.version.excursion} of robot {known.version.robot} "
                f"touches up to {count:.3g} cells, expected at most {limit:.3g} "
                "(setting limit_record_cells)",
            )

"""What is known of an excursion, and what the deliveries of one log add to it (METHOD §3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from possmap.core.model import ErrorModel
from possmap.core.records import Difference, PartialMap, first_difference
from possmap.fusing.stages import LaidOut
from possmap.logs import Delivery, Origin, Parcel


@dataclass(frozen=True, slots=True)
class Part:
    """Some records of an excursion, and what brought them: first and count are their numbers."""

    first: int
    count: int
    origin: Origin

    def holds(self, number: int) -> bool:
        """Whether it brought the record of that number."""
        return self.first <= number < self.first + self.count


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


class Growing:
    """What is known of an excursion while the deliveries of one log are joined to it.

    The ledger of a grid delivers beginnings of the same records, perhaps thousands of them. So of
    what is delivered as the beginning of one whole no record is looked at twice, and records,
    parts and places are put together at the end.

    Parameters
    ----------
    known
        Before the log.
    is_first
        Whether that is the log's own first delivery.
    """

    def __init__(self, known: Known, is_first: bool) -> None:
        self._known = known
        self._whole = known.parcel.whole if is_first else None
        self._agreed = known.parcel.count if is_first else 0  # records of the whole compared so far
        self._longer: Parcel | None = None  # the whole's beginning that continues what is known
        self._parts: list[Part] = []
        self._places: list[str] = []

    def difference(self, parcel: Parcel) -> Difference | None:
        """Return where a delivery disagrees with what is known; None lets it be added."""
        if parcel.whole is not self._whole:
            known = self.known()
            self._known, self._longer = known, None
            self._parts.clear()
            self._places.clear()
            found = first_difference(known.version, parcel.version)
            if found is None:
                self._whole, self._agreed = parcel.whole, parcel.count
            return found
        # What continues what is known is of the same whole, and needs no look.
        here = slice(self._agreed, min(parcel.count, self._known.parcel.count))
        if here.start < here.stop and (
            self._known.version.records[here] != parcel.whole.version.records[here]
        ):
            return first_difference(self._known.version, parcel.version)
        self._agreed = max(self._agreed, parcel.count)
        return None

    def add(self, delivery: Delivery) -> Part | None:
        """Add what does not disagree; return what it brings, None if nothing."""
        known = self._known.parcel if self._longer is None else self._longer
        new = delivery.parcel.count - known.count
        if new <= 0:
            return None
        part = Part(known.count, new, delivery.origin)
        self._longer = delivery.parcel
        self._parts.append(part)
        self._places.append(delivery.place)
        return part

    def known(self) -> Known:
        """Return what is known now; if nothing was added, what was known before, itself."""
        if self._longer is None:
            return self._known
        return replace(
            self._known,
            parcel=Parcel(self._known.version.continued_by(self._longer.version)),
            parts=(*self._known.parts, *self._parts),
            places=(*self._known.places, *self._places),
            foreseen=None,
        )

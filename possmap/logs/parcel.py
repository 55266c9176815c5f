"""A partial map that travels between processes unopened: what is asked of most is on its label."""

from __future__ import annotations

import math
import pickle
from dataclasses import fields
from functools import cached_property
from operator import attrgetter

from possmap.core.records import KIND_OF, KINDS, Beam, Meet, OwnModel, PartialMap, Wall

_CONTENT = {kind: attrgetter(*(one.name for one in fields(kind))) for kind in KINDS.values()}


class Parcel:
    """One version of an excursion; where it was sent, its records are unpacked when looked at.

    Processes of one ``fuse`` send them to each other. Never unpickle one from elsewhere.

    Attributes
    ----------
    name
        Robot and excursion.
    own_model
        The log's own model parameters.
    count
        Of records.
    span
        Diagonal of the smallest box that holds every place logged [m].
    """

    _whole: Parcel | None = None

    def __init__(self, version: PartialMap) -> None:
        self.name = version.name
        self.own_model: OwnModel = version.model
        self.count = len(version.records)
        self.__dict__["version"] = version  # where the cached property looks first

    def beginning(self, count: int) -> Parcel:
        """Return the version that ends after ``count`` records, which are shared, not copied."""
        if count >= self.count:
            return self
        found = Parcel.__new__(Parcel)
        found.name, found.own_model, found.count = self.name, self.own_model, count
        found._whole = self.whole
        return found

    @property
    def whole(self) -> Parcel:
        """What it is the beginning of; itself, if it was not made so."""
        return self if self._whole is None else self._whole

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Parcel) and self.version == other.version

    def __hash__(self) -> int:
        return hash((self.name, self.count))

    def __repr__(self) -> str:
        return f"<parcel of {self.count} records of {self.name[0]} {self.name[1]}>"

    @property
    def terms(self) -> tuple[str, OwnModel]:
        """The robot, and its log's own model: what decides under which model it is fused."""
        return self.name[0], self.own_model

    @cached_property
    def version(self) -> PartialMap:
        """The records and all."""
        if self._whole is not None:
            return self._whole.version.prefix(self.count)
        extra, records = pickle.loads(self._packed)
        made = tuple(KINDS[kind](*values) for kind, *values in records)
        return PartialMap(*self.name, self.own_model, made, extra)

    @cached_property
    def _packed(self) -> bytes:
        # As plain tuples: five times as fast as hundreds of objects, each packed by itself.
        records = [(KIND_OF[type(one)], *_CONTENT[type(one)](one)) for one in self.version.records]
        return pickle.dumps((self.version.extra, records), pickle.HIGHEST_PROTOCOL)

    @cached_property
    def span(self) -> float:
        """Diagonal of the smallest box that holds every place logged [m]."""
        return _span(self.version)

    def __getstate__(self) -> dict[str, object]:
        label = {"name": self.name, "own_model": self.own_model, "count": self.count}
        if self._whole is not None:  # sent once with all its beginnings, as pickle does
            return {**label, "_whole": self._whole}
        return {**label, "span": self.span, "_packed": self._packed}


def _span(version: PartialMap) -> float:
    xs: list[float] = []
    ys: list[float] = []
    for record in version.records:
        if not isinstance(record, Meet):
            xs.append(record.x)
            ys.append(record.y)
            if isinstance(record, Wall | Beam):
                xs.append(record.x2)
                ys.append(record.y2)
    return math.hypot(max(xs) - min(xs), max(ys) - min(ys)) if xs else 0.0

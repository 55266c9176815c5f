"""What brought each excursion of a ledger, for whoever asks of one after the other.

A file of format 1 has no index that leads from an excursion to what brought it. So that of many
excursions is read at once.
"""

from __future__ import annotations

from collections.abc import Iterator

from possmap.errors import GridError
from possmap.grid.arrivals import Arrivals, Event
from possmap.grid.database import Database, Row
from possmap.grid.ledger import Entry

AT_ONCE = 1024
"""Excursions of which is read together."""


class Deliveries:
    """All that came of excursions, as it was when it was first asked for."""

    def __init__(self, database: Database, came: Arrivals) -> None:
        self._database, self._came = database, came
        self._span = range(0)
        self._rows: dict[object, list[Row]] | None = {}

    def events(self, entry: Entry) -> Iterator[Event]:
        """Yield all that came of an excursion, in the order of arrival.

        Raises
        ------
        GridError
            If something of it cannot have been written so.
        """
        if entry.identity not in self._span:
            self._read_on(entry.identity)
        if self._rows is None:
            return self._came.events(entry.name)
        return self._came.parsed(self._rows.get(entry.identity, ()))

    def _read_on(self, first: int) -> None:
        """Read what came of the excursions from one on."""
        sql = "SELECT max(id) FROM (SELECT id FROM excursion WHERE id >= ? ORDER BY id LIMIT ?)"
        (last,) = self._database.one(sql, (first, AT_ONCE)) or (first,)
        self._span = range(first, last + 1)
        try:
            self._rows = self._came.delivered(first, last)
        except GridError:  # one of them cannot even be read: then one by one
            self._rows = None

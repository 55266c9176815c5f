"""The JSON encoding: one log per file, its carried logs inside it (docs/logs.md)."""

from __future__ import annotations

from collections.abc import Iterator

from possmap.core.records import PartialMap
from possmap.errors import LogError, shown
from possmap.logs.builder import ExcursionBuilder, header_of, version_of
from possmap.logs.delivery import Delivery, LogFile, Origin, refusal
from possmap.logs.fields import Fault, Step, record_of, too_many
from possmap.logs.json_text import JsonSyntaxError, JsonText, find
from possmap.logs.parcel import Parcel
from possmap.logs.text import LogText
from possmap.settings.limits import Limits


def read_json(source: LogText, limits: Limits) -> LogFile:
    """Read one JSON log.

    Raises
    ------
    LogError
        With file, line and path, for the first thing that cannot be trusted.
    """
    origin = Origin(source.name, source.sha256, source.size)
    if source.is_cut:
        raise LogError(source.name, "the file is cut short")
    source.check_objects(limits)
    reader = _JsonLogReader(source.text, limits)
    try:
        versions = list(reader.log())
        reader.cursor.end()
    except JsonSyntaxError as error:
        line = reader.cursor.line(error.position)
        column = error.position - source.text.rfind("\n", 0, error.position)
        problem = f"not JSON: {error} (column {column})"
        raise LogError(f"{source.name}:{line}", problem) from None
    except _PlacedFault as placed:
        raise refusal(source.name, reader.cursor.line(placed.position), placed.fault) from None
    own = versions[0][1].name
    deliveries: list[Delivery] = []
    line, counted = 1, 0
    for position, version in versions:  # in the order of the text, which is read once more
        line += source.text.count("\n", counted, position)
        counted = position
        carrier = own if deliveries else None
        deliveries.append(Delivery(Parcel(version), f"{source.name}:{line}", origin, carrier))
    return LogFile(origin, tuple(deliveries))


class _PlacedFault(Exception):
    """A fault with its position in the text."""

    def __init__(self, position: int, fault: Fault) -> None:
        super().__init__(str(fault))
        self.position = position
        self.fault = fault


class _JsonLogReader:
    """Walks the one object of a JSON log."""

    def __init__(self, text: str, limits: Limits) -> None:
        self.text = text
        self.cursor = JsonText(text)
        self.nesting = limits.limit_nesting
        self.most = limits.limit_file_excursions

    def log(self, path: tuple[Step, ...] = ()) -> Iterator[tuple[int, PartialMap]]:
        """Yield the log's own version, then the carried ones, each with its position."""
        start = self.cursor.position
        header: dict[str, object] = {}
        builder = ExcursionBuilder()
        carried: list[tuple[int, PartialMap]] = []
        has_records = False
        depth = len(path) + 1
        try:
            if not self.cursor.is_at("{"):
                raise Fault((), f"found {shown(self.cursor.value())}, expected an object, a log")
            for key in self.cursor.members():
                if key == "records":
                    has_records = True
                    self._records(builder, (*path, key))
                elif key == "carried":
                    if path:
                        raise Fault((key,), "a carried log carries no others: list them beside it")
                    for index in self._items(key):
                        if index + 1 == self.most:  # its own is one more
                            raise too_many(self.most).below(key, index)
                        carried += self.log((key, index))
                else:
                    header[key] = self._header_value(key)
            if not has_records:
                raise Fault((), "records is missing, expected a list, perhaps empty")
            checked = header_of(header, self.nesting - depth, needs_version=not path)
        except Fault as fault:
            position = find(self.text, start, fault.path)
            raise _PlacedFault(position, fault.below(*path)) from None
        yield start, builder.build(checked)
        yield from carried

    def _header_value(self, key: str) -> object:
        try:
            value = self.cursor.value()
            if key == "possmap_log":  # now: a newer version may well have other records
                version_of(value)
        except Fault as fault:
            raise Fault((key,), fault.problem) from None
        return value

    def _items(self, key: str) -> Iterator[int]:
        if not self.cursor.is_at("["):
            raise Fault((key,), f"found {shown(self.cursor.value())}, expected a list")
        return self.cursor.items()

    def _records(self, builder: ExcursionBuilder, path: tuple[Step, ...]) -> None:
        nesting = self.nesting - len(path) - 2
        start, items = self.cursor.position, self._items("records")
        try:
            whole = self.cursor.plain_objects()
            if whole is not None:
                for value in whole:
                    builder.add(record_of(value, nesting))
                return
            for _ in items:
                builder.add(record_of(self.cursor.record(), nesting))
        except Fault as fault:
            index = len(builder.records)
            position = find(self.text, start, (index, *fault.path))
            raise _PlacedFault(position, fault.below(*path, index)) from None

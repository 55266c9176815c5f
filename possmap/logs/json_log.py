"""The JSON encoding: one log per file, its carried logs inside it (docs/logs.md)."""

from __future__ import annotations

from collections.abc import Iterator

from possmap.errors import LogError, shown
from possmap.logs.delivery import refusal
from possmap.logs.excursion import GrowingExcursion, LoggedVersion, header_of, too_many, version_of
from possmap.logs.fields import Fault, Step, record_of
from possmap.logs.json_text import JsonSyntaxError, JsonText, find
from possmap.logs.text import LogText
from possmap.settings.limits import Limits


def read_json(source: LogText, limits: Limits) -> list[LoggedVersion]:
    """Read one JSON log: its own version, then those that it carries.

    Raises
    ------
    LogError
        With file, line and path, for the first thing that cannot be trusted.
    """
    source.check_whole()
    source.check_objects(limits)
    text, reader = source.text, _JsonLogReader(source.text, limits)
    try:
        versions = reader.log()
        reader.cursor.end()
    except JsonSyntaxError as error:
        line = text.count("\n", 0, error.position) + 1
        column = error.position - text.rfind("\n", 0, error.position)
        problem = f"not JSON: {error} (column {column})"
        raise LogError(f"{source.name}:{line}", problem) from None
    except Fault as fault:
        line = text.count("\n", 0, find(text, fault.path)) + 1
        raise refusal(source.name, line, fault) from None
    own, *carried = versions
    return [own, *(one._replace(carrier=own.content.name) for one in carried)]


class _JsonLogReader:
    """Walks the one object of a JSON log."""

    def __init__(self, text: str, limits: Limits) -> None:
        self.cursor = JsonText(text)
        self._nesting = limits.limit_nesting
        self._most = limits.limit_file_excursions

    def log(self, path: tuple[Step, ...] = ()) -> list[LoggedVersion]:
        """Return the log's own version, then the carried ones."""
        excursion = GrowingExcursion(self.cursor.line)
        header: dict[str, object] = {}
        carried: list[LoggedVersion] = []
        seen: set[str] = set()
        try:
            if not self.cursor.is_at("{"):
                raise Fault((), f"found {shown(self.cursor.value())}, expected an object, a log")
            for key in self.cursor.members():
                if key in seen:
                    raise Fault((key,), "the key is given twice")
                seen.add(key)
                if key == "records":
                    self._records(excursion, self._nesting - len(path) - 3)
                elif key == "carried":
                    if path:
                        raise Fault((key,), "a carried log carries no others: list them beside it")
                    for index in self._items(key):
                        if index + 1 == self._most:  # its own is one more
                            raise too_many(self._most).below(key, index)
                        carried += self.log((key, index))
                else:
                    header[key] = self._header_value(key)
            if "records" not in seen:
                raise Fault((), "records is missing, expected a list, perhaps empty")
            checked = header_of(header, self._nesting - len(path) - 1, needs_version=not path)
        except Fault as fault:
            raise fault.below(*path) from None
        return [excursion.version(checked), *carried]

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

    def _records(self, excursion: GrowingExcursion, nesting: int) -> None:
        items = self._items("records")
        try:
            whole = self.cursor.plain_objects()
            if whole is not None:
                for value in whole:
                    excursion.add(record_of(value, nesting))
                return
            for _ in items:
                excursion.add(record_of(self.cursor.record(), nesting))
        except Fault as fault:
            raise fault.below("records", len(excursion.records)) from None

"""The JSON Lines encoding: what a robot appends while it drives (docs/logs.md)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from possmap.errors import LogError
from possmap.logs.delivery import refusal
from possmap.logs.excursion import GrowingExcursion, Header, LoggedVersion, header_of, too_many
from possmap.logs.fields import Fault, as_object, record_of
from possmap.logs.json_text import JsonSyntaxError, JsonText
from possmap.logs.text import LogText
from possmap.settings.limits import Limits


class _Open(NamedTuple):
    header: Header
    excursion: GrowingExcursion


def read_json_lines(
    source: LogText, limits: Limits, allow_truncated: bool
) -> tuple[list[LoggedVersion], str | None]:
    """Read any number of logs, each with the excursions that it carries.

    Parameters
    ----------
    allow_truncated
        Use what comes before a last line that was cut short, instead of refusing the file.

    Returns
    -------
    The versions, and where a last line that was cut was left out; None if none was.

    Raises
    ------
    LogError
        With file and line, for the first thing that cannot be trusted.
    """
    source.check_objects(limits)
    reader = _Lines(limits)
    cut_short: str | None = None
    for number, match in enumerate(_LINE.finditer(source.text), 1):
        line, line_end = match.groups("")
        if not line or line.isspace():
            continue
        try:
            reader.take(number, line)
        except JsonSyntaxError as error:
            if line_end:
                raise LogError(f"{source.name}:{number}", f"not JSON: {error}") from None
            cut_short = f"{source.name}:{number}"
        except Fault as fault:
            raise refusal(source.name, number, fault) from None
    if source.is_cut and cut_short is None:
        cut_short = f"{source.name}:{source.text.count(chr(10)) + 1}"
    if cut_short is not None and not allow_truncated:
        advice = "--allow-truncated uses the whole lines before it"
        raise LogError(cut_short, f"the last line is cut short; {advice}")
    versions = list(reader.versions())
    if not versions:
        raise LogError(f"{source.name}:1", "the file is empty, expected a header line")
    return versions, cut_short


_LINE = re.compile(r"([^\n]+)(\n?)|\n")


class _Lines:
    """Sorts the lines of a file into logs and excursions."""

    def __init__(self, limits: Limits) -> None:
        self._nesting = limits.limit_nesting - 1
        self._most = limits.limit_file_excursions
        self._opened = 0
        self._logs: list[dict[tuple[str, str], _Open]] = []
        self._present: _Open | None = None

    def take(self, number: int, line: str) -> None:
        """Take in one line: a header, or a record of the present excursion."""
        cursor = JsonText(line)
        fields = as_object(cursor.record())
        cursor.end()
        if "kind" not in fields and ("robot" in fields or "excursion" in fields):
            self._begin(number, fields)
        elif self._present is None:
            raise Fault((), "expected a header line with possmap_log, robot and excursion first")
        else:
            self._present.excursion.add(record_of(fields, self._nesting))

    def _begin(self, number: int, fields: dict[str, object]) -> None:
        if "records" in fields:
            raise Fault(
                ("records",), "a header line holds no records: one record a line follows it"
            )
        header = header_of(fields, self._nesting, needs_version=not self._logs)
        if header.version is not None:
            self._logs.append({})
        known = self._logs[-1].get(header.name)
        if known is None:
            if self._opened == self._most:
                raise too_many(self._most)
            self._opened += 1
            known = self._logs[-1][header.name] = _Open(header, GrowingExcursion(number))
        elif header.model not in ((), known.header.model):
            line = known.excursion.line
            raise Fault(("model",), f"differs from that of line {line}, which it continues")
        else:
            known.header.own.update(header.own)
        self._present = known

    def versions(self) -> Iterator[LoggedVersion]:
        """Yield what was read, log by log, each log's own excursion first."""
        for log in self._logs:
            own = next(iter(log))
            for name, one in log.items():
                yield one.excursion.version(one.header, None if name == own else own)

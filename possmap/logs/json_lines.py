"""The JSON Lines encoding: what a robot appends while it drives (docs/logs.md)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from possmap.errors import LogError
from possmap.logs.builder import ExcursionBuilder, Header, header_of
from possmap.logs.delivery import Delivery, LogFile, Origin, refusal
from possmap.logs.fields import Fault, as_object, record_of, too_many
from possmap.logs.json_text import JsonSyntaxError, JsonText
from possmap.logs.parcel import Parcel
from possmap.logs.text import LogText
from possmap.settings.limits import Limits


@dataclass
class _OpenExcursion:
    header: Header
    line: int
    builder: ExcursionBuilder = field(default_factory=ExcursionBuilder)
    extras: list[str] = field(default_factory=list)  # of the lines that continue it


def read_json_lines(source: LogText, limits: Limits, allow_truncated: bool) -> LogFile:
    """Read any number of logs, each with the excursions that it carries.

    Parameters
    ----------
    allow_truncated
        Use what comes before a last line that was cut short, instead of refusing the file.

    Raises
    ------
    LogError
        With file and line, for the first thing that cannot be trusted.
    """
    source.check_objects(limits)
    reader = _Lines(limits)
    cut_short: str | None = None
    for number, line, is_ended in _lines(source.text):
        try:
            reader.take(number, line)
        except JsonSyntaxError as error:
            if is_ended:
                raise LogError(f"{source.name}:{number}", f"not JSON: {error}") from None
            cut_short = f"{source.name}:{number}"
        except Fault as fault:
            raise refusal(source.name, number, fault) from None
    if source.is_cut and cut_short is None:
        cut_short = f"{source.name}:{source.text.count(chr(10)) + 1}"
    if cut_short is not None and not allow_truncated:
        advice = "--allow-truncated uses the whole lines before it"
        raise LogError(cut_short, f"the last line is cut short; {advice}")
    if not reader.logs:
        raise LogError(f"{source.name}:1", "the file is empty, expected a header line")
    origin = Origin(source.name, source.sha256, source.size)
    return LogFile(origin, tuple(reader.deliveries(origin)), cut_short)


def _lines(text: str) -> Iterator[tuple[int, str, bool]]:
    """Yield number, text and whether a line end follows, for each line that is not blank."""
    start, number = 0, 0
    while start < len(text):
        number += 1
        end = text.find("\n", start)
        line = text[start : end if end >= 0 else len(text)]
        if line.strip():
            yield number, line, end >= 0
        start = end + 1 if end >= 0 else len(text)


class _Lines:
    """Sorts the lines of a file into logs and excursions."""

    def __init__(self, limits: Limits) -> None:
        self.nesting = limits.limit_nesting - 1
        self._most = limits.limit_file_excursions
        self._opened = 0
        self.logs: list[dict[tuple[str, str], _OpenExcursion]] = []
        self._present: _OpenExcursion | None = None

    def take(self, number: int, line: str) -> None:
        """Take in one line: a header, or a record of the present excursion."""
        cursor = JsonText(line)
        value = cursor.record()
        cursor.end()
        fields = as_object(value)
        if "kind" not in fields and ("robot" in fields or "excursion" in fields):
            self._open(number, fields)
        elif self._present is None:
            raise Fault((), "expected a header line with possmap_log, robot and excursion first")
        else:
            self._present.builder.add(record_of(fields, self.nesting))

    def _open(self, number: int, fields: dict[str, object]) -> None:
        if "records" in fields:
            raise Fault(
                ("records",), "a header line holds no records: one record a line follows it"
            )
        header = header_of(fields, self.nesting, needs_version=not self.logs)
        if header.version is not None:
            self.logs.append({})
        log = self.logs[-1]
        name = (header.robot, header.excursion)
        known = log.get(name)
        if known is None:
            if self._opened == self._most:
                raise too_many(self._most)
            self._opened += 1
            known = log[name] = _OpenExcursion(header, number)
        elif header.model not in ((), known.header.model):
            raise Fault(("model",), f"differs from that of line {known.line}, which it continues")
        elif header.extra:
            known.extras.append(header.extra)
        self._present = known

    def deliveries(self, origin: Origin) -> Iterator[Delivery]:
        """Yield what was read, log by log, each log's own excursion first."""
        for log in self.logs:
            own = next(iter(log))
            for name, one in log.items():
                yield Delivery(
                    Parcel(one.builder.build(one.header.with_extras(one.extras))),
                    f"{origin.name}:{one.line}",
                    origin,
                    None if name == own else own,
                )

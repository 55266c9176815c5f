"""``possmap convert``: recordings of robots that already exist, written as logs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from possmap.atomic import check_output
from possmap.core.model import FRAME, ErrorModel
from possmap.core.ranges import LARGEST
from possmap.errors import (
    OutputError,
    RecordingError,
    SettingsError,
    plural,
    printable,
    shown,
)
from possmap.lab.convert.convert import ConvertOutcome, Whereabouts, convert
from possmap.lab.convert.legs import KnownPlace, Reference
from possmap.lab.convert.log import JsonRecord
from possmap.lab.convert.orthogonal import Alignment, align
from possmap.lab.convert.request import ConvertRequest, names_of
from possmap.lab.convert.samples import unwrapped
from possmap.lab.convert.settings import ConvertSettings
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings import Recording, Source, open_recordings
from possmap.lab.recordings.roles import Role
from possmap.logs import encoding_of
from possmap.logs.excursion import GrowingExcursion
from possmap.logs.fields import Fault, record_of
from possmap.logs.writing import LEG, LogWriter, check_name, is_folder, writing
from possmap.settings.limits import Limits

T = TypeVar("T")

APPLIED = ("drift", "turn_gain", "scale")
"""Parameters that are taken out of the track here, and so are not written into the log."""


FARTHEST_WAY = 3e5
"""A log of a longer way asks more work than the limits of ``check`` and ``fuse`` allow [m]."""


@dataclass(frozen=True, slots=True)
class Converted:
    """One recording, converted.

    robot : its name in the logs. outcome : what came of it. has_model : whether somebody said how
    wrong its odometry is. tally : what was left out on the way. alignment : what its walls say of
    the building's axes; None without long walls. settings : how it was converted.
    """

    recording: Recording
    robot: str
    has_model: bool
    outcome: ConvertOutcome
    tally: Tally
    alignment: Alignment | None
    settings: ConvertSettings


def convert_recordings(
    paths: Sequence[Path],
    output: Path,
    request: ConvertRequest,
    *,
    overwrite: bool = False,
    progress: Callable[[int, str], Any] | None = None,
) -> list[Converted]:
    """Convert recordings, and write their logs into one file or folder.

    Parameters
    ----------
    progress
        Called with the bytes to read and what is done; gives a context that is told bytes read.

    Raises
    ------
    RecordingError, SettingsError
        If a recording cannot be used.
    OutputError
        If the output exists, or cannot be written.
    """
    recordings = open_recordings(paths, request.source)
    check_name(output, several=len(recordings) > 1 or request.is_cut)
    if not is_folder(output):
        check_output(output, overwrite)
        _check_is_no_source(output, paths)
    starts = _of_each(recordings, request.starts, "--start")
    fixes = request.fixes
    if any(one.place is None for one in fixes):
        if request.reference is None and any(one.columns is None for one in fixes):
            raise SettingsError("--fix: found end=reference, expected a --reference with it")
        fixes = fixes * len(recordings) if len(fixes) == 1 else fixes
    ends = _of_each(recordings, fixes, "--fix")
    reference = _reference(request)
    names = names_of(recordings, request)
    _check_places(request, [robot for robot, _ in names], output)
    marks = [_marks(path, end, request.source) for path, end in zip(paths, ends, strict=False)]
    with writing(output, overwrite) as writer:
        return [
            _convert_one(
                recording,
                name,
                Whereabouts(
                    start=start, reference=reference, errors=request.errors, end=end, marks=known
                ),
                request,
                writer,
                progress,
            )
            for recording, name, start, end, known in zip(
                recordings, names, starts, ends, marks, strict=True
            )
        ]


def _check_places(request: ConvertRequest, robots: Sequence[str], output: Path) -> None:
    """Refuse places that would be lost: of unknown robots, or in a log without models."""
    for robot in request.models.places:
        if robot not in robots:
            known = ", ".join(dict.fromkeys(robots))
            raise SettingsError(f"--place: found robot {shown(robot)}, expected one of {known}")
    for robot in robots if request.settings.align else ():
        for name in FRAME:
            if name in request.models.of(robot):
                raise SettingsError(f"--align: found {name} as well, expected one of them")
    if (request.models.places or request.settings.align) and encoding_of(output) == ".csv":
        option = "--place" if request.models.places else "--align"
        problem = f"a CSV holds no place ({option}), expected .jsonl or a folder"
        raise OutputError(f"{printable(str(output))}: {problem}")


def _check_is_no_source(output: Path, paths: Sequence[Path]) -> None:
    if any(output.resolve() == path.resolve() for path in paths):
        name = printable(str(output))
        raise OutputError(f"{name}: is the recording itself, expected the name of a log")


def _of_each(
    recordings: Sequence[Recording], given: Sequence[T], option: str
) -> Sequence[T | None]:
    """Return what is given for each recording, in their order; None: nothing is."""
    if given and len(given) != len(recordings):
        found, several = len(given), plural(len(recordings), "recording")
        raise SettingsError(f"{option}: found {found} for {several}, expected one for each")
    return given or (None,) * len(recordings)


def _convert_one(
    recording: Recording,
    name: tuple[str, str],
    place: Whereabouts,
    request: ConvertRequest,
    writer: LogWriter,
    progress: Callable[[int, str], Any] | None,
) -> Converted:
    given = request.models.of(name[0])
    settings = replace(request.settings, known=ErrorModel(**given))
    alignment = None
    if settings.orthogonal or settings.align:
        with _told(progress, recording, "walls") as tell:
            # Once for the walls alone: their tally would count everything twice.
            seen = convert(
                recording.samples(Tally(), tell), recording.mounts, place, settings, None, Tally()
            )
        start_spread = math.radians(place.errors[2]) / settings.known.factor
        alignment = align(seen.bearings, start_spread)
        if settings.orthogonal and alignment is not None and not alignment.is_doubtful:
            place = replace(place, alignment=alignment)
    tally = Tally()
    model = {k: v for k, v in given.items() if k not in APPLIED}
    told = place.alignment
    if told is not None and "alignment_spread" not in model and math.isfinite(told.spread):
        spread = math.degrees(told.spread) * settings.known.factor
        model["alignment_spread"] = round(spread, 3)
    if settings.align and alignment is not None and alignment.tells_axes:
        model["frame_heading"] = round(-math.degrees(alignment.axis), 3)
        if not settings.orthogonal and "wall_tilt" not in model:
            model |= _tilt(alignment, settings)
    sink = _Written(writer, recording, name, model, request.is_cut)
    with _told(progress, recording, "convert") as tell:
        outcome = convert(
            recording.samples(tally, tell), recording.mounts, place, settings, sink, tally
        )
    if not outcome.legs:
        raise RecordingError(
            recording.name,
            f"gave fewer than two poses, expected a track{tally.explanation()}",
        )
    if outcome.way > FARTHEST_WAY:  # no check would take it
        raise RecordingError(
            recording.name,
            f"leads over {outcome.way / 1000:.0f} km, expected the way of a robot: are the units "
            "of length, speed and time those of the recording?",
        )
    if request.models.is_silent_on(name[0]):
        tally.add(
            f"models that do not name the robot {name[0]}, so that the log has none "
            f"(--robot {next(iter(request.models.robots))}?)",
        )
    if alignment is None:
        alignment = align(outcome.bearings)
    return Converted(recording, name[0], bool(given), outcome, tally, alignment, settings)


def _tilt(alignment: Alignment, settings: ConvertSettings) -> dict[str, float]:
    """Return how far walls lean from the axes, as the model has it, if that is more than usual."""
    lean = math.degrees(alignment.lean)
    return {"wall_tilt": round(lean, 2)} if lean > settings.known.wall_tilt else {}


class _Written:
    """Writes a recording's legs as excursions that the reader of logs would take."""

    def __init__(
        self,
        writer: LogWriter,
        recording: Recording,
        name: tuple[str, str],
        model: Mapping[str, float],
        is_cut: bool,
    ) -> None:
        self._writer = writer
        self._recording = recording
        self._name = name
        self._model = dict(model)
        self._legs = is_cut
        self._nesting = Limits().limit_nesting
        self._checked = GrowingExcursion()
        self.end = writer.end

    def begin(self, leg: int) -> None:
        robot, excursion = self._name
        head: dict[str, Any] = {
            "robot": robot,
            "excursion": f"{excursion}{LEG}{leg + 1:03d}" if self._legs else excursion,
        }
        if self._model:
            head["model"] = self._model
        head["x_source"] = self._recording.name
        self._checked = GrowingExcursion()
        self._writer.begin(head)

    def record(self, record: JsonRecord) -> None:
        """Write a record, once the door through which logs come in has let it pass.

        Raises
        ------
        RecordingError
            If it does not: of a recording in other units, perhaps.
        """
        try:
            self._checked.add(record_of(record, self._nesting))
        except Fault as fault:
            steps = ".".join(map(str, fault.path))
            problem = (
                f"would give a log that is refused: {record['kind']}, {steps}, {fault.problem}"
            )
            if abs(record.get("x", 0.0)) > LARGEST or abs(record.get("y", 0.0)) > LARGEST:
                problem += "; of coordinates of a country, --start 0,0,0 lays the begin at (0, 0)"
            raise RecordingError(self._recording.name, problem) from None
        del self._checked.records[:-1]  # the order of two is all that it looks at
        self._writer.record(record)


@contextmanager
def _told(
    progress: Callable[[int, str], Any] | None, recording: Recording, what: str
) -> Iterator[Callable[[int], None] | None]:
    if progress is None:
        yield None
        return
    with progress(recording.size, what) as tell:
        yield tell


def _reference(request: ConvertRequest) -> Reference | None:
    """Read the known poses, all of them: three numbers a pose stay in memory."""
    if request.reference is None:
        return None
    found = _poses(request.reference, request.reference_source)
    if found is None:
        raise RecordingError(str(request.reference), "gave no poses, expected a reference")
    return found


def _marks(path: Path, end: KnownPlace | None, source: Source) -> Reference | None:
    """Read the places that two columns of a recording have, in some of its rows."""
    if end is None or end.columns is None:
        return None
    mapping = source.mapping
    if mapping is None or mapping.format == "ros" or len(mapping.tables) != 1:
        raise SettingsError("--fix: found columns=, expected a --mapping of one table with it")
    (table,) = mapping.tables
    columns: dict[Role, str] = {"x": end.columns[0], "y": end.columns[1]}
    if "t" in table.columns:
        columns["t"] = table.columns["t"]
    told = replace(table, columns=columns, beams=(), scan=None)
    mapping = replace(mapping, tables=(told,))
    found = _poses(path, replace(source, mapping=mapping, max_speed=math.inf, sparse=True))
    if found is None:
        a, b = end.columns
        raise RecordingError(str(path), f"no row has numbers in {a} and {b}, expected some (--fix)")
    return found


def _poses(path: Path, source: Source) -> Reference | None:
    (recording,) = open_recordings([path], source)
    parts = list(recording.samples(Tally(), None))
    if not parts:
        return None
    t, x, y, yaw = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "x", "y", "yaw")
    )
    return Reference(t, x, y, unwrapped(yaw, None))

"""``possmap check``: validates logs and says what is in them; changes nothing."""

from __future__ import annotations

import cmath
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

from possmap.core.estimators import estimate
from possmap.core.linear import LinearError
from possmap.core.model import ErrorModel
from possmap.core.placing import placed
from possmap.core.propagation import RIGHT_ANGLE, PoseError
from possmap.core.records import KIND_OF, PartialMap, Pose, Wall
from possmap.core.settings import EvidenceSettings
from possmap.core.track import stretches, waiting
from possmap.core.walls import LEAST_LENGTH_M
from possmap.errors import PossmapError
from possmap.fusing import reading
from possmap.fusing.joining import Joining
from possmap.fusing.layout import LaidOut, Version, lay_out
from possmap.fusing.reach import Reach
from possmap.logs.delivery import LogFile
from possmap.progress import Progress, quiet
from possmap.settings.request import Request, in_force
from possmap.settings.settings import Settings


@dataclass(frozen=True, slots=True)
class Inspection:
    """What one version of an excursion holds.

    carried_by : robot and excursion of the log that carries it; None for the robot's own.
    kinds : records by kind.
    distance : logged [m].
    turns, turned_deg : how many, and how far in all, either way [deg].
    seconds : from the first time to the last; None without times.
    waiting : records after the last pose, which yield nothing yet.
    fixes_ignored : fixes that say nothing, for the estimator is not ``walls``.
    half_x, half_y : of the error rectangle at the last pose [m]; None without a pose.
    heading_half_deg : of the heading there [deg].
    """

    robot: str
    excursion: str
    carried_by: tuple[str, str] | None
    kinds: dict[str, int]
    distance: float
    turns: int
    turned_deg: float
    seconds: float | None
    waiting: int
    fixes_ignored: int
    half_x: float | None
    half_y: float | None
    heading_half_deg: float | None


@dataclass(frozen=True, slots=True)
class CheckedFile:
    """One file: what is in it, or why it is refused."""

    path: str
    excursions: tuple[Inspection, ...] = ()
    error: str | None = None
    note: str | None = None


@dataclass(frozen=True, slots=True)
class CheckSummary:
    """What a run of ``check`` found.

    reach : of every excursion: how much it can say.
    axes_deg : the building's direction as its walls tell it, -45 to 45; None without walls.
    """

    files: tuple[CheckedFile, ...] = field(default_factory=tuple)
    reach: dict[tuple[str, str], Reach] = field(default_factory=dict)
    axes_deg: float | None = None

    @property
    def refused(self) -> int:
        """How many files ``fuse`` would refuse."""
        return sum(one.error is not None for one in self.files)


def check(
    logs: Sequence[str],
    request: Request | None = None,
    *,
    allow_truncated: bool = False,
    progress: Progress = quiet,
) -> CheckSummary:
    """Validate logs, one by one and against each other, and say what is in them.

    Raises
    ------
    SettingsError
        If a given setting is wrong.
    """
    settings = in_force((request or Request()).given())
    joining = Joining(settings)
    names = progress(list(reading.expand(logs)), "log")
    files = tuple(_checked(name, joining, settings, allow_truncated) for name in names)
    reach = {name: one.reach for name, one in joining.laid_out.items()}
    wholes = (one.whole for one in joining.came)
    laid = (placed(one, settings.model_in_force(one.robot, one.model)) for one in wholes)
    return CheckSummary(files, reach, _axes(laid))


def _axes(versions: Iterable[PartialMap]) -> float | None:
    """Return the direction that most metres of wall lie along, or at right angles to [deg]."""
    along = 0j
    for version in {one.name: one for one in versions}.values():
        for record in version.records:
            if isinstance(record, Wall):
                run = complex(record.x2 - record.x, record.y2 - record.y)
                if abs(run) >= LEAST_LENGTH_M:
                    along += run**4 / abs(run) ** 3
    return math.degrees(cmath.phase(along)) / 4 if along else None


def _checked(name: str, joining: Joining, settings: Settings, allow_truncated: bool) -> CheckedFile:
    try:
        log = reading.read(name, settings.limits, allow_truncated)
        joining.join(log, partial(_laid_out, settings))
    except PossmapError as error:
        return CheckedFile(name, error=str(error))
    note = (
        f"{log.cut_short}: the last line is cut short and was left out" if log.cut_short else None
    )
    return CheckedFile(name, tuple(_inspections(log, settings)), note=note)


def _laid_out(settings: Settings, versions: Sequence[Version]) -> Iterator[LaidOut]:
    return (lay_out(one, settings.evidence, settings.limits) for one in versions)


def _inspections(log: LogFile, settings: Settings) -> Iterator[Inspection]:
    for delivery in log.deliveries:
        version = delivery.version
        robot = settings.robots.get(version.robot, {})
        model = settings.evidence.model_in_force(version.model, robot)
        last = _last_error(version, model, settings.evidence)
        yield _inspect(version, delivery.carrier, settings.evidence, last)


def _inspect(
    version: PartialMap,
    carrier: tuple[str, str] | None,
    settings: EvidenceSettings,
    last: PoseError | None,
) -> Inspection:
    track = stretches(version.records)
    kinds = dict(Counter(KIND_OF[type(record)] for record in version.records))
    turns = [stretch.turn_deg for stretch in track if stretch.turn_deg]
    times = [record.t for record in version.records if record.t is not None]
    return Inspection(
        robot=version.robot,
        excursion=version.excursion,
        carried_by=carrier,
        kinds=kinds,
        distance=sum(stretch.distance for stretch in track),
        turns=len(turns),
        turned_deg=sum(map(abs, turns)),
        seconds=times[-1] - times[0] if times else None,
        waiting=len(waiting(version.records)),
        fixes_ignored=0 if settings.estimator == "walls" else kinds.get("fix", 0),
        half_x=last.rectangle.half_x if last else None,
        half_y=last.rectangle.half_y if last else None,
        heading_half_deg=math.degrees(last.heading_half) if last else None,
    )


def _last_error(
    version: PartialMap, model: ErrorModel, settings: EvidenceSettings
) -> PoseError | None:
    """Return the error at the last pose, None without a pose."""
    first = next((record for record in version.records if isinstance(record, Pose)), None)
    if first is None:
        return None
    found = estimate(placed(version, model).records, model, settings)
    if found.errors:
        return found.errors[-1].after
    heading_half = min(RIGHT_ANGLE, math.radians(first.error_heading_deg))
    return LinearError(found.start, heading_half)

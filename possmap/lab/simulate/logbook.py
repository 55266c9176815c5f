"""A robot's memory: its belief and records, and what others handed over (METHOD §5).

What is handed over are always beginnings, never gaps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from possmap.core.correction import Believed, advance
from possmap.core.estimators import at_start
from possmap.core.model import ErrorModel
from possmap.core.propagation import CarriedError, after_stretch
from possmap.core.records import Beam, Corner, CornerKind, Meet, Pose, Record, Sighting, Wall
from possmap.core.settings import Estimator
from possmap.core.track import Stretch

RECORD_BYTES = 24
"""What a record costs on air and on board."""

Name: TypeAlias = tuple[str, str]
JsonRecord: TypeAlias = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Belief:
    """A robot's idea of where it is.

    logged : the last pose as it stands in its log.
    corrected : the same, corrected as the host will (METHOD §1).
    error : its own estimate of what may be wrong, by the host's propagation.
    """

    logged: Pose
    corrected: Believed
    error: CarriedError

    @property
    def heading(self) -> float:
        """The corrected heading [rad]."""
        return math.radians(self.logged.heading_deg + self.corrected.correction_deg)

    @property
    def worst(self) -> float:
        """The larger half-width of its error estimate [m]."""
        return max(self.error.rectangle.half_x, self.error.rectangle.half_y)

    def after(self, pose: Pose, seen: tuple[Sighting, ...], model: ErrorModel) -> Belief:
        """Return the belief at the next pose, given what was seen since the last."""
        numbered = tuple(enumerate(seen))
        stretch = Stretch.between(self.logged, pose, len(seen), numbered)
        corrected, laid = advance(self.corrected, stretch, model)
        error, _ = after_stretch(self.error, laid, model)
        return Belief(pose, corrected, error)


class Held:
    """What is known of an excursion: its model and its first records."""

    def __init__(self, model: Mapping[str, float]) -> None:
        self.model = dict(model)
        self.records: list[JsonRecord] = []


class Logbook:
    """Writes down one excursion as it happens, to 0.1 mm and 0.01°, and keeps its belief."""

    def __init__(
        self,
        name: Name,
        own_model: Mapping[str, float],
        model: ErrorModel,
        estimator: Estimator = "linear",
    ) -> None:
        self.name = name
        self.own = Held(own_model)
        self.relayed: dict[Name, Held] = {}
        self._model = model
        self._estimator: Estimator = estimator
        self._seen: list[Sighting] = []
        self._belief: Belief | None = None

    @property
    def belief(self) -> Belief:
        """Where the robot believes it is."""
        if self._belief is None:
            raise ValueError("an excursion begins with a pose")
        return self._belief

    @property
    def bytes(self) -> int:
        """The memory in use."""
        relayed = sum(len(held.records) for held in self.relayed.values())
        return RECORD_BYTES * (len(self.own.records) + relayed)

    def pose(
        self,
        t: float,
        x: float,
        y: float,
        heading_deg: float,
        turned: bool | None = None,
        ir: list[float] | None = None,
    ) -> None:
        """Write down where the robot believes it is [s, m, deg].

        turned : whether a heading that differs is of a turn, or a belief set anew; ir : readings.
        """
        x, y, heading_deg, t = round(x, 4), round(y, 4), round(heading_deg, 2), round(t, 2)
        seq = len(self.own.records)
        pose = Pose(seq, t, x + 0.0, y + 0.0, heading_deg + 0.0, turned=turned)
        if self._belief is None:
            self._belief = Belief(pose, Believed((pose.x, pose.y)), at_start(pose, self._estimator))
        else:
            self._belief = self._belief.after(pose, tuple(self._seen), self._model)
        self._seen.clear()
        extra = {"turned": turned, "x_ir": ir}
        extra = {key: value for key, value in extra.items() if value is not None}
        self._write(pose, "pose", x=pose.x, y=pose.y, heading=pose.heading_deg, **extra)

    def wall(self, t: float, x: float, y: float, x2: float, y2: float, followed: bool) -> None:
        """Write down a piece of wall [m]; both ends the same: one reading, or a bump."""
        x, y, x2, y2 = (round(value, 4) + 0.0 for value in (x, y, x2, y2))
        wall = Wall(len(self.own.records), round(t, 2), x, y, x2, y2, followed)
        self._seen.append(wall)
        self._write(wall, "wall", x=x, y=y, x2=x2, y2=y2, followed=followed)

    def corner(self, t: float, x: float, y: float, kind: CornerKind) -> None:
        """Write down a singular point [m]."""
        x, y = round(x, 4) + 0.0, round(y, 4) + 0.0
        corner = Corner(len(self.own.records), round(t, 2), x, y, kind)
        self._seen.append(corner)
        self._write(corner, "corner", x=x, y=y, corner=kind)

    def meeting(self, t: float, peer: Name, upto: int | None) -> None:
        """Write down that another robot was met, and up to which of its records one has them."""
        meet = Meet(len(self.own.records), round(t, 2), *peer, upto)
        fields = {} if upto is None else {"upto": upto}
        self._write(meet, "meet", peer=peer[0], peer_excursion=peer[1], **fields)

    def _write(self, record: Record, kind: str, **fields: object) -> None:
        assert not isinstance(record, Beam)
        self.own.records.append({"seq": record.seq, "kind": kind, "t": record.t, **fields})

    def as_log(self) -> dict[str, Any]:
        """Return the log that the robot delivers."""
        log: dict[str, Any] = {"possmap_log": 1, **_head(self.name, self.own)}
        carried = [
            {**_head(name, held), "records": held.records}
            for name, held in sorted(self.relayed.items())
            if held.records
        ]
        log["records"] = self.own.records
        if carried:
            log["carried"] = carried
        return log


def _head(name: Name, held: Held) -> dict[str, Any]:
    head: dict[str, Any] = {"robot": name[0], "excursion": name[1]}
    return {**head, "model": held.model} if held.model else head


def exchange(one: Logbook, other: Logbook, budget_bytes: int, memory_bytes: int) -> tuple[int, int]:
    """Let two robots hand over what the other lacks, until the time they stop for is used up.

    Parameters
    ----------
    budget_bytes
        What the link carries in that time, for both together.
    memory_bytes
        What each can hold.

    Returns
    -------
    tuple
        Records that ``one`` gave, and that it took.
    """
    records = budget_bytes // RECORD_BYTES
    # Half the time each; what one does not need, the other may use.
    given = _hand_over(one, other, records // 2, memory_bytes)
    taken = _hand_over(other, one, records - given, memory_bytes)
    given += _hand_over(one, other, records - given - taken, memory_bytes)
    return given, taken


def _hand_over(giver: Logbook, taker: Logbook, most: int, memory_bytes: int) -> int:
    """Hand over own records first, then relayed excursions, each from the first that is lacking."""
    most = min(most, max(0, memory_bytes - taker.bytes) // RECORD_BYTES)
    handed = 0
    for name, held in [(giver.name, giver.own), *sorted(giver.relayed.items())]:
        if handed == most:
            break
        if name != taker.name:
            handed += _top_up(taker.relayed, name, held, most - handed)
    return handed


def _top_up(relayed: dict[Name, Held], name: Name, held: Held, most: int) -> int:
    known = relayed.get(name)
    have = len(known.records) if known else 0
    news = held.records[have : have + most]
    if news:
        if known is None:
            known = relayed[name] = Held(held.model)
        known.records += news
    return len(news)


def seconds_of(records: int, rate: float) -> float:
    """Return how long the transfer of so many records takes [s], at a rate in bytes per second."""
    return records * RECORD_BYTES / rate

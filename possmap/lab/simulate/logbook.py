"""A robot's memory: its belief and records, and what others handed over (METHOD §5).

What is handed over are always beginnings, never gaps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from possmap.core.correction import Believed, advance
from possmap.core.estimators import at_start
from possmap.core.model import ErrorModel
from possmap.core.propagation import CarriedError, after_stretch
from possmap.core.records import CornerKind, Pose, Sighting, Wall
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
        stretch = Stretch.between(self.logged, pose, len(seen), tuple(enumerate(seen)))
        corrected, laid = advance(self.corrected, stretch, model)
        error, _ = after_stretch(self.error, laid, model)
        return Belief(pose, corrected, error)


@dataclass(frozen=True, slots=True)
class Held:
    """What is known of an excursion: its model, and its records from the first on."""

    model: Mapping[str, float]
    records: list[JsonRecord] = field(default_factory=list)

    def as_log(self, name: Name) -> dict[str, Any]:
        """Return it as a log has it, under its robot's and its own name."""
        head: dict[str, Any] = {"robot": name[0], "excursion": name[1]}
        return {**head, **({"model": self.model} if self.model else {}), "records": self.records}


class Logbook:
    """Writes down one excursion as it happens, to 0.1 mm and 0.01°, and keeps its belief.

    belief : where the robot believes it is; an excursion begins with a pose, which makes it.
    """

    belief: Belief

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

    @property
    def bytes(self) -> int:
        """The memory in use."""
        held = [self.own, *self.relayed.values()]
        return RECORD_BYTES * sum(len(one.records) for one in held)

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
        x, y, heading_deg = _metres(x), _metres(y), round(heading_deg, 2) + 0.0
        pose = Pose(len(self.own.records), round(t, 2), x, y, heading_deg, turned=turned)
        if self.own.records:
            self.belief = self.belief.after(pose, tuple(self._seen), self._model)
        else:
            self.belief = Belief(pose, Believed((x, y)), at_start(pose, self._estimator))
        self._seen.clear()
        extra = {"turned": turned, "x_ir": ir}
        known = {key: value for key, value in extra.items() if value is not None}
        self._write("pose", t, x=x, y=y, heading=heading_deg, **known)

    def wall(self, t: float, x: float, y: float, x2: float, y2: float, followed: bool) -> None:
        """Write down a piece of wall [m]; both ends the same: one reading, or a bump."""
        x, y, x2, y2 = map(_metres, (x, y, x2, y2))
        self._seen.append(Wall(len(self.own.records), round(t, 2), x, y, x2, y2, followed))
        self._write("wall", t, x=x, y=y, x2=x2, y2=y2, followed=followed)

    def corner(self, t: float, x: float, y: float, kind: CornerKind) -> None:
        """Write down a singular point [m]."""
        self._write("corner", t, x=_metres(x), y=_metres(y), corner=kind)

    def meeting(self, t: float, peer: Logbook) -> None:
        """Write down that another robot was met, and up to which of its records one has them."""
        held = self.relayed.get(peer.name)
        upto = {"upto": held.records[-1]["seq"]} if held else {}
        self._write("meet", t, peer=peer.name[0], peer_excursion=peer.name[1], **upto)

    def fix(self, t: float, x: float, y: float, half: float) -> None:
        """Write down where somebody says that the robot truly was at its last pose [m]."""
        self._write("fix", t, x=_metres(x), y=_metres(y), error_x=half, error_y=half)

    def _write(self, kind: str, t: float, **fields: object) -> None:
        seq = len(self.own.records)
        self.own.records.append({"seq": seq, "kind": kind, "t": round(t, 2), **fields})

    def as_log(self) -> dict[str, Any]:
        """Return the log that the robot delivers."""
        log = {"possmap_log": 1, **self.own.as_log(self.name)}
        carried = [held.as_log(name) for name, held in sorted(self.relayed.items())]
        return {**log, "carried": carried} if carried else log

    def top_up(self, name: Name, held: Held, most: int) -> int:
        """Take over what is lacking of an excursion, so many records at most; return how many."""
        have = len(self.relayed[name].records) if name in self.relayed else 0
        news = held.records[have : have + most]
        if news:
            self.relayed.setdefault(name, Held(held.model)).records.extend(news)
        return len(news)


def _metres(value: float) -> float:
    return round(value, 4) + 0.0  # -0 is 0


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
        if name != taker.name:
            handed += taker.top_up(name, held, most - handed)
    return handed

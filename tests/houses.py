"""Small houses, and robots that stray in them as they are told: what refining is tried on."""

from __future__ import annotations

import cmath
import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from possmap.core.model import ErrorModel
from possmap.core.records import PartialMap, Pose, Record, Wall
from possmap.core.settings import EvidenceSettings

SETTINGS = EvidenceSettings(
    estimator="walls",
    orthogonal=True,
    independence="excursion",
    free_fusion="dempster",
    model=ErrorModel(turn_spread=0.5, turn_noise=0.7),
)


class Leg(NamedTuple):
    """A run of so many metres in a direction, as the robot believes it.

    strays : by how much its true direction is more to the left [deg].
    sees : walls, x0, y0, x1, y1, where they truly stand [m].
    """

    direction: float
    metres: float
    strays: float = 0.0
    sees: tuple[tuple[float, float, float, float], ...] = ()


def outing(
    robot: str, name: str, legs: Iterable[Leg], start: tuple[float, float] = (0.0, 0.0)
) -> PartialMap:
    """Return what a robot logs that starts where it believes to."""
    true = believed = complex(*start)
    heading, records, t = 0.0, list[Record](), 0.0

    def pose() -> None:
        records.append(Pose(len(records), t, believed.real, believed.imag, heading))

    pose()
    for leg in legs:
        if leg.direction != heading:
            heading, t = leg.direction, t + 1
            pose()
        turned = cmath.rect(1.0, -math.radians(leg.strays))
        t += 2 * leg.metres
        for x0, y0, x1, y1 in leg.sees:
            one, other = (
                believed + (complex(*end) - true) * turned for end in ((x0, y0), (x1, y1))
            )
            records.append(
                Wall(len(records), t, one.real, one.imag, other.real, other.imag, followed=False)
            )
        true += cmath.rect(leg.metres, math.radians(leg.direction + leg.strays))
        believed += cmath.rect(leg.metres, math.radians(leg.direction))
        pose()
    return PartialMap(robot, name, (), tuple(records))


def write_logs(outings: Sequence[PartialMap], folder: Path) -> list[str]:
    """Write each as a log of its own; return their names."""
    folder.mkdir(exist_ok=True)
    names = []
    for one in outings:
        path = folder / f"{one.robot}-{one.excursion}.json"
        records = []
        for record in one.records:
            told = {"seq": record.seq, "t": record.t, "x": record.x, "y": record.y}
            if isinstance(record, Pose):
                records.append({**told, "kind": "pose", "heading": record.heading_deg})
            elif isinstance(record, Wall):
                ends = {"x2": record.x2, "y2": record.y2, "followed": record.followed}
                records.append({**told, "kind": "wall", **ends})
        path.write_text(
            json.dumps(
                {
                    "possmap_log": 1,
                    "robot": one.robot,
                    "excursion": one.excursion,
                    "records": records,
                }
            )
        )
        names.append(str(path))
    return names

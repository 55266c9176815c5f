"""How wide a robot's wheels stand and what a tick is worth, from the metadata beside a recording.

OptiOdom's ``*_metadata.csv``: rows of a name and values; ``ngear``, ``encRes``, ``Li`` (from wheel
to wheel [m]) and ``Di`` (diameters [m], right and left).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from possmap.errors import RecordingError, shown
from possmap.lab.recordings.mapping import Ticks
from possmap.logs.text import read_text
from possmap.settings.limits import Limits

PATTERN = "*_metadata.csv"


@dataclass(frozen=True, slots=True)
class TickGeometry:
    """A robot's build: its name for messages and models, and its ticks."""

    name: str
    ticks: Ticks

    @property
    def said(self) -> str:
        """What was found, for people."""
        left, right = (f"{worth * 1000:.4g}" for worth in self.ticks.worth)
        return (
            f"ticks of {left} and {right} mm, {self.ticks.track:g} m from wheel to wheel, by the "
            f"metadata beside it ({PATTERN})"
        )


def geometry_beside(recording: Path) -> TickGeometry | None:
    """Return the geometry told beside a recording; None where nothing tells it.

    Raises
    ------
    RecordingError
        If the metadata lack a number, or are of a robot without two driven wheels.
    """
    found = sorted(recording.parent.glob(PATTERN))
    prefix = recording.name.partition("_")[0]
    own = [one for one in found if one.name.startswith(prefix)] or found
    if not own:
        return None
    rows: dict[str, tuple[int, list[str]]] = {}
    text = read_text(own[0], Limits()).text
    for number, line in enumerate(text.lstrip("\ufeff").splitlines(), 1):
        name, *values = [part.strip() for part in line.split(",")]
        rows[name] = number, [value for value in values if value]
    if not rows.keys() & {"ngear", "encRes", "Li", "Di"}:  # of something else
        return None
    kind = rows.get("type", (1, [""]))[1]
    if kind != ["diff"]:
        raise RecordingError(
            f"{own[0]}:1", f"type, found {shown(''.join(kind))}, expected diff: two driven wheels"
        )
    (gear,), (encoder,), (track,) = (
        _numbers(own[0], rows, name, 1) for name in ("ngear", "encRes", "Li")
    )
    right, left = _numbers(own[0], rows, "Di", 2)
    turn = gear * encoder
    ticks = Ticks(
        left=math.pi * left / turn, right=math.pi * right / turn, track=track, cumulative=False
    )
    wheels = f"{right:g}" if right == left else f"{right:g}-{left:g}"
    return TickGeometry(f"Li{track:g}-Di{wheels}", ticks)


def _numbers(
    path: Path, rows: Mapping[str, tuple[int, list[str]]], name: str, count: int
) -> list[float]:
    line, values = rows.get(name, (1, []))
    try:
        found = [float(value) for value in values]
    except ValueError:
        found = []
    if len(found) != count or not all(0 < value < 1e6 for value in found):
        raise RecordingError(
            f"{path}:{line}", f"{name}, found {shown(values)}, expected {count} numbers > 0"
        )
    return found

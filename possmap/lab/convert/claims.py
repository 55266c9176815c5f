"""Which runs claim that the robot had lined up with a wall, so that its heading is known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from possmap.lab.convert.lines import FittedWall
from possmap.lab.convert.log import JsonRecord
from possmap.lab.convert.orthogonal import Alignment
from possmap.lab.convert.simplify import Outline

EVERY_M = 3.0
"""A claim is worth so much way.

METHOD lets nothing move sideways on a followed run. That is true of a robot that rubs along a wall,
not of one whose heading was computed from walls: each of its runs may be some degrees off. So few
runs claim, and the heading's spread grows again behind each (docs/convert.md has the figures)."""

PARALLEL = math.radians(20)
"""A run follows a wall if their directions differ by less."""


class Claims:
    """Lets some of the runs along walls of the building's axes claim to have followed them."""

    def __init__(self, alignment: Alignment) -> None:
        self._alignment = alignment
        self._since = math.inf

    def may(self, wall: FittedWall, outline: Outline, run: int) -> bool:
        """Whether a wall tells the heading, and the run goes along it."""
        if not self._alignment.tells(wall.angle, wall.length):
            return False
        dx = float(outline.x[run + 1] - outline.x[run])
        dy = float(outline.y[run + 1] - outline.y[run])
        if not (dx or dy):
            return False
        return abs(math.remainder(math.atan2(dy, dx) - wall.angle, math.pi)) < PARALLEL

    def settle(self, seen: Sequence[Sequence[JsonRecord]], outline: Outline) -> None:
        """Take back the claims of runs that come too soon behind another's.

        Parameters
        ----------
        seen
            The sightings of each run, changed in place.
        """
        lengths = np.hypot(np.diff(outline.x), np.diff(outline.y)).tolist()
        for length, records in zip(lengths, seen, strict=False):
            self._since += length
            claims = [record for record in records if record.get("followed")]
            if claims and self._since >= EVERY_M:
                self._since = 0.0
                continue
            for record in claims:
                record["followed"] = False

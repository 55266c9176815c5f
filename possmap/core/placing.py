"""A robot's own frame laid into the site's, before anything else (docs/method.md, §1)."""

from __future__ import annotations

import math
from dataclasses import replace

from possmap.core.model import ErrorModel
from possmap.core.records import Beam, Corner, PartialMap, Pose, Record, Wall

_DIGITS = 15
"""Of cosines and sines: those of right angles are then whole numbers."""


def placed(excursion: PartialMap, model: ErrorModel) -> PartialMap:
    """Return an excursion in the frame of the site; a fix stands there already.

    model : says where the robot's frame lies: ``frame_x``, ``frame_y`` [m], ``frame_heading``.
    """
    if not (model.frame_x or model.frame_y or model.frame_heading):
        return excursion
    angle = math.radians(model.frame_heading)
    cos, sin = round(math.cos(angle), _DIGITS), round(math.sin(angle), _DIGITS)

    def at(x: float, y: float) -> tuple[float, float]:
        return model.frame_x + cos * x - sin * y, model.frame_y + sin * x + cos * y

    def laid(one: Record) -> Record:
        match one:
            case Pose():
                x, y = at(one.x, one.y)
                wide, high = (
                    abs(a) * one.error_x + abs(b) * one.error_y for a, b in ((cos, sin), (sin, cos))
                )
                heading_deg = one.heading_deg + model.frame_heading
                return replace(one, x=x, y=y, heading_deg=heading_deg, error_x=wide, error_y=high)
            case Wall() | Beam():
                (x, y), (x2, y2) = at(one.x, one.y), at(one.x2, one.y2)
                return replace(one, x=x, y=y, x2=x2, y2=y2)
            case Corner():
                x, y = at(one.x, one.y)
                return replace(one, x=x, y=y)
        return one

    return replace(excursion, records=tuple(map(laid, excursion.records)))

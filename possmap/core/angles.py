"""Differences of headings, wrapped the way METHOD §0 asks."""

from __future__ import annotations

import math

HALF_TURN_TOLERANCE_DEG = 1e-6
"""Within this of ±180° a turn counts as +180°, a left turn."""


def wrap_degrees(angle_deg: float) -> float:
    """Return the angle wrapped to (-180, 180]; a half turn, within 1e-6°, is +180 (METHOD §0)."""
    wrapped = math.remainder(angle_deg, 360.0)
    if 180.0 - abs(wrapped) <= HALF_TURN_TOLERANCE_DEG:
        return 180.0
    return wrapped

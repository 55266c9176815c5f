"""The swath of a body: how surely a cell lay under a robot on its run (docs/method.md, §2).

A pyramid says that something is *somewhere* in an error rectangle. That is right for a wall seen,
and too much for a path: the robot was somewhere in the rectangle, but it cleared no more floor than
its body covers. So a path denies a wall in a cell as far as it is probable that the body went over
it: with b the larger of the body's width and a cell's side, d the distance of the cell's centre
from the path's line, a how far along the run of length l it lies, and normal errors,

    value = [Φ((b/2 - d)/σ⊥) - Φ((-b/2 - d)/σ⊥)] · [Φ((a + b/2)/σ∥) - Φ((a - l - b/2)/σ∥)]

σ⊥ and σ∥ are those of the place of the path nearest to the cell: √((n_x·h_x)² + (n_y·h_y)²)/factor,
n the unit vector across the run, and the same along it. Nothing is said beyond the rectangle, that
is where d > |n_x|·h_x + |n_y|·h_y + b/2, nor along the run beyond its ends likewise, nor where a
half-width reaches ``max_error``, there or at both stamps next to it. b/2 is a millionth of a cell
more, so that rounding does not move what lies on the very edge (METHOD §0).
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Segment
from possmap.core.lattice import HAIR, Window
from possmap.core.pyramid import Floats, Ints, Stamps, Values, count_of, quantised, relevant

_LEAST = 1e-12
"""In place of no error at all [m]."""


def normal_share(z: Floats) -> Floats:
    """Return the normal distribution up to z, to 1e-7; NumPy has none."""
    known, shares, _ = normal_table().T
    share: Floats = np.interp(z, known, shares)
    return share


@cache
def normal_table() -> Floats:
    """Return knots of the normal distribution: z, the share up to it, and the slope behind it.

    The shape is (6001, 3), z from -6 to 6; the last slope is 0.
    """
    # Only when somebody asks: it takes milliseconds.
    z = np.linspace(-6, 6, 6001)
    share = np.array([(1 + math.erf(one / math.sqrt(2))) / 2 for one in z])
    return np.stack([z, share, np.append(np.diff(share) / np.diff(z), 0.0)], axis=1)


def reach(some: Stamps, segment: Segment, resolution: float) -> Ints:
    """Return how many rows and columns from each stamp the swath may reach, generously.

    Up to the next stamp half-widths may grow by what they grow in a step.
    """
    one, other = segment.rect0, segment.rect1
    growth = abs(other.half_x - one.half_x) + abs(other.half_y - one.half_y)
    width = segment.swath.width if segment.swath else 0.0
    metres = 2 * (some.half_x + some.half_y + growth / count_of(segment, resolution))
    cells: Ints = np.ceil((metres + max(width, resolution)) / resolution).astype(np.int64) + 1
    return cells


def sweep(
    block: Values, window: Window, segment: Segment, resolution: float, max_error: float
) -> None:
    """Raise ``block`` to the maximum of itself and what a segment's swath says, in place.

    Parameters
    ----------
    block
        16-bit values of the cells of ``window``, shape (rows, columns).
    segment
        With a swath.
    max_error
        The error beyond which nothing is said [m].
    """
    if segment.swath is None:
        raise ValueError("expected a segment with a swath")
    half = max(segment.swath.width, resolution) / 2 + HAIR * resolution
    step_x, step_y = segment.x1 - segment.x0, segment.y1 - segment.y0
    length = math.sqrt(step_x * step_x + step_y * step_y)
    # A run that the correction shrinks to nothing: any direction will do.
    ahead_x, ahead_y = (step_x / length, step_y / length) if length else (1.0, 0.0)
    y = ((np.arange(window.row0, window.row1) + 0.5) * resolution - segment.y0)[:, None]
    x = ((np.arange(window.column0, window.column1) + 0.5) * resolution - segment.x0)[None]
    along, across = x * ahead_x + y * ahead_y, np.abs(y * ahead_x - x * ahead_y)
    share = np.clip(along, 0, length) / length if length else np.zeros_like(along)
    one, other = segment.rect0, segment.rect1
    half_x = one.half_x + share * (other.half_x - one.half_x)
    half_y = one.half_y + share * (other.half_y - one.half_y)
    beyond = np.maximum(np.maximum(-along, along - length), 0)
    heard = (half_x < max_error) & (half_y < max_error)
    heard &= _by_stamps(segment, share, resolution, max_error)
    heard &= across <= abs(ahead_y) * half_x + abs(ahead_x) * half_y + half
    heard &= beyond <= abs(ahead_x) * half_x + abs(ahead_y) * half_y + half
    if not heard.any():
        return
    along, across, half_x, half_y = (array[heard] for array in (along, across, half_x, half_y))
    # Times the factor, not divided by it: no factor may make a deviation overflow.
    factor = segment.swath.factor
    sharp_across = factor / np.maximum(_root(ahead_y * half_x, ahead_x * half_y), _LEAST)
    sharp_along = factor / np.maximum(_root(ahead_x * half_x, ahead_y * half_y), _LEAST)
    value = _between((half - across) * sharp_across, (-half - across) * sharp_across)
    value *= _between((along + half) * sharp_along, (along - length - half) * sharp_along)
    block[heard] = np.maximum(block[heard], quantised(value))


def _by_stamps(
    segment: Segment, share: Floats, resolution: float, max_error: float
) -> NDArray[np.bool_]:
    """Return whether a stamp next to a place of the path has a height: only then it has tiles.

    Where one half-width falls while the other rises, neither stamp may have, though the place
    between them would.
    """
    span = relevant(segment, resolution, max_error)
    first, last = span or (0, -1)
    before = np.floor(share * count_of(segment, resolution))
    near: NDArray[np.bool_] = (before + 1 >= first) & (before <= last)
    return near


def _root(one: Floats, other: Floats) -> Floats:
    # No hypot: every machine rounds a root alike, and so do C and NumPy.
    root: Floats = np.sqrt(one * one + other * other)
    return root


def _between(upper: Floats, lower: Floats) -> NDArray[np.float64]:
    return normal_share(upper) - normal_share(lower)

"""The least value of a smooth function of a few numbers >= 0: a projected quasi-Newton method.

Problems here have at most four unknowns and are solved thousands of times. SciPy's L-BFGS-B asks a
BLAS for vectors of four numbers, whose threads then wait for each other.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from possmap.lab.calibrate.trials import Floats

_STEPS, _HALVINGS = 200, 30
_STEP = 1e-6
_ENOUGH = 1e-9
_FARTHEST = 0.5


def least(
    function: Callable[[Floats], float],
    start: Floats,
    slope: Callable[[Floats], Floats] | None = None,
) -> Floats:
    """Return where a function is least; arguments of about 1, none below 0.

    Parameters
    ----------
    start
        Shape (c,), >= 0.
    slope
        Its derivatives; None: by differences.
    """

    def derivatives(at: Floats, value: float) -> Floats:
        if slope is not None:
            return slope(at)
        steps = _STEP * np.maximum(1.0, at)
        return np.array([(function(at + step) - value) / step.max() for step in np.diag(steps)])

    here = start.copy()
    value = function(here)
    gradient = derivatives(here, value)
    inverse: Floats | None = None
    small, again = 0, False
    for _ in range(_STEPS):
        free = (here > 0) | (gradient < 0)
        direction = np.where(free, -gradient, 0.0)
        if inverse is not None:
            part = inverse[np.ix_(free, free)]
            direction[free] = -(part * gradient[free]).sum(axis=1)
            if not (direction * gradient).sum() < 0:
                inverse, direction = None, np.where(free, -gradient, 0.0)
        farthest = float(np.abs(direction).max(initial=0.0))
        share = min(1.0, _FARTHEST * (1 + float(here.max())) / farthest) if farthest else 0.0
        there, lower = here, value
        for _ in range(_HALVINGS):
            there = np.maximum(0.0, here + share * direction)
            lower = function(there)
            if lower <= value + 1e-4 * float((gradient * (there - here)).sum()):
                break
            share /= 2
        else:
            if inverse is None:
                break
            inverse = None  # once more, along the steepest descent
            continue
        small = small + 1 if value - lower < _ENOUGH * (1 + abs(value)) else 0
        moved, before = there - here, gradient
        here, value = there, lower
        gradient = derivatives(here, value)
        if small >= 2:
            if again:
                break
            again, small, inverse = True, 0, None  # a second look, along the steepest descent
            continue
        inverse = _updated(inverse, moved, gradient - before)
    return here


def _updated(inverse: Floats | None, moved: Floats, bent: Floats) -> Floats | None:
    """Return the next inverse of second derivatives (Broyden, Fletcher, Goldfarb, Shanno)."""
    product = float((moved * bent).sum())
    if not product > 1e-14 * float((moved**2).sum()):
        return inverse
    if inverse is None:
        inverse = np.eye(len(moved)) * (product / float((bent**2).sum()))
    left = np.eye(len(moved)) - np.multiply.outer(moved, bent) / product
    middle = np.einsum("ij,jk,lk->il", left, inverse, left)
    found: Floats = middle + np.multiply.outer(moved, moved) / product
    return found

"""Mean effects and variances of heading errors at once: restricted maximum likelihood (REML).

An error of trial i is ``x_i·β + noise``; the noise has one variance for each run begun, one for
each 45° turned, and, if several trials belong to one outing, two that are drawn once per outing:
of the over-turn and of the drift (METHOD §1, the causes that the estimator ``heading`` keeps).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.lab.calibrate.trials import Floats

CONFIDENCE = 0.95
_FLOOR = 1e-6
"""Share of the whole variance that no trial is more exact than."""

_FAR = 1e6
"""Any deviance this much larger is as unlikely as another."""

_SINGULAR = math.log(1e-13)
"""Logarithm of a determinant, of a matrix with ones on its diagonal, that is but rounding."""


class Fitted(NamedTuple):
    """What given variances make of the data.

    deviance : minus twice the log likelihood. beta, covariance : of the effects.
    slope : the deviance's derivatives by the variances.
    """

    deviance: float
    beta: Floats
    covariance: Floats
    slope: Floats


class Interval(NamedTuple):
    """An estimate between its confidence limits."""

    value: float
    low: float
    high: float
    df: float = math.inf
    se: float = math.nan

    @classmethod
    def student(cls, value: float, se: float, df: float) -> Interval:
        """Return the limits of Student's t."""
        from scipy import stats

        half = float(stats.t.ppf((1 + CONFIDENCE) / 2, df)) * se
        return cls(value, value - half, value + half, df, se)

    @classmethod
    def chi_square(cls, deviation: float, df: float) -> Interval:
        """Return the limits of a deviation: exact for normal errors."""
        from scipy import stats

        low, high = stats.chi2.ppf([(1 + CONFIDENCE) / 2, (1 - CONFIDENCE) / 2], df)
        return cls(deviation, deviation * math.sqrt(df / low), deviation * math.sqrt(df / high), df)


@dataclass(frozen=True, eq=False)
class Problem:
    """Data of one fit; n errors, p mean effects, c variances.

    Attributes
    ----------
    x, y
        Shapes (n, p) and (n,); y in degrees.
    own
        How much of each variance that is drawn anew has a trial, shape (n, c_own).
    shared
        How a trial takes part in what is drawn once per outing, shape (n, c - c_own), c at most 5.
    outing
        Number of each trial's outing, shape (n,), never falling.
    """

    x: Floats
    y: Floats
    own: Floats
    shared: Floats
    outing: NDArray[np.intp]

    @cached_property
    def scale(self) -> float:
        """The variance about a least-squares fit: a yardstick [deg²]."""
        beta = np.linalg.lstsq(self.x, self.y, rcond=None)[0]
        rest: Floats = self.y - self.x @ beta
        square: float = float((rest**2).sum()) / max(1, len(rest) - self.x.shape[1])
        return max(square, 1e-12)

    @cached_property
    def _columns(self) -> Floats:
        return np.column_stack([self.x, self.y, self.shared])

    @cached_property
    def _first(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.diff(self.outing, prepend=-1))

    def solve(self, variances: Floats) -> tuple[Floats, Floats, float]:
        """Return V⁻¹·[x, y, shared], the diagonal of V⁻¹, and log|V|, for variances [deg²] (c,)."""
        count = self.own.shape[1]
        # Not by matrix products: on small matrices the threads of a BLAS only wait for each other.
        w = 1 / ((self.own * variances[:count]).sum(axis=1) + _FLOOR * self.scale)
        solved, diagonal, logdet = w[:, None] * self._columns, w, -float(np.log(w).sum())
        if self.shared.shape[1]:
            # Woodbury: an outing's common draws couple its trials, a few unknowns at a time.
            root = self.shared * np.sqrt(variances[count:])
            weighted, first = w[:, None] * root, self._first
            inner = np.add.reduceat(weighted[:, :, None] * root[:, None, :], first)
            inner = inner + np.eye(root.shape[1])
            cross = np.add.reduceat(weighted[:, :, None] * self._columns[:, None, :], first)
            group = np.repeat(np.arange(len(first)), np.diff(first, append=len(w)))
            part = np.einsum("ni,nij->nj", weighted, np.linalg.inv(inner)[group])
            solved = solved - np.einsum("ni,nij->nj", part, cross[group])
            diagonal = diagonal - (part * weighted).sum(axis=1)
            logdet += float(np.linalg.slogdet(inner)[1].sum())
        return solved, diagonal, logdet

    def at(self, variances: Floats) -> Fitted:
        """Return the fit for given variances [deg²], shape (c,).

        The slope is tr(P·Vₖ) - yᵀ·P·Vₖ·P·y with P = V⁻¹ - V⁻¹·X·(XᵀV⁻¹X)⁻¹·Xᵀ·V⁻¹; Vₖ is diagonal,
        or s·sᵀ within each outing.
        """
        solved, diagonal, logdet = self.solve(variances)
        p = self.x.shape[1]
        z, u, of_shared = solved[:, :p], solved[:, p], solved[:, p + 1 :]
        information = np.einsum("ni,nj->ij", self.x, z)
        moment = np.einsum("ni,n->i", z, self.y)
        size = np.sqrt(np.diag(information).clip(min=0))
        sign, part = 0.0, 0.0
        if np.isfinite(information).all() and size.min(initial=1.0) > 0:
            sign, part = np.linalg.slogdet(information / np.multiply.outer(size, size))
        if not (sign > 0 and part > _SINGULAR):  # rounding has eaten what told effects apart
            nan = np.full(p, np.nan)
            return Fitted(math.inf, nan, np.full((p, p), np.nan), np.zeros(len(variances)))
        covariance: Floats = np.asarray(np.linalg.inv(information), dtype=np.float64)
        beta = covariance @ moment
        square = float((self.y * u).sum()) - float(beta @ moment)
        deviance = logdet + square + float(part + 2 * np.log(size).sum())
        left = u - (z * beta).sum(axis=1)  # P·y
        diagonal = diagonal - np.einsum("ni,ij,nj->n", z, covariance, z)
        slope: Floats = (self.own * (diagonal - left**2)[:, None]).sum(axis=0)
        if self.shared.shape[1]:
            first = self._first
            along = np.add.reduceat(self.shared[:, :, None] * z[:, None, :], first)
            trace = (self.shared * of_shared).sum(axis=0)
            trace = trace - np.einsum("gki,ij,gkj->k", along, covariance, along)
            drawn = np.add.reduceat(self.shared * left[:, None], first)
            slope = np.concatenate([slope, trace - (drawn**2).sum(axis=0)])
        return Fitted(deviance, beta, covariance, slope)

    @cached_property
    def variances(self) -> Floats:
        """The most likely variances, shape (c,) [deg²]."""
        return self._best(np.full(self.own.shape[1] + self.shared.shape[1], np.nan))

    @cached_property
    def fitted(self) -> Fitted:
        """The fit at the most likely variances."""
        return self.at(self.variances)

    def _best(self, held: Floats, start: Floats | None = None) -> Floats:
        """Return the most likely variances with some held where they are given (not NaN)."""
        from scipy import optimize

        free = np.isnan(held)
        found = np.where(free, 0.0, held)
        if not free.any():
            return found
        parts = np.column_stack([self.own, self.shared**2]).mean(axis=0)[free]
        begin = self.scale / np.maximum(parts, 1e-9) / free.sum()
        if start is not None:
            begin = np.maximum(start[free], 1e-3 * begin)

        def deviance(shares: Floats) -> tuple[float, Floats]:
            found[free] = shares * begin
            there = self.at(found)
            return min(there.deviance, _FAR**2), there.slope[free] * begin

        best = optimize.minimize(
            deviance,
            np.ones(len(begin)),
            jac=True,
            method="TNC",  # docs/decisions: L-BFGS-B waits for the threads of a BLAS
            bounds=[(0.0, None)] * len(begin),
            options={"maxfun": 1000, "ftol": 1e-12, "gtol": 1e-8, "xtol": 1e-10},
        )
        found[free] = best.x * begin
        return found

    def interval(self, which: int) -> Interval:
        """Return one variance with its limits by the likelihood's profile [deg²]."""
        from scipy import stats

        best = self.variances
        value = float(best[which])
        if not math.isfinite(self.fitted.deviance):
            return Interval(value, 0.0, math.inf)
        allowed = self.fitted.deviance + float(stats.chi2.ppf(CONFIDENCE, 1))

        def over(variance: float) -> float:
            held = np.full(len(best), np.nan)
            held[which] = variance
            return min(self.at(self._best(held, best)).deviance - allowed, _FAR)

        low = 0.0
        if value > 1e-9 * self.scale and over(0.0) > 0:
            low = _crossing(over, value, 0.0)
        step = max(value, 1e-3 * self.scale)
        high = value + step
        while over(high) < 0 and high < 1e9 * self.scale:
            step *= 2
            high += step
        return Interval(value, low, _crossing(over, max(value, high - step), high))

    def effect(self, weights: Floats) -> Interval:
        """Return a combination of mean effects with limits by Student's t.

        Its degrees of freedom are Satterthwaite's: what the variance of the estimate owes to
        variances that are themselves estimated.
        """
        value = float(weights @ self.fitted.beta)
        variance = float(weights @ self.fitted.covariance @ weights)
        return Interval.student(value, math.sqrt(variance), self._satterthwaite(weights, variance))

    def _satterthwaite(self, weights: Floats, variance: float) -> float:
        most = float(max(1, len(self.y) - self.x.shape[1]))
        best = self.variances
        active = np.flatnonzero(best > 1e-6 * self.scale)
        if not len(active) or not variance > 0:
            return most
        information, change = np.empty((len(active), len(active))), np.empty(len(active))
        for k, which in enumerate(active):
            step = np.zeros(len(best))
            step[which] = 0.02 * best[which]
            up, down = self.at(best + step), self.at(best - step)
            # Half the deviance's second derivatives.
            information[k] = (up.slope - down.slope)[active] / (4 * step[which])
            change[k] = float(weights @ (up.covariance - down.covariance) @ weights)
            change[k] /= 2 * step[which]
        try:
            spread = float(change @ np.linalg.solve((information + information.T) / 2, change))
        except np.linalg.LinAlgError:
            return most
        return most if not spread > 0 else min(most, max(1.0, 2 * variance**2 / spread))


def _crossing(over: Callable[[float], float], inside: float, outside: float) -> float:
    """Return where a function rises above 0; an end, if it is on one side all the way."""
    from scipy import optimize

    if over(inside) >= 0:
        return inside
    if over(outside) <= 0:
        return outside
    return float(optimize.brentq(over, *sorted((inside, outside)), rtol=1e-3))


def between(values: Floats, errors: Floats) -> float:
    """Return the deviation of groups' means beyond their own errors (DerSimonian and Laird 1986).

    values, errors : of each group, with its standard error; shape (g,). 0 for fewer than two.
    """
    weight = 1 / errors**2
    if len(values) < 2:
        return 0.0
    middle = float((weight * values).sum() / weight.sum())
    more = float((weight * (values - middle) ** 2).sum()) - (len(values) - 1)
    room = float(weight.sum() - (weight**2).sum() / weight.sum())
    return math.sqrt(max(0.0, more / room))

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
    """What given variances make of the data: minus twice the log likelihood, β, its covariance."""

    deviance: float
    beta: Floats
    covariance: Floats


class Interval(NamedTuple):
    """An estimate between its confidence limits."""

    value: float
    low: float
    high: float
    df: float = math.inf
    se: float = math.nan


def _crossing(over: Callable[[float], float], inside: float, outside: float) -> float:
    """Return where a function rises above 0; an end, if it is on one side all the way."""
    from scipy import optimize

    if over(inside) >= 0:
        return inside
    if over(outside) <= 0:
        return outside
    return float(optimize.brentq(over, *sorted((inside, outside)), rtol=1e-3))


def _lost(effects: int) -> Fitted:
    """Return no fit: rounding has eaten what told the effects apart."""
    return Fitted(math.inf, np.full(effects, np.nan), np.full((effects, effects), np.nan))


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
        How a trial takes part in what is drawn once per outing, shape (n, c - c_own), at most two.
    outing
        Number of each trial's outing, shape (n,).
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
    def _order(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        order = np.argsort(self.outing, kind="stable")
        first = np.flatnonzero(np.diff(self.outing[order], prepend=-1))
        return order, first

    def at(self, variances: Floats) -> Fitted:
        """Return the fit for given variances [deg²], shape (c,)."""
        count = self.own.shape[1]
        # Not by matrix products: on small matrices the threads of a BLAS only wait for each other.
        noise = (self.own * variances[:count]).sum(axis=1) + _FLOOR * self.scale
        weighted = self.x / noise[:, None]
        information = np.einsum("ni,nj->ij", weighted, self.x)
        moment = np.einsum("ni,n->i", weighted, self.y)
        square: float = float((self.y**2 / noise).sum())
        logdet = float(np.log(noise).sum())
        if self.shared.shape[1]:
            # Woodbury: an outing's common draws couple its trials, two unknowns at a time.
            root = self.shared * np.sqrt(variances[count:])
            order, first = self._order
            root, w = root[order], (1 / noise)[order]
            both = np.column_stack([self.x, self.y])[order]
            inner = np.add.reduceat(w[:, None, None] * root[:, :, None] * root[:, None, :], first)
            inner = inner + np.eye(root.shape[1])
            cross = np.add.reduceat(w[:, None, None] * root[:, :, None] * both[:, None, :], first)
            solved = np.linalg.solve(inner, cross)
            less = np.einsum("gki,gkj->ij", cross, solved)
            information = information - less[:-1, :-1]
            moment = moment - less[:-1, -1]
            square -= float(less[-1, -1])
            logdet += float(np.linalg.slogdet(inner)[1].sum())
        if not self.x.shape[1]:
            return Fitted(logdet + square, np.empty(0), np.empty((0, 0)))
        size = np.sqrt(np.diag(information).clip(min=0))
        if not (np.isfinite(information).all() and size.min() > 0):
            return _lost(len(moment))
        sign, part = np.linalg.slogdet(information / np.multiply.outer(size, size))
        if not (sign > 0 and part > _SINGULAR):
            return _lost(len(moment))
        covariance: Floats = np.asarray(np.linalg.inv(information), dtype=np.float64)
        beta = covariance @ moment
        rest = square - float(beta @ moment)
        logdet += float(part + 2 * np.log(size).sum())
        return Fitted(logdet + rest, beta, covariance)

    @cached_property
    def variances(self) -> Floats:
        """The most likely variances, shape (c,) [deg²]."""
        return self._best(np.full(self.own.shape[1] + self.shared.shape[1], np.nan))

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
            fitted = self.at(found)
            if not math.isfinite(fitted.deviance):
                return _FAR**2, np.zeros(len(shares))
            return fitted.deviance, self._slope(found, fitted)[free] * begin

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

    def _slope(self, variances: Floats, fitted: Fitted) -> Floats:
        """Return the deviance's derivatives, shape (c,): tr(P·Vₖ) - yᵀ·P·Vₖ·P·y.

        P = V⁻¹ - V⁻¹·X·(XᵀV⁻¹X)⁻¹·Xᵀ·V⁻¹; Vₖ is diagonal, or s·sᵀ within each outing.
        """
        count = self.own.shape[1]
        order, first = self._order
        x, own, shared = self.x[order], self.own[order], self.shared[order]
        w = 1 / ((own * variances[:count]).sum(axis=1) + _FLOOR * self.scale)
        rest = self.y[order] - (x * fitted.beta).sum(axis=1)
        columns = np.column_stack([x, rest, shared])
        solved = w[:, None] * columns  # V⁻¹ times each column, and the diagonal of V⁻¹
        diagonal = w
        if shared.shape[1]:
            root = shared * np.sqrt(variances[count:])
            weighted = w[:, None] * root
            inner = np.add.reduceat(weighted[:, :, None] * root[:, None, :], first)
            inner = np.linalg.inv(inner + np.eye(root.shape[1]))
            cross = np.add.reduceat(weighted[:, :, None] * columns[:, None, :], first)
            group = np.repeat(np.arange(len(first)), np.diff(first, append=len(order)))
            own_part = np.einsum("ni,nij->nj", weighted, inner[group])
            solved = solved - np.einsum("ni,nij->nj", own_part, cross[group])
            diagonal = diagonal - (own_part * weighted).sum(axis=1)
        z, u, of_shared = np.split(solved, [x.shape[1], x.shape[1] + 1], axis=1)
        diagonal = diagonal - np.einsum("ni,ij,nj->n", z, fitted.covariance, z)
        found: Floats = (own * (diagonal - u[:, 0] ** 2)[:, None]).sum(axis=0)
        if not shared.shape[1]:
            return found
        along = np.add.reduceat(shared[:, :, None] * z[:, None, :], first)
        trace = (shared * of_shared).sum(axis=0)
        trace -= np.einsum("gki,ij,gkj->k", along, fitted.covariance, along)
        return np.concatenate(
            [found, trace - (np.add.reduceat(shared * u, first) ** 2).sum(axis=0)]
        )

    def interval(self, which: int) -> Interval:
        """Return one variance with its limits by the likelihood's profile [deg²]."""
        from scipy import stats

        best = self.variances
        if not math.isfinite(self.at(best).deviance):
            return Interval(float(best[which]), 0.0, math.inf)
        allowed = self.at(best).deviance + float(stats.chi2.ppf(CONFIDENCE, 1))
        near = best.copy()

        def over(value: float) -> float:
            held = np.full(len(best), np.nan)
            held[which] = value
            return min(self.at(self._best(held, near)).deviance - allowed, _FAR)

        value = float(best[which])
        low = 0.0
        if value > 1e-9 * self.scale and over(0.0) > 0:
            low = _crossing(over, value, 0.0)
        step = max(value, 1e-3 * self.scale)
        high = value + step
        while over(high) < 0 and high < 1e9 * self.scale:
            step *= 2
            high += step
        high = _crossing(over, max(value, high - step), high)
        return Interval(value, low, high)

    def effect(self, weights: Floats) -> Interval:
        """Return a combination of mean effects with limits by Student's t.

        Its degrees of freedom are Satterthwaite's: what the variance of the estimate owes to
        variances that are themselves estimated.
        """
        from scipy import stats

        fitted = self.at(self.variances)
        value = float(weights @ fitted.beta)
        variance = float(weights @ fitted.covariance @ weights)
        df = self._satterthwaite(weights, variance)
        half = float(stats.t.ppf((1 + CONFIDENCE) / 2, df)) * math.sqrt(variance)
        return Interval(value, value - half, value + half, df, math.sqrt(variance))

    def _satterthwaite(self, weights: Floats, variance: float) -> float:
        most = float(max(1, len(self.y) - self.x.shape[1]))
        best = self.variances
        active = np.flatnonzero(best > 1e-6 * self.scale)
        if not len(active) or not variance > 0:
            return most
        information = self._information(best, active)
        slope = np.empty(len(active))
        for k, which in enumerate(active):
            up = best.copy()
            up[which] *= 1.01
            there = float(weights @ self.at(up).covariance @ weights)
            slope[k] = (there - variance) / (0.01 * best[which])
        try:
            spread = float(slope @ np.linalg.solve(information, slope))
        except np.linalg.LinAlgError:
            return most
        return most if not spread > 0 else min(most, max(1.0, 2 * variance**2 / spread))

    def _information(self, best: Floats, active: NDArray[np.intp]) -> Floats:
        """Return half the deviance's second derivatives, by differences."""
        steps = 0.02 * best[active]
        middle = self.at(best).deviance

        def moved(*moves: tuple[int, float]) -> float:
            there = best.copy()
            for k, sign in moves:
                there[active[k]] += sign * steps[k]
            return self.at(there).deviance

        size = len(active)
        found = np.empty((size, size))
        for i in range(size):
            both = moved((i, 1)) - 2 * middle + moved((i, -1))
            found[i, i] = max(both, 1e-12) / (2 * steps[i] ** 2)
            for j in range(i):
                mixed = (
                    moved((i, 1), (j, 1)) - moved((i, 1), (j, -1))
                    - moved((i, -1), (j, 1)) + moved((i, -1), (j, -1))
                )  # fmt: skip
                found[i, j] = found[j, i] = mixed / (8 * steps[i] * steps[j])
        return found

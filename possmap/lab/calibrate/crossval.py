"""Which terms earn their place: models held against trials that they have not seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from possmap.core.settings import Estimator
from possmap.lab.calibrate.heading import TERMS, Term
from possmap.lab.calibrate.model import Fit, fit_model, paper_model
from possmap.lab.calibrate.rectangles import HeldTrials, hold
from possmap.lab.calibrate.trials import Floats, Trial

FOLDS = 10
LEAST = 6
LEAST_ROBOTS = 4
"""Fewest robots of which one can be held out and the rest still tell how robots differ."""
_PENALTY = 2 / (1 - 0.9747)
"""Of Winkler's score: what a miss costs against what a width does, at 97.5 % per axis."""

CLEARLY = 2.326
"""Standard errors by which a term must better the score: chance does it with one of the five terms
one time in twenty."""


@dataclass(frozen=True, slots=True)
class Score:
    """How rectangles fare on trials that they were not fitted to.

    Attributes
    ----------
    coverage, trials
        Share of the ends inside, of how many; NaN without runs.
    size
        Mean of √(hx·hy) [m].
    heading_coverage, headings, heading_half
        Share of the headings within their half-width, of how many, and its mean [deg].
    """

    coverage: float
    trials: int
    size: float
    heading_coverage: float
    headings: int
    heading_half: float


@dataclass(frozen=True, slots=True)
class Worth:
    """What the model is without one term.

    Attributes
    ----------
    without
        Its score.
    gain, error
        By how much the term betters the interval score of a trial (size and misses in one; 1: as
        much as the model's own half-widths), and the standard error of that.
    """

    without: Score
    gain: float
    error: float

    @property
    def earned(self) -> bool:
        """Whether the term earns its place."""
        return self.gain > CLEARLY * self.error


@dataclass(frozen=True, eq=False)
class Validation:
    """Cross-validated scores.

    paper : the paper's model under its estimator. full : all terms, under heading.
    linear, heading : the model that is written, under each (``written``; before it all terms).
    worth : of each term that the fit has. fold : of each trial.
    """

    paper: Score
    linear: Score
    heading: Score
    full: Score
    worth: dict[Term, Worth]
    fold: NDArray[np.intp]


def folds(trials: Sequence[Trial], rng: np.random.Generator) -> NDArray[np.intp]:
    """Return the fold of each trial: whole outings, manoeuvres spread evenly, drawn by lot."""
    outings: dict[str, list[int]] = {}
    for index, trial in enumerate(trials):
        outings.setdefault(trial.outing, []).append(index)
    groups = list(outings.values())
    keys = rng.permutation(len(groups))
    order = sorted(
        range(len(groups)),
        key=lambda k: (_kind(trials[groups[k][0]]), keys[k]),
    )
    found = np.empty(len(trials), dtype=np.intp)
    for place, k in enumerate(order):
        found[groups[k]] = place % min(FOLDS, len(groups))
    return found


def _kind(trial: Trial) -> tuple[int, int]:
    return round(trial.turn / 10), round(4 * math.log(max(trial.distance, 0.1)))


def cross_validate(
    trials: Sequence[Trial], rng: np.random.Generator, fleet: bool = False
) -> Validation | None:
    """Score models on trials left out of their fit; None for too few trials, outings or robots."""
    fold = folds(trials, rng)
    if len(trials) < LEAST or fold.max(initial=0) < (LEAST_ROBOTS - 1 if fleet else 1):
        return None
    full = frozenset(TERMS)
    all_terms = _left_out(trials, fold, lambda some: fit_model(some, full, fleet))
    if all_terms is None:
        return None
    model = fit_model(trials, full, fleet)
    heading, linear = (_held(trials, all_terms, one) for one in _ESTIMATORS)
    unit = _unit(heading)
    worth = {}
    for term in TERMS:
        if term not in model.parameters or not _can_do_without(trials, term):
            continue
        without = _left_out(trials, fold, lambda some, t=term: fit_model(some, full - {t}, fleet))  # type: ignore[misc]
        if without is None:
            continue
        held = _held(trials, without, "heading")
        gain = _winkler(held, unit) - _winkler(heading, unit)
        if not np.abs(gain).max() > 0:
            continue  # no trial held out speaks of it
        error = float(gain.std(ddof=1)) / math.sqrt(len(gain))
        worth[term] = Worth(score(held), float(gain.mean()), error)
    as_paper = _left_out(trials, fold, paper_model)
    assert as_paper is not None  # it tells of the same trials
    paper = _held(trials, as_paper, "linear")
    full_score = score(heading)
    return Validation(score(paper), score(linear), full_score, full_score, worth, fold)


def written(
    validation: Validation,
    trials: Sequence[Trial],
    terms: Collection[Term],
    factors: Mapping[str, float],
    fleet: bool = False,
) -> Validation:
    """Return scores of the model that is written.

    terms : those left in it. factors : by what its parameters differ from those of its fit.
    """

    def fit(some: list[Trial]) -> Fit:
        made = fit_model(some, terms, fleet)
        found = {name: value * factors.get(name, 1.0) for name, value in made.parameters.items()}
        return replace(made, parameters=found)

    folded = _left_out(trials, validation.fold, fit)
    if folded is None:
        return validation
    heading, linear = (score(_held(trials, folded, one)) for one in _ESTIMATORS)
    return replace(validation, heading=heading, linear=linear)


def _can_do_without(trials: Sequence[Trial], term: Term) -> bool:
    """Whether a model without a term is another one; turns without a run need their noise."""
    return term != "turn_noise" or all(one.is_run for one in trials if one.is_turn)


_ESTIMATORS: tuple[Estimator, Estimator] = ("heading", "linear")
_Folded = list[tuple[Fit, list[int]]]


def _left_out(
    trials: Sequence[Trial], fold: NDArray[np.intp], fit: Callable[[list[Trial]], Fit]
) -> _Folded | None:
    """Return for each fold the fit of all others, and those of its trials that this fit tells of.

    Three runs cannot spare one of them; then only turns are held out. None if nothing can be.
    """
    found: _Folded = []
    for number in range(int(fold.max()) + 1):
        seen = [trial for trial, one in zip(trials, fold, strict=True) if one != number]
        made = fit(seen)
        runs, turns = "across" in made.parameters, "turn_spread" in made.parameters
        which = [
            k
            for k in np.flatnonzero(fold == number).tolist()
            if (runs or not trials[k].is_run) and (turns or not trials[k].is_turn)
        ]
        found.append((made, which))
    return found if any(which for _, which in found) else None


def _held(trials: Sequence[Trial], folded: _Folded, estimator: Estimator) -> HeldTrials:
    error = np.full((len(trials), 3), np.nan)
    half = np.full((len(trials), 3), np.nan)
    for fit, which in folded:
        if not which:
            continue
        part = hold([trials[k] for k in which], fit.model, estimator)
        error[which], half[which] = part.error, part.half
    return HeldTrials(error, half)


def score(held: HeldTrials) -> Score:
    """Sum up trials held against rectangles."""
    inside, heading = held.inside, held.heading_inside
    runs, told = ~np.isnan(inside), ~np.isnan(heading)
    return Score(
        float(inside[runs].mean()) if runs.any() else math.nan,
        int(runs.sum()),
        float(held.size[runs].mean()) if runs.any() else math.nan,
        float(heading[told].mean()) if told.any() else math.nan,
        int(told.sum()),
        float(held.half[told, 2].mean()) if told.any() else math.nan,
    )


def _unit(held: HeldTrials) -> Floats:
    """Return the mean half-width of each axis, shape (3,); 1 where nothing is told."""
    told = ~np.isnan(held.error)
    summed = np.where(told, held.half, 0.0).sum(axis=0)
    found: Floats = np.where(summed > 0, summed / np.maximum(1, told.sum(axis=0)), 1.0)
    return found


def _winkler(held: HeldTrials, unit: Floats) -> Floats:
    """Return each trial's interval score, mean over what it tells, in units of half-widths."""
    over = np.maximum(0.0, np.abs(held.error) - held.half)
    each = (2 * held.half + _PENALTY * over) / (2 * unit)
    told = ~np.isnan(held.error)
    found: Floats = np.where(told, each, 0.0).sum(axis=1) / np.maximum(1, told.sum(axis=1))
    return found

"""Models held against trials and legs that they have not seen, carried by the host's own code."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from possmap.core.estimators import estimate
from possmap.core.model import ErrorModel
from possmap.core.records import Pose
from possmap.core.settings import Estimator, EvidenceSettings
from possmap.lab.calibrate.cutting import TrueTrack
from possmap.lab.calibrate.heading import TERMS, Term
from possmap.lab.calibrate.model import ModelFit, fit_model
from possmap.lab.calibrate.trials import Floats, Trial

WRAPPED_DEG = 170.0
"""A larger turn is laid out in parts, since of a half turn a log does not tell the side."""

FOLDS = 10
LEAST, LEAST_DAYS = 6, 4
"""Fewest trials, and days (or robots), of which some can be held out."""

_PENALTY = 2 / (1 - 0.9747)
"""Of Winkler's score: what a miss costs against what a width does, at 97.5 % per axis."""

CLEARLY = 2.326
"""Standard errors by which a term must better the score: chance does it with one of the five terms
one time in twenty."""

Errors = tuple[float, float, float]
"""Of x, y [m] and heading [deg]; or half-widths."""

Modelled = tuple[Sequence[int] | None, ErrorModel]
"""Which trials a model is held against (None: all), and the model."""


class Score(NamedTuple):
    """How rectangles fare on trials that they were not fitted to.

    coverage, trials : share of the ends inside, of how many; NaN without runs. size : mean of
    √(hx·hy) [m]. heading_coverage, headings, heading_half : share of the headings within their
    half-width, of how many, and its mean [deg].
    """

    coverage: float
    trials: int
    size: float
    heading_coverage: float
    headings: int
    heading_half: float


@dataclass(frozen=True, eq=False)
class HeldTrials:
    """Errors left, and half-widths, of n trials; NaN where a trial tells nothing.

    error, half : along x (the way asked to run), along y [m] and of the heading [deg], (n, 3).
    """

    error: Floats
    half: Floats

    def inside(self, *axes: int) -> Floats:
        """Whether some axes lie within their half-widths: 1, 0, NaN if untold; shape (n,)."""
        error, half = self.error[:, axes], self.half[:, axes]
        held: Floats = np.all(np.abs(error) <= half + 1e-9, axis=1).astype(np.float64)
        held[np.isnan(error).any(axis=1)] = np.nan
        return held

    @property
    def score(self) -> Score:
        """All of them summed up."""
        ends, headings = (one[~np.isnan(one)] for one in (self.inside(0, 1), self.inside(2)))
        wide = np.sqrt(self.half[:, 0] * self.half[:, 1])
        size, half = (float(_means(one, axis=0)) for one in (wide, self.half[:, 2]))
        nan = math.nan
        return Score(
            *(float(ends.mean()), len(ends), size) if len(ends) else (nan, 0, nan),
            *(float(headings.mean()), len(headings), half) if len(headings) else (nan, 0, nan),
        )

    def winkler(self, unit: Floats) -> Floats:
        """Return each trial's interval score, mean over what it tells, in units (3,)."""
        over = np.maximum(0.0, np.abs(self.error) - self.half)
        each = (2 * self.half + _PENALTY * over) / (2 * unit)
        return _means(each, axis=1)


def _means(values: Floats, axis: int) -> Floats:
    told = ~np.isnan(values)
    found: Floats = np.where(told, values, 0.0).sum(axis=axis) / np.maximum(1, told.sum(axis=axis))
    return found


def hold(trials: Sequence[Trial], models: Sequence[Modelled], estimator: Estimator) -> HeldTrials:
    """Hold trials against the rectangles that models give their ends."""
    both = np.full((len(trials), 2, 3), np.nan)
    for which, model in models:
        for k in range(len(trials)) if which is None else which:
            both[k] = _held_trial(trials[k], model, estimator)
    return HeldTrials(both[:, 0], both[:, 1])


def _held_trial(trial: Trial, model: ErrorModel, estimator: Estimator) -> tuple[Errors, Errors]:
    """Return errors left and half-widths of one trial; poses begin turned away, and end ahead."""
    parts = math.ceil(abs(trial.turn) / 120) if abs(trial.turn) > WRAPPED_DEG else 1
    poses = [Pose(k, None, 0.0, 0.0, trial.turn * (k / parts - 1)) for k in range(parts + 1)]
    bend = trial.bend if trial.distance > 0 else 0.0
    if trial.distance > 0:
        poses.append(Pose(len(poses), None, trial.distance, 0.0, bend))
    found = estimate(poses, model, EvidenceSettings(estimator=estimator))
    end, last = found.stretches[-1], found.errors[-1]
    nan = math.nan
    off_x = off_y = half_x = half_y = off = half = nan
    if trial.is_run:
        off_x, off_y = trial.distance + trial.along - end.end[0], trial.across - end.end[1]
        half_x, half_y = last.end.half_x, last.end.half_y
    if not math.isnan(trial.heading):
        off, half = bend + trial.heading - end.heading_deg, math.degrees(last.after.heading_half)
    return (off_x, off_y, off), (half_x, half_y, half)


class Worth(NamedTuple):
    """What the model is without one term.

    without : its score. gain, error : by how much the term betters the interval score of a trial
    (size and misses in one; 1: as much as the model's own half-widths), and the standard error.
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

    paper : the paper's model under ``linear``. full : all terms, under ``heading``.
    worth : of each term that the fit has. fold : of each trial. by_day : whether days are folds.
    """

    paper: Score
    full: Score
    worth: dict[Term, Worth]
    fold: NDArray[np.intp]
    by_day: bool


def folds(trials: Sequence[Trial], rng: np.random.Generator) -> tuple[NDArray[np.intp], bool]:
    """Return the fold of each trial, and whether folds are of whole days, or of whole outings.

    Manoeuvres are spread evenly, drawn by lot.
    """
    by_day = len({one.day for one in trials}) >= LEAST_DAYS
    groups: dict[str, list[int]] = {}
    for index, trial in enumerate(trials):
        groups.setdefault(trial.day if by_day else trial.outing, []).append(index)
    several = list(groups.values())
    keys = rng.permutation(len(several))
    kinds = [
        (round(one.turn / 10), round(4 * math.log(max(one.distance, 0.1))))
        for one in (trials[group[0]] for group in several)
    ]
    order = sorted(range(len(several)), key=lambda k: (kinds[k], keys[k]))
    found = np.empty(len(trials), dtype=np.intp)
    for place, k in enumerate(order):
        found[several[k]] = place % min(FOLDS, len(several))
    return found, by_day


def cross_validate(trials: Sequence[Trial], rng: np.random.Generator) -> Validation | None:
    """Score models on trials left out of their fit; None for too few trials or outings."""
    fold, by_day = folds(trials, rng)
    if len(trials) < LEAST or fold.max(initial=0) < 1:
        return None
    terms = frozenset(TERMS)
    models = left_out(trials, fold, fit_model)
    if models is None:
        return None
    everything = hold(trials, models, "heading")
    unit = _means(everything.half, axis=0)
    unit[~(unit > 0)] = 1.0
    worth: dict[Term, Worth] = {}
    own = fit_model(trials).parameters
    # Turns without a run need their noise.
    every_turn_ran = all(one.is_run for one in trials if one.is_turn)
    for term in TERMS:
        if term not in own or (term == "turn_noise" and not every_turn_ran):
            continue
        rest = left_out(trials, fold, lambda some, t=term: fit_model(some, terms - {t}))  # type: ignore[misc]
        if rest is None:
            continue
        without = hold(trials, rest, "heading")
        gain = without.winkler(unit) - everything.winkler(unit)
        if np.abs(gain).max() > 0:  # otherwise no trial held out speaks of it
            error = float(gain.std(ddof=1)) / math.sqrt(len(gain))
            worth[term] = Worth(without.score, float(gain.mean()), error)
    papers = left_out(trials, fold, lambda some: fit_model(some, papers=True))
    paper = hold(trials, papers or [], "linear").score
    return Validation(paper, everything.score, worth, fold, by_day)


def left_out(
    trials: Sequence[Trial], fold: NDArray[np.intp], fit: Callable[[list[Trial]], ModelFit]
) -> list[Modelled] | None:
    """Return for each fold the model of all others, and those of its trials that it tells of.

    Three runs cannot spare one of them; then only turns are held out. None if nothing can be.
    """
    found: list[Modelled] = []
    for number in range(int(fold.max()) + 1):
        made = fit([trial for trial, one in zip(trials, fold, strict=True) if one != number])
        runs, turns = "across" in made.parameters, "turn_spread" in made.parameters
        which = [
            k
            for k in np.flatnonzero(fold == number).tolist()
            if (runs or not trials[k].is_run) and (turns or not trials[k].is_turn)
        ]
        found.append((which, made.model))
    return found if any(which for which, _ in found) else None


class LegScore(NamedTuple):
    """How rectangles fare on whole legs of a track that the model has not seen.

    length : of a leg [m]. legs, poses : how many. coverage, end_coverage : share of the poses, and
    of the legs' ends, inside their rectangles. half_width : mean of (hx + hy)/2 at the ends [m].
    """

    length: float
    estimator: Estimator
    legs: int
    poses: int
    coverage: float
    end_coverage: float
    half_width: float


def held_legs(
    judged: Sequence[tuple[TrueTrack, ErrorModel]],
    lengths: Sequence[float],
    start: Errors = (0.0, 0.0, 0.0),
    mount: float = 0.0,
) -> Iterator[LegScore]:
    """Hold legs of some lengths [m] against the rectangles of models that have not seen them.

    Parameters
    ----------
    judged
        Tracks, each with its model.
    start
        How wrong the truth itself may be where a leg begins.
    mount
        Angle between the truth's heading and the way driven [deg].
    """
    estimators: tuple[Estimator, Estimator] = ("heading", "linear")
    for length in lengths:
        legs = [(leg, model) for track, model in judged for leg in _legs(track, length)]
        for estimator in estimators if legs else ():
            found = [_held_leg(leg, model, estimator, start, mount) for leg, model in legs]
            every = np.concatenate([inside for inside, _ in found])
            yield LegScore(
                length, estimator, len(found), len(every), float(every.mean()),
                float(np.mean([inside[-1] for inside, _ in found])),
                float(np.mean([half for _, half in found])),
            )  # fmt: skip


def _legs(track: TrueTrack, length: float) -> Iterator[TrueTrack]:
    """Yield whole legs, one after the other; what is left at the end is none."""
    way, start = track.way, 0
    while (stop := int(np.searchsorted(way, way[start] + length))) < len(way):
        yield track.part(start, stop + 1)
        start = stop


def _held_leg(
    leg: TrueTrack, model: ErrorModel, estimator: Estimator, start: Errors, mount: float
) -> tuple[Floats, float]:
    """Return which poses lie in their rectangles (the first is known), and the last half-width."""
    turn = leg.true[0, 2] + mount - leg.logged[0, 2]
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    (dx, dy), (x0, y0) = (leg.logged[:, :2] - leg.logged[0, :2]).T, leg.true[0, :2]
    rows = np.column_stack([x0 + cos * dx - sin * dy, y0 + sin * dx + cos * dy,
                            leg.logged[:, 2] + turn]).tolist()  # fmt: skip
    poses = [Pose(k, None, *row, *(start if k == 0 else ())) for k, row in enumerate(rows)]
    found = estimate(poses, model, EvidenceSettings(estimator=estimator))
    off = np.abs(leg.true[1:, :2] - np.array([one.end for one in found.stretches]))
    half = np.array([(one.end.half_x, one.end.half_y) for one in found.errors])
    return (off <= half + 1e-9).all(axis=1).astype(np.float64), float(half[-1].mean())

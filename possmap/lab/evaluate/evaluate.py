"""Every measure of a grid against the truth, beside what a log-odds grid makes of its ledger."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from possmap.core import views
from possmap.core.lattice import Window
from possmap.core.views import CellArray
from possmap.lab.evaluate.bayes import BayesSettings, LogOddsGrid, bayes, probability
from possmap.lab.evaluate.exam import Exam
from possmap.lab.evaluate.local import Strongest, strongest
from possmap.lab.evaluate.ranking import Ranking
from possmap.lab.evaluate.raster import Flags, Floats, Segments, cells_of
from possmap.lab.evaluate.reference import true_walls
from possmap.lab.evaluate.reliability import by_necessity, by_possibility
from possmap.lab.evaluate.results import (
    Evaluation,
    Explored,
    IntervalScore,
    MethodScore,
    Reference,
)
from possmap.lab.evaluate.smeared import SmearSettings, bayes_smeared
from possmap.lab.evaluate.strokes import Outing
from possmap.lab.evaluate.tracks import TrackErrors, matched, rectangles, track_errors
from possmap.lab.evaluate.true_map import TrueMap, true_map

Name = tuple[str, str]
"""Robot and excursion."""

MOST_CELLS = 10_000_000
"""Cells of the largest window that is evaluated at once."""


class NothingToExamine(Exception):
    """No cell is left on which a map could be right or wrong."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A grid to be judged: N and Π of each cell of the window, and the ledger behind them."""

    necessity: CellArray
    possibility: CellArray
    outings: tuple[Outing, ...]

    @property
    def touched(self) -> Flags:
        """Cells of which some record says something."""
        found: Flags = (self.necessity > 0) | (self.possibility < 1)
        return found


@dataclass(frozen=True, eq=False)
class Truth:
    """What is true.

    walls : x, y, x2, y2 [m].
    inside : places that are free for sure [m], shape (n, 2).
    tracks : by robot and excursion; columns as in ``tracks``.
    """

    walls: Segments
    inside: Floats
    tracks: Mapping[Name, Floats] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Baselines:
    """How the log-odds grids are made."""

    bayes: BayesSettings = field(default_factory=BayesSettings)
    smeared: SmearSettings = field(default_factory=SmearSettings)


def evaluate(
    candidates: Mapping[str, Candidate],
    truth: Truth,
    window: Window,
    resolution: float,
    base_rate: float = 0.5,
    baselines: Baselines | None = None,
) -> Evaluation:
    """Judge grids of one ledger on one mask; the baselines are made from the first one's.

    Parameters
    ----------
    candidates
        By name; arrays of the window's shape.

    Raises
    ------
    NothingToExamine
        If the mask is empty.
    """
    baselines = baselines or Baselines()
    first = next(iter(candidates.values()))
    odds = {
        "bayes": bayes(first.outings, window, resolution, baselines.bayes),
        "bayes-smeared": bayes_smeared(first.outings, window, resolution, baselines.smeared),
    }
    true = true_map(truth.walls, truth.inside, window, resolution, MOST_CELLS)
    touched = [one.touched for one in candidates.values()] + [one.touched for one in odds.values()]
    exam = Exam.of(true, np.logical_or.reduce(touched))
    if not exam.wall.size:
        raise NothingToExamine
    tracks = {name: tuple(_errors(one.outings, truth)) for name, one in candidates.items()}
    methods = {name: _of_interval(exam, one, base_rate) for name, one in candidates.items()}
    methods |= {name: _of_odds(exam, one, base_rate) for name, one in odds.items()}
    return Evaluation(
        window=window,
        resolution=resolution,
        base_rate=base_rate,
        mask_cells=int(exam.wall.size),
        wall_cells=int(exam.wall.sum()),
        methods=methods,
        intervals={
            name: _interval(exam, one, window, resolution) for name, one in candidates.items()
        },
        rectangles={name: rectangles(list(one)) for name, one in tracks.items()},
        tracks=tracks,
        explored={name: _explored(one, true) for name, one in candidates.items()},
        reference=Reference(
            exam.all_wall_f1(), _ceiling(exam, first.outings, truth, window, resolution)
        ),
        walls=truth.walls,
        notes=tuple(_notes(first.outings, truth, true)),
    )


def _of_interval(exam: Exam, one: Candidate, base_rate: float) -> MethodScore:
    n, p = one.necessity[exam.mask], one.possibility[exam.mask]
    return exam.score((n + p) / 2, views.probability(n, p, base_rate), p < 0.5)


def _of_odds(exam: Exam, one: LogOddsGrid, base_rate: float) -> MethodScore:
    """Score a log-odds grid: an interval without width, so that Π < 0.5 is P < 0.5."""
    log_odds = one.log_odds[exam.mask].astype(np.float64)
    return exam.score(log_odds, probability(log_odds, base_rate), log_odds < 0)


def _interval(exam: Exam, one: Candidate, window: Window, resolution: float) -> IntervalScore:
    """Return what only a map of N and Π has: whether its bounds are true, and how far apart."""
    n, p = one.necessity[exam.mask], one.possibility[exam.mask]
    best = strongest((outing.found for outing in one.outings), window, resolution)
    walls = {
        "wall": exam.wall,
        "wall_10cm": exam.within[0.1],
        "wall_30cm": exam.within[0.3],
        "wall_local": _within_rectangle(exam, best, window),
    }
    return IntervalScore(
        auc_necessity=Ranking(n).auc(exam.wall),
        sharpness=float(views.ignorance(n, p).mean()),
        contradicted=float(views.contradicted(n, p).mean()),
        mean_conflict=float(views.conflict(n, p).mean()),
        lower_validity=by_necessity(n, walls),
        upper_validity=by_possibility(p, walls),
    )


def _within_rectangle(exam: Exam, best: Strongest, window: Window) -> Flags:
    rows, columns = np.nonzero(exam.mask)
    up, across = (array[exam.mask].astype(np.int64) for array in (best.up, best.across))
    return exam.truth.any_within(rows + window.row0, columns + window.column0, up, across)


def _explored(one: Candidate, true: TrueMap) -> Explored:
    free = None
    if true.free is not None and true.free_cells:
        free = int((true.free & (one.possibility < 1)).sum()) / true.free_cells
    wall = int((true.walls & (one.necessity > 0)).sum())
    return Explored(free, wall / true.wall_cells if true.wall_cells else None)


def _errors(outings: Iterable[Outing], truth: Truth) -> Iterator[TrackErrors]:
    for outing, track, rows in _tracked(outings, truth):
        yield track_errors(outing.version, outing.found, track, rows)


def _ceiling(
    exam: Exam, outings: Sequence[Outing], truth: Truth, window: Window, resolution: float
) -> float | None:
    """Return F1 of the same records laid at their true poses."""
    laid = [true_walls(one.version, track, rows) for one, track, rows in _tracked(outings, truth)]
    if not laid:
        return None
    return exam.drawn_f1(cells_of(np.concatenate(laid), window, resolution))


def _tracked(
    outings: Iterable[Outing], truth: Truth
) -> Iterator[tuple[Outing, Floats, dict[int, int]]]:
    """Yield the excursions whose poses have true places."""
    for outing in outings:
        track = truth.tracks.get((outing.version.robot, outing.version.excursion))
        if track is not None:
            rows = matched(outing.version, track)
            if rows:
                yield outing, track, rows


def _notes(outings: Sequence[Outing], truth: Truth, true: TrueMap) -> Iterator[str]:
    """Say what could not be had, and why."""
    if not truth.tracks:
        yield "no true tracks: no rectangles, and no score at true poses"
    else:
        known = sum(1 for _ in _tracked(outings, truth))
        if not known:
            yield (
                "no pose matches a true track by robot, excursion and time: "
                "no rectangles, and no score at true poses"
            )
        elif known < len(outings):
            missing = len(outings) - known
            yield f"{missing} of {len(outings)} excursions match no true track by their times"
    if true.free is None:
        yield "the walls close no building in: how much of its floor is known cannot be said"

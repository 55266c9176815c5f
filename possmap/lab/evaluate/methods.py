"""Grids of one ledger and log-odds grids of the same records, scored on one mask."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from possmap.core.lattice import Window
from possmap.core.views import Readout
from possmap.errors import printable
from possmap.lab.evaluate.bayes import LogOddsGrid, LogOddsSettings, bayes, probability
from possmap.lab.evaluate.frame import TruthError, refuse_other_logs
from possmap.lab.evaluate.local_rectangles import strongest
from possmap.lab.evaluate.observations import JudgedExcursion
from possmap.lab.evaluate.raster import Flags, Floats, cells_of
from possmap.lab.evaluate.results import Evaluation, GridScore
from possmap.lab.evaluate.scores import JudgedCells, MethodScore, Ranking
from possmap.lab.evaluate.smeared import bayes_smeared
from possmap.lab.evaluate.tracks import TrackErrors, matched, rectangles, track_errors
from possmap.lab.evaluate.true_map import TrueMap, true_map
from possmap.lab.evaluate.true_poses import true_walls
from possmap.lab.evaluate.validity import of_lower_bound, of_upper_bound
from possmap.truth.truth import Truth

MOST_CELLS = 10_000_000
"""Cells of the largest window that is evaluated at once."""


class NothingToJudge(Exception):
    """No cell is left on which a map could be right or wrong."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A grid to be judged: what it says of each cell of the window, and the ledger behind it."""

    cells: Readout
    excursions: tuple[JudgedExcursion, ...]

    @property
    def touched(self) -> Flags:
        """Cells of which some record says something."""
        found: Flags = (self.cells.w > 0) | (self.cells.v > 0)
        return found


@dataclass(frozen=True, slots=True)
class Baselines:
    """How the log-odds grids are made."""

    bayes: LogOddsSettings = field(default_factory=LogOddsSettings)
    smeared: LogOddsSettings = field(default_factory=LogOddsSettings)


def score_methods(
    candidates: Mapping[str, Candidate],
    truth: Truth,
    inside: Floats,
    window: Window,
    resolution: float,
    base_rate: float = 0.5,
    baselines: Baselines | None = None,
) -> Evaluation:
    """Judge grids of one ledger on one mask; the baselines are made from the first one's geometry.

    Parameters
    ----------
    candidates
        By name; arrays of the window's shape.
    inside
        Places that are free for sure [m], shape (n, 2).

    Raises
    ------
    NothingToJudge
        If the mask is empty.
    """
    baselines = baselines or Baselines()
    first = next(iter(candidates.values()))
    odds = {
        "bayes": bayes(first.excursions, window, resolution, baselines.bayes),
        "bayes-smeared": bayes_smeared(first.excursions, window, resolution, baselines.smeared),
    }
    walls = np.array(truth.walls, dtype=np.float64).reshape(-1, 4)
    true = true_map(walls, inside, window, resolution, MOST_CELLS)
    touched = [one.touched for one in candidates.values()] + [one.touched for one in odds.values()]
    cells = JudgedCells.among(true, np.logical_or.reduce(touched))
    if not cells.wall.size:
        raise NothingToJudge
    return Evaluation(
        window=window,
        resolution=resolution,
        base_rate=base_rate,
        mask_cells=int(cells.wall.size),
        wall_cells=int(cells.wall.sum()),
        methods=dict(_methods(cells, candidates, odds, base_rate)),
        grids={name: _grid_score(cells, one, truth) for name, one in candidates.items()},
        all_wall_f1_15cm=cells.all_wall_f1(),
        true_pose_f1_15cm=_ceiling(cells, first.excursions, truth),
        walls=walls,
        notes=tuple(_notes(first.excursions, truth, true)),
    )


def tracks_alone(
    grids: Mapping[str, Sequence[JudgedExcursion]], truth: Truth, path: Path
) -> Evaluation:
    """Judge the rectangles of grids, where a truth (motion capture, say) knows no walls.

    Raises
    ------
    TruthError
        If no pose matches a true track, or the tracks are those of other logs.
    """
    name = printable(str(path))
    scores = {}
    for grid, excursions in grids.items():
        refuse_other_logs(excursions, truth, name)
        tracks = tuple(_track_errors(excursions, truth))
        if not any(len(one.half_x) for one in tracks):
            raise TruthError(
                f"{name}: has no walls, and no pose matches a track of it by robot, excursion and "
                "time, so nothing to judge"
            )
        nan = math.nan
        scores[grid] = GridScore(
            None, nan, nan, nan, nan, (), (), tracks, rectangles(tracks), None, None
        )
    notes = ("the truth has no walls: only error rectangles are judged",)
    return Evaluation(
        Window(0, 0, 0, 0), math.nan, 0.5, 0, 0, {}, scores, None, None, np.empty((0, 4)), notes
    )


def _methods(
    cells: JudgedCells,
    candidates: Mapping[str, Candidate],
    odds: Mapping[str, LogOddsGrid],
    base_rate: float,
) -> Iterator[tuple[str, MethodScore]]:
    """Yield every method's scores; a log-odds grid is an interval without width: Pl = P."""
    floor_share = None
    for name, one in candidates.items():
        said = _masked(one, cells)
        free = said.plausibility < 0.5
        score = cells.score(said.pignistic_logit, said.probability(base_rate), free, floor_share)
        floor_share = score.called_free if floor_share is None else floor_share
        yield name, score
    for name, grid in odds.items():
        log_odds = grid.log_odds[cells.mask].astype(np.float64)
        told = probability(log_odds, base_rate)
        yield name, cells.score(log_odds, told, log_odds < 0, floor_share)


def _grid_score(cells: JudgedCells, one: Candidate, truth: Truth) -> GridScore:
    said = _masked(one, cells)
    walls = {
        "wall": cells.wall,
        "wall_10cm": cells.within[0.1],
        "wall_30cm": cells.within[0.3],
        "wall_local": _within_rectangle(cells, one.excursions),
    }
    true = cells.truth
    free = None
    if true.free is not None and true.free_cells:
        free = int((true.free & (one.cells.v > 0)).sum()) / true.free_cells
    seen = int((true.walls & (one.cells.w > 0)).sum())
    tracks = tuple(_track_errors(one.excursions, truth))
    return GridScore(
        auc_necessity=Ranking(said.w).auc(cells.wall),  # N saturates, w does not
        sharpness=float(said.ignorance.mean()),
        contested=float((said.contested > 0.5).mean()),
        contradicted=float(said.contradicted.mean()),
        mean_conflict=float(said.conflict.mean()),
        lower_validity=of_lower_bound(said.belief, walls),
        upper_validity=of_upper_bound(said.plausibility, walls),
        tracks=tracks,
        rectangles=rectangles(tracks),
        explored_free=free,
        explored_wall=seen / true.wall_cells if true.wall_cells else None,
    )


def _masked(one: Candidate, cells: JudgedCells) -> Readout:
    """Return what a grid says of the cells judged, shape (n,)."""
    said = one.cells
    return Readout(said.w[cells.mask], said.v[cells.mask], said.possibility[cells.mask])


def _within_rectangle(cells: JudgedCells, excursions: Iterable[JudgedExcursion]) -> Flags:
    """Tell of each cell of the mask whether a wall lies within its local rectangle."""
    window = cells.truth.window
    best = strongest((one.found for one in excursions), window, cells.truth.resolution)
    rows, columns = np.nonzero(cells.mask)
    up, across = (array[cells.mask].astype(np.int64) for array in (best.up, best.across))
    return cells.truth.any_within(rows + window.row0, columns + window.column0, up, across)


def _track_errors(excursions: Iterable[JudgedExcursion], truth: Truth) -> Iterator[TrackErrors]:
    for one, track, rows in _tracked(excursions, truth):
        yield track_errors(one.version, one.found, track, rows)


def _ceiling(
    cells: JudgedCells, excursions: Iterable[JudgedExcursion], truth: Truth
) -> float | None:
    """Return F1 of the same records laid at their true poses."""
    laid = [
        true_walls(one.version, track, rows) for one, track, rows in _tracked(excursions, truth)
    ]
    if not laid:
        return None
    true = cells.truth
    return cells.drawn_f1(cells_of(np.concatenate(laid), true.window, true.resolution))


def _tracked(
    excursions: Iterable[JudgedExcursion], truth: Truth
) -> Iterator[tuple[JudgedExcursion, Floats, dict[int, int]]]:
    """Yield the excursions whose poses have true places."""
    for one in excursions:
        track = truth.tracks.get(one.version.name)
        rows = {} if track is None else matched(one.version, track)
        if track is not None and rows:
            yield one, track, rows


def _notes(excursions: Sequence[JudgedExcursion], truth: Truth, true: TrueMap) -> Iterator[str]:
    """Say what could not be had, and why."""
    known = sum(1 for _ in _tracked(excursions, truth))
    without = "no rectangles, and no score at true poses"
    if not truth.tracks:
        yield f"no true tracks: {without}"
    elif not known:
        yield f"no pose matches a true track by robot, excursion and time: {without}"
    elif known < len(excursions):
        missing = len(excursions) - known
        yield f"{missing} of {len(excursions)} excursions match no true track by their times"
    if true.free is None:
        yield "the walls close no building in: how much of its floor is known cannot be said"

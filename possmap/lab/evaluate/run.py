"""``possmap evaluate``: how true a grid is, beside what a log-odds grid makes of its ledger."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from possmap.atomic import check_output
from possmap.core.evidence import Geometry, findings
from possmap.core.lattice import Lattice, Window
from possmap.errors import OutputError, PossmapError, printable, shown
from possmap.exports.run import refuse_itself
from possmap.grid.grid import Grid
from possmap.lab.evaluate import evaluate as judging
from possmap.lab.evaluate.evaluate import MOST_CELLS, Baselines, Candidate, NothingToExamine
from possmap.lab.evaluate.overlap import Witnesses, astray, crossings, sightings
from possmap.lab.evaluate.reference import true_walls
from possmap.lab.evaluate.report import draw_report
from possmap.lab.evaluate.results import Evaluation
from possmap.lab.evaluate.strokes import Outing
from possmap.lab.evaluate.tracks import apart, matched
from possmap.settings.limits import Limits
from possmap.truth.truth import Truth, read_any_truth

Metres = tuple[float, float, float, float]
"""A rectangle: x0, y0, x1, y1."""

DOUBTFUL, IMPOSSIBLE, FROM_TRACKS = 0.1, 0.5, 0.25
"""Share of what robots that know their place did or saw which the truth may belie.

Above the first there is a note, above the second a refusal: a robot whose error model is wrong may
also not be where it is sure to be, and that is worth an evaluation. True tracks leave less
room."""

ROUNDED_M = 0.01
"""How far a pose as logged may lie from what the truth says was believed [m]."""


class TruthError(PossmapError):
    """A truth that does not belong to the grid, or leaves nothing to judge."""


@dataclass(frozen=True, kw_only=True)
class Question:
    """What is to be judged, and how.

    beside : more grids of the same logs, judged on the same mask.
    base_rate : of the view ``probability``.
    window_m : only this rectangle.
    truth_resolution, truth_origin : of a truth that is a bare image.
    """

    beside: tuple[Path, ...] = ()
    base_rate: float = 0.5
    window_m: Metres | None = None
    truth_resolution: float | None = None
    truth_origin: tuple[float, float] | None = None
    baselines: Baselines | None = None


def evaluate(
    path: Path,
    truth: Path,
    question: Question | None = None,
    picture: Path | None = None,
    overwrite: bool = False,
) -> Evaluation:
    """Judge a grid against the truth, and draw a report if a picture is asked for.

    The grid is the method ``possmap``; those beside it go by their files' names.

    Raises
    ------
    GridError, LogError, SettingsError, OutputError
        If a grid or the truth cannot be read, or the picture cannot be written.
    TruthError
        If nothing was fused, the truth is of another frame, or no cell is left to judge.
    """
    question = question or Question()
    if picture is not None:
        _check_picture(path, picture, overwrite)
    true = read_any_truth(truth, Limits(), question.truth_resolution, question.truth_origin)
    paths = {"possmap": path}
    for other in question.beside:
        paths[_name(other, paths)] = other
    read = {name: _Read.of(one) for name, one in paths.items()}
    first = read["possmap"]
    for one in read.values():
        if one.resolution != first.resolution:
            raise TruthError(
                f"{printable(str(one.path))}: {one.resolution:g} m per cell, expected "
                f"{first.resolution:g} as in {printable(str(path))}"
            )
    window = _window(list(read.values()), question)
    doubts = _check_frame(first, true, truth)
    try:
        found = judging.evaluate(
            {name: one.candidate(window) for name, one in read.items()},
            judging.Truth(
                np.array(true.walls, dtype=np.float64).reshape(-1, 4),
                _inside(first, true),
                true.tracks,
            ),
            window,
            first.resolution,
            question.base_rate,
            question.baselines,
        )
    except NothingToExamine:
        raise TruthError(
            f"{printable(str(path))}: no cell to judge: there is no evidence in the window"
        ) from None
    if not found.wall_cells:
        raise TruthError(
            f"{printable(str(truth))}: none of its walls lies in the {found.mask_cells} cells that "
            "any method touched: is it of another frame or resolution?"
        )
    found = replace(found, notes=(*doubts, *found.notes))
    if picture is not None:
        draw_report(path, found, picture, overwrite)
    return found


def _check_picture(path: Path, picture: Path, overwrite: bool) -> None:
    """Refuse a picture that cannot be written, before the work and not after it."""
    if picture.suffix.lower() != ".png":
        raise OutputError(
            f"{printable(str(picture))}: unknown suffix {shown(picture.suffix)}, expected .png"
        )
    refuse_itself(path, picture)
    check_output(picture, overwrite)


def _name(path: Path, taken: Collection[str]) -> str:
    """Return a name that no other method has."""
    name = path.stem
    while name in taken or name in ("bayes", "bayes-smeared"):
        name += "'"
    return name


@dataclass(frozen=True, eq=False)
class _Read:
    """A grid as far as it is read before the window is known."""

    path: Path
    resolution: float
    evidence: Window | None
    outings: tuple[Outing, ...]

    @classmethod
    def of(cls, path: Path) -> _Read:
        with Grid(path) as grid, grid.snapshot():
            settings = grid.settings
            outings = []
            for entry in grid.ledger.entries():
                version = grid.ledger.version(entry)
                outings.append(Outing(version, findings(version, entry.model, settings)))
            if not any(outing.found.evidence for outing in outings):
                raise TruthError(f"{printable(str(path))}: holds no evidence, so nothing to judge")
            return cls(path, settings.resolution, grid.window, tuple(outings))

    def candidate(self, window: Window) -> Candidate:
        with Grid(self.path) as grid, grid.snapshot():
            return Candidate(grid.necessity(window), grid.possibility(window), self.outings)

    def places(self) -> Iterator[Metres]:
        """Yield a box around each record's place: no baseline says anything beyond.

        A Gaussian ends at three deviations, which is less than twice the half-width; and what is as
        far off as ``max_error`` it leaves out.
        """
        for outing in self.outings:
            most = outing.found.model.max_error
            for at in outing.found.geometry.values():
                halves = (at.rect.half_x, at.rect.half_y, at.rect2.half_x, at.rect2.half_y)
                margin = 2 * min(most, max(halves)) + BODY_M
                yield (
                    min(at.x, at.x2) - margin,
                    min(at.y, at.y2) - margin,
                    max(at.x, at.x2) + margin,
                    max(at.y, at.y2) + margin,
                )


BODY_M = 0.3
"""More than the width of the floor that a robot sweeps [m]."""


def _window(grids: list[_Read], question: Question) -> Window:
    """Return the window that holds what any method says, or what was asked for of it."""
    lattice = Lattice(grids[0].resolution)
    places = np.array([box for grid in grids for box in grid.places()]).reshape(-1, 4)
    low, high = places[:, :2].min(axis=0), places[:, 2:].max(axis=0)
    window = lattice.window_of(*low.tolist(), *high.tolist())
    for grid in grids:
        window = window.union(grid.evidence) if grid.evidence else window
    if question.window_m is not None:
        window = window.intersection(lattice.window_of(*question.window_m))
    if not window.cells:
        raise TruthError(
            f"{printable(str(grids[0].path))}: no cell to judge: there is no evidence in the window"
        )
    if window.cells > MOST_CELLS:
        raise TruthError(
            f"{printable(str(grids[0].path))}: {window.cells} cells to judge at once, expected at "
            f"most {MOST_CELLS}; judge a part with --window X0,Y0,X1,Y1"
        )
    return window


def _inside(grid: _Read, true: Truth) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Return places that are free for sure: home and the true tracks, else where robots set out."""
    places = [track[:, 1:3] for track in true.tracks.values()]
    if true.home is not None:
        places.append(np.array([true.home]))
    if not places:
        places = [np.array([(at.x, at.y)]) for at in _starts(grid)]
    return np.concatenate([np.empty((0, 2)), *places])


def _starts(grid: _Read) -> Iterator[Geometry]:
    for outing in grid.outings:
        if outing.found.geometry:
            yield outing.found.geometry[min(outing.found.geometry)]


def _check_frame(grid: _Read, true: Truth, path: Path) -> tuple[str, ...]:
    """Refuse a truth that cannot be that of the grid; return what makes one doubt it.

    Where tracks match the logs, what was seen from them is asked, and the error model is not: it
    may be wrong, and that is worth an evaluation. Otherwise robots that know their place are asked.

    Raises
    ------
    TruthError
        If nothing of it is where the map is, robots would have driven through its walls, or its
        tracks are those of other logs.
    """
    name = printable(str(path))
    if not true.walls:
        raise TruthError(f"{name}: found no walls, expected some")
    walls = np.array(true.walls, dtype=np.float64)
    laid = [np.empty((0, 4))]
    for outing in grid.outings:
        track = true.tracks.get((outing.version.robot, outing.version.excursion))
        rows = {} if track is None else matched(outing.version, track)
        if track is not None and rows:
            off = float(np.median(apart(outing.version, track, rows)))
            if off > ROUNDED_M:
                raise TruthError(
                    f"{name}: excursion {outing.version.excursion} of {outing.version.robot} "
                    f"believed itself {off:.2f} m from where the log has it, expected the logs' "
                    "own truth"
                )
            laid.append(true_walls(outing.version, track, rows))
    if len(laid) > 1:
        from_tracks = astray(np.concatenate(laid), walls), f"{_SEEN} from its tracks"
        return _doubts(name, [from_tracks], FROM_TRACKS)
    return _doubts(
        name,
        [
            (sightings(grid.outings, walls), f"{_SEEN} by robots that knew their place"),
            (
                crossings(grid.outings, walls, grid.resolution),
                "runs by robots that knew their place go through its walls",
            ),
        ],
        IMPOSSIBLE,
    )


_SEEN = "walls lie near none of its walls, as seen"


def _doubts(
    name: str, testimony: Sequence[tuple[Witnesses, str]], impossible: float
) -> tuple[str, ...]:
    """Refuse a truth that too large a share of witnesses belie, and return what some do.

    Raises
    ------
    TruthError
        ``file: how many of how many what``.
    """
    told = []
    for witnesses, what in testimony:
        line = (
            f"{name}: {witnesses.belied} of {witnesses.asked} {what}: is it of another frame or "
            "resolution?"
        )
        if witnesses.belied > impossible * witnesses.asked:
            raise TruthError(line)
        if witnesses.belied > DOUBTFUL * witnesses.asked:
            told.append(line)
    return tuple(told)

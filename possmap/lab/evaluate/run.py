"""``possmap evaluate``: how true a grid is, beside what a log-odds grid makes of its ledger."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from possmap.atomic import check_output
from possmap.core.evidence import Layer
from possmap.core.lattice import Lattice, Window
from possmap.core.views import Readout
from possmap.errors import OutputError, printable, shown
from possmap.exports.job import refuse_itself
from possmap.grid.copying import selected
from possmap.grid.grid import Grid
from possmap.grid.selection import Selection
from possmap.lab.evaluate.frame import TruthError, doubts_of_frame
from possmap.lab.evaluate.methods import (
    MOST_CELLS,
    Baselines,
    Candidate,
    NothingToJudge,
    score_methods,
    tracks_alone,
)
from possmap.lab.evaluate.observations import JudgedExcursion
from possmap.lab.evaluate.raster import Floats
from possmap.lab.evaluate.report import draw_report
from possmap.lab.evaluate.results import Evaluation
from possmap.settings.limits import Limits
from possmap.truth.truth import Truth, read_any_truth

Metres = tuple[float, float, float, float]
"""A rectangle: x0, y0, x1, y1."""

BODY_M = 0.3
"""More than the width of the floor that a robot sweeps [m]."""


@dataclass(frozen=True, kw_only=True)
class Question:
    """What is to be judged, and how.

    beside : more grids of the same logs, judged on the same mask.
    base_rate : of the view ``probability``.
    window_m : only this rectangle.
    truth_resolution, truth_origin : of a truth that is a bare image.
    selection : only these excursions of each grid.
    """

    beside: tuple[Path, ...] = ()
    base_rate: float = 0.5
    window_m: Metres | None = None
    truth_resolution: float | None = None
    truth_origin: tuple[float, float] | None = None
    baselines: Baselines | None = None
    selection: Selection = field(default_factory=Selection)


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
    with ExitStack() as stack:
        paths = {"possmap": path}
        for other in question.beside:
            paths[_name(other, paths)] = other
        read = {
            name: _Read.of(one, stack.enter_context(selected(one, question.selection)))
            for name, one in paths.items()
        }
        found = _judged(read, true, truth, question)
        if picture is not None and not found.methods:
            raise TruthError(f"{printable(str(truth))}: has no walls to draw, leave --picture out")
        if picture is not None:
            draw_report(read["possmap"].part, found, picture, overwrite)
    return found


def _judged(read: Mapping[str, _Read], true: Truth, truth: Path, question: Question) -> Evaluation:
    first = read["possmap"]
    path = first.path
    if true.tracks and not true.walls:
        return tracks_alone({name: one.excursions for name, one in read.items()}, true, truth)
    for one in read.values():
        if one.resolution != first.resolution:
            raise TruthError(
                f"{printable(str(one.path))}: {one.resolution!r} m per cell, expected "
                f"{first.resolution!r} as in {printable(str(path))}"
            )
    window = _window(list(read.values()), question)
    doubts = doubts_of_frame(first.excursions, true, truth, first.resolution)
    try:
        found = score_methods(
            {name: one.candidate(window) for name, one in read.items()},
            true,
            _inside(first, true),
            window,
            first.resolution,
            question.base_rate,
            question.baselines,
        )
    except NothingToJudge:
        raise _no_cell(path) from None
    if not found.wall_cells:
        raise TruthError(
            f"{printable(str(truth))}: none of its walls lies in the {found.mask_cells} cells that "
            "any method touched: is it of another frame or resolution?"
        )
    return replace(found, notes=(*doubts, *found.notes))


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


def _no_cell(path: Path) -> TruthError:
    return TruthError(
        f"{printable(str(path))}: no cell to judge: there is no evidence in the window"
    )


@dataclass(frozen=True, eq=False)
class _Read:
    """A grid as far as it is read before the window is known.

    part : a grid of the excursions that are meant; ``path`` itself, if all are.
    """

    path: Path
    part: Path
    resolution: float
    evidence: Window | None
    excursions: tuple[JudgedExcursion, ...]

    @classmethod
    def of(cls, path: Path, part: Path) -> _Read:
        with Grid(part) as grid, grid.snapshot():
            settings = grid.settings
            excursions = []
            for entry in grid.ledger.entries():
                version = grid.ledger.version(entry)
                refined = grid.ledger.tracks.track(entry.identity)
                excursions.append(JudgedExcursion.of(version, entry.model, settings, refined))
            if not any(one.found.evidence for one in excursions):
                raise TruthError(f"{printable(str(path))}: holds no evidence, so nothing to judge")
            return cls(path, part, settings.resolution, grid.window, tuple(excursions))

    def candidate(self, window: Window) -> Candidate:
        with Grid(self.part) as grid, grid.snapshot():
            layers = []
            for layer in (Layer.WALLS, Layer.FREE):
                whole = np.zeros(window.shape, dtype=np.int64)
                for crop in grid.tiles.crops(layer, window):
                    whole[crop.window.slices_in(window)] = crop.cells
                layers.append(whole)
            cells = Readout.of(layers[0], layers[1], grid.settings.free_fusion)
            return Candidate(cells, self.excursions)

    def places(self) -> Iterator[Metres]:
        """Yield a box around each record's place: no baseline says anything beyond.

        A Gaussian ends at three deviations, which is less than twice the half-width; and what is as
        far off as ``max_error`` it leaves out.
        """
        for one in self.excursions:
            most = one.found.model.max_error
            for at in one.found.geometry.values():
                halves = (at.rect.half_x, at.rect.half_y, at.rect2.half_x, at.rect2.half_y)
                margin = 2 * min(most, max(halves)) + BODY_M
                yield (
                    min(at.x, at.x2) - margin,
                    min(at.y, at.y2) - margin,
                    max(at.x, at.x2) + margin,
                    max(at.y, at.y2) + margin,
                )


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
        raise _no_cell(grids[0].path)
    if window.cells > MOST_CELLS:
        raise TruthError(
            f"{printable(str(grids[0].path))}: {window.cells} cells to judge at once, expected at "
            f"most {MOST_CELLS}; judge a part with --window X0,Y0,X1,Y1"
        )
    return window


def _inside(grid: _Read, true: Truth) -> Floats:
    """Return places that are free for sure: home and the true tracks, else where robots set out."""
    places = [track[:, 1:3] for track in true.tracks.values()]
    if true.home is not None:
        places.append(np.array([true.home]))
    if not places:
        starts = [min(one.found.geometry.items()) for one in grid.excursions if one.found.geometry]
        places = [np.array([(at.x, at.y)]) for _, at in starts]
    return np.concatenate([np.empty((0, 2)), *places])

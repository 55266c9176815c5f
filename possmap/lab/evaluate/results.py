"""What an evaluation finds: every number, with the arrays that a picture needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from possmap.core.lattice import Window
from possmap.lab.evaluate.raster import Segments
from possmap.lab.evaluate.scores import MethodScore
from possmap.lab.evaluate.tracks import Rectangles, TrackErrors
from possmap.lab.evaluate.validity import Bin


@dataclass(frozen=True, slots=True, eq=False)
class GridScore:
    """What only possmap's grids have, which say two numbers of a cell, and of what robots ran.

    Attributes
    ----------
    auc_necessity
        As ``auc``, of N alone; None if the mask has only one kind.
    sharpness
        Mean of m(Ω) = Pl - Bel, how much is left open; the lower the sharper.
    contested, contradicted, mean_conflict
        Share of cells above ½ of the view, share with N > Π, and mean of Dempster's K.
    lower_validity, upper_validity
        Cells binned by Bel, and by Pl.
    tracks, rectangles
        Error against rectangle, by excursion, and summed up; None where no pose has a true place.
    explored_free
        Share of the building's free cells with Π < 1; None if they are not known.
    explored_wall
        Share of its wall cells, and so of the walls' length, with N > 0; None without any.
    """

    auc_necessity: float | None
    sharpness: float
    contested: float
    contradicted: float
    mean_conflict: float
    lower_validity: tuple[Bin, ...]
    upper_validity: tuple[Bin, ...]
    tracks: tuple[TrackErrors, ...]
    rectangles: Rectangles | None
    explored_free: float | None
    explored_wall: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """How true a grid is, beside what a log-odds grid makes of the same ledger.

    Attributes
    ----------
    window, resolution
        The cells looked at, and their side [m].
    base_rate
        Of the probabilities.
    mask_cells, wall_cells
        Cells that any method touched, without solid insides; and those of them that are wall.
    methods
        By name; the grids first, then ``bayes`` and ``bayes-smeared``.
    grids
        What only possmap's grids have, by the same names.
    all_wall_f1_15cm
        F1 of calling every cell of the mask a wall: less is worse than useless.
    true_pose_f1_15cm
        F1 of the same records laid at the true poses: the ceiling. None without a true track.
    walls
        The true walls [m].
    notes
        What could not be had, and why; one line each.
    """

    window: Window
    resolution: float
    base_rate: float
    mask_cells: int
    wall_cells: int
    methods: Mapping[str, MethodScore]
    grids: Mapping[str, GridScore]
    all_wall_f1_15cm: float | None
    true_pose_f1_15cm: float | None
    walls: Segments
    notes: tuple[str, ...]

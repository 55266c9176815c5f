"""What an evaluation finds: every number, with the arrays that a picture needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from possmap.core.lattice import Window
from possmap.lab.evaluate.proper import Split
from possmap.lab.evaluate.ranking import Curve
from possmap.lab.evaluate.raster import Segments
from possmap.lab.evaluate.reliability import Bin
from possmap.lab.evaluate.tracks import Rectangles, TrackErrors


@dataclass(frozen=True, slots=True, eq=False)
class MethodScore:
    """How true one method's map is, within the common mask.

    Attributes
    ----------
    auc
        How often a wall cell scores higher than another; None if the mask has only one kind.
    f1_5cm, f1_15cm, precision_15cm, recall_15cm
        At the threshold that is best for F1 within the tolerance; None without a wall cell.
    brier, log_score
        Of the probability at the base rate, each split.
    dangerous_free
        Share of wall cells that the map calls free; None without a wall cell.
    curve_15cm
        Precision and recall of all thresholds, thinned.
    probability_bins
        Probability against frequency, as (mean, share of walls, cells) of each bin.
    """

    auc: float | None
    f1_5cm: float | None
    f1_15cm: float | None
    precision_15cm: float | None
    recall_15cm: float | None
    brier: Split
    log_score: Split
    dangerous_free: float | None
    curve_15cm: Curve | None
    probability_bins: tuple[tuple[float, float, int], ...]


@dataclass(frozen=True, slots=True, eq=False)
class IntervalScore:
    """What only a map of N and Π has.

    auc_necessity : as auc, of N alone.
    sharpness : mean of max(0, Π - N), how much is left open; the lower the sharper.
    contradicted : share of cells with N > Π.
    mean_conflict : mean of K = N·(1 - Π).
    lower_validity, upper_validity : cells binned by N, and by Π.
    """

    auc_necessity: float | None
    sharpness: float
    contradicted: float
    mean_conflict: float
    lower_validity: tuple[Bin, ...]
    upper_validity: tuple[Bin, ...]


@dataclass(frozen=True, slots=True)
class Explored:
    """How much of the building the evidence touches.

    free : share of the building's free cells with Π < 1; None if they are not known.
    wall : share of its wall cells, and so of the walls' length, with N > 0; None without any.
    """

    free: float | None
    wall: float | None


@dataclass(frozen=True, slots=True)
class Reference:
    """What F1 within 15 cm means here.

    all_wall_f1_15cm : of calling every cell of the mask a wall: less is worse than useless.
    true_pose_f1_15cm : of the same records laid at the true poses: the ceiling. None without a
        true track.
    """

    all_wall_f1_15cm: float | None
    true_pose_f1_15cm: float | None


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
    intervals
        What only possmap's grids have, by the same names.
    rectangles
        By the name of the grid; None where no pose has a true place.
    tracks
        Error against rectangle, excursion by excursion, by the name of the grid.
    explored
        By the name of the grid.
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
    intervals: Mapping[str, IntervalScore]
    rectangles: Mapping[str, Rectangles | None]
    tracks: Mapping[str, tuple[TrackErrors, ...]]
    explored: Mapping[str, Explored]
    reference: Reference
    walls: Segments
    notes: tuple[str, ...]

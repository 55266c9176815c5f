"""What workers do with evidence: lay an excursion out, and stamp what many say into a tile.

Both functions are pure, and take and return what can be sent to other processes. Before any of it
is done, its work is bounded from above (docs/trust.md). The measure is a cell stamped once; what
else takes time is told in the same measure: a stamp's overhead, a tile that is read, packed and
written, a cell held against a body or a clip line.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import NamedTuple, TypeAlias

import numpy as np

from possmap.core.estimators import is_smoothed
from possmap.core.evidence import Findings, Layer, findings
from possmap.core.fusion import fuse_tile
from possmap.core.lattice import TILE, TileKey
from possmap.core.model import ErrorModel
from possmap.core.plan import ExcursionPlan, TileWork, plan_excursion
from possmap.core.pyramid import COLUMNS, FARTHEST, Floats, table_of
from possmap.core.records import PartialMap
from possmap.core.settings import EvidenceSettings
from possmap.errors import LogError
from possmap.fusing.reach import Reach
from possmap.grid.encoding import EncodedTile, encode, unpacked
from possmap.grid.rows import ExcursionRows, excursion_rows
from possmap.settings.limits import Limits

FARTHEST_M = 1e15
"""No corrected place lies farther from the origin, and no rectangle is wider [m]."""

MARGIN = 32
"""Rows, and columns, that a stamp counts beyond its own: one of a single cell takes time, too."""

TILE_WORK = 5e6
"""Cells that a tile is worth: about a millisecond."""

BY_BODY = 256
"""Cells that a cell held against a body's path is worth."""

BY_LINE = 8
"""Cells that a cell held against a line which clips a path is worth."""

StoredTile: TypeAlias = Mapping[Layer, EncodedTile]
"""The layers of a tile, as they are stored."""

TileResult: TypeAlias = tuple[TileKey, StoredTile]


class Version(NamedTuple):
    """A version of an excursion of which the grid does not hold everything.

    in_grid : how many of its records, from the first, the grid holds.
    place : ``file:line``, for messages.
    """

    map: PartialMap
    model: ErrorModel
    in_grid: int
    place: str


class LaidOut(NamedTuple):
    """What the ledger notes of an excursion, and what it says in which tiles.

    work : cells of work, at most.
    reach : how many of its records can say something.
    restamps : whether it takes the place of what the grid holds of it (METHOD §7).
    """

    rows: ExcursionRows
    plan: ExcursionPlan
    work: float
    reach: Reach
    restamps: bool


def lay_out(version: Version, settings: EvidenceSettings, limits: Limits) -> LaidOut:
    """Correct, propagate and lay out an excursion, and cut what it says at the borders of tiles.

    Raises
    ------
    LogError
        If it is more work than the limits allow, or no reader of the grid would accept it.
    """
    found = findings(version.map, version.model, settings)
    _check_places(version, found, settings.resolution)
    work = _checked_work(version, found, settings.resolution, limits)
    is_unit = is_smoothed(version.map.records, settings)
    in_grid = 0 if is_unit else version.in_grid
    plan = plan_excursion(found, in_grid, settings)
    rows = excursion_rows(
        version.map,
        version.model,
        in_grid,
        found.geometry,
        plan.touched(),
        found.observations,
    )
    reach = Reach.of(version.map, found)
    return LaidOut(rows, plan, work, reach, restamps=is_unit and version.in_grid > 0)


def stamp(work: TileWork, stored: StoredTile, settings: EvidenceSettings) -> TileResult:
    """Stamp everything new into one tile, and return the layers that change, as they are stored.

    Raises
    ------
    TileError
        If the stored tile is damaged.
    """
    changed = fuse_tile(work, unpacked(work.key, stored), settings)
    return work.key, {layer: encode(layer, work.key, array) for layer, array in changed.items()}


def _check_places(version: Version, found: Findings, resolution: float) -> None:
    """Refuse what the correction takes off every lattice, or makes wider than one."""
    most = min(FARTHEST * resolution, FARTHEST_M)
    for number, at in found.geometry.items():
        x, y, (half_x, half_y), x2, y2, (half_x2, half_y2), _ = at
        if not (
            -most < x < most and -most < y < most and -most < x2 < most and -most < y2 < most
            and half_x < most and half_y < most and half_x2 < most and half_y2 < most
        ):  # fmt: skip
            away, wide = max(map(abs, (x, y, x2, y2))), max(*at.rect, *at.rect2)
            what = f"lies, corrected, {away:.3g} m from the origin"
            if away < most:
                what = f"is uncertain by {wide:.3g} m"
            raise _refused(version, number, f"{what}, expected less than {most:.3g}")


def _checked_work(version: Version, found: Findings, resolution: float, limits: Limits) -> float:
    """Return the work of an excursion; refuse what is too much."""
    works = works_of(found, resolution)
    for number, work in works.items():
        if work > limits.limit_record_cells:
            raise _refused(
                version, number,
                f"takes {work:.3g} cells of work, expected at most "
                f"{limits.limit_record_cells:.3g} (setting limit_record_cells)",
            )  # fmt: skip
    total = sum(works.values())
    if total > limits.limit_file_cells:
        raise LogError(
            version.place.rpartition(":")[0],
            f"its records take {total:.3g} cells of work, expected at most "
            f"{limits.limit_file_cells:.3g} (setting limit_file_cells)",
        )
    return total


def _refused(version: Version, number: int, why: str) -> LogError:
    name = f"excursion {version.map.excursion} of robot {version.map.robot}"
    return LogError(version.place, f"seq {version.map.records[number].seq} of {name} {why}")


def works_of(found: Findings, resolution: float) -> dict[int, float]:
    """Return the work of each record that says something, by its index: a bound, no estimate."""
    segments = list(chain.from_iterable(one.segments for one in found.evidence))
    if not segments:
        return {}
    lines = [len(one.clip) for one in found.evidence for _ in one.segments]
    table = table_of(segments, found.model.max_error)
    works = segment_works(table, np.array(lines, dtype=float), resolution)
    records = np.array([one.record for one in segments])
    sums = np.bincount(records, weights=works)
    some = np.flatnonzero(np.bincount(records))
    return dict(zip(some.tolist(), sums[some].tolist(), strict=True))


def segment_works(table: Floats, lines: Floats, resolution: float) -> Floats:
    """Return the work of each row of a ``pyramid.table_of``, of which so many lines clip each."""
    x0, y0, x1, y1, half_x0, half_y0, half_x1, half_y1, most, width, is_point, _ = table.T
    assert len(COLUMNS) == table.shape[1]
    # One whose rectangle is too wide from end to end has no stamp with a height.
    is_wide = (np.minimum(half_x0, half_x1) >= most) | (np.minimum(half_y0, half_y1) >= most)
    # Nor have those between ends of which one is too wide: half-widths are linear on the way.
    begins, ends = np.zeros(len(table)), np.ones(len(table))
    for half0, half1 in ((half_x0, half_x1), (half_y0, half_y1)):
        grows = half1 - half0
        with np.errstate(over="ignore"):  # beyond all numbers is beyond the end
            crossing = np.clip((most - half0) / np.where(grows == 0, 1, grows), 0, 1)
        begins = np.maximum(begins, np.where(grows < 0, crossing, 0))
        ends = np.minimum(ends, np.where(grows > 0, crossing, 1))
    share = np.maximum(0, ends - begins)
    steps_x, steps_y = (np.abs(run) / resolution * share + 1 for run in (x1 - x0, y1 - y0))
    stamps = np.where(is_point > 0, 0, np.maximum(steps_x, steps_y)) + 1
    half_x = np.minimum(most, np.maximum(half_x0, half_x1))
    half_y = np.minimum(most, np.maximum(half_y0, half_y1))
    # A body clears as far as swath.reach says: the farther, the faster half-widths grow.
    growth = np.abs(half_x1 - half_x0) + np.abs(half_y1 - half_y0)
    reach = 2 * (half_x + half_y + growth / stamps) + width
    columns = 2 * np.where(width > 0, reach, half_x) / resolution + 3
    rows = 2 * np.where(width > 0, reach, half_y) / resolution + 3
    along_x, along_y = (np.where(is_point > 0, 0, steps) / TILE for steps in (steps_x, steps_y))
    high, wide = rows / TILE, columns / TILE
    tiles = high * wide + along_x * (high + 1) + along_y * (wide + 1)
    boxes = (stamps / TILE + 1) * (TILE + columns) * (TILE + rows)
    stamped = np.where(width > 0, BY_BODY * boxes, stamps * (rows + MARGIN) * (columns + MARGIN))
    works: Floats = np.where(is_wide, 0.0, stamped + TILE_WORK * tiles + BY_LINE * lines * boxes)
    return works

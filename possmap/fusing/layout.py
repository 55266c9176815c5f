"""What workers do with evidence: lay an excursion out, and stamp what many say into a tile.

Both functions are pure, and take and return what can be sent to other processes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

from possmap.core.estimators import is_smoothed
from possmap.core.evidence import Findings, Layer, findings
from possmap.core.fusion import fuse_tile
from possmap.core.lattice import TileKey
from possmap.core.model import ErrorModel
from possmap.core.observations import Observations
from possmap.core.plan import ExcursionPlan, TileWork, plan_excursion
from possmap.core.pyramid import FARTHEST
from possmap.core.records import PartialMap
from possmap.core.settings import EvidenceSettings
from possmap.errors import LogError
from possmap.fusing.work import works_of
from possmap.grid.encoding import EncodedTile, encode, unpacked
from possmap.grid.rows import ExcursionRows, excursion_rows
from possmap.settings.limits import Limits

FARTHEST_M = 1e15
"""No corrected place lies farther from the origin, and no rectangle is wider [m]."""


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


class Reach(NamedTuple):
    """How many of an excursion's records the error leaves anything to say, and where they lie.

    records : that lie on the map. beyond : how many of them say nothing, their error being
    ``max_error`` or more. seq, t : of the first of these. box : x0, y0, x1, y1 of all [m].
    observations : of the heading.
    """

    records: int
    beyond: int
    seq: int | None
    t: float | None
    box: tuple[float, float, float, float]
    max_error: float
    observations: Observations

    @classmethod
    def of(cls, version: PartialMap, found: Findings) -> Reach:
        """Count the records of one excursion."""
        most, places = found.model.max_error, found.geometry.values()
        beyond = [
            number
            for number, (_, _, (half_x, half_y), _, _, (half_x2, half_y2), _) in (
                found.geometry.items()
            )
            if half_x >= most or half_y >= most or half_x2 >= most or half_y2 >= most
        ]
        first = version.records[min(beyond)] if beyond else None
        return cls(
            len(found.geometry),
            len(beyond),
            first.seq if first else None,
            first.t if first else None,
            (
                min((at.x for at in places), default=0.0),
                min((at.y for at in places), default=0.0),
                max((at.x for at in places), default=0.0),
                max((at.y for at in places), default=0.0),
            ),
            most,
            found.observations,
        )


class LaidOut(NamedTuple):
    """What the ledger notes of an excursion, and what it says in which tiles.

    work : cells of work, at most (``possmap.fusing.work``).
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

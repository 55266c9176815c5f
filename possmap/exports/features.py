"""What a drawing or a GIS shows of a grid: outlines of cells, tracks, walls with their error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from possmap.core.evidence import Geometry
from possmap.core.lattice import Window
from possmap.core.records import Corner, Pose, Wall
from possmap.errors import OutputError
from possmap.exports import outline
from possmap.exports.cells import known
from possmap.exports.job import Job, Metres, tidy
from possmap.exports.outline import Polygon, Ring, TooManySidesError, polygons

Point = tuple[float, float]


def outline_of_evidence(job: Job) -> list[Polygon]:
    """Return the outlines of the cells that hold evidence, from the window's corner.

    Raises
    ------
    OutputError
        If they are too long for memory.
    """
    areas = job.grid.tiles.areas(job.window)
    return _polygons(job, ((area, known(job.grid, area)) for area in areas))


def outline_of_walls(job: Job) -> list[Polygon]:
    """Return the outlines of the occupied cells, whose Bel reaches the threshold, likewise.

    Raises
    ------
    OutputError
        If they are too long for memory.
    """
    areas = job.grid.tiles.areas(job.window)
    least = job.choices.occupied
    return _polygons(job, ((area, job.grid.view("belief", area) >= least) for area in areas))


def outline_of_free(job: Job) -> list[Polygon]:
    """Return the outlines of the free cells, not occupied and Pl within the threshold, likewise.

    Raises
    ------
    OutputError
        If they are too long for memory.
    """
    most = job.choices.free
    return _polygons(
        job,
        (
            (
                area,
                (job.grid.view("belief", area) < job.choices.occupied)
                & (job.grid.view("plausibility", area) <= most),
            )
            for area in job.grid.tiles.areas(job.window)
        ),
    )


def _polygons(job: Job, pieces: Iterator[tuple[Window, outline.Marks]]) -> list[Polygon]:
    try:
        return polygons(job.window, pieces)
    except TooManySidesError:
        raise OutputError(
            f"{job.name}: outlines of more than {outline.MOST_SIDES:,} sides of cells, expected "
            "fewer; take a part of it: --window X0,Y0,X1,Y1"
        ) from None


def metres(job: Job, ring: Ring, local: bool = False) -> list[Point]:
    """Return a ring's corners in the site frame, or ``local``: from the window's corner [m]."""
    row0, column0 = (0, 0) if local else (job.window.row0, job.window.column0)
    lattice = job.grid.lattice  # to ask the grid reads its settings
    corners = [lattice.corner_of(row + row0, column + column0) for column, row in ring]
    return [(tidy(x), tidy(y)) for x, y in corners]


@dataclass(frozen=True, slots=True)
class Outing:
    """One excursion's records that lie on the map, each with its place."""

    robot: str
    excursion: str
    poses: tuple[tuple[Pose, Geometry], ...]
    walls: tuple[tuple[Wall, Geometry], ...]
    corners: tuple[tuple[Corner, Geometry], ...]


def outings(job: Job) -> Iterator[Outing]:
    """Yield the excursions one by one, in the order in which they were first fused.

    With a window asked for, only what reaches into it: walls and corners one by one, a track whole.
    """
    for entry in list(job.grid.ledger.entries()):
        records, places = job.grid.ledger.version(entry).records, job.grid.ledger.geometry(entry)
        poses: list[tuple[Pose, Geometry]] = []
        walls: list[tuple[Wall, Geometry]] = []
        corners: list[tuple[Corner, Geometry]] = []
        for number, at in places.items():
            record = records[number]
            if isinstance(record, Pose):
                poses.append((record, at))
            elif not _reaches([(at.x, at.y), (at.x2, at.y2)], job.window_m):
                continue
            elif isinstance(record, Wall):
                walls.append((record, at))
            elif isinstance(record, Corner):
                corners.append((record, at))
        if not _reaches([(at.x, at.y) for _, at in poses], job.window_m):
            poses = []
        yield Outing(entry.robot, entry.excursion, tuple(poses), tuple(walls), tuple(corners))


def _reaches(points: list[Point], window_m: Metres | None) -> bool:
    """Whether the smallest box around points meets a rectangle; any, if there is no rectangle."""
    if window_m is None:
        return True
    if not points:
        return False
    x0, y0, x1, y1 = window_m
    xs, ys = [x for x, _ in points], [y for _, y in points]
    return min(xs) <= x1 and x0 <= max(xs) and min(ys) <= y1 and y0 <= max(ys)


def swept(at: Geometry) -> list[Point]:
    """Return all places where a segment may lie, as a ring, anticlockwise and not closed [m].

    Its error rectangle changes linearly from end to end, so this is the convex hull of the two.
    """
    corners = [
        (x + sign_x * rect.half_x, y + sign_y * rect.half_y)
        for x, y, rect in ((at.x, at.y, at.rect), (at.x2, at.y2, at.rect2))
        for sign_x in (-1, 1)
        for sign_y in (-1, 1)
    ]
    points = sorted(set(corners))
    if len(points) < 3:
        return points
    return _chain(points) + _chain(points[::-1])


def _chain(points: list[Point]) -> list[Point]:
    """Return the lower half of a convex hull, without its last point (Andrew's monotone chain)."""
    chain: list[Point] = []
    for x, y in points:
        while len(chain) > 1:
            (x0, y0), (x1, y1) = chain[-2:]
            if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0:
                break
            chain.pop()
        chain.append((x, y))
    return chain[:-1]

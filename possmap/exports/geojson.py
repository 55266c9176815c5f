"""The ``.geojson`` export: the ledger as features, and the outline of what is known."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO

from possmap.core.evidence import Geometry
from possmap.core.records import Corner, Fix
from possmap.exports.job import Job, LaidOuting, Point, tidy
from possmap.exports.outline import Polygon, metres, outlines

Feature = dict[str, Any]

CRS = {"type": "name", "properties": {"name": 'LOCAL_CS["possmap site",UNIT["metre",1]]'}}
"""Metres that lie nowhere on Earth. Without it, or with null, GDAL takes them for degrees."""


def write_geojson(job: Job, streams: Sequence[BinaryIO]) -> None:
    """Write one FeatureCollection in metres of the site frame, a feature a line.

    ``properties.kind`` says what a feature is: ``track``, ``wall``, ``wall_error``, ``corner``,
    ``fix``, ``outline`` (of what is known), ``occupied`` or ``free`` (by the thresholds).

    Raises
    ------
    OutputError
        If the outline is too long for memory.
    """
    out, choices = streams[0], job.choices

    def line(feature: Feature) -> bytes:
        if choices.offset != (0.0, 0.0):
            place = feature["geometry"]
            place["coordinates"] = _moved(place["coordinates"], *choices.offset)
        return json.dumps(feature, allow_nan=False).encode()

    kinds = ("outline", job.known), ("occupied", job.occupied), ("free", job.free)
    areas = [
        _areas(job, kind, shapes) for kind, marked in kinds if (shapes := outlines(job, marked))
    ]
    crs = CRS
    if choices.epsg is not None:
        name = f"urn:ogc:def:crs:EPSG::{choices.epsg}"
        crs = {"type": "name", "properties": {"name": name}}
    head = {"type": "FeatureCollection", "crs": crs, "possmap": dict(job.facts())}
    out.write(json.dumps(head)[:-1].encode() + b', "features": [\n')
    out.write(b",\n".join(map(line, areas)))
    for outing in job.outings():
        for feature in _features(outing):
            out.write(b",\n" + line(feature))
    out.write(b"\n]}\n")


def _moved(coordinates: Any, x: float, y: float) -> Any:
    """Return coordinates, however deep in lists, farther by x and y [m]."""
    if isinstance(coordinates, tuple):
        return tidy(coordinates[0] + x), tidy(coordinates[1] + y)
    return [_moved(one, x, y) for one in coordinates]


def _features(outing: LaidOuting) -> Iterator[Feature]:
    whose = {"robot": outing.robot, "excursion": outing.excursion}
    if outing.poses:
        places = [at for _, at in outing.poses]
        yield _feature(
            _line_of([_point(at.x, at.y) for at in places]),
            {
                "kind": "track",
                **whose,
                "seq": [pose.seq for pose, _ in outing.poses],
                "t": [pose.t for pose, _ in outing.poses],
                "half_x": [tidy(at.rect.half_x) for at in places],
                "half_y": [tidy(at.rect.half_y) for at in places],
            },
        )
    for wall, at in outing.walls:
        said = {**whose, "seq": wall.seq, "t": wall.t}
        ends = [_point(at.x, at.y), _point(at.x2, at.y2)]
        yield _feature(
            _line_of(ends), {"kind": "wall", **said, "followed": wall.followed, **_halves(at)}
        )
        ring = [_point(x, y) for x, y in swept(at)]
        if len(ring) > 2:  # without an error there is no area
            polygon = {"type": "Polygon", "coordinates": [_closed(ring)]}
            yield _feature(polygon, {"kind": "wall_error", **said})
    points: list[tuple[str, Corner | Fix, Geometry, Feature]] = [
        ("corner", one, at, {"corner": one.corner}) for one, at in outing.corners
    ]
    points += [("fix", fix, at, {}) for fix, at in outing.fixes]
    for kind, one, at, said in points:
        yield _feature(
            {"type": "Point", "coordinates": _point(at.x, at.y)},
            {
                "kind": kind,
                **whose,
                "seq": one.seq,
                "t": one.t,
                **said,
                "half_x": tidy(at.rect.half_x),
                "half_y": tidy(at.rect.half_y),
            },
        )


def _halves(at: Geometry) -> dict[str, float]:
    return {
        "half_x": tidy(at.rect.half_x),
        "half_y": tidy(at.rect.half_y),
        "half_x2": tidy(at.rect2.half_x),
        "half_y2": tidy(at.rect2.half_y),
    }


def _areas(job: Job, kind: str, shapes: Sequence[Polygon]) -> Feature:
    coordinates = [_rings(job, shape) for shape in shapes]
    return _feature(
        {"type": "MultiPolygon", "coordinates": coordinates}, {"kind": kind, "parts": len(shapes)}
    )


def _rings(job: Job, shape: Polygon) -> list[list[Point]]:
    return [_closed(metres(job, ring)) for ring in (shape.shell, *shape.holes)]


def _closed(ring: list[Point]) -> list[Point]:
    return [*ring, ring[0]]


def _point(x: float, y: float) -> Point:
    return tidy(x), tidy(y)


def _line_of(points: list[Point]) -> Feature:
    """Return a line, or a point where there is but one place: a line needs two."""
    if len(set(points)) == 1:
        return {"type": "Point", "coordinates": points[0]}
    return {"type": "LineString", "coordinates": points}


def _feature(geometry: Feature, properties: Feature) -> Feature:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


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

"""What an excursion says of walls, free space and singular points (METHOD §2)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

from possmap.core.clip import ClipLine, clip_lines
from possmap.core.correction import CorrectedStretch
from possmap.core.estimators import estimate
from possmap.core.model import ErrorModel
from possmap.core.observations import Fit, Observations
from possmap.core.placing import placed
from possmap.core.propagation import ErrorRectangle, StretchErrors
from possmap.core.records import Beam, PartialMap, Pose, Wall
from possmap.core.refined import RefinedTrack
from possmap.core.settings import EvidenceSettings
from possmap.core.track import Stretch


class Layer(IntEnum):
    """The three layers of a grid; their numbers are part of the file format."""

    WALLS = 0
    """Weights of evidence for a wall."""
    FREE = 1
    """The strongest denial of a wall, 1 - Π."""
    POINTS = 2
    """Weights of evidence for a singular point."""


class Swath(NamedTuple):
    """The floor that a body clears along its path (docs/method.md, "The swath of a body").

    width : of the body [m].
    factor : standard deviations in a half-width.
    """

    width: float
    factor: float


class Segment(NamedTuple):
    """A straight line of stamps between two places, the rectangle changing linearly (METHOD §2).

    record : index, in the excursion, of the record that says so.
    x0, y0, x1, y1 : the places [m]; the same place twice is a single stamp.
    rect0, rect1 : the rectangles there.
    swath : what it clears in place of pyramids; None: pyramids.
    """

    record: int
    x0: float
    y0: float
    x1: float
    y1: float
    rect0: ErrorRectangle
    rect1: ErrorRectangle
    swath: Swath | None = None


class Evidence(NamedTuple):
    """Segments of one layer that are not independent: inside them the maximum counts (METHOD §3).

    layer : WALLS and POINTS: one detection; FREE: paths, for which grouping does not matter.
    closed_by : index of the pose that closes the stretch; a shorter version says nothing of it yet.
    clip : lines at which a path ends (``clip_coobserved``).
    """

    layer: Layer
    closed_by: int
    segments: tuple[Segment, ...]
    clip: tuple[ClipLine, ...] = ()


class Geometry(NamedTuple):
    """A record laid out on the map, kept beside it in the ledger.

    x, y, x2, y2 : corrected places [m], the same twice where the record has but one.
    rect, rect2 : the rectangles there, with the sensor's error where a sensor was used.
    heading_deg : corrected heading of a pose [deg], else None.
    """

    x: float
    y: float
    rect: ErrorRectangle
    x2: float
    y2: float
    rect2: ErrorRectangle
    heading_deg: float | None = None

    @classmethod
    def of_point(
        cls, x: float, y: float, rect: ErrorRectangle, heading_deg: float | None = None
    ) -> Geometry:
        """Lay out a record that has one place."""
        return cls(x, y, rect, x, y, rect, heading_deg)


class Findings(NamedTuple):
    """Everything that one version of an excursion yields.

    geometry : by record index; records that wait, and meetings, have none.
    observations, fit : what walls told of the heading, and how well (estimator ``walls``).
    """

    model: ErrorModel
    geometry: dict[int, Geometry]
    evidence: tuple[Evidence, ...]
    observations: Observations = Observations()
    fit: Fit = Fit()

    def before(self, count: int) -> Findings:
        """Return what the first ``count`` records alone yield."""
        known = tuple(one for one in self.evidence if one.closed_by < count)
        return self._replace(evidence=known)


def findings(
    excursion: PartialMap,
    model: ErrorModel,
    settings: EvidenceSettings,
    refined: RefinedTrack | None = None,
) -> Findings:
    """Correct, propagate and lay out one excursion: METHOD §1 and §2 in four steps.

    refined : its track, if ``possmap refine`` moved it.

    Raises
    ------
    ValueError
        If that is none of this excursion.
    """
    excursion = placed(excursion, model)
    geometry: dict[int, Geometry] = {}
    evidence: list[Evidence] = []
    swath = Swath(settings.path_width, model.factor) if settings.path_width else None
    poses = (at for at, one in enumerate(excursion.records) if isinstance(one, Pose))
    index = next(poses, None)
    if index is None:
        return Findings(model, geometry, ())
    laid = estimate(excursion.records, model, settings, refined)
    geometry[index] = Geometry.of_point(*laid.place, laid.start, laid.heading_deg)
    for stretch, error in zip(laid.stretches, laid.errors, strict=True):
        logged = stretch.logged
        if logged.seen:
            geometry.update(_lay_out(stretch, error, model))
            evidence += _detections(logged, geometry)
        (x, y), rect = stretch.end, error.end
        geometry[logged.end_index] = Geometry(x, y, rect, x, y, rect, stretch.heading_deg)
        if logged.is_run and (settings.free_along_walls or not logged.has_wall):
            evidence.append(_path(stretch, error, geometry, settings, swath))
        if logged.seen and settings.free_along_beams:
            evidence += _along_beams(logged, geometry, settings.resolution)
    return Findings(model, geometry, tuple(evidence), laid.observations, laid.fit)


def _lay_out(
    stretch: CorrectedStretch, error: StretchErrors, model: ErrorModel
) -> Iterator[tuple[int, Geometry]]:
    """Place what was recorded during a stretch."""
    for index, sighting in stretch.logged.seen:
        x, y = stretch.place(sighting.x, sighting.y)
        share = stretch.share(sighting.x, sighting.y)
        rect = error.start.towards(error.end, share).grown(model.sensor, model.sensor)
        if isinstance(sighting, Wall):
            share2 = stretch.share(sighting.x2, sighting.y2)
            rect2 = error.start.towards(error.end, share2).grown(model.sensor, model.sensor)
            yield index, Geometry(x, y, rect, *stretch.place(sighting.x2, sighting.y2), rect2)
        elif isinstance(sighting, Beam):
            x2, y2 = stretch.place(sighting.x2, sighting.y2)
            rect2 = _at_beam_end(rect, x2 - x, y2 - y, error.heading_half)
            yield index, Geometry(x, y, rect, x2, y2, rect2)
        else:
            yield index, Geometry.of_point(x, y, rect)


def _at_beam_end(
    rect: ErrorRectangle, reach_x: float, reach_y: float, heading_half: float
) -> ErrorRectangle:
    """Grow the rectangle at a beam's start by what the heading error moves its end (METHOD §2)."""
    across, along = math.sin(heading_half), 1 - math.cos(heading_half)
    return rect.grown(
        abs(reach_y) * across + abs(reach_x) * along, abs(reach_x) * across + abs(reach_y) * along
    )


def _detections(logged: Stretch, geometry: dict[int, Geometry]) -> Iterator[Evidence]:
    """Yield each wall, the hits of all beams together, and each singular point as one detection."""
    closed_by = logged.end_index
    hits: list[Segment] = []
    for index, sighting in logged.seen:
        at = geometry[index]
        if isinstance(sighting, Wall):
            wall = Segment(index, at.x, at.y, at.x2, at.y2, at.rect, at.rect2)
            yield Evidence(Layer.WALLS, closed_by, (wall,))
        elif isinstance(sighting, Beam):
            if sighting.hit:
                hits.append(Segment(index, at.x2, at.y2, at.x2, at.y2, at.rect2, at.rect2))
        else:
            point = Segment(index, at.x, at.y, at.x, at.y, at.rect, at.rect)
            yield Evidence(Layer.POINTS, closed_by, (point,))
    if hits:
        yield Evidence(Layer.WALLS, closed_by, tuple(hits))


def _path(
    stretch: CorrectedStretch,
    error: StretchErrors,
    geometry: dict[int, Geometry],
    settings: EvidenceSettings,
    swath: Swath | None,
) -> Evidence:
    """Return the path of a run, which ends at the walls that it saw where the settings ask so."""
    closed_by = stretch.logged.end_index
    path = Segment(closed_by, *stretch.start, *stretch.end, error.start, error.end, swath)
    clipped = stretch.logged.has_wall and settings.clip_coobserved
    return Evidence(
        Layer.FREE, closed_by, (path,), clip_lines(stretch, geometry) if clipped else ()
    )


def _along_beams(
    logged: Stretch, geometry: dict[int, Geometry], resolution: float
) -> Iterator[Evidence]:
    """Yield the free parts of all beams together, if there is any."""
    beams = [
        path
        for index, sighting in logged.seen
        if isinstance(sighting, Beam)
        for path in _beam_path(index, sighting.hit, geometry[index], resolution)
    ]
    if beams:
        yield Evidence(Layer.FREE, logged.end_index, tuple(beams))


def _beam_path(index: int, hit: bool, beam: Geometry, resolution: float) -> Iterator[Segment]:
    """Yield the free part of a beam: all of it, or up to ``c + max(hx, hy)`` short of its hit."""
    reach_x, reach_y = beam.x2 - beam.x, beam.y2 - beam.y
    length = math.hypot(reach_x, reach_y)
    short = resolution + max(beam.rect2.half_x, beam.rect2.half_y) if hit else 0.0
    if length < short:
        return
    share = (length - short) / length if length else 1.0
    yield Segment(
        index,
        beam.x,
        beam.y,
        beam.x + share * reach_x,
        beam.y + share * reach_y,
        beam.rect,
        beam.rect2,
    )

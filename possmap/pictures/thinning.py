"""Places too many for a picture, thinned: a site has more corners than pixels."""

from __future__ import annotations

from possmap.pictures.raster import Raster

Place = tuple[float, float]
"""x, y [m]."""

MOST_POINTS = 50_000
"""So many signs cover a picture: more are thinned."""

_FINEST = 0.5
"""Where a track is thinned, places in one such part of a pixel are one [pixels]."""


class Points:
    """Singular points, at most ``most``: where there are more, of near ones the most certain."""

    def __init__(self, raster: Raster, resolution: float, most: int = MOST_POINTS) -> None:
        self._raster, self._resolution, self._most = raster, resolution, most
        self._side: float | None = None
        self._kept: dict[tuple[float, ...], tuple[Place, float]] = {}

    def add(self, place: Place, certainty: float) -> None:
        """Add a point with its certainty in [0, 1]."""
        self._keep(place, certainty)
        while len(self._kept) > self._most:
            self._side = 2 * self._side if self._side else _FINEST
            kept, self._kept = self._kept, {}
            for point in kept.values():
                self._keep(*point)

    def _keep(self, place: Place, certainty: float) -> None:
        at: tuple[float, ...] = (*place, len(self._kept))  # all are drawn as long as there is room
        if self._side is not None:
            x, y = self._raster.to_pixel(*place, self._resolution)
            at = x // self._side, y // self._side
        if at not in self._kept or certainty > self._kept[at][1]:
            self._kept[at] = place, certainty

    def all(self) -> list[tuple[Place, float]]:
        """Return the points kept."""
        return list(self._kept.values())


class Track:
    """The places of one excursion; where a pixel is many cells, not those that it cannot show."""

    def __init__(self, raster: Raster, resolution: float) -> None:
        self._raster, self._resolution = raster, resolution
        self._places: list[Place] = []
        self._end: list[Place] = []
        self._last: Place | None = None

    def __len__(self) -> int:
        return len(self._places)

    def add(self, place: Place) -> None:
        """Go on to a place."""
        at = place
        if self._raster.shrink > 1:
            x, y = self._raster.to_pixel(*place, self._resolution)
            at = x // _FINEST, y // _FINEST
            if at == self._last:
                self._end = [place]
                return
        self._places.append(place)
        self._end, self._last = [], at

    def all(self) -> list[Place]:
        """Return the places kept, and the last one."""
        return self._places + self._end

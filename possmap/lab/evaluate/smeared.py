"""The baseline ``bayes-smeared``: log-odds spread over where a record may really belong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.core.lattice import Window
from possmap.core.swath import normal_share
from possmap.lab.evaluate.bayes import BayesSettings, LogOdds, LogOddsGrid
from possmap.lab.evaluate.raster import Floats, Ints, grown
from possmap.lab.evaluate.strokes import Cells, Outing, floor_cells, line_cells, strokes, way_cells

AT_ONCE = 512
"""Cells of a record that are spread together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SmearSettings(BayesSettings):
    """What a record adds, and how it is spread.

    reach : standard deviations at which the Gaussian ends.
    height : what a record adds at most. ``mass``: as much as there is probability that the cell is
        the one it saw, so a record in doubt adds little; ``peak``: the full log-odds in the middle,
        whatever the doubt.
    """

    reach: float = 3.0
    height: str = "mass"


def bayes_smeared(
    outings: Iterable[Outing], window: Window, resolution: float, settings: SmearSettings
) -> LogOddsGrid:
    """Add up, over excursions, the strongest report of a wall and the strongest denial of each.

    An excursion's records share its error, so they are not added up among themselves. The sum is
    held between ``low`` and ``high`` at the end: the order does not matter.
    """
    log_odds: LogOdds = np.zeros(window.shape, dtype=np.float32)
    touched = np.zeros(window.shape, dtype=np.bool_)
    for outing in outings:
        model = outing.found.model
        spread = _Spread(resolution, model.factor, model.max_error, settings)
        farthest = int(spread.reach(np.array([model.max_error]))[0])
        hits, free = spread.reports(outing, grown(window, farthest))
        region = _extent([*hits, *free], spread, window)
        if not region.cells:
            continue
        strongest = [np.zeros(region.shape, dtype=np.float32) for _ in range(2)]
        for array, reports in zip(strongest, (hits, free), strict=True):
            for cells in reports:
                spread.raise_to(array, region, cells)
        cut = region.slices_in(window)
        log_odds[cut] += settings.hit * strongest[0] - settings.free * strongest[1]
        touched[cut] |= (strongest[0] > 0) | (strongest[1] > 0)
    np.clip(log_odds, settings.low, settings.high, out=log_odds)
    return LogOddsGrid(log_odds, touched)


@dataclass(frozen=True, slots=True)
class _Spread:
    """How the records of one excursion are spread."""

    resolution: float
    factor: float
    max_error: float
    settings: SmearSettings

    def reports(self, outing: Outing, window: Window) -> tuple[list[Cells], list[Cells]]:
        """Return the cells in a window of each report of a wall, and of each denial.

        What is as far off as ``max_error`` is left out, as it is in possmap's own grid.
        """
        hits: list[Cells] = []
        free: list[Cells] = []
        for stroke in strokes(outing):
            hits += [
                line_cells(hit, window, self.resolution, self.max_error) for hit in stroke.hits
            ]
            if stroke.driven is not None:
                width = self.settings.body
                free.append(
                    floor_cells(stroke.driven, width, window, self.resolution, self.max_error)
                )
            if self.settings.beam_paths:
                free += [
                    way_cells(*beam, window, self.resolution, self.max_error)
                    for beam in stroke.seen_through
                ]
        return [one for one in hits if len(one)], [one for one in free if len(one)]

    def reach(self, half: Floats) -> Ints:
        """Return how many cells away a half-width lets a cell's report go."""
        sd = half / self.factor
        reach: Ints = np.ceil(self.settings.reach * sd / self.resolution - 0.5).astype(np.int64)
        return np.maximum(reach, 0)

    def raise_to(self, array: LogOdds, region: Window, cells: Cells) -> None:
        """Raise an array to the maximum of itself and one report, spread, in place."""
        around = _extent([cells], self, region)
        if not around.cells:
            return
        block = np.zeros(around.shape)
        rows = np.arange(around.row0, around.row1)
        columns = np.arange(around.column0, around.column1)
        for begin in range(0, len(cells), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            up = self._shares(rows, cells.rows[part], cells.half_y[part])
            across = self._shares(columns, cells.columns[part], cells.half_x[part])
            block += up.T @ across
        if self.settings.height == "peak":
            block /= block.max() or 1.0
        target = array[around.slices_in(region)]
        np.maximum(target, block, out=target, casting="same_kind")

    def _shares(self, cells: Ints, centres: Ints, half: Floats) -> Floats:
        """Return how much of a Gaussian around each centre falls into each cell of an axis.

        The shape is (centres, cells).
        """
        sd = np.maximum(half / self.factor, 1e-9)[:, None]
        away = cells - centres[:, None]
        borders = np.concatenate([away - 0.5, away[:, -1:] + 0.5], axis=1) * (self.resolution / sd)
        shares: Floats = np.diff(normal_share(borders), axis=1)
        shares[np.abs(away) > self.reach(half)[:, None]] = 0
        return shares


def _extent(reports: Sequence[Cells], spread: _Spread, window: Window) -> Window:
    """Return the part of a window that reports reach, spread."""
    parts = list(_bounds(reports, spread))
    whole = parts[0] if parts else Window(window.row0, window.row0, window.column0, window.column0)
    for part in parts[1:]:
        whole = whole.union(part)
    return whole.intersection(window)


def _bounds(reports: Sequence[Cells], spread: _Spread) -> Iterator[Window]:
    for one in reports:
        up, across = spread.reach(one.half_y), spread.reach(one.half_x)
        yield Window(
            int((one.rows - up).min()),
            int((one.rows + up).max()) + 1,
            int((one.columns - across).min()),
            int((one.columns + across).max()) + 1,
        )

"""The baseline ``bayes-smeared``: log-odds spread over where a record may really belong."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from possmap.core.lattice import Window
from possmap.core.swath import normal_share
from possmap.lab.evaluate.bayes import LogOdds, LogOddsGrid, LogOddsSettings
from possmap.lab.evaluate.observations import ErrorCells, JudgedExcursion, Rasterizer, observations
from possmap.lab.evaluate.raster import Floats, Ints, grown

AT_ONCE = 512
"""Cells of a record that are spread together."""

REACH = 3.0
"""Standard deviations at which a Gaussian ends."""


def bayes_smeared(
    excursions: Iterable[JudgedExcursion],
    window: Window,
    resolution: float,
    settings: LogOddsSettings,
) -> LogOddsGrid:
    """Add up, over excursions, the strongest report of a wall and the strongest denial of each.

    A record adds as much as there is probability that the cell is the one it saw. An excursion's
    records share its error, so they are not added up among themselves. The sum is held between
    ``low`` and ``high`` at the end: the order does not matter.
    """
    log_odds: LogOdds = np.zeros(window.shape, dtype=np.float32)
    touched = np.zeros(window.shape, dtype=np.bool_)
    for excursion in excursions:
        model = excursion.found.model
        spread = _Gaussian(resolution, model.factor)
        farthest = int(spread.reach(np.array([model.max_error]))[0])
        # What is as far off as max_error is left out, as it is in possmap's own grid.
        raster = Rasterizer(grown(window, farthest), resolution, model.max_error)
        reports = _reports(excursion, raster, settings.body)
        region = spread.extent([one for part in reports for one in part], window)
        if not region.cells:
            continue
        strongest = [np.zeros(region.shape, dtype=np.float32) for _ in range(2)]
        for array, part in zip(strongest, reports, strict=True):
            for cells in part:
                spread.raise_to(array, region, cells)
        cut = region.slices_in(window)
        log_odds[cut] += settings.hit * strongest[0] - settings.free * strongest[1]
        touched[cut] |= (strongest[0] > 0) | (strongest[1] > 0)
    np.clip(log_odds, settings.low, settings.high, out=log_odds)
    return LogOddsGrid(log_odds, touched)


def _reports(
    excursion: JudgedExcursion, raster: Rasterizer, body: float
) -> tuple[list[ErrorCells], list[ErrorCells]]:
    """Return the cells of each report of a wall, and of each denial."""
    hits: list[ErrorCells] = []
    free: list[ErrorCells] = []
    for one in observations(excursion):
        hits += [raster.line(hit) for hit in one.hits]
        if one.driven is not None:
            free.append(raster.floor(one.driven, body))
        free += [raster.seen_through(*beam) for beam in one.seen_through]
    return [one for one in hits if len(one)], [one for one in free if len(one)]


@dataclass(frozen=True, slots=True)
class _Gaussian:
    """How the records of one excursion are spread."""

    resolution: float
    factor: float

    def reach(self, half: Floats) -> Ints:
        """Return how many cells away a half-width lets a cell's report go."""
        cells = REACH * half / self.factor / self.resolution
        return np.maximum(np.ceil(cells - 0.5), 0).astype(np.int64)

    def extent(self, reports: Sequence[ErrorCells], window: Window) -> Window:
        """Return the part of a window that reports reach, spread."""
        whole = Window(window.row0, window.row0, window.column0, window.column0)
        for number, one in enumerate(reports):
            up, across = self.reach(one.half_y), self.reach(one.half_x)
            part = Window(
                int((one.rows - up).min()),
                int((one.rows + up).max()) + 1,
                int((one.columns - across).min()),
                int((one.columns + across).max()) + 1,
            )
            whole = whole.union(part) if number else part
        return whole.intersection(window)

    def raise_to(self, array: LogOdds, region: Window, cells: ErrorCells) -> None:
        """Raise an array to the maximum of itself and one report, spread, in place."""
        around = self.extent([cells], region)
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

"""``possmap render``: a grid as a picture, in a file or in the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from possmap.atomic import check_output, replacing
from possmap.budget import Budget
from possmap.core.evidence import findings
from possmap.core.lattice import Window
from possmap.errors import OutputError, plural, printable, shown
from possmap.exports.run import chosen_window, refuse_itself
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.pictures import compose, raster
from possmap.pictures.compose import Scene
from possmap.pictures.coverage import Counts, counted
from possmap.pictures.overlays import Overlays
from possmap.pictures.png import write_png
from possmap.pictures.raster import Raster
from possmap.pictures.thinning import Place, Points, Track
from possmap.release import version
from possmap.settings.limits import Limits
from possmap.truth.truth import read_truth

HOME_M = 1.0
"""Robots that set out so near to each other set out from one home [m]."""

BARE_BYTES, PANEL_BYTES, SHEET_BYTES, COVERAGE_BYTES = 2, 12, 20, 10
"""What a pixel takes: as it is; in a panel; under fine overlays; where excursions are counted."""
FINE_PIXELS = 4_000_000
"""Overlays on larger pictures are not drawn finer than these."""
PLACE_BYTES = 150

Metres = tuple[float, float, float, float]
"""A rectangle: x0, y0, x1, y1."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """How a picture is to look.

    layers : names of ``compose.NAMES``, side by side.
    window_m : only this rectangle.
    scale : pixels per cell; None: chosen.
    max_size : the map's longer side, at most [pixels]; None: chosen.
    tracks : draw the robots' tracks.
    truth : a truth file whose walls are drawn.
    title : above the picture; None: the grid's name.
    """

    layers: Sequence[str] = (compose.MAP,)
    palette: str = "viridis"
    bare: bool = False
    window_m: Metres | None = None
    scale: int | None = None
    max_size: int | None = None
    tracks: bool = False
    truth: Path | None = None
    title: str | None = None
    base_rate: float = 0.5


@dataclass(frozen=True)
class RenderSummary:
    """What was drawn. ``width``, ``height``: of the picture [pixels]; ``frames``: of a film."""

    output: Path
    width: int
    height: int
    frames: int = 1


def render(
    path: Path, output: Path, look: Look, overwrite: bool = False, budget: Budget | None = None
) -> RenderSummary:
    """Draw a grid into a PNG file.

    Raises
    ------
    BudgetError
        If the picture, or what it needs, does not fit into the memory allowed.
    OutputError
        For an output that is not PNG or exists, no evidence, or a picture that is too large.
    GridError, LogError
        If the grid, or the truth file, cannot be read.
    """
    if output.suffix.lower() != ".png":
        raise OutputError(
            f"{printable(str(output))}: unknown suffix {shown(output.suffix)}, expected .png "
            "(a film: --animate with .png, .gif or .webp)"
        )
    refuse_itself(path, output)
    budget = budget or Budget()
    with Grid(path, budget=budget) as grid, grid.snapshot():
        chosen = raster_of(grid, look)
        check_fits(look, chosen, budget)
        check_output(output, overwrite)
        image = picture(grid, look, chosen)
        with replacing(output, overwrite) as stream:
            write_png(image, stream, metadata(grid, look, chosen))
    return RenderSummary(output, *image.size)


def check_fits(look: Look, chosen: Raster, budget: Budget) -> None:
    """Refuse a picture whose pixels do not fit into memory.

    Raises
    ------
    BudgetError
        With what would help.
    """
    width, height = chosen.size
    budget.check_held(
        f"a picture of {width} × {height} pixels",
        size_of(look, chosen),
        "shrink it with --max-size PIXELS, or take a part: --window X0,Y0,X1,Y1",
    )


def size_of(look: Look, chosen: Raster) -> int:
    """Return what a picture takes in memory while it is drawn [bytes]."""
    width, height = chosen.size
    pixels, panels = width * height, len(look.layers)
    size = BARE_BYTES * pixels
    if not look.bare:
        size = panels * PANEL_BYTES * pixels + SHEET_BYTES * min(pixels, FINE_PIXELS)
    if compose.COVERAGE in look.layers:
        size += COVERAGE_BYTES * chosen.blocks[0] * chosen.blocks[1]
    return size


def picture(grid: Grid, look: Look, chosen: Raster | None = None) -> Image.Image:
    """Return a grid's picture.

    Raises
    ------
    OutputError
        If there is no evidence, or the picture would be too large.
    """
    chosen = chosen or raster_of(grid, look)
    scene = scene_of(grid, look, chosen)
    if look.bare:
        return compose.bare(scene, look.layers[0], chosen, look.palette)
    return compose.furnished(scene, look.layers, chosen, look.palette)


def raster_of(grid: Grid, look: Look) -> Raster:
    """Choose the cells of a picture and their size."""
    window = evidence_window(grid, look.window_m)
    if look.bare:
        return raster.plan(window, look.scale, look.max_size)
    exact = look.window_m is not None
    return compose.furnished_raster(window, exact, look.scale, look.max_size, len(look.layers))


def evidence_window(grid: Grid, window_m: Metres | None) -> Window:
    """Return the window to draw.

    Raises
    ------
    OutputError
        If there is no evidence, or none in the window asked for.
    """
    everything = chosen_window(grid, None, most=None)
    if window_m is None:
        return everything
    window = chosen_window(grid, window_m, most=None)
    if not window.intersection(everything).cells:
        x0, y0 = grid.lattice.corner_of(everything.row0, everything.column0)
        x1, y1 = grid.lattice.corner_of(everything.row1, everything.column1)
        raise OutputError(
            f"{printable(str(grid.path))}: nothing in the window; all evidence lies within "
            f"{x0:.2f},{y0:.2f},{x1:.2f},{y1:.2f}"
        )
    return window


def scene_of(grid: Grid, look: Look, chosen: Raster) -> Scene:
    """Gather what a picture of a grid needs."""
    return Scene(
        cells=grid.tiles,
        resolution=grid.resolution,
        coverage=lambda at: coverage_of(grid, at, size_of(look, chosen)),
        title=look.title if look.title is not None else grid.path.stem,
        subtitle=counted_words(grid),
        base_rate=look.base_rate,
        overlays=Overlays() if look.bare else overlays_of(grid, look, chosen),
    )


def coverage_of(grid: Grid, chosen: Raster, besides: int) -> Counts:
    """Count the excursions that touched each block; ``besides``: bytes for the picture."""
    settings = grid.settings
    excursions = (
        findings(grid.ledger.version(entry), entry.model, settings)
        for entry in list(grid.ledger.entries())
    )
    budget = grid.budget or Budget()

    def check(size: int) -> None:
        budget.check_held(
            f"{printable(str(grid.path))}: counting excursions cell by cell",
            size + besides,
            "take a part of it: --window X0,Y0,X1,Y1",
        )

    return counted(excursions, settings, chosen, check)


def counted_words(grid: Grid) -> str:
    """Return robots, excursions and records in words, with the resolution."""
    entries = list(grid.ledger.entries())
    robots = len({entry.robot for entry in entries})
    records = sum(entry.records for entry in entries)
    return (
        f"{plural(robots, 'robot')}, {plural(len(entries), 'excursion')}, "
        f"{plural(records, 'record')}; {grid.resolution:g} m per cell"
    )


def overlays_of(
    grid: Grid, look: Look, chosen: Raster, known: Mapping[int, int] | None = None
) -> Overlays:
    """Gather singular points, homes, tracks and true walls within the picture.

    known : how many records of each excursion count, by its id in the ledger; None: all.
    """

    def counts(entry: Entry, number: int) -> bool:
        return known is None or number < known.get(entry.identity, 0)

    x0, y0 = grid.lattice.corner_of(chosen.window.row0, chosen.window.column0)
    x1, y1 = grid.lattice.corner_of(chosen.window.row1, chosen.window.column1)
    window_m = (x0, y0, x1, y1)
    points = Points(chosen, grid.resolution)
    homes: dict[tuple[float, float], Place] = {}
    tracks: dict[str, list[Track]] = {}
    if compose.MAP in look.layers:
        for entry, number, at in grid.ledger.places("corner", window_m):
            worst = max(at.rect.half_x, at.rect.half_y) / entry.model.max_error
            if worst < 1 and counts(entry, number):
                points.add((at.x, at.y), 1 - worst)
        last = None
        for entry, number, at in grid.ledger.places("pose"):
            tracks.setdefault(entry.robot, [])  # a colour of its own, whether it has come or not
            if not counts(entry, number):
                continue
            if entry != last:
                if x0 <= at.x <= x1 and y0 <= at.y <= y1:
                    near = (round(at.x / HOME_M), round(at.y / HOME_M))
                    homes.setdefault(near, (at.x, at.y))
                if look.tracks:
                    _check_tracks(grid, tracks)
                    tracks[entry.robot].append(Track(chosen, grid.resolution))
                last = entry
            if look.tracks:
                tracks[entry.robot][-1].add((at.x, at.y))
    truth = read_truth(look.truth, Limits()).walls if look.truth else ()
    shown_tracks = [
        (robot, [track.all() for track in some]) for robot, some in sorted(tracks.items())
    ]
    return Overlays(points.all(), list(homes.values()), shown_tracks if look.tracks else [], truth)


def _check_tracks(grid: Grid, tracks: Mapping[str, Sequence[Track]]) -> None:
    places = sum(len(track) for some in tracks.values() for track in some)
    (grid.budget or Budget()).check_held(
        f"{printable(str(grid.path))}: tracks through {plural(places, 'place')}",
        places * PLACE_BYTES,
        "take a part of it: --window X0,Y0,X1,Y1",
    )


def metadata(grid: Grid, look: Look, chosen: Raster) -> dict[str, str]:
    """Return what a picture says of itself in its tEXt chunks; numbers in metres and pixels."""
    window = chosen.window
    x, y = grid.lattice.corner_of(window.row0, window.column0)
    return {
        "Software": f"possmap {version()}",
        "possmap:digest": grid.digest(),
        "possmap:view": ",".join(look.layers),
        "possmap:palette": look.palette,
        "possmap:resolution": repr(grid.resolution),
        "possmap:origin": f"{x!r},{y!r}",
        "possmap:cells": f"{window.shape[1]}x{window.shape[0]}",
        "possmap:pixels_per_cell": repr(chosen.scale / chosen.shrink),
    }

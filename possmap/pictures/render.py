"""``possmap render``: a grid as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from PIL import Image

from possmap.atomic import check_output, replacing
from possmap.core.lattice import Window
from possmap.errors import OutputError, plural, printable, shown
from possmap.exports.export import chosen_window, refuse_itself
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.replay import replay
from possmap.grid.selection import Selection
from possmap.pictures import compose, raster
from possmap.pictures.compose import Scene
from possmap.pictures.layers import Cells
from possmap.pictures.overlays import Overlays, Place, Thinned, pixel_of
from possmap.pictures.png import write_png
from possmap.pictures.raster import Raster
from possmap.pictures.tiles import Counts, TileMemory
from possmap.release import version
from possmap.settings.limits import Limits
from possmap.truth.truth import read_truth

HOME_M = 1.0
"""Robots that set out so near to each other set out from one home [m]."""

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
    selection : only what these excursions say.
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
    selection: Selection = field(default_factory=Selection)


@dataclass(frozen=True)
class RenderSummary:
    """What was drawn. ``width``, ``height``: of the picture [pixels]; ``frames``: of a film."""

    output: Path
    width: int
    height: int
    frames: int = 1


def render(path: Path, output: Path, look: Look, overwrite: bool = False) -> RenderSummary:
    """Draw a grid into a PNG file.

    Raises
    ------
    OutputError
        For an output that is not PNG or exists, no evidence, or a picture that is too large.
    GridError, LogError
        If the grid, or the truth file, cannot be read, or holds none of the excursions selected.
    """
    if output.suffix.lower() != ".png":
        raise OutputError(
            f"{printable(str(output))}: unknown suffix {shown(output.suffix)}, expected .png "
            "(a film: --animate with .png, .gif or .webp)"
        )
    refuse_itself(path, output)
    with Grid(path) as grid, grid.snapshot():
        chosen = raster_of(grid, look)
        check_output(output, overwrite)
        image = picture(grid, look, chosen)
        with replacing(output, overwrite) as stream:
            write_png(image, stream, metadata(grid, look, chosen))
    return RenderSummary(output, *image.size)


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
    return raster.furnished_raster(window, exact, look.scale, look.max_size, len(look.layers))


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
    """Gather what a picture of a grid needs; of a selection, laid out again from the ledger."""
    settings = grid.settings
    entries = entries_of(grid, look)

    def memory() -> TileMemory:
        return TileMemory(printable(str(grid.path)), settings, chosen.window)

    def coverage(at: Raster) -> Counts:
        counted = memory()
        for entry in entries:
            counted.count(replay(grid, entry, settings).findings)
        return counted.counts(at)

    cells: Cells = grid.tiles
    if look.selection:
        cells = some = memory()
        for entry in entries:
            some.fuse(replay(grid, entry, settings).findings)
    title = look.title if look.title is not None else grid.path.stem
    return Scene(
        cells=cells,
        resolution=grid.resolution,
        free_fusion=settings.free_fusion,
        coverage=coverage,
        title=title,
        subtitle=counted_words(grid, entries),
        base_rate=look.base_rate,
        overlays=Overlays() if look.bare else overlays_of(grid, look, chosen, entries),
    )


def entries_of(grid: Grid, look: Look) -> list[Entry]:
    """Return the excursions that a picture shows."""
    return look.selection.entries(grid) if look.selection else list(grid.ledger.entries())


def counted_words(grid: Grid, entries: Sequence[Entry] | None = None) -> str:
    """Return robots, excursions and records in words, with the resolution."""
    entries = list(grid.ledger.entries()) if entries is None else entries
    robots = len({entry.robot for entry in entries})
    records = sum(entry.records for entry in entries)
    refined = ", refined" if grid.ledger.tracks.making() else ""
    return (
        f"{plural(robots, 'robot')}, {plural(len(entries), 'excursion')}, "
        f"{plural(records, 'record')}{refined}; {grid.resolution:g} m per cell"
    )


def overlays_of(
    grid: Grid,
    look: Look,
    chosen: Raster,
    entries: Sequence[Entry] | None = None,
    known: Mapping[int, int] | None = None,
) -> Overlays:
    """Gather singular points, homes, tracks and true walls within the picture.

    entries : those that count; None: all.
    known : how many records of each excursion count, by its id in the ledger; None: all.
    """
    counted = {entry.identity for entry in entries or grid.ledger.entries()}

    def counts(entry: Entry, number: int) -> bool:
        upto = entry.records if known is None else known.get(entry.identity, 0)
        return entry.identity in counted and number < upto

    truth = read_truth(look.truth, Limits()).walls if look.truth else ()
    if compose.MAP not in look.layers:
        return Overlays(truth=truth)
    x0, y0 = grid.lattice.corner_of(chosen.window.row0, chosen.window.column0)
    x1, y1 = grid.lattice.corner_of(chosen.window.row1, chosen.window.column1)
    points = Thinned(chosen, grid.resolution)
    for entry, number, at in grid.ledger.places("corner", (x0, y0, x1, y1)):
        worst = max(at.rect.half_x, at.rect.half_y) / entry.model.max_error
        if worst < 1 and counts(entry, number):
            points.add((at.x, at.y), 1 - worst)
    homes: dict[tuple[float, float], Place] = {}
    tracks: dict[str, list[list[Place]]] = {}
    last, pixel = None, None
    for entry, number, at in grid.ledger.places("pose"):
        tracks.setdefault(entry.robot, [])  # a colour of its own, whether it has come or not
        if not counts(entry, number):
            continue
        place = at.x, at.y
        if entry != last:
            if x0 <= at.x <= x1 and y0 <= at.y <= y1:
                homes.setdefault((round(at.x / HOME_M), round(at.y / HOME_M)), place)
            tracks[entry.robot].append([])
            last, pixel = entry, None
        if look.tracks and pixel != (pixel := pixel_of(chosen, place, grid.resolution)):
            tracks[entry.robot][-1].append(place)
    return Overlays(
        points.all(), list(homes.values()), sorted(tracks.items()) if look.tracks else [], truth
    )


def metadata(grid: Grid, look: Look, chosen: Raster) -> dict[str, str]:
    """Return what a picture says of itself in its tEXt chunks; numbers in metres and pixels."""
    window = chosen.window
    x, y = grid.lattice.corner_of(window.row0, window.column0)
    said = {"possmap:selection": look.selection.title} if look.selection else {}
    if making := grid.ledger.tracks.making():
        said["possmap:refined_from"] = making.made_of
    return {
        "Software": f"possmap {version()}",
        "possmap:digest": grid.digest(),
        "possmap:view": ",".join(look.layers),
        "possmap:palette": look.palette,
        "possmap:resolution": repr(grid.resolution),
        "possmap:origin": f"{x!r},{y!r}",
        "possmap:cells": f"{window.shape[1]}x{window.shape[0]}",
        "possmap:pixels_per_cell": repr(chosen.scale / chosen.shrink),
        **said,
    }

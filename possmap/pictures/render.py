"""``possmap render``: a grid as a picture."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from PIL import Image

from possmap.atomic import check_output, replacing
from possmap.core.lattice import Window
from possmap.errors import OutputError, plural, printable, shown
from possmap.exports.job import chosen_window, nothing_in_window, refuse_itself
from possmap.grid.copying import selected
from possmap.grid.grid import Grid
from possmap.grid.selection import Selection
from possmap.pictures import compose, raster
from possmap.pictures.compose import Scene
from possmap.pictures.layers import MAP
from possmap.pictures.overlays import Marks, Overlays
from possmap.pictures.palettes import write_png
from possmap.pictures.raster import Raster
from possmap.pictures.tiles import coverage
from possmap.release import version
from possmap.settings.limits import Limits
from possmap.truth.truth import read_truth

Metres = tuple[float, float, float, float]
"""A rectangle: x0, y0, x1, y1."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """How a picture is to look.

    layers : names of ``layers.NAMES``, side by side.
    window_m : only this rectangle.
    scale : pixels per cell; None: chosen.
    max_size : the map's longer side, at most [pixels]; None: chosen.
    tracks : draw the robots' tracks.
    truth : a truth file whose walls are drawn.
    title : above the picture; None: the grid's name.
    selection : only what these excursions say.
    """

    layers: Sequence[str] = (MAP,)
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
    check_suffix(output, (".png",), ".png (a film: --animate with .png, .gif or .webp)")
    with opened(path, look, output) as grid:
        chosen = raster_of(grid, look)
        check_output(output, overwrite)
        image = picture(grid, look, chosen)
        with replacing(output, overwrite) as stream:
            write_png(image, stream, metadata(grid, look, chosen))
    return RenderSummary(output, *image.size)


def check_suffix(output: Path, suffixes: Collection[str], expected: str) -> None:
    """Raise OutputError unless an output has one of the suffixes."""
    if output.suffix.lower() not in suffixes:
        name, found = printable(str(output)), shown(output.suffix)
        raise OutputError(f"{name}: unknown suffix {found}, expected {expected}")


@contextmanager
def opened(path: Path, look: Look, output: Path | None = None) -> Iterator[Grid]:
    """Lend what is to be drawn: a grid, or one of its selected excursions alone."""
    if output is not None:
        refuse_itself(path, output)
    with selected(path, look.selection) as part, Grid(part) as grid, grid.snapshot():
        grid.path = path  # in messages and titles
        yield grid


def picture(grid: Grid, look: Look, chosen: Raster | None = None) -> Image.Image:
    """Return a grid's picture; a selection is not looked at.

    Raises
    ------
    OutputError
        If there is no evidence, or the picture would be too large.
    """
    chosen = chosen or raster_of(grid, look)
    scene = scene_of(grid, look, chosen)
    if look.bare:
        return compose.bare(scene, look.layers[0], chosen, look.palette)
    drawn = {name: scene.drawn(name, chosen) for name in look.layers}
    return compose.furnished(scene, drawn, chosen, look.palette)


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
    window = chosen_window(grid, window_m, most=None)
    if not window.intersection(everything).cells:
        raise nothing_in_window(grid, everything)
    return window


def scene_of(grid: Grid, look: Look, chosen: Raster) -> Scene:
    """Gather what a picture of a grid needs."""
    return Scene(
        cells=grid.tiles,
        resolution=grid.resolution,
        free_fusion=grid.settings.free_fusion,
        coverage=partial(coverage, grid),
        title=look.title if look.title is not None else grid.path.stem,
        subtitle=counted_words(grid),
        base_rate=look.base_rate,
        overlays=Overlays() if look.bare else overlays_of(grid, look, chosen),
    )


def counted_words(grid: Grid) -> str:
    """Return robots, excursions and records in words, with the resolution."""
    entries = list(grid.ledger.entries())
    robots = len({entry.robot for entry in entries})
    records = sum(entry.records for entry in entries)
    refined = ", refined" if grid.ledger.tracks.making() else ""
    return (
        f"{plural(robots, 'robot')}, {plural(len(entries), 'excursion')}, "
        f"{plural(records, 'record')}{refined}; {grid.resolution:g} m per cell"
    )


def overlays_of(grid: Grid, look: Look, chosen: Raster) -> Overlays:
    """Gather singular points, homes, tracks and true walls within the picture."""
    known = {entry.identity: entry.records for entry in grid.ledger.entries()}
    return marks_of(grid, look, chosen)(known)


def marks_of(grid: Grid, look: Look, chosen: Raster) -> Callable[[Mapping[int, int]], Overlays]:
    """Return what gives the overlays of so many records of each excursion, by its id."""
    truth = read_truth(look.truth, Limits()).walls if look.truth else ()
    if MAP not in look.layers:
        return lambda known: Overlays(truth=truth)
    marks = Marks(grid, chosen, look.tracks)
    return lambda known: replace(marks.known(known), truth=truth)


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

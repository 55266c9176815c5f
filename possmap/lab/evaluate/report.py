"""The picture of an evaluation: what to draw of a grid and the truth, and where it goes."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from possmap.atomic import replacing
from possmap.core.lattice import Window
from possmap.grid.grid import Grid
from possmap.lab.evaluate.picture import report
from possmap.lab.evaluate.results import Evaluation
from possmap.pictures import compose, overlays, palettes
from possmap.pictures.frame import Panel, framed
from possmap.pictures.keys import Entry, Group
from possmap.pictures.overlays import Overlays
from possmap.pictures.png import palette_image, write_png
from possmap.pictures.raster import Raster, plan
from possmap.pictures.render import Look, counted_words, overlays_of, scene_of
from possmap.release import version

_LONGEST = 700
"""The longer side of the map, and of the truth beside it [pixels]."""


def draw_report(path: Path, found: Evaluation, output: Path, overwrite: bool) -> None:
    """Draw the report of a grid's evaluation into a PNG file.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    with Grid(path) as grid, grid.snapshot():
        window = _shown(grid, found)
        chosen = plan(window, None, _LONGEST, _LONGEST)
        maps = _maps(grid, found, chosen)
        digest = grid.digest()
    with replacing(output, overwrite) as stream:
        text = {"Software": f"possmap {version()}", "possmap:digest": digest}
        write_png(report(found, maps), stream, text)


def _shown(grid: Grid, found: Evaluation) -> Window:
    """Return what holds evidence of what was judged."""
    everything = grid.window
    if everything is None:
        return found.window
    shown = everything.intersection(found.window)
    return shown if shown.cells else found.window


def _maps(grid: Grid, found: Evaluation, chosen: Raster) -> Image.Image:
    """Return map and truth side by side."""
    look = Look(title=f"How true {grid.path.stem} is")
    scene = scene_of(grid, look, chosen)
    index, _ = compose.indices(scene, compose.MAP, chosen)
    table = compose.colours(compose.MAP, look.palette)
    picture = palette_image(index, table, chosen.scale).convert("RGB")
    overlays.paint(picture, overlays_of(grid, look, chosen), chosen, grid.resolution)
    truth = Image.new("RGB", picture.size, palettes.UNKNOWN)
    walls = tuple((x, y, x2, y2) for x, y, x2, y2 in found.walls.tolist())
    overlays.paint(truth, Overlays(truth=walls), chosen, grid.resolution)
    keys = [
        *compose.keys(scene.overlays, {compose.MAP: 1}, look.palette),
        Group([Entry("line", palettes.TRUTH, "true wall")]),
    ]
    panels = [Panel(picture, chosen, "map"), Panel(truth, chosen, "truth")]
    return framed(panels, keys, scene.title, counted_words(grid), grid.resolution)

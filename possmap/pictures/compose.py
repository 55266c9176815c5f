"""From a grid's numbers to a finished picture: layer or map, bare or with everything around it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from PIL import Image

from possmap.core.lattice import Window
from possmap.pictures import composite, layers, overlays, palettes, raster
from possmap.pictures.coverage import Counts
from possmap.pictures.frame import Panel, framed
from possmap.pictures.keys import ColourBar, Entry, Group, Key
from possmap.pictures.layers import LAYERS, LEVELS, UNKNOWN_INDEX, Cells, Indices
from possmap.pictures.overlays import Overlays
from possmap.pictures.palettes import Table
from possmap.pictures.png import gray_image, palette_image
from possmap.pictures.raster import Raster

MAP = "map"
COVERAGE = "coverage"
NAMES = (MAP, *LAYERS, COVERAGE)
"""What a picture can show."""


@dataclass(frozen=True)
class Scene:
    """What there is to draw.

    cells : the grid's numbers.
    resolution : metres per cell.
    coverage : counts the excursions per block, when asked to.
    title, subtitle : above the picture.
    """

    cells: Cells
    resolution: float
    coverage: Callable[[Raster], Counts] | None = None
    title: str = ""
    subtitle: str = ""
    base_rate: float = 0.5
    overlays: Overlays = field(default_factory=Overlays)


def indices(scene: Scene, name: str, chosen: Raster) -> tuple[Indices, int]:
    """Return a layer's palette indices, and the number that the scale's upper end stands for."""
    if name == MAP:
        return composite.drawn(scene.cells, chosen), 1
    if name != COVERAGE:
        return layers.drawn(LAYERS[name], scene.cells, chosen, scene.base_rate), 1
    counts = _counts(scene, chosen)
    most = max(1, int(counts.max(initial=0)))
    index: Indices = np.empty(counts.shape, dtype=np.uint8)
    for line, row in zip(index, counts, strict=True):
        line[:] = np.where(row == 0, UNKNOWN_INDEX, row * (LEVELS - 1) // most)
    return index, most


def _counts(scene: Scene, chosen: Raster) -> Counts:
    if scene.coverage is None:
        raise ValueError("this scene knows no excursions")
    return scene.coverage(chosen)


def letters(name: str) -> str:
    """Return the 256 characters that a layer's indices stand for where there is no colour."""
    if name == MAP:
        return composite.letters()
    tenths = "".join(str(min(9, index * 10 // LEVELS)) for index in range(LEVELS))
    return tenths + " "


def colours(name: str, palette: str) -> Table:
    """Return the 256 colours that a layer's indices stand for."""
    if name == MAP:
        return composite.table(palette)
    at = np.rint(np.linspace(0, 255, LEVELS)).astype(int)
    values = palettes.table(palette)[at]
    return np.vstack([values, [palettes.unknown(palette)]]).astype(np.uint8)


def bare(scene: Scene, name: str, chosen: Raster, palette: str) -> Image.Image:
    """Return nothing but the cells; in ``gray`` a layer's values, to be read back."""
    if palette == "gray" and name == COVERAGE:
        counts = np.minimum(_counts(scene, chosen), 255).astype(np.uint8)
        return gray_image(counts, chosen.scale)
    if palette == "gray" and name != MAP:
        values = layers.drawn_gray(LAYERS[name], scene.cells, chosen, scene.base_rate)
        return gray_image(values, chosen.scale)
    index, _ = indices(scene, name, chosen)
    return palette_image(index, colours(name, palette), chosen.scale)


def furnished(
    scene: Scene,
    names: Sequence[str],
    chosen: Raster,
    palette: str,
    legend: Overlays | None = None,
) -> Image.Image:
    """Return layers side by side with title, axes, scale bar and keys.

    legend : what the keys speak of; None: what is drawn. A film's frames share the last one's.
    """
    panels: list[Panel] = []
    ends: dict[str, int] = {}
    for name in names:
        index, ends[name] = indices(scene, name, chosen)
        picture = palette_image(index, colours(name, palette), chosen.scale).convert("RGB")
        shown = scene.overlays if name == MAP else Overlays(truth=scene.overlays.truth)
        overlays.paint(picture, shown, chosen, scene.resolution)
        title = name if len(names) > 1 else ""
        panels.append(Panel(picture, chosen, title))
    subtitle = scene.subtitle
    if chosen.shrink > 1:
        subtitle += f"; a pixel is {chosen.shrink} x {chosen.shrink} cells"
    explained = keys(legend or scene.overlays, ends, palette)
    return framed(panels, explained, scene.title, subtitle, scene.resolution)


def keys(shown: Overlays, ends: dict[str, int], palette: str) -> list[Key]:
    """Return one key for each scale in use, and the signs.

    ends : of each layer shown, the number that its scale's upper end stands for.
    """
    found: list[Key] = []
    entries: list[Entry] = []
    values = [name for name in ends if name in LAYERS]
    if MAP in ends:
        gray = palette == "gray"
        free = palettes.PAPER_FREE_STOPS if gray else palettes.FREE_STOPS
        wall = palettes.PAPER_WALL_STOPS if gray else palettes.WALL_STOPS
        for title, stops, span, words in (
            ("wall: necessity N", wall, ("0", "1"), ("", "certain")),
            ("path: possibility of a wall", free, ("1", "0"), ("", "free")),
        ):
            table = np.rint(palettes.ramp(stops, 256)).astype(np.uint8)
            found.append(ColourBar(title, table, span, words))
    if values:
        only = LAYERS[values[0]] if len(values) == 1 else None
        found.append(
            ColourBar(
                only.title if only else "value of each view",
                palettes.table(palette),
                ("0", "1"),
                (only.low, only.high) if only else ("", ""),
            )
        )
    if COVERAGE in ends:
        found.append(
            ColourBar(
                "excursions that touched a cell",
                palettes.table(palette),
                ("0", str(ends[COVERAGE])),
                ("", ""),
            )
        )
    if MAP in ends:
        unknown = palettes.PAPER if palette == "gray" else palettes.UNKNOWN
        entries += [
            Entry("box", unknown, "unknown"),
            Entry("box", palettes.CONTRADICTED, "contradicted: N above possibility"),
        ]
        if shown.points:
            entries.append(Entry("point", palettes.POINT, "corner or wall end"))
        if shown.homes:
            entries.append(Entry("home", palettes.INK, "home, where robots set out"))
        entries += [
            Entry("line", colour, f"track of {robot}") for robot, colour in shown.robot_colours()
        ]
    if values or COVERAGE in ends:
        label = "unknown" if MAP not in ends or palette == "gray" else "unknown (views)"
        if not (MAP in ends and palettes.unknown(palette) == palettes.UNKNOWN):
            entries.append(Entry("box", palettes.unknown(palette), label))
    if shown.truth:
        entries.append(Entry("line", palettes.TRUTH, "true wall"))
    if entries:
        found.append(Group(entries))
    return found


LONGEST = 960
"""The longer side of a map with furniture, if nothing else is asked for [pixels]."""
LARGEST = 1600
_LEAST = (240, 160)


def furnished_raster(
    evidence: Window, exact: bool, scale: int | None, max_size: int | None, panels: int = 1
) -> Raster:
    """Choose how a map with furniture is drawn.

    exact : the window was asked for; otherwise it gets a margin, and at least room for its labels.
    panels : how many share the picture.
    """
    share = min(panels, 3)
    longest = LONGEST // share
    largest = max_size or (LARGEST // share if scale is None else None)
    if exact:
        return raster.plan(evidence, scale, largest, longest)
    margin = max(2, max(evidence.shape) // 40)
    window = _grown(evidence, margin, margin)
    small = scale is None and max(window.shape) * 24 <= longest
    chosen = raster.plan(window, 24 if small else scale, largest, longest)
    width, height = chosen.size
    cells = chosen.shrink / chosen.scale
    least = [side if max_size is None else min(side, max_size - 3) for side in _LEAST]
    more_columns = max(0, round((least[0] - width) * cells / 2 + 0.5))
    more_rows = max(0, round((least[1] - height) * cells / 2 + 0.5))
    if not (more_columns or more_rows):
        return chosen
    window = _grown(window, more_rows, more_columns)
    return raster.plan(window, chosen.scale, largest, longest)


def _grown(window: Window, rows: int, columns: int) -> Window:
    return Window(
        window.row0 - rows, window.row1 + rows, window.column0 - columns, window.column1 + columns
    )

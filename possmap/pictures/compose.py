"""From a grid's numbers to a finished picture: layer or map, bare or with everything around it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from PIL import Image

from possmap.core.settings import FreeFusion
from possmap.pictures import composite, layers, overlays, palettes
from possmap.pictures.frame import Panel, framed
from possmap.pictures.layers import LAYERS, LEVELS, UNKNOWN_INDEX, Cells, Indices
from possmap.pictures.legend import ColourBar, Entry, Group, Key
from possmap.pictures.overlays import Overlays
from possmap.pictures.palettes import Table
from possmap.pictures.png import gray_image, palette_image
from possmap.pictures.raster import Raster
from possmap.pictures.tiles import Counts

MAP = "map"
COVERAGE = "coverage"
NAMES = (MAP, *LAYERS, COVERAGE)
"""What a picture can show."""


def _no_counts(raster: Raster) -> Counts:
    raise ValueError("this scene knows no excursions")


@dataclass(frozen=True)
class Scene:
    """What there is to draw.

    cells, free_fusion : the grid's numbers, and how those of free space add up.
    resolution : metres per cell.
    coverage : counts the excursions per block, when asked to.
    title, subtitle : above the picture.
    """

    cells: Cells
    resolution: float
    free_fusion: FreeFusion
    coverage: Callable[[Raster], Counts] = _no_counts
    title: str = ""
    subtitle: str = ""
    base_rate: float = 0.5
    overlays: Overlays = field(default_factory=Overlays)


def indices(scene: Scene, name: str, chosen: Raster) -> tuple[Indices, int]:
    """Return a layer's palette indices, and the number that the scale's upper end stands for."""
    if name == MAP:
        return composite.drawn(scene.cells, chosen, scene.free_fusion), 1
    if name != COVERAGE:
        drawn = layers.drawn(name, scene.cells, chosen, scene.base_rate, scene.free_fusion)
        return drawn, 1
    counts = scene.coverage(chosen)
    most = max(1, int(counts.max(initial=0)))
    index: Indices = (counts.astype(np.uint32) * (LEVELS - 1) // most).astype(np.uint8)
    index[counts == 0] = UNKNOWN_INDEX
    return index, most


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
        counts = np.minimum(scene.coverage(chosen), 255).astype(np.uint8)
        return gray_image(counts, chosen.scale)
    if palette == "gray" and name != MAP:
        values = layers.drawn_gray(name, scene.cells, chosen, scene.base_rate, scene.free_fusion)
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
        panels.append(Panel(picture, chosen, name if len(names) > 1 else ""))
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
        found += _bars_of_map(palette)
        entries += _signs_of_map(shown, palette)
    if values:
        only = LAYERS[values[0]] if len(values) == 1 else None
        title = only.title if only else "value of each view"
        words = (only.low, only.high) if only else ("", "")
        found.append(ColourBar(title, palettes.table(palette), ("0", "1"), words))
    if COVERAGE in ends:
        title, scale = "excursions that touched a cell", ("0", str(ends[COVERAGE]))
        found.append(ColourBar(title, palettes.table(palette), scale, ("", "")))
    unknown = palettes.unknown(palette)
    if (values or COVERAGE in ends) and not (MAP in ends and unknown == palettes.UNKNOWN):
        label = "unknown" if MAP not in ends or palette == "gray" else "unknown (views)"
        entries.append(Entry("box", unknown, label))
    if shown.truth:
        entries.append(Entry("line", palettes.TRUTH, "true wall"))
    if entries:
        found.append(Group(entries))
    return found


def _bars_of_map(palette: str) -> list[Key]:
    gray = palette == "gray"
    free = palettes.PAPER_FREE_STOPS if gray else palettes.FREE_STOPS
    wall = palettes.PAPER_WALL_STOPS if gray else palettes.WALL_STOPS
    walls, floor = (np.rint(palettes.ramp(stops, 256)).astype(np.uint8) for stops in (wall, free))
    contested = composite.contested_ramp(palette)
    return [
        ColourBar("wall: belief", walls, ("0", "1"), ("", "certain")),
        ColourBar("free: plausibility of a wall", floor, ("1", "0"), ("", "certain")),
        ColourBar("contested: evidence both ways", contested, ("0", "1"), ("", "undecided")),
    ]


def _signs_of_map(shown: Overlays, palette: str) -> list[Entry]:
    unknown = palettes.PAPER if palette == "gray" else palettes.UNKNOWN
    entries = [Entry("box", unknown, "unknown")]
    if shown.points:
        entries.append(Entry("point", palettes.POINT, "corner or wall end"))
    if shown.homes:
        entries.append(Entry("home", palettes.INK, "home, where robots set out"))
    entries += [
        Entry("line", colour, f"track of {robot}") for robot, colour in shown.robot_colours()
    ]
    return entries

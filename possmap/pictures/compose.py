"""From a grid's numbers to a finished picture: layer or map, bare or with everything around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from PIL import Image

from possmap.core.settings import FreeFusion
from possmap.pictures import layers, legend, overlays, palettes
from possmap.pictures.frame import Panel, framed
from possmap.pictures.layers import COVERAGE, LAYERS, LEVELS, MAP, UNKNOWN_INDEX, Cells
from possmap.pictures.legend import ColourBar, Group, Key, LegendEntry
from possmap.pictures.overlays import Overlays
from possmap.pictures.palettes import Indices, image_of
from possmap.pictures.raster import Raster
from possmap.pictures.tiles import Counts

Drawn: TypeAlias = Mapping[str, tuple[Indices, int]]
"""By layer: its palette indices, and the number that its scale's upper end stands for."""


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

    def drawn(self, name: str, chosen: Raster, read_back: bool = False) -> tuple[Indices, int]:
        """Return a layer's palette indices, and the number at its scale's upper end.

        read_back : values instead, of a layer as round(255·v).
        """
        if name != COVERAGE:
            draw = layers.gray if read_back else layers.indices
            return draw(name, self.cells, chosen, self.base_rate, self.free_fusion), 1
        counts = self.coverage(chosen)
        if read_back:
            return np.minimum(counts, 255).astype(np.uint8), 255
        most = max(1, int(counts.max(initial=0)))
        index: Indices = (counts.astype(np.uint32) * (LEVELS - 1) // most).astype(np.uint8)
        index[counts == 0] = UNKNOWN_INDEX
        return index, most


def bare(
    scene: Scene, name: str, chosen: Raster, palette: str, index: Indices | None = None
) -> Image.Image:
    """Return nothing but the cells; in ``gray`` a layer's values, to be read back.

    index : what was drawn of them already.
    """
    read_back = palette == "gray" and name != MAP
    if index is None:
        index, _ = scene.drawn(name, chosen, read_back)
    return image_of(index, chosen.scale, None if read_back else layers.colours(name, palette))


def furnished(
    scene: Scene, drawn: Drawn, chosen: Raster, palette: str, explained: Overlays | None = None
) -> Image.Image:
    """Return layers side by side with title, axes, scale bar and keys.

    explained : what the keys speak of; None: what is drawn. A film's frames share the last one's.
    """
    panels: list[Panel] = []
    for name, (index, _) in drawn.items():
        picture = image_of(index, chosen.scale, layers.colours(name, palette)).convert("RGB")
        shown = scene.overlays if name == MAP else Overlays(truth=scene.overlays.truth)
        overlays.paint(picture, shown, chosen, scene.resolution)
        panels.append(Panel(picture, chosen, name if len(drawn) > 1 else ""))
    subtitle = scene.subtitle
    if chosen.shrink > 1:
        subtitle += f"; a pixel is {chosen.shrink} x {chosen.shrink} cells"
    ends = {name: end for name, (_, end) in drawn.items()}
    found = keys(explained or scene.overlays, ends, palette)
    return framed(panels, found, scene.title, subtitle, scene.resolution)


def keys(shown: Overlays, ends: Mapping[str, int], palette: str) -> list[Key]:
    """Return one key for each scale in use, and the signs.

    ends : of each layer shown, the number that its scale's upper end stands for.
    """
    found: list[Key] = []
    entries: list[LegendEntry] = []
    values = [LAYERS[name] for name in ends if name in LAYERS]
    if MAP in ends:
        for title, colours, scale, word in palettes.map_scales(palette):
            found.append(ColourBar(title, colours, scale, ("", word)))
        entries += _signs_of_map(shown, palette)
    if len(values) == 1:
        words = values[0].low, values[0].high
        found.append(ColourBar(values[0].title, palettes.table(palette), ("0", "1"), words))
    elif values:
        found.append(ColourBar("value of each view", palettes.table(palette), ("0", "1")))
    if COVERAGE in ends:
        scale = "0", str(ends[COVERAGE])
        found.append(ColourBar("excursions that touched a cell", palettes.table(palette), scale))
    unknown = palettes.unknown(palette)
    if (values or COVERAGE in ends) and not (MAP in ends and unknown == palettes.UNKNOWN):
        label = "unknown" if MAP not in ends or palette == "gray" else "unknown (views)"
        entries.append(LegendEntry(legend.box(unknown), label))
    if shown.truth:
        entries.append(LegendEntry(legend.line(palettes.TRUTH), "true wall"))
    if entries:
        found.append(Group(entries))
    return found


def _signs_of_map(shown: Overlays, palette: str) -> list[LegendEntry]:
    unknown = palettes.PAPER if palette == "gray" else palettes.UNKNOWN
    entries = [LegendEntry(legend.box(unknown), "unknown")]
    if shown.points:
        entries.append(LegendEntry(legend.point, "corner or wall end"))
    if shown.homes:
        entries.append(LegendEntry(legend.circled("I"), "home, where robots set out"))
    if shown.fixes:
        entries.append(LegendEntry(legend.fixed, "fix, where a robot truly was"))
    entries += [
        LegendEntry(legend.line(colour), f"track of {robot}")
        for robot, colour in shown.robot_colours()
    ]
    return entries

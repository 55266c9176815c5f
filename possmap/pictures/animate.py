"""``possmap render --animate``: the ledger replayed, each frame what the host knew then."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

from PIL import Image

from possmap.atomic import replacing
from possmap.budget import Budget
from possmap.core.evidence import Findings, findings
from possmap.core.memory import TileMemory
from possmap.errors import OutputError, plural, printable, shown
from possmap.exports.run import refuse_itself
from possmap.grid.arrivals import with_news
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.pictures import compose
from possmap.pictures.compose import Scene
from possmap.pictures.film import FORMATS, write_film
from possmap.pictures.overlays import Overlays
from possmap.pictures.raster import Raster
from possmap.pictures.render import (
    Look,
    RenderSummary,
    check_fits,
    metadata,
    overlays_of,
    picture,
    raster_of,
)
from possmap.progress import Progress, quiet

By: TypeAlias = Literal["excursion", "record"]

MOST_FRAMES = 400
_DEFAULT_FRAMES = 100


@dataclass(frozen=True)
class _Step:
    """A frame's news: of each excursion, how many records are known from now on."""

    upto: Sequence[tuple[Entry, int]]
    caption: str


def animate(
    path: Path,
    output: Path,
    look: Look,
    by: By,
    *,
    frames: int | None = None,
    frame_ms: int = 400,
    overwrite: bool = False,
    progress: Progress = quiet,
    budget: Budget | None = None,
) -> RenderSummary:
    """Draw how a grid grew, in the order in which its logs arrived.

    Parameters
    ----------
    by
        A frame for each delivery of an excursion, or for a number of records each.
    frames
        How many, at most.

    Raises
    ------
    OutputError
        For a suffix that is no film's, several layers, no evidence, or too large a picture.
    """
    suffix = output.suffix.lower()
    if suffix not in FORMATS:
        raise OutputError(
            f"{printable(str(output))}: unknown suffix {shown(output.suffix)}, "
            f"expected one of {', '.join(FORMATS)}"
        )
    if compose.COVERAGE in look.layers:
        raise OutputError("coverage cannot be animated yet; any other layer can")
    look = look if look.max_size or look.scale else replace(look, max_size=720)
    refuse_itself(path, output)
    budget = budget or Budget()
    with Grid(path, budget=budget) as grid, grid.snapshot():
        chosen = raster_of(grid, look)
        check_fits(look, chosen, budget)
        steps = list(_steps(grid, by, min(frames or _DEFAULT_FRAMES, MOST_FRAMES)))
        with replacing(output, overwrite) as stream:
            last = picture(grid, look, chosen).convert("RGB")
            legend = overlays_of(grid, look, chosen)
            drawn = _frames(grid, look, chosen, steps, legend, progress)
            text = metadata(grid, look, chosen)
            count = write_film(drawn, last, stream, suffix, frame_ms, text)
    return RenderSummary(output, *last.size, count)


def _steps(grid: Grid, by: By, most: int) -> Iterator[_Step]:
    """Yield the news of each frame, first what arrived first."""
    entries = {entry.name: entry for entry in grid.ledger.entries()}
    parts = []
    for arrival, first in with_news(grid.ledger.came.all()):
        if first is not None:
            entry = entries[arrival.name]
            carried = f", carried by {' '.join(arrival.carrier)}" if arrival.carrier else ""
            caption = f"{entry.robot} {entry.excursion}{carried}"
            parts.append((entry, first, arrival.records, caption))
    total = sum(end - first for _, first, end, _ in parts)
    stops = max(1, min(most, len(parts) if by == "excursion" else total))
    news: list[tuple[Entry, int]] = []
    gone, stop = 0, 1
    for number, (entry, first, end, caption) in enumerate(parts, 1):
        if by == "excursion":
            news.append((entry, end))
            if number * stops >= stop * len(parts):
                yield _Step(news, caption)
                news, stop = [], stop + 1
            continue
        while stop * total < (gone + end - first) * stops:
            upto = first + -(-stop * total // stops) - gone
            yield _Step([*news, (entry, upto)], caption)
            news, stop = [], stop + 1
        news.append((entry, end))
        gone += end - first
        if number == len(parts):
            yield _Step(news, caption)


def _frames(
    grid: Grid,
    look: Look,
    chosen: Raster,
    steps: Sequence[_Step],
    legend: Overlays,
    progress: Progress,
) -> Iterator[Image.Image]:
    """Fuse step by step into memory, and draw after each."""
    settings = grid.settings
    memory = TileMemory(settings)
    known: dict[int, int] = {}
    laid_out: dict[int, Findings] = {}
    robots: set[str] = set()
    for step in progress(steps, "frame"):
        for entry, upto in step.upto:
            if entry.identity not in laid_out:
                version = grid.ledger.version(entry)
                laid_out[entry.identity] = findings(version, entry.model, settings)
            before = known.get(entry.identity, 0)
            memory.fuse(laid_out[entry.identity].before(upto), before)
            known[entry.identity] = upto
            robots.add(entry.robot)
        scene = _scene(grid, look, chosen, memory, known, len(robots), step.caption)
        if look.bare:
            yield compose.bare(scene, look.layers[0], chosen, look.palette).convert("RGB")
        else:
            yield compose.furnished(scene, look.layers, chosen, look.palette, legend)


def _scene(
    grid: Grid,
    look: Look,
    chosen: Raster,
    memory: TileMemory,
    known: dict[int, int],
    robots: int,
    caption: str,
) -> Scene:
    return Scene(
        cells=memory,
        resolution=grid.resolution,
        title=look.title if look.title is not None else grid.path.stem,
        subtitle=(
            f"{plural(robots, 'robot')}, {plural(len(known), 'excursion')}, "
            f"{plural(sum(known.values()), 'record')}; now {caption}"
        ),
        base_rate=look.base_rate,
        overlays=overlays_of(grid, look, chosen, known),
    )

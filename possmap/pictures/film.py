"""``possmap render --animate``: the ledger replayed, each frame what the host knew then."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, Literal, TypeAlias

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from possmap.atomic import replacing
from possmap.core.evidence import Findings
from possmap.errors import OutputError, plural, printable, shown
from possmap.exports.export import refuse_itself
from possmap.grid.arrivals import with_news
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.replay import replay
from possmap.pictures import compose
from possmap.pictures.raster import Raster
from possmap.pictures.render import (
    Look,
    RenderSummary,
    entries_of,
    metadata,
    overlays_of,
    picture,
    raster_of,
    scene_of,
)
from possmap.pictures.tiles import TileMemory
from possmap.progress import Progress, quiet

By: TypeAlias = Literal["excursion", "record"]

FORMATS: Mapping[str, str] = {".png": "PNG", ".apng": "PNG", ".gif": "GIF", ".webp": "WEBP"}
"""Suffix -> Pillow's name."""

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
        For a suffix that is no film's, coverage, no evidence, or too large a picture.
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
    with Grid(path) as grid, grid.snapshot():
        chosen = raster_of(grid, look)
        steps = list(_steps(grid, look, by, min(frames or _DEFAULT_FRAMES, MOST_FRAMES)))
        last = picture(grid, look, chosen).convert("RGB")
        with replacing(output, overwrite) as stream:
            drawn = _frames(grid, look, chosen, steps, progress)
            count = _write(drawn, last, stream, suffix, frame_ms, metadata(grid, look, chosen))
    return RenderSummary(output, *last.size, count)


def _steps(grid: Grid, look: Look, by: By, most: int) -> Iterator[_Step]:
    """Yield the news of each frame, first what arrived first."""
    entries = {entry.name: entry for entry in entries_of(grid, look)}
    parts = []
    for arrival, first in with_news(grid.ledger.came.all()):
        entry = entries.get(arrival.name)
        if entry is not None and first is not None:
            carried = f", carried by {' '.join(arrival.carrier)}" if arrival.carrier else ""
            caption = f"{entry.robot} {entry.excursion}{carried}"
            parts.append((entry, first, arrival.records, caption))
    total = sum(end - first for _, first, end, _ in parts)
    stops = max(1, min(most, len(parts) if by == "excursion" else total))
    news: list[tuple[Entry, int]] = []
    gone, stop = 0, 1
    for number, (entry, first, end, caption) in enumerate(parts, 1):
        while by == "record" and stop * total < (gone + end - first) * stops:
            upto = first + -(-stop * total // stops) - gone
            yield _Step([*news, (entry, upto)], caption)
            news, stop = [], stop + 1
        news.append((entry, end))
        gone += end - first
        due = number * stops >= stop * len(parts) if by == "excursion" else number == len(parts)
        if due:
            yield _Step(news, caption)
            news, stop = [], stop + 1


def _frames(
    grid: Grid, look: Look, chosen: Raster, steps: Sequence[_Step], progress: Progress
) -> Iterator[Image.Image]:
    """Fuse step by step into memory, and draw after each."""
    settings = grid.settings
    entries = entries_of(grid, look)
    scene, legend = scene_of(grid, look, chosen), overlays_of(grid, look, chosen, entries)
    memory = TileMemory(printable(str(grid.path)), settings, chosen.window)
    known: dict[int, int] = {}
    laid_out: dict[int, Findings] = {}
    robots: set[str] = set()
    for step in progress(steps, "frame"):
        for entry, upto in step.upto:
            if entry.identity not in laid_out:
                laid_out[entry.identity] = replay(grid, entry, settings).findings
            memory.fuse(laid_out[entry.identity].before(upto), known.get(entry.identity, 0))
            known[entry.identity] = upto
            robots.add(entry.robot)
            if upto == entry.records:
                del laid_out[entry.identity]
        now = replace(
            scene,
            cells=memory,
            subtitle=f"{plural(len(robots), 'robot')}, {plural(len(known), 'excursion')}, "
            f"{plural(sum(known.values()), 'record')}; now {step.caption}",
            overlays=overlays_of(grid, look, chosen, entries, known),
        )
        if look.bare:
            yield compose.bare(now, look.layers[0], chosen, look.palette).convert("RGB")
        else:
            yield compose.furnished(now, look.layers, chosen, look.palette, legend)


def _write(
    frames: Iterator[Image.Image],
    last: Image.Image,
    stream: BinaryIO,
    suffix: str,
    frame_ms: int,
    text: Mapping[str, str],
) -> int:
    """Write frames and return how many there were; the last is shown four times as long.

    last : has all colours of the film; of a GIF these become 256.
    """
    kind = FORMATS[suffix]
    if kind == "GIF":
        palette = last.quantize(256)
        frames = (one.quantize(palette=palette, dither=Image.Dither.NONE) for one in frames)
    first, *rest = frames
    more: dict[str, object] = {}
    if kind == "PNG":
        info = PngInfo()
        for key, value in text.items():
            info.add_text(key, value)
        more = {"pnginfo": info}
    elif kind == "GIF":
        more = {"comment": text["Software"].encode(), "optimize": False}
    else:
        more = {"lossless": True}
    durations = [frame_ms] * len(rest) + [4 * frame_ms]
    first.save(
        stream,
        kind,
        save_all=True,
        append_images=rest,
        duration=durations if rest else frame_ms,
        loop=0,
        **more,
    )
    return 1 + len(rest)

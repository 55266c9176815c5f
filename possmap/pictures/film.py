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
from possmap.core.lattice import TileKey, tile_window
from possmap.errors import OutputError, plural
from possmap.grid.arrivals import with_news
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.replay import laid_out
from possmap.pictures import compose
from possmap.pictures.layers import COVERAGE, MAP
from possmap.pictures.raster import Raster
from possmap.pictures.render import (
    Look,
    RenderSummary,
    check_suffix,
    marks_of,
    metadata,
    opened,
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
    check_suffix(output, FORMATS, f"one of {', '.join(FORMATS)}")
    if COVERAGE in look.layers:
        raise OutputError("coverage cannot be animated yet; any other layer can")
    look = look if look.max_size or look.scale else replace(look, max_size=720)
    with opened(path, look, output) as grid:
        chosen = raster_of(grid, look)
        steps = list(_steps(grid, by, min(frames or _DEFAULT_FRAMES, MOST_FRAMES)))
        last = picture(grid, look, chosen).convert("RGB")
        with replacing(output, overwrite) as stream:
            drawn = _frames(grid, look, chosen, steps, progress)
            suffix, text = output.suffix.lower(), metadata(grid, look, chosen)
            count = _write(drawn, last, stream, suffix, frame_ms, text)
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
    """Fuse step by step into memory, and draw after each what has changed."""
    settings, memory = grid.settings, TileMemory(grid, chosen.window)
    scene = replace(scene_of(grid, look, chosen), cells=memory)
    explained, marks = scene.overlays, marks_of(grid, look, chosen)
    read_back = look.bare and look.palette == "gray" and look.layers[0] != MAP
    drawn = {name: scene.drawn(name, chosen, read_back) for name in look.layers}
    known: dict[int, int] = {}
    waiting: dict[int, Findings] = {}
    robots: set[str] = set()
    for step in progress(steps, "frame"):
        changed: set[TileKey] = set()
        for entry, upto in step.upto:
            if entry.identity not in waiting:
                waiting[entry.identity] = laid_out(grid, entry, settings)[1]
            found = waiting[entry.identity].before(upto)
            changed |= memory.fuse(found, known.get(entry.identity, 0))
            known[entry.identity] = upto
            robots.add(entry.robot)
            if upto == entry.records:
                del waiting[entry.identity]
        for key in changed:
            part, place = chosen.around(tile_window(key))
            for name, (index, _) in drawn.items():
                index[place], _ = scene.drawn(name, part, read_back)
        if look.bare:
            name, (index, _) = next(iter(drawn.items()))
            yield compose.bare(scene, name, chosen, look.palette, index).convert("RGB")
            continue
        now = replace(
            scene,
            subtitle=f"{plural(len(robots), 'robot')}, {plural(len(known), 'excursion')}, "
            f"{plural(sum(known.values()), 'record')}; now {step.caption}",
            overlays=marks(known),
        )
        yield compose.furnished(now, drawn, chosen, look.palette, explained)


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

"""``possmap info``."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.budget import Budget
    from possmap.grid.arrivals import Event
    from possmap.grid.forgotten import Forgotten
    from possmap.grid.ledger import Entry
    from possmap.inspection.info import GridInfo


@click.command(epilog="Example: possmap info site.possmap")
@options.grid_argument
@options.memory
@options.as_json
def info(grid: Path, budget: Budget, as_json: bool) -> None:
    """Say what a grid holds: size, settings, robots, excursions, and its digest.

    Two grids of the same evidence have one digest, in whatever order the logs came.
    """
    from possmap.inspection.info import info as look

    found = look(grid, budget)
    click.echo(json.dumps(_as_json(found)) if as_json else "\n".join(_as_text(found)))


def _as_json(found: GridInfo) -> dict[str, Any]:
    from possmap.cli.forget import as_told
    from possmap.grid.arrivals import Again, Part

    events = found.events_by_excursion()
    return {
        "grid": str(found.grid),
        "digest": found.digest,
        "resolution": found.resolution,
        "rows": found.window.shape[0] if found.window else 0,
        "columns": found.window.shape[1] if found.window else 0,
        "extent": found.extent_m,
        "tiles": found.tiles,
        "file_size": found.file_size,
        "records": found.records,
        "robots": found.robots,
        "settings": found.stored,
        "excursions": [
            {
                "robot": one.robot,
                "excursion": one.excursion,
                "records": one.records,
                "model": _own(found, one),
                "parts": [
                    {"first": event.what.first, "count": event.what.count, **_came(event)}
                    for event in events.get(one.name, ())
                    if isinstance(event.what, Part)
                ],
                "again": [
                    {"count": event.what.end, **_came(event)}
                    for event in events.get(one.name, ())
                    if isinstance(event.what, Again)
                ],
            }
            for one in found.excursions
        ],
        "forgotten": [as_told(one) for one in found.forgotten],
    }


def _came(event: Event) -> dict[str, Any]:
    what = event.what
    return {
        "carried_by": what.carrier,
        "source": what.origin.name,
        "sha256": what.origin.sha256,
        "size": what.origin.size,
        "fused_at": event.fused_at,
        "version": event.version,
    }


def _own(found: GridInfo, entry: Entry) -> dict[str, float]:
    """Return the parameters in which an excursion's model differs from the grid's."""
    general = found.settings.evidence.model
    return {
        name: getattr(entry.model, name)
        for name in asdict(entry.model)
        if getattr(entry.model, name) != getattr(general, name)
    }


def _as_text(found: GridInfo) -> list[str]:
    from possmap.errors import brief, plural, printable
    from possmap.grid.arrivals import Part
    from possmap.settings.setting_table import SHAPING
    from possmap.settings.settings import Settings, flat_evidence, scalar

    size = "nothing"
    if found.window and found.extent_m:
        rows, columns = found.window.shape
        x0, y0, x1, y1 = found.extent_m
        size = (
            f"{x1 - x0:.2f} × {y1 - y0:.2f} m from ({x0:.2f}, {y0:.2f}), "
            f"{columns} × {rows} cells of {found.resolution:g} m"
        )
    lines = [
        f"grid        {printable(str(found.grid))}, {found.file_size / 1024:.0f} KiB",
        f"digest      {found.digest}",
        f"map         {size}, {plural(found.tiles, 'tile')}",
        f"evidence    {plural(found.records, 'record')} of "
        f"{plural(len(found.excursions), 'excursion')} by {plural(len(found.robots), 'robot')}",
    ]
    defaults = flat_evidence(Settings().evidence)
    changed = [
        f"{name} {scalar(found.stored[name])}"
        for name in SHAPING
        if found.stored[name] != defaults[name]
    ]
    changed += [
        f"{name} {scalar(value)}"
        for name, value in sorted(found.stored.items())
        if name not in SHAPING
    ]
    lines += ["settings    " + (", ".join(changed) or "the paper's, all of them")]
    lines += [f"forgotten   {_forgotten(one)}" for one in found.forgotten]
    events = found.events_by_excursion()
    for one in found.excursions:
        own = ", ".join(f"{name} {scalar(value)}" for name, value in _own(found, one).items())
        line = f"  {brief(one.robot)} {brief(one.excursion)}: {plural(one.records, 'record')}"
        lines += [f"{line}, its own {own}" if own else line]
        for event in events.get(one.name, ()):
            part = event.what
            if isinstance(part, Part):
                by = " ".join(map(brief, part.carrier or ()))
                carrier = f", carried by {by}" if by else ""
                lines += [f"    {part.count} from {brief(part.origin.name)}{carrier}"]
    return lines


def _forgotten(one: Forgotten) -> str:
    from possmap.errors import brief, plural

    return (
        f"{one.title}, {brief(one.forgotten_at)}: {plural(one.records, 'record')} of "
        f"{plural(one.excursions, 'excursion')}"
    )

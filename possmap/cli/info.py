"""``possmap info``."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.app.info import GridInfo
    from possmap.files.gridfile.ledger import Entry


@click.command(epilog="Example: possmap info site.possmap")
@options.grid_argument
@options.as_json
def info(grid: Path, as_json: bool) -> None:
    """Say what a grid holds: size, settings, robots, excursions, and its digest.

    Two grids of the same evidence have one digest, in whatever order the logs came.
    """
    from possmap.app.info import info as look

    found = look(grid)
    click.echo(json.dumps(_as_json(found)) if as_json else "\n".join(_as_text(found)))


def _as_json(found: GridInfo) -> dict[str, Any]:
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
                    {
                        "first": arrival.part.first,
                        "count": arrival.part.count,
                        "carried_by": arrival.part.carrier,
                        "source": arrival.part.origin.name,
                        "sha256": arrival.part.origin.sha256,
                        "size": arrival.part.origin.size,
                        "fused_at": arrival.fused_at,
                        "version": arrival.version,
                    }
                    for arrival in found.arrivals
                    if (arrival.robot, arrival.excursion) == one.name
                ],
            }
            for one in found.excursions
        ],
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
    from possmap.errors import plural, printable
    from possmap.files.setting_table import SHAPING
    from possmap.files.settings import Settings, flat_evidence, scalar

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
    for one in found.excursions:
        own = ", ".join(f"{name} {scalar(value)}" for name, value in _own(found, one).items())
        line = f"  {one.robot} {one.excursion}: {plural(one.records, 'record')}"
        lines += [f"{line}, its own {own}" if own else line]
        for arrival in found.arrivals:
            if (arrival.robot, arrival.excursion) == one.name:
                part = arrival.part
                carrier = f", carried by {' '.join(part.carrier)}" if part.carrier else ""
                lines += [f"    {part.count} from {printable(part.origin.name)}{carrier}"]
    return lines

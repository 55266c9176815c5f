"""``possmap info``."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.grid.arrivals import Arrival
    from possmap.grid.forgotten import Forgotten
    from possmap.grid.ledger import Entry
    from possmap.inspection.info import GridInfo, Share


@click.command(epilog="Example: possmap info site.possmap")
@options.grid_argument
@click.option("--excursions", is_flag=True, help="List every excursion, and what brought it.")
@options.as_json
def info(grid: Path, excursions: bool, as_json: bool) -> None:
    """Say what a grid holds: size, settings, robots, weeks, and its digest.

    Two grids of the same evidence have one digest, in whatever order the logs came.
    """
    from possmap.inspection.info import info as look

    found = look(grid)
    if as_json:
        click.echo(json.dumps(_as_json(found)))
    else:
        click.echo("\n".join([*_as_text(found), *(_listed if excursions else _in_short)(found)]))


def _as_json(found: GridInfo) -> dict[str, Any]:
    from possmap.cli.forget import as_told

    return {
        "grid": str(found.grid),
        "digest": found.digest,
        "refined": found.refined._asdict() if found.refined else None,
        "resolution": found.resolution,
        "rows": found.window.shape[0] if found.window else 0,
        "columns": found.window.shape[1] if found.window else 0,
        "extent": found.extent_m,
        "tiles": found.tiles,
        "file_size": found.file_size,
        "records": found.records,
        "cells_known": found.undecided and found.undecided.known,
        "cells_contested": found.undecided and found.undecided.contested,
        "robots": found.robots,
        "by_robot": {name: asdict(share) for name, share in found.by_robot.items()},
        "by_week": {name: asdict(share) for name, share in found.by_week.items()},
        "settings": found.stored,
        "excursions": [
            {
                "robot": one.robot,
                "excursion": one.excursion,
                "records": one.records,
                "beyond": one.beyond,
                "heading": {**one.observations._asdict(), "bias": one.observations.bias},
                "model": _own(found, one),
                "parts": [
                    {"first": first, "count": came.records - first, **_came(came)}
                    for came, first in arrived
                    if first is not None
                ],
                "again": [
                    {"count": came.records, **_came(came)}
                    for came, first in arrived
                    if first is None
                ],
            }
            for one, arrived in _arrived(found)
        ],
        "forgotten": [as_told(one) for one in found.forgotten],
    }


def _arrived(found: GridInfo) -> list[tuple[Entry, list[tuple[Arrival, int | None]]]]:
    """Return each excursion with what came of it, and the first record of it that was new."""
    from possmap.grid.arrivals import with_news

    by_name: dict[tuple[str, str], list[tuple[Arrival, int | None]]] = {}
    for came, first in with_news(found.arrivals):
        by_name.setdefault(came.name, []).append((came, first))
    return [(one, by_name.get(one.name, [])) for one in found.excursions]


def _came(came: Arrival) -> dict[str, Any]:
    return {
        "carried_by": came.carrier,
        "source": came.origin.name,
        "sha256": came.origin.sha256,
        "size": came.origin.size,
        "fused_at": came.fused_at,
        "version": came.version,
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
        *(
            [f"refined     of a grid of digest {brief(found.refined.made_of)}"]
            if found.refined
            else []
        ),
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
    beyond = sum(one.beyond for one in found.excursions)
    if beyond:
        lines += [
            f"beyond      {plural(beyond, 'record')} of them: the error reaches max_error there"
        ]
    used, vague, outliers = (
        sum(one.observations[place] for one in found.excursions) for place in range(3)
    )
    if used or vague or outliers:
        lines += [f"heading     {used} observations used, {vague} vague, {outliers} outliers"]
    if found.undecided is None:
        lines += ["contested   not counted: the map is large"]
    elif found.undecided.known:
        lines += [f"contested   {found.undecided.share:.1%} of {found.undecided.known} known cells"]
    return lines + [f"forgotten   {_forgotten(one)}" for one in found.forgotten]


def _in_short(found: GridInfo) -> list[str]:
    """Return a line for each robot and each week."""
    from possmap.errors import brief, plural

    def line(name: str, share: Share, others: str) -> str:
        beyond = f", {share.beyond} of them beyond max_error" if share.beyond else ""
        excursions = plural(share.excursions, "excursion")
        return f"  {brief(name)}: {excursions}{others}, {plural(share.records, 'record')}{beyond}"

    return [
        "robots",
        *(line(name, share, "") for name, share in found.by_robot.items()),
        "weeks",
        *(
            line(name, share, f" of {plural(share.robots, 'robot')}")
            for name, share in found.by_week.items()
        ),
    ]


def _listed(found: GridInfo) -> list[str]:
    """Return a line for each excursion, and for each file that brought some of it."""
    from possmap.errors import brief, plural
    from possmap.settings.settings import scalar

    lines: list[str] = []
    for one, arrived in _arrived(found):
        own = ", ".join(f"{name} {scalar(value)}" for name, value in _own(found, one).items())
        line = f"  {brief(one.robot)} {brief(one.excursion)}: {plural(one.records, 'record')}"
        line += f" ({one.beyond} beyond max_error)" if one.beyond else ""
        lines += [f"{line}, its own {own}" if own else line]
        for came, first in arrived:
            if first is not None:
                by = " ".join(map(brief, came.carrier or ()))
                carrier = f", carried by {by}" if by else ""
                lines += [f"    {came.records - first} from {brief(came.origin.name)}{carrier}"]
    return lines


def _forgotten(one: Forgotten) -> str:
    from possmap.errors import brief, plural

    return (
        f"{one.title}, {brief(one.forgotten_at)}: {plural(one.records, 'record')} of "
        f"{plural(one.excursions, 'excursion')}"
    )

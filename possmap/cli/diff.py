"""``possmap diff``."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.grid.ledger import Entry
    from possmap.inspection.changes import Change, ChangedCells
    from possmap.inspection.diff import DiffSummary, ExcursionDiff, Pair
    from possmap.settings.setting_table import Value

_AT_LENGTH = 3
"""As many excursions that changed in the same way are named one by one."""


@click.command(epilog="Example: possmap diff before.possmap site.possmap --picture diff.png")
@click.argument("a", type=options.EXISTING_FILE, metavar="A.possmap")
@click.argument("b", type=options.EXISTING_FILE, metavar="B.possmap")
@click.option(
    "--largest", type=click.IntRange(0, 100), default=5, show_default=True,
    help="How many of the largest changes to name; they lie at least 1 m apart.",
)  # fmt: skip
@options.window
@click.option(
    "--picture", type=click.Path(path_type=Path), metavar="OUT.png", help="Draw what changed."
)
@options.overwrite
@options.as_json
@click.pass_context
def diff(
    ctx: click.Context,
    /,
    a: Path,
    b: Path,
    largest: int,
    window: tuple[float, float, float, float] | None,
    picture: Path | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Say in what two grids of one resolution differ, from A to B.

    Settings, excursions and records, cells known, changes of the belief in a wall, of its
    plausibility and of singular points, what became contested. Shares are those of the cells that A
    or B knows. Where the digests are equal, no cell differs, and none is read.
    """
    from possmap.cli.progress import bar
    from possmap.inspection.diff import diff as compare

    if overwrite and picture is None:
        raise click.UsageError("--overwrite belongs to --picture.")
    found = compare(
        a,
        b,
        largest=largest,
        window_m=window,
        picture=picture,
        overwrite=overwrite,
        progress=bar,
    )
    click.echo(json.dumps(_as_json(found, picture)) if as_json else "\n".join(_as_text(found)))
    if picture is not None and found.picture and not as_json and not ctx.obj["quiet"]:
        from possmap.errors import printable

        width, height = found.picture
        click.echo(f"{printable(str(picture))}: {width} x {height} pixels")


def _as_json(found: DiffSummary, picture: Path | None) -> dict[str, Any]:
    def names(entries: tuple[Entry, ...]) -> list[dict[str, Any]]:
        return [
            {"robot": one.robot, "excursion": one.excursion, "records": one.records}
            for one in entries
        ]

    def pairs(of: Mapping[str, Pair[Any]]) -> dict[str, Any]:
        return {name: pair._asdict() for name, pair in of.items()}

    return {
        "a": str(found.a),
        "b": str(found.b),
        "digests": found.digests._asdict(),
        "equal": found.equal,
        "settings": pairs(found.settings),
        "records": found.records._asdict(),
        "excursions": {
            "equal": found.equal_excursions,
            "only_a": names(found.only_a),
            "only_b": names(found.only_b),
            "changed": [
                {
                    "robot": one.robot,
                    "excursion": one.excursion,
                    "records": one.records._asdict(),
                    "model": pairs(one.model),
                }
                for one in found.changed
            ],
        },
        "cells": None if found.cells is None else _cells_as_json(found.cells, found.largest),
        "picture": None if picture is None else str(picture),
    }


def _cells_as_json(cells: ChangedCells, largest: tuple[Change, ...]) -> dict[str, Any]:
    from possmap.inspection.changes import QUANTITIES, THRESHOLDS

    either = cells.in_either
    return {
        "known": {"a": cells.in_a, "b": cells.in_b, "both": cells.in_both, "either": either},
        "changed": {
            quantity: {
                "over": dict(zip(map(str, THRESHOLDS), counts.tolist(), strict=True)),
                "mean": float(moved) / max(1, either),
            }
            for quantity, counts, moved in zip(QUANTITIES, cells.beyond, cells.moved, strict=True)
        },
        "contested": {"became": cells.became, "ceased": cells.ceased},
        "largest": [one._asdict() for one in largest],
    }


def _as_text(found: DiffSummary) -> Iterator[str]:
    from possmap.errors import printable

    yield f"A             {printable(str(found.a))}"
    yield f"B             {printable(str(found.b))}"
    equal = "equal: no cell differs" if found.equal else "differ"
    yield f"digests       {equal}"
    if found.settings or not found.equal:
        yield f"settings      {len(found.settings) or 'none'} changed"
    for name, (a, b) in found.settings.items():
        yield f"  {name} {_value(a)} -> {_value(b)}"
    if not found.equal:
        yield from _excursions_as_text(found)
    if found.cells:
        yield from _cells_as_text(found.cells, found.largest)


def _value(value: Value | None) -> str:
    from possmap.settings.settings import scalar

    return "none" if value is None else scalar(value)


def _excursions_as_text(found: DiffSummary) -> Iterator[str]:
    from possmap.errors import brief, plural

    a, b = found.records
    yield (
        f"excursions    {found.equal_excursions} the same, {len(found.changed)} changed, "
        f"{len(found.only_a)} only in A, {len(found.only_b)} only in B"
    )
    for entries, which in ((found.only_a, "A"), (found.only_b, "B")):
        for entry in entries:
            records = plural(entry.records, "record")
            yield f"  {brief(entry.robot)} {brief(entry.excursion)}: {records}, only in {which}"
    notes: dict[str, list[str]] = {}
    for changed in found.changed:
        name = f"{brief(changed.robot)} {brief(changed.excursion)}"
        notes.setdefault(", ".join(_changes(changed)), []).append(name)
    for note, names in notes.items():
        # One other setting changes the model of every excursion: that is said once.
        many = [plural(len(names), "excursion")] if len(names) > _AT_LENGTH else names
        yield from (f"  {name}: {note}" for name in many)
    yield f"records       {a} in A, {b} in B"


def _changes(changed: ExcursionDiff) -> list[str]:
    a, b = changed.records
    said = [f"{a} -> {b} records"] if a != b else []
    said += [f"{name} {_value(x)} -> {_value(y)}" for name, (x, y) in changed.model.items()]
    return said or ["as many records, but others"]


def _cells_as_text(cells: ChangedCells, largest: tuple[Change, ...]) -> Iterator[str]:
    from possmap.inspection.changes import QUANTITIES, THRESHOLDS

    def share(count: int) -> str:
        return f"{count / max(1, cells.in_either):.2%}"

    counts = {"A or B": cells.in_either, "A": cells.in_a, "B": cells.in_b, "both": cells.in_both}
    digits = len(str(cells.in_either))
    for label, (name, count) in zip(("known cells", "", "", ""), counts.items(), strict=True):
        yield f"{label:<14}{count:>{digits}}  {share(count):>7}  in {name}"
    yield "changed by    " + "".join(f"{f'> {one}':>9}" for one in THRESHOLDS) + "     mean"
    for quantity, beyond, moved in zip(QUANTITIES, cells.beyond, cells.moved, strict=True):
        columns = "".join(f"{share(int(count)):>9}" for count in beyond)
        yield f"  {quantity:<12}{columns}{moved / max(1, cells.in_either):>9.4f}"
    yield f"contested     {cells.became} became so, {cells.ceased} no longer are"
    yield f"largest       {len(largest) or 'none'}"
    digits = len(str(len(largest)))
    for number, one in enumerate(largest, 1):
        yield (
            f"  {number:>{digits}}  ({one.x:.3f}, {one.y:.3f}) m: "
            f"{one.quantity} {one.a:.4f} -> {one.b:.4f}"
        )

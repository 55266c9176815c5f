"""``possmap audit``."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from possmap.cli import options

if TYPE_CHECKING:
    from possmap.grid.selection import Selection
    from possmap.inspection.audit import Audit
    from possmap.inspection.judgement import Side

_COLUMNS = (
    "contradiction",
    "above",
    "compared",
    "mean K",
    "walls",
    "outliers",
    "surprise",
    "strays",
)


@click.command(epilog="Example: possmap audit site.possmap")
@options.grid_argument
@click.option(
    "--top",
    type=click.IntRange(min=1),
    default=10,
    show_default=True,
    metavar="N",
    help="How many robots and excursions to list; --json has all.",
)
@options.window
@options.selection
@options.as_json
def audit(
    grid: Path,
    top: int,
    window: tuple[float, float, float, float] | None,
    selection: Selection,
    as_json: bool,
) -> None:
    """Say which robots and excursions contradict others, or what their own walls tell.

    Each is held against what the other robots say of the same cells, and against its own model.
    Who stands out may be broken, or the only one that is right: look at the place.
    """
    from possmap.cli.progress import bar
    from possmap.inspection.audit import audit as hold

    found = hold(grid, window_m=window, selection=selection, progress=bar)
    click.echo(json.dumps(_as_json(found)) if as_json else "\n".join(_as_text(found, top)))


def _as_json(found: Audit) -> dict[str, Any]:
    return {
        "grid": str(found.grid),
        "resolution": found.resolution,
        "robots": [_of(one) for one in found.robots],
        "excursions": [_of(one) for one in found.excursions],
    }


def _of(side: Side) -> dict[str, Any]:
    told = asdict(side) | {"stands_out": side.stands_out, "reasons": list(side.reasons)}
    del told["since" if side.excursion is not None else "excursion"]
    if side.worst is not None:
        told["worst"] = dict(zip(("x", "y", "conflict"), side.worst, strict=True))
    return told


def _as_text(found: Audit, top: int) -> Iterator[str]:
    from possmap.errors import plural, printable

    yield f"grid        {printable(str(found.grid))}"
    yield (
        f"judged      {_judged(found.robots)} of {plural(len(found.robots), 'robot')}, "
        f"{_judged(found.excursions)} of {plural(len(found.excursions), 'excursion')}"
    )
    yield f"stands out  {_suspects(found, top)}"
    sides = [*_listed(found.robots, top), *_listed(found.excursions, top)]
    width = max([0, *(len(_name(one)) for one in sides)])
    digits = len(str(max(1, min(top, len(found.excursions)))))
    for title, some in (("robots", found.robots), ("excursions", found.excursions)):
        listed = _listed(some, top)
        if listed:
            indent = f"{title:<{max(len('excursions'), 4 + digits + width)}}"
            yield indent + "".join(f"{one:>{_wide(one)}}" for one in _COLUMNS) + "  worst place"
        for number, one in enumerate(listed, 1):
            name = f"  {number:>{digits}}  {_name(one):<{width}}"
            yield f"{name:<{len('excursions')}}" + "".join(_cells(one))
    unjudged = [one for one in found.excursions if not one.judged]
    if unjudged:
        yield "not compared, for others say too little of the same cells"
        for one in unjudged[:top]:
            yield f"  {_name(one)}: {plural(one.compared, 'cell')} compared, {one.share:.1%}"
        if len(unjudged) > top:
            yield f"  and {len(unjudged) - top} more"


def _judged(sides: Sequence[Side]) -> int:
    return sum(one.judged for one in sides)


def _listed(sides: Sequence[Side], top: int) -> list[Side]:
    return [one for one in sides if one.judged or one.stands_out][:top]


def _name(side: Side) -> str:
    from possmap.errors import brief

    names = (side.robot,) if side.excursion is None else (side.robot, side.excursion)
    return " ".join(map(brief, names))


def _suspects(found: Audit, top: int) -> str:
    from possmap.errors import brief

    names = []
    for one in found.robots:
        if one.stands_out:
            since = f" since {brief(one.since)}" if one.since else ""
            names.append(f"robot {_name(one)}{since} ({', '.join(one.reasons)})")
    odd = [one for one in found.excursions if one.stands_out]
    names += [f"excursion {_name(one)} ({', '.join(one.reasons)})" for one in odd[:top]]
    if len(odd) > top:
        names.append(f"and {len(odd) - top} more excursions")
    if names:
        return "; ".join(names)
    sides = (*found.robots, *found.excursions)
    told = any(one.above is not None or one.told.seen or one.told.fixes for one in sides)
    return "nobody" if told else "cannot be said"


def _wide(column: str) -> int:
    return max(8, len(column)) + 2


def _cells(side: Side) -> Iterator[str]:
    mark = "!" if side.stands_out else ""
    values = (
        f"{side.contradiction:.3f}",
        "-" if side.above is None else f"{mark}{side.above:.1f}",
        f"{side.share:.1%}",
        f"{side.conflict:.4f}",
        f"{side.told.seen}",
        f"{side.told.outliers}",
        f"{side.told.surprise:.1f}",
        f"{side.told.stray_deg:.1f}°",
    )
    for column, value in zip(_COLUMNS, values, strict=True):
        yield f"{value:>{_wide(column)}}"
    yield "  none" if side.worst is None else f"  ({side.worst[0]:.3f}, {side.worst[1]:.3f}) m"

"""What ``possmap convert`` says of what it did, as text or JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from possmap.errors import plural, printable
from possmap.lab.convert.hits import ECHOES
from possmap.lab.convert.run import Converted


def to_json(found: Sequence[Converted], output: Path) -> dict[str, Any]:
    """Return what came of the recordings as JSON holds it."""
    return {"output": str(output), "recordings": [_one_to_json(one) for one in found]}


STEADY_DEG_PER_M = 0.2
"""A drift that the axes of a building should not have to take out [deg/m]."""


def _one_to_json(one: Converted) -> dict[str, Any]:
    outcome = one.outcome
    told: dict[str, Any] = {
        "recording": one.recording,
        "robot": one.robot,
        "excursions": outcome.legs,
        "metres": round(outcome.way, 3),
        "samples": outcome.samples,
        "beams": one.beams,
        "records": dict(sorted(outcome.kinds.items())),
        "followed": outcome.followed,
        "turned_deg": round(outcome.turned_deg, 2),
        "readings_within_reach": outcome.readings,
        "strays_m": {
            "median": round(outcome.strays.median, 5),
            "worst": round(outcome.strays.worst, 5),
        },
        "counted": [
            {"what": what, "count": count.count, "first": count.first or None}
            for what, count in one.tally.counts.items()
        ],
    }
    if one.alignment is not None:
        told["orthogonal"] = {
            "axis_deg": round(math.degrees(one.alignment.axis), 3),
            "share_near_an_axis": round(one.alignment.share, 4),
            "wall_spread_deg": _degrees(one.alignment.spread),
            "steady_drift_deg_per_m": _degrees(one.alignment.drift),
            "walls": [
                {
                    "leg": wall.bearing.leg + 1,
                    "way_m": round(wall.bearing.way, 3),
                    "length_m": round(wall.bearing.length, 3),
                    "off_axis_deg": _degrees(wall.off),
                    "heading_error_deg": _degrees(
                        one.alignment.error_at(wall.bearing.leg, wall.bearing.way)
                    ),
                    "used": wall.used,
                }
                for wall in one.alignment.walls
            ],
        }
    return told


def _degrees(angle: float) -> float | None:
    return round(math.degrees(angle), 3) if math.isfinite(angle) else None


def report(found: Sequence[Converted], output: Path, verbose: bool) -> None:
    """Print what came of the recordings."""
    for one in found:
        outcome, name = one.outcome, printable(one.recording)
        kinds = ", ".join(
            plural(outcome.kinds[kind], kind)
            for kind in ("pose", "wall", "beam", "corner")
            if outcome.kinds.get(kind)
        )
        click.echo(
            f"{name}: {plural(outcome.samples, 'sample')}, {outcome.way:.1f} m, "
            f"{plural(one.beams, 'beam')} -> {plural(outcome.legs, 'excursion')} of "
            f"{printable(one.robot)}: {kinds}"
        )
        click.echo(
            f"  track      strays {outcome.strays.median * 1000:.0f} mm in the median, "
            f"{outcome.strays.worst * 1000:.0f} mm at worst; "
            f"turns {outcome.turned_deg:.0f} deg in all"
        )
        for what, count in one.tally.counts.items():
            first = f" (first: {printable(count.first)})" if count.first else ""
            click.echo(f"  counted    {count.count} {what}{first}")
        for doubt in _doubts(one):
            click.echo(f"possmap: {name}: {doubt}", err=True)
        if one.alignment is not None:
            _report_alignment(one, verbose)
            if one.alignment.is_doubtful:
                click.echo(
                    f"possmap: {name}: only {one.alignment.share:.0%} of its walls lie within "
                    "20 degrees of an axis, so the heading stays as it is: is the building one of "
                    "right angles, and the robot's drift given?",
                    err=True,
                )
    click.echo(f"{printable(str(output))}: written")


def _report_alignment(one: Converted, verbose: bool) -> None:
    told = one.alignment
    assert told is not None
    used = sum(wall.used for wall in told.walls)
    errors = [
        math.degrees(told.error_at(wall.bearing.leg, wall.bearing.way)) for wall in told.walls
    ]
    spread = _degrees(told.spread)
    click.echo(
        f"  orthogonal {used} of {len(told.walls)} long walls used, axes at "
        f"{math.degrees(told.axis):.1f} deg; heading was off by {min(errors):+.1f} to "
        f"{max(errors):+.1f} deg; one wall from the others "
        f"{'unknown' if spread is None else f'{spread:.1f} deg'}"
    )
    drift = math.degrees(told.drift)
    if abs(drift) >= STEADY_DEG_PER_M:
        click.echo(
            f"  drift      {drift:+.2f} deg/m of the heading's error is steady: add it to "
            "--set drift=..., and right angles tell the rest"
        )
    if verbose:
        for wall, error in zip(told.walls, errors, strict=True):
            click.echo(
                f"    leg {wall.bearing.leg + 1:3d} at {wall.bearing.way:7.2f} m: "
                f"{wall.bearing.length:5.2f} m, {math.degrees(wall.off):+6.1f} deg off the axis, "
                f"heading off {error:+6.1f} deg{'' if wall.used else ', not used'}"
            )


def _doubts(one: Converted) -> Iterator[str]:
    """Yield what makes one doubt that the beams were read as they should be."""
    outcome, echoes = one.outcome, one.tally.of(ECHOES)
    if one.beams and not outcome.readings:
        yield "no beam has a reading within reach, so the log is a track alone"
    elif 2 * echoes > outcome.readings:
        yield (
            f"{echoes} of {outcome.readings} readings were taken for the robot's own echo: if its "
            "walls are that near, give a smaller --echo"
        )

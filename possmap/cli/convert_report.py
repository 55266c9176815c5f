"""What ``possmap convert`` says of what it did, as text or JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from possmap.errors import plural, printable
from possmap.lab.convert.hits import ECHOES
from possmap.lab.convert.orthogonal import Alignment
from possmap.lab.convert.run import Converted
from possmap.lab.recordings.leaps import JUMPS

SLOWEST, FASTEST = 2e-3, 20.0
"""No robot drives slower or faster in the middle of its way [m/s]."""

ODD_AXIS_DEG = 2.0
"""Axes that are farther off those of the frame are told [deg]."""


def to_json(found: Sequence[Converted], output: Path) -> dict[str, Any]:
    """Return what came of the recordings as JSON holds it."""
    return {"output": str(output), "recordings": [_one_to_json(one) for one in found]}


def _one_to_json(one: Converted) -> dict[str, Any]:
    outcome = one.outcome
    told: dict[str, Any] = {
        "recording": one.recording.name,
        "robot": one.robot,
        "excursions": outcome.legs,
        "metres": round(outcome.way, 3),
        "samples": outcome.samples,
        "beams": len(one.recording.mounts),
        "beams_not_used_deg": [_degrees(angle) for angle in one.recording.unused],
        "median_speed": round(outcome.speed, 4) if math.isfinite(outcome.speed) else None,
        "records": dict(sorted(outcome.kinds.items())),
        "followed": outcome.followed,
        "turned_deg": round(outcome.turned_deg, 2),
        "readings_within_reach": outcome.readings,
        "strays_m": {
            "median": round(outcome.strays.median, 5),
            "worst": round(outcome.strays.worst, 5),
        },
        "notes": one.tally.notes,
        "counted": [
            {"what": what, "count": count.count, "first": count.first or None}
            for what, count in one.tally.counts.items()
        ],
    }
    if one.alignment is not None:
        name = "orthogonal" if one.settings.orthogonal else "axes"
        told[name] = _alignment_to_json(one.alignment)
    return told


def _alignment_to_json(told: Alignment) -> dict[str, Any]:
    return {
        "axis_deg": round(math.degrees(told.axis), 3),
        "share_near_an_axis": round(told.share, 4),
        "wall_spread_deg": _degrees(told.spread),
        "wall_lean_deg": _degrees(told.lean),
        "steady_drift_deg_per_m": _degrees(told.drift),
        "walls": [
            {
                "leg": wall.bearing.leg + 1,
                "way_m": round(wall.bearing.way, 3),
                "length_m": round(wall.bearing.length, 3),
                "off_axis_deg": _degrees(wall.off),
                "heading_error_deg": _degrees(told.error_at(wall.bearing.leg, wall.bearing.way)),
                "used": wall.used,
            }
            for wall in told.walls
        ],
    }


def _degrees(angle: float) -> float | None:
    return round(math.degrees(angle), 3) if math.isfinite(angle) else None


def report(found: Sequence[Converted], output: Path, verbose: bool) -> None:
    """Print what came of the recordings: the figures of the JSON, and what to doubt."""
    for one in found:
        told, name = _one_to_json(one), printable(one.recording.name)
        records, strays = told["records"], told["strays_m"]
        kinds = [
            plural(records[kind], kind)
            for kind in ("pose", "wall", "beam", "corner", "fix")
            if kind in records
        ]
        click.echo(
            f"{name}: {plural(told['samples'], 'sample')}, {one.outcome.way:.1f} m, "
            f"{plural(told['beams'], 'beam')} -> {plural(told['excursions'], 'excursion')} of "
            f"{printable(one.robot)}: {', '.join(kinds)}"
        )
        click.echo(
            f"  track      strays {strays['median'] * 1000:.0f} mm in the median, "
            f"{strays['worst'] * 1000:.0f} mm at worst; "
            f"turns {one.outcome.turned_deg:.0f} deg in all"
        )
        for note in told["notes"]:
            click.echo(f"  source     {printable(note)}")
        if one.recording.unused:
            angles = ", ".join(f"{angle:g}" for angle in told["beams_not_used_deg"])
            click.echo(f"  beams      not used: those at {angles} deg (--beams)")
        for entry in told["counted"]:
            first = f" (first: {printable(entry['first'])})" if entry["first"] else ""
            click.echo(f"  counted    {entry['count']} {entry['what']}{first}")
        if "orthogonal" in told:
            _report_alignment(told["orthogonal"], verbose)
        if "axes" in told and one.alignment is not None:
            _report_axes(one.alignment, one.settings.align)
        if one.alignment is not None and one.alignment.is_steady and _uses_axes(one):
            click.echo(
                f"  drift      {math.degrees(one.alignment.drift):+.2f} deg/m of the heading's "
                "error is steady: add it to --set drift=..., and right angles tell the rest"
            )
        for doubt in _doubts(one):
            click.echo(f"possmap: {name}: {doubt}", err=True)
    grid = printable(f"{output.name.partition('.')[0]}.possmap")
    click.echo(
        f"{printable(str(output))}: written; next: possmap fuse {printable(str(output))} -g {grid}"
    )


def _report_axes(found: Alignment, is_aligned: bool) -> None:
    """Say where the axes are, if they are not those of the log's frame."""
    told = _alignment_to_json(found)
    axis, walls, lean = told["axis_deg"], told["walls"], told["wall_lean_deg"]
    if not found.tells_axes or not (is_aligned or abs(axis) >= ODD_AXIS_DEG):
        return
    leaning = "" if lean is None else f", 95 % within {lean:.1f} deg of the others"
    advice = f"--align turns the frame onto them, or fuse --set axes={axis:.1f}"
    click.echo(
        f"  axes       {sum(wall['used'] for wall in walls)} of {len(walls)} long walls near "
        f"{axis:.1f} deg{leaning}: {'the frame is turned onto them' if is_aligned else advice}"
    )


def _report_alignment(told: dict[str, Any], verbose: bool) -> None:
    walls, spread = told["walls"], told["wall_spread_deg"]
    errors = [wall["heading_error_deg"] for wall in walls]
    click.echo(
        f"  orthogonal {sum(wall['used'] for wall in walls)} of {len(walls)} long walls used, "
        f"axes at {told['axis_deg']:.1f} deg; heading was off by {min(errors):+.1f} to "
        f"{max(errors):+.1f} deg; one wall from the others "
        f"{'unknown' if spread is None else f'{spread:.1f} deg'}"
    )
    for wall in walls if verbose else ():
        click.echo(
            f"    leg {wall['leg']:3d} at {wall['way_m']:7.2f} m: {wall['length_m']:5.2f} m, "
            f"{wall['off_axis_deg']:+6.1f} deg off the axis, heading off "
            f"{wall['heading_error_deg']:+6.1f} deg{'' if wall['used'] else ', not used'}"
        )


def _uses_axes(one: Converted) -> bool:
    """Whether somebody asked for the building's axes."""
    return one.settings.orthogonal or one.settings.align


def _doubts(one: Converted) -> Iterator[str]:
    """Yield what makes one doubt that the recording was read as it should be."""
    outcome, echoes = one.outcome, one.tally.of(ECHOES)
    if one.recording.mounts and not outcome.readings:
        yield "no beam has a reading within reach, so the log is a track alone"
    elif 2 * echoes > outcome.readings:
        yield (
            f"{echoes} of {outcome.readings} readings were taken for the robot's own echo: if its "
            "walls are that near, give a smaller --echo"
        )
    if not SLOWEST <= outcome.speed <= FASTEST and math.isfinite(outcome.speed):
        yield (
            f"its median speed is {outcome.speed:.3g} m/s, which no robot has: are the units of "
            "length, speed and time (units in the mapping) those of the recording?"
        )
    jumps = sum(count.count for what, count in one.tally.counts.items() if what in JUMPS)
    if jumps:
        yield (
            f"{plural(jumps, 'step')} no robot can make: --jump says what becomes of them, "
            "--max-speed which they are; counters that begin anew need ticks: {wrap: ...}"
        )
    if _uses_axes(one) and one.alignment is not None and one.alignment.is_doubtful:
        yield (
            f"only {one.alignment.share:.0%} of its walls lie within 20 degrees of an axis, so the "
            "heading stays as it is: is the building one of right angles, and the robot's drift "
            "given?"
        )

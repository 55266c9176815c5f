"""How far an excursion's records reach before its error silences them, and what of it is said."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from possmap.core.evidence import Findings
from possmap.core.observations import Observations
from possmap.core.records import PartialMap
from possmap.core.walls import MOST_OUTLIERS, SURPRISING
from possmap.errors import plural, printable
from possmap.grid.tiles import Undecided

FEW = 50
"""Of fewer records it is not asked whether ``max_error`` suits the site."""

AXES_DOUBTED = 4.0
"""Σ r/√V / √n of the walls seen; farther from 0 the building's axes are not what they are said
to be (METHOD §1)."""


class Reach(NamedTuple):
    """How many of an excursion's records the error leaves anything to say, and where they lie.

    records : that lie on the map. beyond : how many of them say nothing, their error being
    ``max_error`` or more. seq, t : of the first of these. box : x0, y0, x1, y1 of all [m].
    observations : of the heading.
    """

    records: int
    beyond: int
    seq: int | None
    t: float | None
    box: tuple[float, float, float, float]
    max_error: float
    observations: Observations

    @classmethod
    def of(cls, version: PartialMap, found: Findings) -> Reach:
        """Count the records of one excursion."""
        most, places = found.model.max_error, found.geometry.values()
        beyond = [
            number
            for number, (_, _, (half_x, half_y), _, _, (half_x2, half_y2), _) in (
                found.geometry.items()
            )
            if half_x >= most or half_y >= most or half_x2 >= most or half_y2 >= most
        ]
        first = version.records[min(beyond)] if beyond else None
        return cls(
            len(found.geometry),
            len(beyond),
            first.seq if first else None,
            first.t if first else None,
            (
                min((at.x for at in places), default=0.0),
                min((at.y for at in places), default=0.0),
                max((at.x for at in places), default=0.0),
                max((at.y for at in places), default=0.0),
            ),
            most,
            found.observations,
        )


def reach_line(
    reach: Mapping[tuple[str, str], Reach], undecided: Undecided | None = None
) -> Iterator[str]:
    """Yield what a user should know of the excursions that were laid out, if there are any: lines.

    undecided : the cells of the tiles that they touched.
    """
    if not reach:
        return
    records = sum(one.records for one in reach.values())
    beyond = {name: one for name, one in reach.items() if one.beyond}
    lost = sum(one.beyond for one in beyond.values())
    told = [f"{records - lost} of {plural(records, 'record')} on the map used"]
    told_by = [one.observations for one in reach.values()]
    used, vague = sum(one.used for one in told_by), sum(one.vague for one in told_by)
    outliers = sum(one.outliers for one in told_by)
    if used or vague or outliers:
        told += [
            f"heading told by {plural(used, 'observation')}, {vague} vague, "
            f"{plural(outliers, 'outlier')}"
        ]
    if undecided is not None and undecided.known:
        told += [f"{undecided.share:.1%} of {plural(undecided.known, 'cell')} contested"]
    yield "; ".join(told)
    if beyond:
        (robot, excursion), first = min(beyond.items(), key=lambda item: (-item[1].beyond, item[0]))
        others = plural(len(beyond) - 1, "other excursion") if len(beyond) > 1 else ""
        yield (
            f"{plural(lost, 'record')} {'says' if lost == 1 else 'say'} nothing, being as unsure "
            f"as max_error or more: {_where(robot, excursion, first)}"
            f"{f', and in {others}' if others else ''}; calibrate the robot, drive shorter "
            "excursions, or set max_error higher"
        )
    yield from _too_wide(reach)
    yield from _surprises(reach)
    if doubts_axes(reach):
        yield (
            f"the building's axes do not look right: the walls seen {_doubt(reach)}; the setting "
            "axes says where they are, and possmap check proposes it"
        )


def _surprises(reach: Mapping[tuple[str, str], Reach]) -> Iterator[str]:
    """Yield a line if a fix lies where the model does not let a robot be."""
    told = {name: one.observations for name, one in reach.items() if one.observations.surprising}
    if told:
        name = max(told, key=lambda name: (told[name].surprise, name))
        count = sum(one.surprising for one in told.values())
        yield (
            f"{plural(count, 'fix')} {'surprises' if count == 1 else 'surprise'} the error model, "
            f"and {'is' if count == 1 else 'are'} used all the same: "
            f"{printable(name[0])} {printable(name[1])} by "
            f"{told[name].surprise:.1f}{'' if len(told) == 1 else ' at most'}, where chance "
            f"exceeds {SURPRISING} once in a thousand times; is the fix that of another place, or "
            "the robot broken?"
        )


def doubts_axes(reach: Mapping[tuple[str, str], Reach]) -> bool:
    """Whether what walls told does not go together with the setting ``axes``."""
    seen = [one.observations for one in reach.values()]
    odd = sum(one.outliers - one.seen for one in seen) > MOST_OUTLIERS
    return odd or abs(_bias(reach)) > AXES_DOUBTED


def _doubt(reach: Mapping[tuple[str, str], Reach]) -> str:
    if abs(_bias(reach)) > AXES_DOUBTED:
        return f"lie to one side of them by {_bias(reach):+.1f} times what chance allows"
    return "contradict them more often than not"


def _bias(reach: Mapping[tuple[str, str], Reach]) -> float:
    """Return Σ r/√V / √n of the walls that all excursions saw."""
    seen = sum(one.observations.seen for one in reach.values())
    residuals = sum(one.observations.residuals for one in reach.values())
    return float(residuals / seen**0.5) if seen else 0.0


def _too_wide(reach: Mapping[tuple[str, str], Reach]) -> Iterator[str]:
    """Yield a line if ``max_error`` is more than half of what was driven."""
    if sum(one.records for one in reach.values()) < FEW:
        return
    boxes = [one.box for one in reach.values()]
    x0, y0, x1, y1 = (
        pick(box[at] for box in boxes) for at, pick in enumerate((min, min, max, max))
    )
    wide, most = max(x1 - x0, y1 - y0), max(one.max_error for one in reach.values())
    if most > wide / 2:
        yield (
            f"max_error {most:g} m is more than half of the site, {x1 - x0:.1f} by "
            f"{y1 - y0:.1f} m: what is as unsure tells no room from the next; set max_error to "
            f"{wide / 4:.1g} or so"
        )


def _where(robot: str, excursion: str, one: Reach) -> str:
    time = "" if one.t is None else f" (t {one.t:g} s)"
    return f"{printable(robot)} {printable(excursion)} from seq {one.seq}{time} on"

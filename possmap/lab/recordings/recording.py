"""A recording that is open: its beams, and its samples as a stream that can be read again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from possmap.lab.convert.samples import Mount, Samples
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.stream import Progress

CHUNK_ROWS = 4096
"""Rows read before they are looked at together."""


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording of one robot.

    Attributes
    ----------
    name
        For messages, and for the robot if it has no other name.
    mounts
        The beams, in the order of the samples' ranges.
    samples
        Reads the recording from its beginning: samples piece by piece. What is left out on the way
        is counted in the tally.
    size
        Of its files [bytes], as the progress counts them.
    """

    name: str
    mounts: tuple[Mount, ...]
    samples: Callable[[Tally, Progress | None], Iterator[Samples]]
    size: int


def left_out(problem: str, tally: Tally) -> str:
    """Return a problem with what was left out on the way behind it, which may explain it."""
    counts = [
        f"{one.count} {what} ({one.first})" if one.first else f"{one.count} {what}"
        for what, one in tally.counts.items()
    ]
    return "; ".join([problem, *counts])

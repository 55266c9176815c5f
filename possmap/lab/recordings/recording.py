"""A recording that is open: its beams, and its samples as a stream that can be read again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from possmap.lab.convert.samples import Mount, Samples
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings.leaps import Jump
from possmap.lab.recordings.stream import Progress

CHUNK_ROWS = 4096
"""Rows read before they are looked at together."""


@dataclass(frozen=True, slots=True)
class Handling:
    """What becomes of steps that no robot can make.

    max_speed : what is faster is one [m/s]; None: what stands out of the recording itself.
    sparse : whether rows are places far apart, most of them empty: then no step is one.
    """

    jump: Jump = "bridge"
    max_speed: float | None = None
    sparse: bool = False


BRIDGED = Handling()


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
    unused
        Where beams that it has besides look [rad].
    """

    name: str
    mounts: tuple[Mount, ...]
    samples: Callable[[Tally, Progress | None], Iterator[Samples]]
    size: int
    unused: tuple[float, ...] = ()

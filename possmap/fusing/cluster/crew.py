"""``possmap fuse --dask``: workers read, lay out and stamp, one committer writes (docs/cluster.md).

Plans stay with the workers that made them. For ranges of tiles, each worker stamps what it holds
into partial tiles; these are merged as a tree, in pairs, and into what the grid holds already. All
of it is integer sums and maxima, so the digest is that of one process (METHOD §3).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from typing import NamedTuple

from possmap.core.lattice import TileKey
from possmap.core.settings import EvidenceSettings
from possmap.errors import TileError, plural, printable
from possmap.fusing import inputs
from possmap.fusing.cluster import tasks
from possmap.fusing.cluster.client import Sent, Team, Work
from possmap.fusing.cluster.names import whole
from possmap.fusing.cluster.start import team
from possmap.fusing.crew import Batch, Crew, layout_tasks, read_tasks
from possmap.fusing.judge import Known
from possmap.fusing.stages import Elsewhere, LaidOut, Read, ReadTask, TileResult, read_logs
from possmap.grid.rows import ExcursionRows
from possmap.grid.tiles import TileStore

MOST_TILES = 16
"""Tiles of a range: a partial result of them takes at most 18 MiB."""

BLOCK = 4
"""Tiles along a side of a square whose tiles go together."""

FEWEST_TILES = 8
"""Tiles of a range, where there would otherwise be fewer ranges than hands."""

MOST_RANGES = 16
"""Ranges on their way at once: with the size of a range, what bounds workers' memory."""

_LAY_OUT, _STAMP, _MERGE, _FINISH = 10, 20, 30, 40  # what is nearer to the end comes first


@contextmanager
def cluster(address: str) -> Iterator[Crew]:
    """Let the workers of a cluster do the work of ``fuse``.

    Parameters
    ----------
    address
        Of the scheduler, ``tcp://host:port``; ``local`` or ``local:N`` starts one here.

    Raises
    ------
    MissingExtra, WorkerError
        As ``possmap.fusing.cluster.start.team``.
    """
    with team(address) as connected:
        yield _Cluster(connected)


class _Cluster:
    foresees = True

    def __init__(self, connected: Team) -> None:
        self._team = connected

    def read(self, names: Iterable[str], how: ReadTask) -> Iterator[Read]:
        for is_here, some in groupby(names, key=_is_here):
            if is_here:
                # Laid out by workers all the same, later.
                yield from read_logs(how._replace(names=tuple(some), foresee=None))
                continue
            works = (_reading(task) for task in read_tasks(some, how))
            for held, labels in self._team.labelled(works):
                for read, rows in labels:
                    foreseen = tuple(None if one is None else _kept(held, one) for one in rows)
                    yield read._replace(foreseen=foreseen)

    def batch(
        self, accepted: Sequence[Known], settings: EvidenceSettings, tiles: TileStore
    ) -> Batch:
        self._team.look()  # workers may have joined
        return _ClusterBatch(self._team, accepted, settings, tiles)


def _is_here(name: str) -> bool:
    """Whether only this process can read it."""
    return name == inputs.STDIN or inputs.is_grid(name)


def _reading(task: ReadTask) -> Work:
    names = tuple(whole(name) for name in task.names)
    far = tasks.FarTask(task._replace(names=names), task.names)
    return Work(_about(task.names), tasks.read_held, tasks.pack(far))


def _about(names: Sequence[str]) -> str:
    others = f" or one of {len(names) - 1} after it" if len(names) > 1 else ""
    return f"{printable(names[0])}{others}"


def _kept(held: Sent, rows: ExcursionRows) -> LaidOut:
    return LaidOut(rows, Elsewhere(held, tasks.hash_of(rows)))


class _Range(NamedTuple):
    """Tiles that are stamped together, and what is to be stamped: by worker, by what it holds."""

    keys: list[TileKey]
    by_worker: dict[str, dict[int, list[bytes]]]


def _in_blocks(key: TileKey) -> tuple[int, int, TileKey]:
    """Return what sorts neighbours together, so that few excursions touch a range."""
    return key.row // BLOCK, key.column // BLOCK, key


class _ClusterBatch:
    def __init__(
        self,
        connected: Team,
        accepted: Sequence[Known],
        settings: EvidenceSettings,
        tiles: TileStore,
    ) -> None:
        self._team, self._settings, self._tiles = connected, settings, tiles
        laid_out = list(self._lay_out(accepted))
        self._rows = [rows for rows, _ in laid_out]
        self._held: list[Sent] = []
        ranges = self._ranges(laid_out)
        self._count = sum(len(one.keys) for one in ranges)
        self._waiting = deque(ranges)
        self._sent: deque[Sent] = deque()
        self._send()  # workers stamp while the ledger is written

    def rows(self) -> Iterator[ExcursionRows]:
        yield from self._rows
        self._rows.clear()

    def tiles(self) -> tuple[int, Iterator[TileResult]]:
        return self._count, self._results()

    def _results(self) -> Iterator[TileResult]:
        while self._sent:
            try:
                packed = self._team.result(self._sent.popleft())
            except TileError as error:
                raise self._tiles.damaged(str(error)) from error
            self._send()
            results: list[TileResult] = tasks.unpack(packed)
            yield from results

    def _lay_out(self, accepted: Sequence[Known]) -> Iterator[LaidOut]:
        works = (
            Work(_about([" ".join(task.parcel.name) for task in chunk]), tasks.lay_out_held, data)
            for chunk in layout_tasks(accepted, self._settings)
            for data in [tasks.pack(chunk)]
        )
        made = (
            _kept(held, rows)
            for held, some in self._team.labelled(works, _LAY_OUT)
            for rows in some
        )
        for known in accepted:
            yield known.foreseen or next(made)

    def _ranges(self, laid_out: Sequence[LaidOut]) -> list[_Range]:
        """Cut the touched tiles into ranges, and say who has what to stamp into each."""
        touched = [{TileKey(*place[:2]) for place in rows.touched} for rows, _ in laid_out]
        keys = sorted(set().union(*touched), key=_in_blocks)
        size = min(MOST_TILES, max(FEWEST_TILES, -(-len(keys) // max(1, self._team.threads))))
        ranges = [_Range(keys[at : at + size], {}) for at in range(0, len(keys), size)]
        range_of = {key: one for one in ranges for key in one.keys}
        numbers: dict[str, int] = {}
        places: list[tuple[int, bytes]] = []
        for _, plan in laid_out:
            assert isinstance(plan, Elsewhere), "what a worker makes, it keeps"
            number = numbers.setdefault(plan.held.future.key, len(self._held))
            if number == len(self._held):
                self._held.append(plan.held)
            places.append((number, plan.digest))
        homes = self._team.homes(self._held)
        for (number, digest), some in zip(places, touched, strict=True):
            for first in {range_of[key].keys[0] for key in some}:
                chosen = range_of[first].by_worker.setdefault(homes[number], {})
                chosen.setdefault(number, []).append(digest)
        return ranges

    def _send(self) -> None:
        """Send ranges as long as few are on their way."""
        most = min(MOST_RANGES, self._team.in_flight)
        while self._waiting and len(self._sent) < most:
            self._sent.append(self._sent_range(self._waiting.popleft()))

    def _sent_range(self, one: _Range) -> Sent:
        first = one.keys[0]
        what = f"tile {first.row}, {first.column} and {plural(len(one.keys) - 1, 'other')}"
        partials = []
        for chosen in one.by_worker.values():
            task = tasks.StampTask(list(chosen.values()), one.keys, self._settings)
            work = Work(what, tasks.stamp_held, tasks.pack(task))
            held = [self._held[number] for number in chosen]
            partials.append(self._team.send(work, *held, priority=_STAMP))
        merge = Work(what, tasks.merge, b"")
        while len(partials) > 1:
            pairs = zip(partials[::2], partials[1::2], strict=False)
            merged = [self._team.send(merge, *pair, priority=_MERGE) for pair in pairs]
            partials = merged + partials[len(merged) * 2 :]
        stored = tasks.pack({key: self._tiles.packed(key) for key in one.keys})
        return self._team.send(Work(what, tasks.finish, stored), partials[0], priority=_FINISH)

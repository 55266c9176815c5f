"""What workers of a cluster do, and what they keep: plans and partial tiles (docs/cluster.md).

Nothing here needs dask. What goes in is packed, so that nobody on the way looks into it; what comes
back to the committer is packed too.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from possmap.core.evidence import Layer
from possmap.core.fusion import LayerArray, TileLayers, blank, fuse_tile, merged
from possmap.core.lattice import TileKey
from possmap.core.plan import ExcursionPlan, by_tile
from possmap.core.settings import EvidenceSettings, FreeFusion
from possmap.errors import WorkerError
from possmap.fusing.cluster.names import as_given
from possmap.fusing.stages import (
    LaidOut,
    LayoutTask,
    Read,
    ReadTask,
    TileResult,
    lay_out,
    read_logs,
)
from possmap.grid.encoding import EncodedTile, encode, unpacked
from possmap.grid.rows import ExcursionRows
from possmap.release import version

Bits: TypeAlias = NDArray[np.uint8]
Numbers: TypeAlias = NDArray[np.unsignedinteger]

_HASH = 5
"""Where in ``ExcursionRows.head`` the excursion's hash stands."""


class Label(NamedTuple):
    """What the committer learns of a log that was read: all but the plans, which stay.

    rows : of each delivery, what the ledger would write, if it was laid out.
    """

    read: Read
    rows: tuple[ExcursionRows | None, ...]


class FarTask(NamedTuple):
    """Logs to read, and what they are called by the user, and so in what is said of them.

    how : with names by which a worker finds them (``possmap.fusing.cluster.names``).
    """

    how: ReadTask
    given: tuple[str, ...]


class StampTask(NamedTuple):
    """What to stamp of what a worker holds.

    chosen : hashes of excursions, for each of the things held.
    keys : the tiles, and no others.
    """

    chosen: list[list[bytes]]
    keys: list[TileKey]
    settings: EvidenceSettings


class Held:
    """Plans that stay with the worker that made them, by the hash of their excursion.

    label : what the committer gets of them, packed.
    """

    def __init__(self, laid_out: list[LaidOut], label: object) -> None:
        self.plans = {hash_of(one.rows): one.plan for one in laid_out}
        self.label = pack(label)

    def __sizeof__(self) -> int:
        """Return bytes, by which dask decides what to move, and when a worker is full."""
        plans = [one for one in self.plans.values() if isinstance(one, ExcursionPlan)]
        tables = sum(one.segments.nbytes + one.pieces.nbytes + one.records.nbytes for one in plans)
        return len(self.label) + tables + sum(100 * len(one.clips) for one in plans)


class Partial:
    """Tiles made of some evidence alone; packed when it travels, and only then.

    On its way a layer is a bit for each cell, whether it is not 0, and the numbers that are not, in
    the narrowest type: three times as many bytes as ``encode`` makes, in a fifth of the time.
    """

    def __init__(self, tiles: dict[TileKey, TileLayers], free_fusion: FreeFusion) -> None:
        self.tiles, self.free_fusion = tiles, free_fusion

    def __sizeof__(self) -> int:
        """Return bytes."""
        return sum(array.nbytes for layers in self.tiles.values() for array in layers.values())

    def __getstate__(self) -> tuple[FreeFusion, list[tuple[TileKey, Layer, Bits, Numbers]]]:
        return self.free_fusion, [
            (key, layer, *_told(array))
            for key, layers in self.tiles.items()
            for layer, array in layers.items()
        ]

    def __setstate__(
        self, state: tuple[FreeFusion, list[tuple[TileKey, Layer, Bits, Numbers]]]
    ) -> None:
        self.free_fusion, packed = state
        self.tiles = {}
        for key, layer, bits, numbers in packed:
            whole = blank(layer)
            whole[np.unpackbits(bits).reshape(whole.shape).astype(bool)] = numbers
            self.tiles.setdefault(key, {})[layer] = whole


def _told(array: LayerArray) -> tuple[Bits, Numbers]:
    told = array != 0
    numbers = array[told]
    return np.packbits(told), numbers.astype(np.min_scalar_type(int(numbers.max(initial=0))))


def pack(value: object) -> bytes:
    """Return bytes to send."""
    return pickle.dumps(value, pickle.HIGHEST_PROTOCOL)


def unpack(data: bytes) -> Any:
    """Return what was sent, by nobody but another process of the same ``fuse``."""
    return pickle.loads(data)


def hash_of(rows: ExcursionRows) -> bytes:
    """Return the hash of an excursion, of its rows."""
    digest = rows.head[_HASH]
    assert isinstance(digest, bytes)
    return digest


_here = cache(version)


def run_as(expected: str, function: Callable[..., Any], *args: Any) -> Any:
    """Run a task, unless this worker is of another version: a worker may join at any time.

    Raises
    ------
    WorkerError
        If it is.
    """
    if _here() != expected:
        raise WorkerError(f"a worker has possmap {_here()}, and this process has {expected}")
    return function(*args)


def read_held(task: bytes) -> Held:
    """Read logs, and keep their plans. ``task`` : a FarTask."""
    how, given = unpack(task)
    reads = [as_given(read, name) for read, name in zip(read_logs(how), given, strict=True)]
    laid_out = [one for read in reads for one in read.foreseen if one is not None]
    labels = [
        Label(
            read._replace(foreseen=()),
            tuple(None if one is None else one.rows for one in read.foreseen),
        )
        for read in reads
    ]
    return Held(laid_out, labels)


def lay_out_held(task: bytes) -> Held:
    """Lay out excursions, and keep their plans. ``task`` : a list of LayoutTask."""
    tasks: list[LayoutTask] = unpack(task)
    laid_out = lay_out(tasks)
    return Held(laid_out, [one.rows for one in laid_out])


def label_of(held: Held) -> bytes:
    """Return what the committer gets: a list of Label, or of ExcursionRows."""
    return held.label


def stamp_held(task: bytes, *held: Held) -> Partial:
    """Stamp what is held, and within some tiles only. ``task`` : a StampTask.

    Raises
    ------
    WorkerError
        If a worker died, and what it read has changed by the time another reads it.
    """
    chosen, keys, settings = unpack(task)
    plans: list[ExcursionPlan] = []
    for one, digests in zip(held, chosen, strict=True):
        for digest in digests:
            plan = one.plans.get(digest)
            if not isinstance(plan, ExcursionPlan):
                raise WorkerError("a log changed while it was fused")
            plans.append(plan.among(keys))
    _, works = by_tile(plans)
    return Partial(
        {work.key: fuse_tile(work, {}, settings) for work in works}, settings.free_fusion
    )


def merge(one: Partial, other: Partial) -> Partial:
    """Return what two partial results say together; neither is changed."""
    tiles = dict(one.tiles)
    for key, layers in other.tiles.items():
        tiles[key] = merged(tiles.get(key, {}), layers, one.free_fusion)
    return Partial(tiles, one.free_fusion)


def finish(task: bytes, partial: Partial) -> bytes:
    """Merge what is new into what the grid holds. ``task`` : those tiles, as they are stored.

    Returns
    -------
    bytes
        A list of TileResult.

    Raises
    ------
    TileError
        If a stored tile is damaged.
    """
    stored: Mapping[TileKey, Mapping[Layer, EncodedTile]] = unpack(task)
    found: list[TileResult] = []
    for key, layers in sorted(partial.tiles.items()):
        held = unpacked(key, stored.get(key, {}))
        known = {layer: held[layer] for layer in layers if layer in held}
        whole = merged(known, layers, partial.free_fusion)
        packed = {layer: encode(layer, key, array) for layer, array in whole.items()}
        found.append(TileResult(key, packed))
    return pack(found)

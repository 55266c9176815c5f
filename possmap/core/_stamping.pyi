from typing import Any, TypeAlias

from numpy.typing import NDArray

Buffer: TypeAlias = NDArray[Any]

def raise_(
    block: Buffer,
    row0: int,
    column0: int,
    rows: int,
    columns: int,
    segments: Buffer,
    pieces: Buffer,
    lines: Buffer,
    starts: Buffer,
    knots: Buffer,
    resolution: float,
) -> None: ...
def reinforce(
    weights: Buffer,
    row0: int,
    column0: int,
    rows: int,
    columns: int,
    segments: Buffer,
    pieces: Buffer,
    lines: Buffer,
    starts: Buffer,
    knots: Buffer,
    table: Buffer,
    resolution: float,
) -> None: ...
def touch(segments: Buffer, resolution: float) -> bytes: ...

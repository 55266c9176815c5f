"""What ``possmap diff`` finds, as values to read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from possmap.grid.ledger import Entry
from possmap.settings.setting_table import Value


@dataclass(frozen=True, slots=True)
class ExcursionDiff:
    """An excursion that both grids know, but not the same of it.

    records : how many, in A and in B.
    model : the parameters in force that differ, in A and in B.
    """

    robot: str
    excursion: str
    records: tuple[int, int]
    model: dict[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Excursions:
    """Whose excursions the grids hold.

    equal : how many are the same in both.
    records : of all excursions, in A and in B.
    """

    only_a: tuple[Entry, ...]
    only_b: tuple[Entry, ...]
    changed: tuple[ExcursionDiff, ...]
    equal: int
    records: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Change:
    """A cell that changed.

    x, y : its centre [m].
    quantity : one of QUANTITIES.
    a, b : its value in each grid.
    """

    x: float
    y: float
    quantity: str
    a: float
    b: float


@dataclass(frozen=True, slots=True)
class Cells:
    """How cells changed.

    in_a, in_b, in_both, in_either : how many are not pure ignorance there.
    beyond : quantity -> how many changed by more than each of ``THRESHOLDS``.
    mean : quantity -> the mean change, without sign, over the cells known in either.
    became_contradicted, ceased_contradicted : cells with N > Π in B only, in A only.
    largest : the largest changes, the largest first.
    """

    in_a: int
    in_b: int
    in_both: int
    in_either: int
    beyond: dict[str, tuple[int, ...]]
    mean: dict[str, float]
    became_contradicted: int
    ceased_contradicted: int
    largest: tuple[Change, ...]


@dataclass(frozen=True, slots=True)
class DiffSummary:
    """In what two grids differ.

    settings : those that differ; None where a grid has none of that name.
    cells : None if the digests are equal, for then no cell differs.
    picture : width and height of what was drawn [pixels].
    """

    a: Path
    b: Path
    digest_a: str
    digest_b: str
    settings: dict[str, tuple[Value | None, Value | None]]
    excursions: Excursions
    cells: Cells | None
    picture: tuple[int, int] | None = None

    @property
    def equal(self) -> bool:
        """Whether both hold the same evidence."""
        return self.digest_a == self.digest_b

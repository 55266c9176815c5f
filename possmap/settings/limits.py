"""How much of the machine one input may take; hostile and broken logs exist (docs/logs.md)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from possmap.core.ranges import PROBABILITY, Count, Positive

BaseRate: TypeAlias = Annotated[float, PROBABILITY, "probability of a wall where nothing is known"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Bounds of one call; they do not belong to a grid.

    Objects and lists bound the memory of reading, since records are objects; cells of work
    (``fusing.layout``) of one log in all are not those of a grid's ledger.
    """

    limit_file_mib: Annotated[Positive, "largest log, decompressed [MiB]"] = 64.0
    limit_nesting: Annotated[Count, "deepest nesting of a log's JSON"] = 16
    limit_file_objects: Annotated[Count, "most objects and lists in a log's JSON"] = 2_000_000
    limit_file_excursions: Annotated[Count, "most excursions that one log may hold"] = 100_000
    limit_record_cells: Annotated[Count, "most cells of work of one record"] = 50_000_000_000
    limit_file_cells: Annotated[Count, "most cells of work of one log"] = 300_000_000_000
    transaction_records: Annotated[Count, "records read between two commits"] = 20_000

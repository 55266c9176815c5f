"""How much of the machine one input may take; hostile and broken logs exist (docs/logs.md)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Bounds of one call; they do not belong to a grid.

    limit_file_mib : size of one log, decompressed [MiB].
    limit_nesting : how deep the JSON of a log may be nested.
    limit_file_objects : objects and lists that the JSON of a log may hold; records are objects.
    limit_file_excursions : how many a log may hold, carried ones among them.
    limit_record_cells : cells of work (``core.work``) that one record may take.
    limit_file_cells : the same, of the records of one log in all; not of a grid's ledger.
    transaction_records : after so many records read, what was fused is committed.
    """

    limit_file_mib: float = 64.0
    limit_nesting: int = 16
    limit_file_objects: int = 2_000_000
    limit_file_excursions: int = 100_000
    limit_record_cells: int = 100_000_000
    limit_file_cells: int = 10_000_000_000
    transaction_records: int = 20_000

"""Meetings: who hears whom, and what they hand over; always beginnings, never gaps (METHOD §5)."""

from __future__ import annotations

from possmap.lab.simulate.logbook import RECORD_BYTES, Held, Logbook, Name


def exchange(one: Logbook, other: Logbook, budget_bytes: int, memory_bytes: int) -> tuple[int, int]:
    """Let two robots hand over what the other lacks, until the time they stop for is used up.

    Parameters
    ----------
    budget_bytes
        What the link carries in that time, for both together.
    memory_bytes
        What each can hold.

    Returns
    -------
    tuple
        Records that ``one`` gave, and that it took.
    """
    records = budget_bytes // RECORD_BYTES
    # Half the time each; what one does not need, the other may use.
    given = _hand_over(one, other, records // 2, memory_bytes)
    taken = _hand_over(other, one, records - given, memory_bytes)
    given += _hand_over(one, other, records - given - taken, memory_bytes)
    return given, taken


def _hand_over(giver: Logbook, taker: Logbook, most: int, memory_bytes: int) -> int:
    """Hand over own records first, then relayed excursions, each from the first that is lacking."""
    most = min(most, max(0, memory_bytes - taker.bytes) // RECORD_BYTES)
    handed = 0
    for name, held in [(giver.name, giver.own), *sorted(giver.relayed.items())]:
        if handed == most:
            break
        if name != taker.name:
            handed += _top_up(taker.relayed, name, held, most - handed)
    return handed


def _top_up(relayed: dict[Name, Held], name: Name, held: Held, most: int) -> int:
    known = relayed.get(name)
    have = len(known.records) if known else 0
    news = held.records[have : have + most]
    if news:
        if known is None:
            known = relayed[name] = Held(held.model)
        known.records += news
    return len(news)


def seconds_of(records: int, rate: float) -> float:
    """Return how long the transfer of so many records takes [s], at a rate in bytes per second."""
    return records * RECORD_BYTES / rate

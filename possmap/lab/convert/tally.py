"""What was left out on the way: counted, with the place where it happened first."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Count:
    """How often something happened, and where first (empty where no place is to name)."""

    count: int
    first: str


class Tally:
    """Counts what a conversion skipped, replaced or dropped; silence would be repair.

    counts : by what it was. notes : what is no count.
    """

    def __init__(self) -> None:
        self.counts: dict[str, Count] = {}
        self.notes: list[str] = []

    def add(self, what: str, place: str = "", count: int = 1) -> None:
        """Count ``what``, a phrase that goes behind a number: ``lines cut short, skipped``."""
        if count <= 0:
            return
        held = self.counts.get(what)
        if held is None:
            self.counts[what] = Count(count, place)
        else:
            held.count += count

    def note(self, what: str) -> None:
        """Keep what a user should know of how a recording was read: what was guessed or found."""
        if what not in self.notes:
            self.notes.append(what)

    def explanation(self) -> str:
        """Return what was left out on the way, which may explain a problem said before it."""
        counts = (
            f"; {one.count} {what}" + f" ({one.first})" * bool(one.first)
            for what, one in self.counts.items()
        )
        return "".join(counts)

    def of(self, what: str) -> int:
        """Return how often something happened."""
        held = self.counts.get(what)
        return held.count if held else 0

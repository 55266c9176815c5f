"""How a long job tells how far it is, without knowing who looks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, TypeVar

T = TypeVar("T")


class Progress(Protocol):
    """Wraps what a job goes through, to show how far it is."""

    def __call__(self, items: Iterable[T], unit: str, total: int | None = None) -> Iterable[T]:
        """Return the items, one by one.

        unit : says what they are; total : how many, where they do not know it themselves.
        """


def quiet(items: Iterable[T], unit: str, total: int | None = None) -> Iterable[T]:
    """Show nothing."""
    return items

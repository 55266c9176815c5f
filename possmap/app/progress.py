"""How a long job tells how far it is, without knowing who looks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol, TypeVar

T = TypeVar("T")


class Progress(Protocol):
    """Wraps what a job goes through, to show how far it is."""

    def __call__(self, items: Sequence[T], unit: str) -> Iterable[T]:
        """Return the items, one by one; ``unit`` says what they are."""


def quiet(items: Sequence[T], unit: str) -> Iterable[T]:
    """Show nothing."""
    return items

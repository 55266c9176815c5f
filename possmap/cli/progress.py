"""The progress bar: on a terminal only, on stderr, outside the work that it shows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeVar

T = TypeVar("T")


def bar(items: Sequence[T], unit: str) -> Iterable[T]:
    """Return the items one by one, and show how far it is."""
    from tqdm import tqdm

    shown: Iterable[T] = tqdm(items, unit=unit, disable=None, leave=False)
    return shown

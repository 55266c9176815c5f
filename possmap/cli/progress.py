"""The progress bar: on a terminal only, on stderr, outside the work that it shows."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")


def bar(items: Iterable[T], unit: str, total: int | None = None) -> Iterable[T]:
    """Return the items one by one, and show how far it is."""
    if sys.stderr is None or not sys.stderr.isatty():
        return items  # nothing to show, and tqdm takes 18 ms to import
    from tqdm import tqdm

    shown: Iterable[T] = tqdm(items, unit=unit, total=total, disable=None, leave=False)
    return shown


@contextmanager
def clock() -> Iterator[Callable[[float, float], None]]:
    """Show simulated time: yields what is told the seconds gone, and how many there are."""
    from tqdm import tqdm

    with tqdm(unit="s", disable=None, leave=False) as shown:

        def tell(gone: float, whole: float) -> None:
            if gone - shown.n >= 1:
                shown.total = max(round(whole), round(gone))
                shown.update(round(gone - shown.n))

        yield tell


@contextmanager
def bytes_read(size: int, what: str) -> Iterator[Callable[[int], None]]:
    """Show how much of a file is read: yields what is told the bytes read since."""
    from tqdm import tqdm

    with tqdm(total=size, unit="B", unit_scale=True, desc=what, disable=None, leave=False) as shown:

        def tell(count: int) -> None:
            shown.update(count)

        yield tell

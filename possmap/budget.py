"""How much memory a command may take, and what that means for each of its parts (``--memory``)."""

from __future__ import annotations

import gc
from dataclasses import dataclass

from possmap.errors import BudgetError, printable

LEAST_MIB = 128
DEFAULT_MIB = 1024

_START_MIB = 56
"""What the interpreter, numpy, Pillow and SQLite take before anything is read."""
_RECORD_BYTES = 2600
"""A record parsed, laid out and planned."""
_TEXT_BYTES = 40
"""A byte of a log's text, parsed, laid out and planned: records take 65 bytes and more."""
_AHEAD_BYTES = 1 << 25
"""More is not read ahead: it is what 170 logs of a kilometre take; 33 make a transaction."""


@dataclass(frozen=True, slots=True)
class Budget:
    """A bound on a command's memory.

    mib : of the whole process, the interpreter included [MiB].

    Raises
    ------
    ValueError
        If it is less than any command needs.
    """

    mib: int = DEFAULT_MIB

    def __post_init__(self) -> None:
        if self.mib < LEAST_MIB:
            raise ValueError(f"found {self.mib}, expected at least {LEAST_MIB} MiB")

    @property
    def spare(self) -> int:
        """What is left once the program has started [bytes]."""
        return (self.mib - _START_MIB) << 20

    @property
    def cache_kib(self) -> int:
        """SQLite's cache of a grid; more than 64 MiB is of no use [KiB]."""
        return min(1 << 16, self.spare // 4 >> 10)

    @property
    def held(self) -> int:
        """What a command may hold from its beginning to its end: a result, a picture [bytes]."""
        return self.spare * 3 // 4

    @property
    def batch_records(self) -> int:
        """Records that may be read before they are committed."""
        return self.spare // 3 // _RECORD_BYTES

    @property
    def ahead(self) -> int:
        """What other processes may have read and laid out before it is asked for [bytes]."""
        return min(self.spare // 12, _AHEAD_BYTES)

    @property
    def log_bytes(self) -> int:
        """Text of one log that may be read [bytes]."""
        return self.spare // _TEXT_BYTES

    def check_log(self, name: str, size: int) -> None:
        """Refuse a log of so many bytes that it would not fit, before it is read.

        Raises
        ------
        BudgetError
            If it is larger than ``log_bytes``.
        """
        if size > self.log_bytes:
            needed = _START_MIB + -(-size * _TEXT_BYTES >> 20)
            raise BudgetError(
                f"{printable(name)}: a log of {size / 2**20:.1f} MiB needs --memory {needed}, "
                f"found {self.mib}"
            )

    def check_together(self, records: int) -> None:
        """Refuse so many records in one transaction that they would not fit.

        Raises
        ------
        BudgetError
            If they are more than can be laid out at once.
        """
        if records * _RECORD_BYTES > self.spare:
            needed = _START_MIB + -(-records * _RECORD_BYTES >> 20)
            raise BudgetError(
                f"--strict keeps all logs in memory: {records} records need --memory {needed}, "
                f"found {self.mib}"
            )

    def check_held(self, what: str, size: int, instead: str = "") -> None:
        """Refuse what would not fit.

        Parameters
        ----------
        what
            What is asked for, as a message begins.
        size
            What it takes [bytes].
        instead
            What else can be done, in the imperative.

        Raises
        ------
        BudgetError
            If it is more than ``held``.
        """
        if size > self.held:
            needs = f"{what} needs --memory {self.needed_for(size)}, found {self.mib}"
            raise BudgetError(f"{needs}; or {instead}" if instead else needs)

    def fewest(self, most: int, each: int) -> tuple[int, str]:
        """Return how many things of so many bytes may be held, ``most`` at best.

        With it what a message says of it, up to what else can be done.
        """
        fitting = self.held // each
        if fitting < most:
            return fitting, f"expected fewer with --memory {self.mib}; give more, or "
        return most, "expected fewer; "

    def needed_for(self, size: int) -> int:
        """Return the least budget [MiB] in which so many bytes can be held."""
        return _START_MIB + -(-4 * size // 3 >> 20)


def collect_seldom() -> None:
    """Let Python seldom look for cycles: records are many, and none of them is in one.

    That is a fourteenth of the time of a batch, and a tenth of that of ``possmap refine``.
    """
    gc.set_threshold(100_000, 50, 100)

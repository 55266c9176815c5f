"""Valid files with a few places changed: read, or refused in one line, whatever the change."""

from __future__ import annotations

import random
import tempfile
from functools import cache
from pathlib import Path

import pytest
from fuzz.mutation import mutated
from fuzz.readers import READERS, Reader
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from possmap.errors import PossmapError

SLOW = ("bag", "db3", "mcap", "grid", "mission")


@cache
def seeds_of(name: str) -> tuple[bytes, ...]:
    return tuple(READERS[name].seeds())


def told(reader: Reader, path: Path) -> str:
    """Return how a file is refused; empty if it is not."""
    try:
        reader.read(path)
    except PossmapError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("name", READERS)
def test_what_the_mutations_begin_with_is_sound(tmp_path: Path, name: str) -> None:
    for number, seed in enumerate(seeds_of(name)):
        path = tmp_path / f"{number}{READERS[name].suffix}"
        path.write_bytes(seed)
        READERS[name].read(path)


@pytest.mark.parametrize("name", READERS)
def test_a_changed_file_is_read_or_refused_in_one_line(name: str) -> None:
    reader = READERS[name]
    seeds = seeds_of(name)

    @settings(
        max_examples=10 if name in SLOW else 60,
        deadline=None,
        database=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(seed=st.integers(0, len(seeds) - 1), change=st.integers(0, 2**32))
    def check(seed: int, change: int) -> None:
        data = mutated(seeds[seed], random.Random(change), reader.words)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"input{reader.suffix}"
            path.write_bytes(data)
            assert told(reader, path).isprintable()

    check()

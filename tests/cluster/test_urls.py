"""Logs at URLs: read by whatever fsspec knows, refused like files, and never beyond the limit."""

from __future__ import annotations

import gzip
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from literal.teams import random_excursion
from teams import digest

from possmap.cli.main import main
from possmap.errors import MissingExtra
from possmap.fusing import urls
from possmap.settings.limits import Limits

fsspec = pytest.importorskip("fsspec")


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False)


def log(robot: str = "r1") -> bytes:
    rng = np.random.default_rng(3)
    return json.dumps({"possmap_log": 1, **random_excursion(rng, robot, "a")}).encode()


@pytest.fixture
def store() -> Iterator[Any]:
    """Return a store in memory, empty."""
    found = fsspec.filesystem("memory")
    found.store.clear()
    yield found
    found.store.clear()


def test_a_log_in_a_store_is_fused_as_a_file_is(store: Any, tmp_path: Path) -> None:
    store.pipe("/day/a.json", log())
    store.pipe("/day/b.json.gz", gzip.compress(log("r2")))
    for name, robot in (("a", "r1"), ("b", "r2")):
        (tmp_path / f"{name}.json").write_bytes(log(robot))
    here, there, folder = (tmp_path / f"{name}.possmap" for name in "xyz")
    run("fuse", tmp_path / "a.json", tmp_path / "b.json", "-g", here)
    result = run("fuse", "memory://day/a.json", "memory://day/b.json.gz", "-g", there)
    assert (result.exit_code, result.stderr) == (0, "")
    store.pipe("/day/readme.txt", b"no log")
    result = run("fuse", "memory://day", "-g", folder)
    assert (result.exit_code, result.stderr) == (0, "")
    assert digest(there) == digest(folder) == digest(here)


@pytest.mark.parametrize(
    ("url", "problem"),
    [
        ("memory://gone.json", "cannot be read: "),
        ("memory://empty", "the folder holds no logs, expected files of .json, "),
        ("memory://log.txt", "unknown suffix, expected one of .json, "),
        ("nowhere://a/b.json", "cannot be read: Protocol not known: nowhere"),
        ("memory://other.possmap", "unknown suffix, expected one of .json, "),
        ("memory://bad.json", "expected "),
    ],
)
def test_a_url_that_gives_no_log_is_refused(
    url: str, problem: str, store: Any, tmp_path: Path
) -> None:
    store.makedirs("/empty", exist_ok=True)
    store.pipe({"/log.txt": log(), "/other.possmap": log(), "/bad.json": b"[]"})
    good, grid = tmp_path / "a.json", tmp_path / "site.possmap"
    good.write_bytes(log())
    result = run("fuse", url, good, "-g", grid)
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert result.stderr.startswith(f"possmap: {url}") and problem in result.stderr
    assert "fused 1 log " in result.stdout and "1 refused" in result.stdout


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    result = run("fuse", f"file://{tmp_path}/pipe.json", "-g", tmp_path / "site.possmap")
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert "not a regular file" in result.stderr


class Counting:
    """A stream that counts what is read of it."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.count = 0

    def read(self, size: int = -1) -> bytes:
        """Read on."""
        data: bytes = self._stream.read(size)
        self.count += len(data)
        return data

    def __enter__(self) -> Counting:
        return self

    def __exit__(self, *_: object) -> None:
        pass


@pytest.mark.parametrize("is_told", [True, False])
@pytest.mark.parametrize("suffix", [".json", ".json.gz"])
def test_of_a_large_log_no_more_is_read_than_the_limit(
    suffix: str, is_told: bool, store: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = os.urandom(1 << 22) if suffix == ".json" else gzip.compress(os.urandom(1 << 22), 0)
    store.pipe(f"/large{suffix}", content)
    streams: list[Counting] = []
    info, opened = type(store).info, type(store).open

    def told(self: Any, path: str, **more: Any) -> dict[str, Any]:
        return {**info(self, path, **more), **({} if is_told else {"size": None})}

    def counting(*args: Any, **more: Any) -> Counting:
        streams.append(Counting(opened(*args, **more)))
        return streams[-1]

    monkeypatch.setattr(type(store), "info", told)
    monkeypatch.setattr(type(store), "open", counting)
    limit = "--set=limit_file_mib=0.25"
    result = run("fuse", f"memory://large{suffix}", "-g", tmp_path / "site.possmap", limit)
    assert result.exit_code == 1
    assert "larger than 0.25 MiB" in result.stderr
    assert "(setting limit_file_mib)" in result.stderr
    assert sum(one.count for one in streams) <= 0.25 * 2**20 + 2**17


def test_a_name_in_a_url_may_be_followed_by_what_the_server_asks_for() -> None:
    assert urls._path_of("https://host/day/a.json.gz?key=1") == "/day/a.json.gz"
    assert urls._path_of("/bucket/a?.json") == "/bucket/a?.json"


def test_without_the_extra_the_command_that_brings_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "fsspec", None)
    result = run("fuse", "s3://bucket/a.json", "-g", tmp_path / "site.possmap")
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert "needs the extra cluster: pip install 'possmap[cluster]'" in result.stderr
    with pytest.raises(MissingExtra):
        urls.read("s3://bucket/a.json", Limits(), False)

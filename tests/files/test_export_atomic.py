"""Files that belong together appear both or neither, and what was there before comes back."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from possmap.atomic import replacing_all
from possmap.errors import OutputError


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def write(one: Path, two: Path, overwrite: bool = False) -> None:
    with replacing_all((one, two), overwrite) as (first, second):
        first.write(b"new one")
        second.write(b"new two")


def test_both_appear(tmp_path: Path) -> None:
    write(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == b"new one"
    assert (tmp_path / "b").read_bytes() == b"new two"
    assert names(tmp_path) == ["a", "b"]


def test_an_error_while_writing_leaves_neither(tmp_path: Path) -> None:
    def half() -> None:
        with replacing_all((tmp_path / "a", tmp_path / "b"), False) as (first, _):
            first.write(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        half()
    assert names(tmp_path) == []


@pytest.mark.parametrize("there", ["a", "b"])
def test_one_that_exists_keeps_both_from_being_written(there: str, tmp_path: Path) -> None:
    (tmp_path / there).write_bytes(b"old")
    with pytest.raises(OutputError, match=f"{there}: exists already"):
        write(tmp_path / "a", tmp_path / "b")
    assert names(tmp_path) == [there]
    assert (tmp_path / there).read_bytes() == b"old"


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("before", [["a", "b"], ["a"], ["b"], []])
@pytest.mark.parametrize("failing", [1, 2])
def test_a_name_that_cannot_be_given_brings_back_what_was_there(
    before: list[str], failing: int, links: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in before:
        (tmp_path / name).write_bytes(b"old " + name.encode())
    calls = []
    replace = Path.replace

    def fails_once(self: Path, target: Path) -> Path:
        calls.append(target)
        if len(calls) == failing:
            raise OSError(5, "Input/output error")
        return replace(self, target)

    def no_links(*_: object) -> None:
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "replace", fails_once)
    if not links:
        monkeypatch.setattr(os, "link", no_links)
    with pytest.raises(OutputError, match=r"a and .*b: cannot be written: Input/output error"):
        write(tmp_path / "a", tmp_path / "b", overwrite=True)
    assert len(calls) >= failing
    assert names(tmp_path) == before
    for name in before:
        assert (tmp_path / name).read_bytes() == b"old " + name.encode()


def test_both_are_replaced_and_nothing_is_left_beside(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).write_bytes(b"old")
    write(tmp_path / "a", tmp_path / "b", overwrite=True)
    assert [(tmp_path / name).read_bytes() for name in names(tmp_path)] == [b"new one", b"new two"]


def test_two_names_of_one_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(OutputError, match="lead to one file, expected 2"):
        write(tmp_path / "a", tmp_path / "b")
    assert names(tmp_path) == ["b"]


def test_a_link_to_nowhere_is_followed_and_one_to_itself_refused(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("real")
    write(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "a").is_symlink() and (tmp_path / "real").read_bytes() == b"new one"
    (tmp_path / "c").symlink_to("c")
    with pytest.raises(OutputError, match="c: "):
        write(tmp_path / "d", tmp_path / "c")
    assert names(tmp_path) == ["a", "b", "c", "real"]

"""What lies beside a grid is looked at before SQLite, which would delete, hang or follow links."""

from __future__ import annotations

import errno
import os
import shutil
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from possmap.cli.main import main
from possmap.errors import GridError
from possmap.grid import database
from possmap.grid.grid import Grid

DATA = Path(__file__).parents[2] / "data" / "json"
MAGIC = bytes.fromhex("d9d505f920a163d7")
SECTOR = 512


def run(*args: str) -> Result:
    return CliRunner().invoke(main, list(args), prog_name="possmap")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    grid = tmp_path_factory.mktemp("sound") / "site.possmap"
    assert run("-q", "fuse", str(DATA), "-g", str(grid)).exit_code == 0
    return grid


@pytest.fixture
def grid(sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copy(sound, "site.possmap"))


COMMANDS = (
    ["info", "site.possmap"],
    ["query", "site.possmap", "0", "0"],
    ["verify", "site.possmap"],
    ["repair", "site.possmap", "-o", "new.possmap"],
    ["forget", "site.possmap", "--robot", "r3"],
    ["fuse", str(DATA), "-g", "site.possmap"],
)


def journal_with_a_name(grid: Path, name: bytes, checksum: int) -> bytes:
    """Return a hot journal that changes nothing, and ends in the name of another file."""
    data = grid.read_bytes()
    (size,) = struct.unpack_from(">H", data, 16)
    head = MAGIC + struct.pack(">5I", 1, 0, len(data) // size, SECTOR, size)
    page = data[size : 2 * size]
    sum_of_page = sum(page[size - 200 : 0 : -200])
    ending = struct.pack(">I", 0x40000000 // size + 1) + name
    ending += struct.pack(">II", len(name), checksum) + MAGIC
    return (
        head.ljust(SECTOR, b"\0")
        + struct.pack(">I", 2) + page + struct.pack(">I", sum_of_page)
        + ending
    )  # fmt: skip


def test_sqlite_itself_deletes_what_a_journal_names(grid: Path) -> None:
    mine = Path("mine.txt").absolute()
    mine.write_text("years of work")
    name = str(mine).encode()
    Path("site.possmap-journal").write_bytes(journal_with_a_name(grid, name, sum(name)))
    connection = sqlite3.connect(grid)
    connection.execute("SELECT count(*) FROM tile")
    connection.close()
    assert not mine.exists(), "else the next test shows nothing"


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
def test_no_file_is_deleted_because_a_journal_names_it(command: list[str], grid: Path) -> None:
    mine = Path("mine.txt").absolute()
    mine.write_text("years of work")
    name, before = str(mine).encode(), grid.read_bytes()
    for checksum in (sum(name), 0):  # SQLite passes over a wrong one, but nobody honest writes it
        Path("site.possmap-journal").write_bytes(journal_with_a_name(grid, name, checksum))
        result = run(*command)
        assert result.exit_code == 1 and result.stdout == ""
        assert result.stderr == (
            f"possmap: {grid.absolute()}-journal: names another file, which SQLite would delete; "
            "possmap never writes such a journal\n"
        )
        assert mine.read_text() == "years of work"
        assert grid.read_bytes() == before and Path("site.possmap-journal").exists()


def test_a_grid_to_be_made_is_not_let_near_such_a_journal_either(grid: Path) -> None:
    name = str(Path("mine.txt").absolute()).encode()
    Path("new.possmap-journal").write_bytes(journal_with_a_name(grid, name, sum(name)))
    result = run("fuse", str(DATA), "-g", "new.possmap")
    assert result.exit_code == 1 and "new.possmap-journal: names another file" in result.stderr
    assert not Path("new.possmap").exists()


def test_a_link_to_a_grid_leads_to_the_journal_of_the_grid(grid: Path) -> None:
    name = str(Path("mine.txt").absolute()).encode()
    Path("site.possmap-journal").write_bytes(journal_with_a_name(grid, name, sum(name)))
    Path("link.possmap").symlink_to(grid)
    assert "site.possmap-journal: names another file" in run("info", "link.possmap").stderr


IRREGULAR: dict[str, Callable[[Path], object]] = {
    "a pipe": os.mkfifo,
    "a folder": Path.mkdir,
    "a link to a file": lambda path: path.symlink_to("mine.txt"),
    "a link to nothing": lambda path: path.symlink_to("nothing"),
}


@pytest.mark.parametrize("suffix", ["-journal", "-wal", "-shm"])
@pytest.mark.parametrize("kind", IRREGULAR)
def test_what_is_no_regular_file_beside_a_grid_is_refused(
    kind: str, suffix: str, grid: Path
) -> None:
    Path("mine.txt").write_text("years of work")
    beside = Path(f"site.possmap{suffix}")
    IRREGULAR[kind](beside)
    for command in COMMANDS:
        result = run(*command)
        assert result.exit_code == 1 and result.stdout == ""
        assert result.stderr == (
            f"possmap: {beside.absolute()}: not a regular file, as what SQLite leaves beside a "
            "grid is\n"
        )
    assert Path("mine.txt").read_text() == "years of work"


def test_a_grid_in_wal_mode_that_cannot_be_opened_says_so(
    grid: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    connection = sqlite3.connect(grid)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.close()
    folder = Path("closed")
    folder.mkdir()
    shutil.move(grid, folder / grid)

    assert run("info", "closed/site.possmap").exit_code == 0, "one who may write may read"
    refused = "attempt to write a readonly database"  # tests may run as root, who may all
    with monkeypatch.context() as patch:
        patch.setattr("possmap.grid.database.sqlite3.connect", refuse(refused))
        result = run("info", "closed/site.possmap")
    assert result.exit_code == 1
    assert result.stderr == (
        "possmap: closed/site.possmap: another program has put it into SQLite's WAL mode, and "
        "reading it so needs the right to write it and its folder\n"
    )


def refuse(message: str) -> Callable[..., sqlite3.Connection]:
    def connect(*_: object, **__: object) -> sqlite3.Connection:
        error = sqlite3.OperationalError(message)
        error.sqlite_errorcode = sqlite3.SQLITE_READONLY
        raise error

    return connect


def test_an_empty_grid_is_told_in_the_same_words_whatever_lies_beside_it(grid: Path) -> None:
    grid.write_bytes(b"")
    alone = run("info", "site.possmap")
    assert alone.stderr.startswith("possmap: site.possmap: empty: a first fuse that was stopped")
    Path("site.possmap-journal").write_bytes(bytes(SECTOR))
    beside = run("info", "site.possmap")
    assert (beside.stderr, beside.exit_code) == (alone.stderr, 1)


@pytest.mark.parametrize("function", ["is_in_wal_mode", "bytes_held"])
def test_a_disk_that_fails_at_the_first_look_is_told(
    sound: Path, monkeypatch: pytest.MonkeyPatch, function: str
) -> None:
    def fail(_: Path) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(database, function, fail)
    with pytest.raises(GridError, match="cannot be read: Input/output error"):
        Grid(sound)


@pytest.mark.parametrize(
    ("suffix", "told"),
    [("-wal", None), ("-journal", "-journal: cannot be read: Permission denied")],
)
def test_what_lies_beside_a_grid_and_may_not_be_read_is_left_alone_or_named(
    grid: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, told: str | None
) -> None:
    beside = grid.with_name(grid.name + suffix)
    beside.touch()
    opened = Path.open

    def forbidden(path: Path, *how: str) -> object:
        if path.name == beside.name:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        return opened(path, *how)

    monkeypatch.setattr(Path, "open", forbidden)
    result = run("info", str(grid))
    assert result.exit_code == (0 if told is None else 1)
    assert told is None or told in result.stderr

"""A grid whose pages lead in circles is refused before it takes much time or memory."""

from __future__ import annotations

import json
import shutil
import sqlite3
import struct
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from teams import write_logs

import possmap
from possmap.errors import GridError
from possmap.fusing.forget import Target, forget
from possmap.grid.bounds import CELLS, SHORT

DATA = Path(__file__).parents[2] / "data" / "json"
LEVELS = 4

TABLES = (
    "setting", "source", "excursion", "part", "record", "touched", "tile", "cells", "again",
    "forgotten", "part_of_excursion", "sqlite_autoindex_excursion_1", "sqlite_autoindex_tile_1",
)  # fmt: skip

CHILD = """
import json, resource, sys
from click.testing import CliRunner
from possmap.cli.main import main
resource.setrlimit(resource.RLIMIT_AS, (2**31, 2**31))
for command in json.loads(sys.argv[1]):
    result = CliRunner().invoke(main, command, prog_name="possmap")
    print(json.dumps([command[0], result.exit_code, result.stderr, result.exc_info[0].__name__]))
with open("/proc/self/status") as status:
    print(json.dumps(next(int(line.split()[1]) for line in status if "VmHWM" in line)))
"""


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sound")
    grid = folder / "site.possmap"
    possmap.fuse([DATA], grid)
    known = folder / "known.json"
    known.write_text((DATA / "01-r2-a.json").read_text() + "\n")
    possmap.fuse([known], grid)
    forget(grid, Target(robot="r3"))
    return grid


def forge(source: Path, grid: Path, name: str, levels: int = LEVELS) -> None:
    """Make of a grid one in which all inner pages of a table or an index lead to one page."""
    shutil.copy(source, grid)
    with closing(sqlite3.connect(grid)) as connection:
        (root,) = connection.execute(
            "SELECT rootpage FROM sqlite_schema WHERE name = ?", (name,)
        ).fetchone()
        (size,) = connection.execute("PRAGMA page_size").fetchone()
    data = bytearray(grid.read_bytes())
    leaf = page = bytes(data[(root - 1) * size : root * size])
    while leaf[0] in (2, 5):  # an inner page already: down to its first leaf
        (cell,) = struct.unpack_from(">H", leaf, 12)
        (child,) = struct.unpack_from(">I", leaf, cell)
        leaf = bytes(data[(child - 1) * size : child * size])
    is_table = leaf[0] == 13
    key = b"\x7f"
    if not is_table and struct.unpack_from(">H", leaf, 3)[0]:
        (cell,) = struct.unpack_from(">H", leaf, 8)
        key = leaf[cell : cell + 1 + leaf[cell]]
    data += leaf
    for _ in range(levels):
        page = _inner(len(data) // size, key, size, is_table)
        data += page
    data[(root - 1) * size : root * size] = page
    struct.pack_into(">I", data, 28, len(data) // size)
    grid.write_bytes(data)


def _inner(child: int, key: bytes, size: int, is_table: bool) -> bytes:
    cell = struct.pack(">I", child) + key
    count = (size - 12) // (len(cell) + 2)
    start = size - count * len(cell)
    places = struct.pack(f">{count}H", *range(start, size, len(cell)))
    head = struct.pack(">BHHHBI", 5 if is_table else 2, 0, count, start, 0, child)
    return (head + places).ljust(start, b"\0") + cell * count


def outcomes(*commands: list[str], timeout: float = 30) -> tuple[list[Any], int]:
    """Run commands in a process of their own; what each came to, and the peak of memory [MiB]."""
    done = subprocess.run(
        [sys.executable, "-c", CHILD, json.dumps(commands)],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=True,
    )
    *results, kib = map(json.loads, done.stdout.splitlines())
    return results, kib // 1024


@pytest.mark.parametrize("name", TABLES)
def test_no_command_follows_a_tree_that_the_file_cannot_hold(
    name: str, sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    forge(sound, Path("forged.possmap"), name)
    for copy in ("fused.possmap", "forgot.possmap"):
        shutil.copy("forged.possmap", copy)
    shutil.copy(sound, "sound.possmap")
    poses = [{"seq": n, "kind": "pose", "x": n, "y": 0, "heading": 0} for n in (0, 1)]
    new = {"possmap_log": 1, "robot": "new", "excursion": "a", "records": poses}
    (log,) = write_logs(tmp_path / "logs", [new])
    results, peak_mib = outcomes(
        ["info", "forged.possmap"],
        ["verify", "forged.possmap"],
        ["audit", "forged.possmap"],
        ["query", "forged.possmap", "0", "0"],
        ["render", "forged.possmap", "-o", "forged.png"],
        ["export", "forged.possmap", "-o", "forged.npz"],
        ["diff", "forged.possmap", "sound.possmap"],
        ["repair", "forged.possmap", "-o", "repaired.possmap"],
        ["fuse", "forged.possmap", "-g", "new.possmap"],
        ["fuse", str(DATA), str(log), "-g", "fused.possmap"],
        ["forget", "forgot.possmap", "--robot", "r2"],
    )
    assert peak_mib < 300
    refusals = 0
    for command, exit_code, stderr, raised in results:
        assert raised == "SystemExit" or exit_code == 0, (command, raised)
        lines = stderr.splitlines()
        if command not in ("verify", "repair", "fuse"):  # these name each fault, or each log
            assert len(lines) <= 1, (command, stderr)
        if exit_code:
            assert "damaged" in stderr, (command, stderr)
            refusals += 1
    assert refusals, "verify at least"


def test_a_tree_in_a_circle_is_called_what_it_is(sound: Path, tmp_path: Path) -> None:
    grid = tmp_path / "forged.possmap"
    forge(sound, grid, "record")
    size = grid.stat().st_size
    (result,), _ = outcomes(["query", str(grid), "0", "0"])
    problem = f"damaged: its tables lead to more than its {size} bytes can hold"
    assert result == ["query", 1, f"possmap: {grid}: {problem}\n", "SystemExit"]


def test_after_a_refusal_nothing_more_is_read(sound: Path, tmp_path: Path) -> None:
    grid = tmp_path / "forged.possmap"
    forge(sound, grid, "record")
    with possmap.open_grid(grid) as opened:
        entry = next(opened.ledger.entries())
        with pytest.raises(GridError, match="can hold"):
            opened.ledger.version(entry)
        with pytest.raises(GridError, match="can hold"):
            opened.ledger.identities()


def test_holes_hold_nothing(sound: Path, tmp_path: Path) -> None:
    grid = tmp_path / "forged.possmap"
    forge(sound, grid, "record")
    size = grid.stat().st_size
    with grid.open("r+b") as stream:
        stream.truncate(2**36)
        stream.seek(28)
        stream.write(struct.pack(">I", 2**24))
    if grid.stat().st_blocks * 512 > 2**30:
        pytest.skip("the file system makes no holes")
    results, peak_mib = outcomes(["query", str(grid), "0", "0"])
    (command, exit_code, stderr, _), *_ = results
    assert exit_code == 1 and f"more than its {size} bytes can hold" in stderr, command
    assert peak_mib < 300


def test_rows_that_grow_while_sorted_are_stopped(sound: Path, tmp_path: Path) -> None:
    wide = tmp_path / "wide.possmap"
    shutil.copy(sound, wide)
    with closing(sqlite3.connect(wide)) as connection, connection:
        connection.execute("UPDATE part SET carrier_robot = ?", ("x" * 7000,))
    forge(wide, tmp_path / "forged.possmap", "part_of_excursion")
    (result,), peak_mib = outcomes(["info", str(tmp_path / "forged.possmap")])
    assert result[1] == 1 and "can hold" in result[2]
    assert peak_mib < 300


def test_what_is_long_and_honest_is_read(tmp_path: Path) -> None:
    """Keys of one's own may be long; a grid that grew while it was open holds more than before."""
    pose = {"kind": "pose", "x": 0, "y": 0, "heading": 0}
    long = {"seq": 0, **pose, "x_note": "n" * (CELLS + SHORT)}
    log = {"possmap_log": 1, "robot": "r1", "excursion": "a", "records": [long]}
    grid = tmp_path / "site.possmap"
    short = {"possmap_log": 1, "robot": "r2", "excursion": "a", "records": [{"seq": 0, **pose}]}
    first, second = write_logs(tmp_path / "logs", [short, log | {"x_more": "m" * 3 * CELLS}])
    possmap.fuse([first], grid)
    with possmap.open_grid(grid) as opened:
        possmap.fuse([second], grid)
        entry = opened.ledger.entry(("r1", "a"))
        assert entry is not None
        version = opened.ledger.version(entry)
    assert len(version.extra) > 3 * CELLS
    assert len(version.records[0].extra) > CELLS

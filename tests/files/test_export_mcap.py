"""The MCAP file: a reader of ROS bags finds the map cell by cell, and every track pose by pose."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maps import drawn_grid
from rosbags.highlevel import AnyReader
from teams import fuse

from possmap.errors import OutputError
from possmap.exports import mcap
from possmap.exports.export import export
from possmap.exports.job import MODES, Choices
from possmap.grid.grid import Grid

DATA = Path(__file__).parents[2] / "data" / "json"
DRAWN = ["#####?", "#...#?", "#.!.##"]


def messages(path: Path) -> dict[str, list[Any]]:
    """Return the messages of each topic, in their order."""
    found: dict[str, list[Any]] = {}
    with AnyReader([path]) as bag:
        for connection, _, data in bag.messages():
            message = bag.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    return found


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("row", "column"), [(0, 0), (-1000, 70000)])
def test_the_map_is_what_is_drawn(mode: str, row: int, column: int, tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", DRAWN, row, column)
    export(grid, tmp_path / "site.mcap", choices=Choices(mode=mode))
    (found,) = messages(tmp_path / "site.mcap")["/map"]
    assert (found.info.width, found.info.height) == (6, 3)
    assert found.info.resolution == pytest.approx(0.5)
    origin = found.info.origin.position
    assert (origin.x, origin.y) == (column * 0.5, row * 0.5)
    between = "?" if mode == "trinary" else "%"
    letters = {-1: "?", 0: ".", 100: "#"}
    rows = np.asarray(found.data).reshape(3, 6)[::-1].tolist()
    seen = ["".join(letters.get(one, "%") for one in line) for line in rows]
    assert seen == [line.replace("!", between) for line in DRAWN]


def test_every_excursion_has_a_path_through_its_poses(tmp_path: Path) -> None:
    grid = tmp_path / "site.possmap"
    fuse(sorted(DATA.iterdir()), grid, {})
    export(grid, tmp_path / "site.mcap")
    found = messages(tmp_path / "site.mcap")
    with Grid(grid) as site:
        for entry in site.ledger.entries():
            laid = [
                (at.x, at.y, at.heading_deg)
                for at in site.ledger.geometry(entry).values()
                if at.heading_deg is not None
            ]
            (path,) = found.pop(f"/tracks/{entry.robot}/{entry.excursion}")
            assert path.header.frame_id == "map"
            for one, (x, y, heading_deg) in zip(path.poses, laid, strict=True):
                place, turn = one.pose.position, one.pose.orientation
                assert (place.x, place.y) == pytest.approx((x, y))
                off = math.degrees(2 * math.atan2(turn.z, turn.w)) - heading_deg
                assert math.remainder(off, 360) == pytest.approx(0, abs=1e-6)
    assert list(found) == ["/possmap", "/map"]


def test_names_become_those_of_topics(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    lines = ['{"possmap_log": 1, "robot": "7:of-9", "excursion": "NAME"}']
    poses = ['{"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0}',
             '{"seq": 1, "kind": "pose", "x": 1, "y": 0, "heading": 0}']  # fmt: skip
    both = ["\n".join([*lines, *poses]).replace("NAME", name) for name in ("a-1", "a.1")]
    log.write_text("\n".join(both) + "\n")
    fuse([log], tmp_path / "site.possmap", {})
    export(tmp_path / "site.possmap", tmp_path / "site.mcap")
    found = messages(tmp_path / "site.mcap")
    assert {topic: len(some) for topic, some in found.items()} == {
        "/possmap": 1, "/map": 1, "/tracks/_7_of_9/a_1": 2,
    }  # fmt: skip


def test_a_map_too_large_for_a_message_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = drawn_grid(tmp_path / "site.possmap", DRAWN, 0, 0)
    monkeypatch.setattr(mcap, "MOST", 17)
    with pytest.raises(OutputError, match="3 × 6 cells, expected at most 17; take a part of it"):
        export(grid, tmp_path / "site.mcap")
    assert not (tmp_path / "site.mcap").exists()

"""Metadata beside a recording: what they say of its wheels, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from possmap.errors import RecordingError
from possmap.lab.recordings.tick_geometry import geometry_beside

SOUND = "type,diff,,\nngear,43.7,,\nencRes,64,,\nLi,0.2,,\nDi,0.084,0.085,\nN,3,,\n"


def beside(folder: Path, text: str) -> Path:
    (folder / "1_metadata.csv").write_text(text, encoding="utf-8")
    return folder / "1_run-01.csv"


def test_wheels_and_ticks_are_read(tmp_path: Path) -> None:
    told = geometry_beside(beside(tmp_path, SOUND))
    assert told is not None and told.name == "Li0.2-Di0.084-0.085"
    assert told.ticks.right == pytest.approx(math.pi * 0.084 / (43.7 * 64))
    assert told.ticks.left == pytest.approx(math.pi * 0.085 / (43.7 * 64))
    assert told.ticks.track == 0.2 and not told.ticks.cumulative


def test_the_metadata_of_the_recording_itself_count(tmp_path: Path) -> None:
    (tmp_path / "0_metadata.csv").write_text(SOUND.replace("0.2", "0.3"))
    told = geometry_beside(beside(tmp_path, SOUND))
    assert told is not None and told.ticks.track == 0.2


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("type,diff", "type,tricyc", "1_metadata.csv:1: type, found \"tricyc\", expected diff"),
        ("Li,0.2", "Li,wide", "1_metadata.csv:4: Li, found [\"wide\"], expected 1 numbers > 0"),
        ("Di,0.084,0.085", "Di,0.084,", "1_metadata.csv:5: Di, found [\"0.084\"], expected 2"),
        ("ngear,43.7", "ngear,-1", "1_metadata.csv:2: ngear, found"),
        ("encRes,64,,\n", "", "encRes, found [], expected 1 numbers"),
    ],
)  # fmt: skip
def test_what_is_no_geometry_is_refused_with_its_line(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    with pytest.raises(RecordingError) as raised:
        geometry_beside(beside(tmp_path, SOUND.replace(old, new)))
    assert words in str(raised.value)

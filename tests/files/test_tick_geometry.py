"""Metadata beside a recording: what they say of its wheels, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from possmap.errors import RecordingError
from possmap.lab.convert.samples import joined
from possmap.lab.convert.tally import Tally
from possmap.lab.recordings import Source, find_mapping, open_recordings, read_mapping
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


def test_a_table_of_ticks_is_laid_out_by_the_metadata_beside_it(tmp_path: Path) -> None:
    rows = "0,0,0,0,0,0\n0.05,0,0,0,100,-100\n0.1,0,0,0,100,-100\n"
    own = beside(tmp_path, SOUND)
    own.write_text(rows)
    source = Source(mapping=read_mapping(find_mapping("optiodom-ticks")))
    (recording,) = open_recordings([own], source)
    samples = joined(recording.samples(Tally(), None))
    unit = math.pi * (0.084 + 0.085) / (43.7 * 64)
    assert samples.yaw[-1] - samples.yaw[0] == pytest.approx(200 * unit / 0.2)


def test_metadata_of_something_else_tell_nothing(tmp_path: Path) -> None:
    assert geometry_beside(beside(tmp_path, "title,a drive\n")) is None
    (tmp_path / "2_metadata.csv").write_text(SOUND)
    assert geometry_beside(tmp_path / "drive.csv") is None, "whose?"


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

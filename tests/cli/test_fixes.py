"""Fixes as a user meets them: who writes them, who tells of them, where they are drawn."""

from __future__ import annotations

import gzip
import json
import math
import shutil
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from literal.teams import as_csv, as_jsonl
from teams import digest

from possmap.cli.main import main
from possmap.core.records import Fix, PartialMap, Pose
from possmap.grid.grid import Grid
from possmap.logs import read_log
from possmap.pictures.overlays import Marks
from possmap.pictures.raster import furnished_raster
from possmap.settings.limits import Limits

ROOT = Path(__file__).parents[2]
HALL = "data/recordings/hall.log"
TRUTH = [
    "--reference", "data/recordings/hall-truth.csv",
    "--reference-mapping", "data/recordings/hall-truth.yaml",
]  # fmt: skip


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False)


def log(y: float = 0.1, robot: str = "r1") -> dict[str, Any]:
    """Return a run of 5 m, at whose end somebody looked."""
    records = [
        {"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0},
        {"seq": 1, "kind": "pose", "x": 5, "y": 0, "heading": 0},
        {"seq": 2, "kind": "fix", "x": 5, "y": y, "error_x": 0.05, "error_y": 0.05},
    ]
    return {"possmap_log": 1, "robot": robot, "excursion": "a", "records": records}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def clone(here: Path) -> Path:
    """Stand in a folder with the shipped recordings."""
    shutil.copytree(ROOT / "data/recordings", here / "data/recordings")
    return here


def test_check_says_where_fixes_are_ignored(here: Path) -> None:
    Path("a.json").write_text(json.dumps(log()))
    ignored = "    ignored   1 fix is ignored: only the estimator walls looks back\n"
    assert ignored in run("check", "a.json", "--profile", "paper").stdout
    result = run("check", "a.json", "--profile", "robust")
    assert "ignored" not in result.stdout
    assert "±0.049 m in y" in result.stdout
    (one,) = json.loads(run("check", "a.json", "--profile", "paper", "--json").stdout)["logs"]
    assert one["excursions"][0]["fixes_ignored"] == 1
    assert one["excursions"][0]["waiting"] == 0


def test_fuse_and_audit_tell_of_a_fix_that_surprises(here: Path) -> None:
    Path("a.json").write_text(json.dumps(log(y=3.0)))
    Path("b.json").write_text(json.dumps(log(robot="r2")))
    result = run("fuse", "a.json", "b.json", "-g", "g.possmap", "--profile", "robust")
    assert result.exit_code == 0
    (line,) = (one for one in result.output.splitlines() if "surpris" in one)
    assert line.startswith("1 fix surprises the error model, and is used all the same: r1 a by ")
    told = run("info", "g.possmap", "--json")
    heading = json.loads(told.stdout)["excursions"][0]["heading"]
    assert (heading["fixes"], heading["surprising"]) == (1, 1)
    assert heading["surprise"] > 13.8
    assert "excursion r1 a (a fix surprises its model)" in run("audit", "g.possmap").stdout


def test_every_encoding_holds_fixes(here: Path) -> None:
    known = log()
    known["records"][2] |= {"t": 3.5, "heading": 1.0, "error_heading": 0.5}
    Path("a.json").write_text(json.dumps(known))
    Path("b.jsonl.gz").write_bytes(gzip.compress(as_jsonl([known]).encode()))
    Path("c.csv").write_text(as_csv([known]))
    for name in ("a.json", "b.jsonl.gz", "c.csv"):
        (delivery,) = read_log(Path(name), Limits()).deliveries
        assert delivery.whole.records[2] == Fix(2, 3.5, 5.0, 0.1, 0.05, 0.05, 1.0, 0.5)
        assert run("fuse", name, "-g", f"{name}.possmap").exit_code == 0
    assert len({digest(path) for path in here.glob("*.possmap")}) == 1


def test_maps_with_tracks_and_geojson_show_them(here: Path) -> None:
    Path("a.json").write_text(json.dumps(log()))
    run("fuse", "a.json", "-g", "g.possmap")
    with Grid("g.possmap") as grid:
        assert grid.window is not None
        raster = furnished_raster(grid.window, False, None, None)
        known = {entry.identity: entry.records for entry in grid.ledger.entries()}
        assert Marks(grid, raster, tracks=True).known(known).fixes == [(5.0, 0.1)]
        assert Marks(grid, raster, tracks=False).known(known).fixes == []
    assert run("export", "g.possmap", "-o", "g.geojson").exit_code == 0
    features = json.loads(Path("g.geojson").read_text())["features"]
    (fix,) = (one for one in features if one["properties"]["kind"] == "fix")
    assert fix["geometry"] == {"type": "Point", "coordinates": [5.0, 0.1]}
    assert fix["properties"] == {
        "kind": "fix", "robot": "r1", "excursion": "a", "seq": 2, "t": None,
        "half_x": 0.05, "half_y": 0.05,
    }  # fmt: skip


# --- Who writes them ---------------------------------------------------------------------------


def converted(*arguments: str) -> list[PartialMap]:
    result = run("-q", "convert", HALL, *arguments, "-o", "out.jsonl", "--overwrite")
    assert result.exit_code == 0, result.output
    return [one.version for one in read_log(Path("out.jsonl"), Limits()).deliveries]


def fixes(one: PartialMap) -> list[Fix]:
    return [record for record in one.records if isinstance(record, Fix)]


def test_convert_writes_where_a_recording_truly_ended(clone: Path) -> None:
    for text in ("end=1.25,-3.5,0.05", "END=1.25,-3.5,±0.05"):
        (one,) = converted("--fix", text)
        (fix,) = fixes(one)
        assert one.records[-1] == fix
        assert (fix.x, fix.y, fix.error_x, fix.error_y) == (1.25, -3.5, 0.05, 0.05)
    (plain,) = converted()
    assert plain.records == one.records[:-1]
    *others, last = converted("--legs", "5", "--fix", "end=1.25,-3.5,0.05")
    assert others
    assert not any(map(fixes, others))
    assert len(fixes(last)) == 1


def test_convert_ends_every_leg_where_the_reference_has_it(clone: Path) -> None:
    legs = converted(*TRUTH, "--legs", "5", "--fix", "end=reference,0.1")
    assert len(legs) > 1
    for leg, following in pairwise(legs):
        (fix,) = fixes(leg)
        first = next(one for one in following.records if isinstance(one, Pose))
        assert math.hypot(fix.x - first.x, fix.y - first.y) < 1e-3
        assert fix.error_x == 0.1


def test_convert_takes_fixes_from_columns_that_few_rows_fill(clone: Path) -> None:
    header, *rows = Path("data/recordings/hall.csv").read_text().splitlines()
    known = {0: "1.5,2.5", 70: "3,4", 71: "3.25,4", len(rows) - 1: "-6,0.5"}
    marked = [f"{row},{known.get(number, ',')}" for number, row in enumerate(rows)]
    Path("marked.csv").write_text("\n".join([f"{header},mark_x,mark_y", *marked, ""]))
    command = ["convert", "marked.csv", "--mapping", "data/recordings/hall.yaml", "-o", "out.jsonl"]
    assert run(*command, "--fix", "columns=mark_x,mark_y,±0.05").exit_code == 0
    (delivery,) = read_log(Path("out.jsonl"), Limits()).deliveries
    records = delivery.version.records
    found = {record.t: (record.x, record.y) for record in records if isinstance(record, Fix)}
    times = {number: float(row.split(",")[0]) * 1e-3 for number, row in enumerate(rows)}
    assert found == {
        times[number]: tuple(map(float, text.split(","))) for number, text in known.items()
    }
    for before, record in pairwise(records):  # each stands behind the pose of its moment
        if isinstance(record, Fix):
            assert isinstance(before, Pose)
            assert before.t == record.t


def test_a_mark_on_no_excursion_is_counted_and_one_between_two_is_in_both(clone: Path) -> None:
    """Legs end and begin at one sample; what lies before the first reference pose is left out."""
    header, *rows = Path("data/recordings/hall.csv").read_text().splitlines()
    marked = [f"{row},1,2" for row in rows]
    Path("marked.csv").write_text("\n".join([f"{header},mark_x,mark_y", *marked, ""]))
    command = ["convert", "marked.csv", "--mapping", "data/recordings/hall.yaml", "-o", "out.jsonl"]
    fixed = ["--fix", "columns=mark_x,mark_y,0.05"]
    result = run(*command, *fixed, "--legs", "20", "--json")
    (one,) = json.loads(result.stdout)["recordings"]
    assert one["records"]["fix"] == len(rows) + one["excursions"] - 1
    assert not [told for told in one["counted"] if "truly was" in told["what"]]
    late = Path("data/recordings/hall-truth.csv").read_text().splitlines()
    Path("late.csv").write_text("\n".join([late[0], *late[200:], ""]))
    reference = ["--reference", "late.csv", "--reference-mapping", TRUTH[3]]
    result = run(*command, *fixed, *reference, "--json", "--overwrite")
    (one,) = json.loads(result.stdout)["recordings"]
    (told,) = (told for told in one["counted"] if "truly was" in told["what"])
    assert told["count"] == len(rows) - one["records"]["fix"] > 0


@pytest.mark.parametrize(
    ("columns", "problem"),
    [
        ("mark_x,mark_z", 'column "mark_z" is missing'),
        ("mark_x,mark_y", "no row has numbers in mark_x and mark_y, expected some (--fix)"),
    ],
)
def test_columns_without_a_fix_are_refused(columns: str, problem: str, clone: Path) -> None:
    header, *rows = Path("data/recordings/hall.csv").read_text().splitlines()
    lines = [f"{header},mark_x,mark_y", *(f"{row},," for row in rows), ""]
    Path("marked.csv").write_text("\n".join(lines))
    command = ["convert", "marked.csv", "--mapping", "data/recordings/hall.yaml", "-o", "out.jsonl"]
    result = run(*command, "--fix", f"columns={columns},0.05", "--overwrite")
    assert result.exit_code == 1
    assert problem in result.stderr
    assert not Path("out.jsonl").exists()


@pytest.mark.parametrize(
    "fix",
    ["1,2,0.05", "start=1,2,0.05", "end=1,2,0", "end=1,2,-1", "end=1,2", "end=1,2,x", "end=1,2,3,4",
     "end=nan,2,0.1", "end=2e6,2,0.1", "end=reference", "end=reference,0", "end=1,2,inf"],
)  # fmt: skip
def test_convert_refuses_what_is_no_fix(fix: str, clone: Path) -> None:
    result = run("convert", HALL, *TRUTH, "--fix", fix, "-o", "out.jsonl")
    expected = "end=X,Y,±M, end=reference,±M or columns=X,Y,±M with M > 0"
    problem = f"found {fix!r}, expected {expected}"
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.splitlines()[-1] == f"Error: Invalid value for '--fix': {problem}"
    assert not Path("out.jsonl").exists()


def test_a_fix_by_the_reference_needs_one(clone: Path) -> None:
    result = run("convert", HALL, "--fix", "end=reference,0.1", "-o", "out.jsonl")
    problem = "--fix: found end=reference, expected a --reference with it"
    assert (result.exit_code, result.stderr) == (1, f"possmap: {problem}\n")


def test_one_fix_for_each_recording_or_none(clone: Path) -> None:
    result = run("convert", HALL, HALL, "--fix", "end=1,2,0.1", "-o", "out.jsonl")
    problem = "--fix: found 1 for 2 recordings, expected one for each"
    assert (result.exit_code, result.stderr) == (1, f"possmap: {problem}\n")


def test_simulate_notes_where_collected_robots_truly_are(here: Path) -> None:
    given = ["--set", "minutes=6", "--robots", "2", "--seed", "3"]
    for name, more in (("with", ["--set", "dock_error=0.05"]), ("without", [])):
        result = run("simulate", ROOT / "configs/missions/office.yaml", "-o", name, *given, *more)
        assert result.exit_code == 0, result.output
    truth = json.loads(Path("with/truth.json").read_text())
    ends = {(one["robot"], one["excursion"]): one["track"][-1][1:3] for one in truth["robots"]}
    off = []
    for path in sorted(Path("with/logs").iterdir()):
        log = json.loads(path.read_text())
        found = [one for one in log["records"] if one["kind"] == "fix"]
        assert [one["error_x"] for one in found] == [0.05]
        x, y = ends[log["robot"], log["excursion"]]
        off += [found[0]["x"] - x, found[0]["y"] - y]
        # Nobody drives otherwise for being looked at.
        plain = json.loads((Path("without/logs") / path.name).read_text())
        kept = [{**one, "seq": 0} for one in log["records"] if one["kind"] != "fix"]
        assert [{**one, "seq": 0} for one in plain["records"]] == kept
    assert 0 < max(map(abs, off)) < 4 * 0.05 / 2.236

"""``possmap export`` in all formats: what is said, what is refused, and nothing half done."""

from __future__ import annotations

import json
import os
import resource
import sys
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import map_server
import pytest
from commands import files, refused, run
from maps import cells_of, drawn_grid, write_grid

from possmap.exports.export import FORMATS
from possmap.grid.grid import Grid

DRAWN = ["###", "#.?", "!?7"]
SUFFIXES = list(FORMATS)
BESIDE = {".yaml": ".pgm", ".yml": ".pgm", ".png": ".pgw"}
EXTRAS = [
    (".dxf", "ezdxf", "dxf"),
    (".bt", "pyoctomap", "octomap"),
    (".mcap", "rosbags", "ros"),
]


@pytest.fixture
def grid(tmp_path: Path) -> Path:
    return drawn_grid(tmp_path / "site.possmap", DRAWN, -1, -2)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_format_says_what_it_wrote(suffix: str, grid: Path, tmp_path: Path) -> None:
    out = tmp_path / f"map{suffix}"
    result = run("export", grid, "-o", out)
    names = f"{out} and {tmp_path}/map{BESIDE[suffix]}" if suffix in BESIDE else f"{out}"
    said = "3 rows × 3 columns of 0.5 m, from (-1.00, -0.50)"
    assert (result.stdout, result.stderr) == (f"{names}: {said}\n", "")
    assert result.exit_code == 0
    expected = {grid.name, out.name, *([f"map{BESIDE[suffix]}"] if suffix in BESIDE else [])}
    assert set(files(tmp_path)) == expected
    assert all(files(tmp_path).values())


@pytest.mark.parametrize("suffix", sorted(set(SUFFIXES) - {".dxf"}))
def test_the_same_grid_gives_the_same_bytes_whatever_it_is_called(
    suffix: str, grid: Path, tmp_path: Path
) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    run("export", grid, "-o", tmp_path / f"a/map{suffix}")
    other = grid.rename(tmp_path / "other.possmap")
    run("export", other, "-o", tmp_path / f"b/map{suffix}")
    assert files(tmp_path / "a") == files(tmp_path / "b") != {}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_format_states_version_digest_resolution_and_frame(
    suffix: str, grid: Path, tmp_path: Path
) -> None:
    out = tmp_path / f"map{suffix}"
    run("export", grid, "-o", out)
    content = out.read_bytes()
    if suffix == ".npz":
        with zipfile.ZipFile(out) as archive:
            content = archive.comment
    with Grid(grid) as opened:
        assert opened.digest().encode() in content
    for fact in (b"possmap", b"0.1.0", b"0.5", b"x right, y up"):
        assert fact in content


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_existing_output_is_replaced_only_with_overwrite(
    suffix: str, grid: Path, tmp_path: Path
) -> None:
    out = tmp_path / f"map{suffix}"
    for there in [out, *([out.with_suffix(BESIDE[suffix])] if suffix in BESIDE else [])]:
        there.write_text("precious")
        before = files(tmp_path)
        why = refused(run("export", grid, "-o", out))
        assert why == f"{there}: exists already; --overwrite replaces it"
        assert files(tmp_path) == before
        assert run("export", grid, "-o", out, "--overwrite").exit_code == 0
        assert there.read_bytes() != b"precious"
        for path in tmp_path.glob("map.*"):
            path.unlink()


@contextmanager
def full_disk(size: int) -> Iterator[None]:
    """Let no file grow beyond ``size`` bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("size", [10, 300])
def test_a_full_disk_leaves_no_part_of_a_file(
    suffix: str, size: int, grid: Path, tmp_path: Path
) -> None:
    out = tmp_path / f"map{suffix}"
    before = files(tmp_path)
    with full_disk(size):
        result = run("export", grid, "-o", out)
    why = refused(result)
    assert why.startswith(f"{out}") and why.endswith(": cannot be written: File too large")
    assert files(tmp_path) == before


@pytest.mark.parametrize("suffix", [".yaml", ".png"])
def test_a_disk_that_fills_while_replacing_leaves_the_old_pair(
    suffix: str, grid: Path, tmp_path: Path
) -> None:
    out = tmp_path / f"map{suffix}"
    run("export", grid, "-o", out, "--window", "-9,-9,9,9")
    before = files(tmp_path)
    with full_disk(300):
        result = run("export", grid, "-o", out, "--overwrite")
    assert "cannot be written" in refused(result)
    assert files(tmp_path) == before


@pytest.mark.parametrize(("suffix", "library", "extra"), EXTRAS)
def test_a_missing_extra_is_named_with_the_command_that_installs_it(
    suffix: str, library: str, extra: str, grid: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setitem(sys.modules, library, None)
    out = tmp_path / f"map{suffix}"
    assert refused(run("export", grid, "-o", out)) == (
        f"{out}: needs {library}, which is not installed: pip install 'possmap[{extra}]'"
    )
    assert set(files(tmp_path)) == {grid.name}


def test_an_extra_that_does_not_work_is_said_to(
    grid: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lib").mkdir()
    monkeypatch.delitem(sys.modules, "ezdxf", raising=False)
    monkeypatch.syspath_prepend(tmp_path / "lib")
    for text, reason in (
        ("import not_there_at_all", "No module named 'not_there_at_all'"),
        ("raise ImportError('libx.so:\\n not found')", "libx.so: not found"),
    ):
        (tmp_path / "lib/ezdxf.py").write_text(text)
        os.utime(tmp_path / "lib/ezdxf.py", (len(text), len(text)))  # no old bytecode
        why = refused(run("export", grid, "-o", tmp_path / "map.dxf"))
        assert why == f"{tmp_path}/map.dxf: ezdxf does not work: {reason}"


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("map.geojsn", 'unknown suffix ".geojsn", did you mean ".geojson"?'),
        ("map.yamll", 'unknown suffix ".yamll", did you mean ".yaml"?'),
        ("map.PGM", 'unknown suffix ".PGM", expected .yaml, which writes .pgm beside it'),
        ("map.pgw", 'unknown suffix ".pgw", expected .png, which writes .pgw beside it'),
        ("map.tiff", 'unknown suffix ".tiff", expected one of .npz, .yaml, '),
    ],
)
def test_an_unknown_suffix_is_answered_with_what_was_meant(
    name: str, complaint: str, grid: Path, tmp_path: Path
) -> None:
    why = refused(run("export", grid, "-o", tmp_path / name))
    assert why.startswith(f"{tmp_path / name}: {complaint}")
    assert set(files(tmp_path)) == {grid.name}


@pytest.mark.parametrize("suffix", sorted(set(SUFFIXES) - {".npz"}))
def test_a_window_without_evidence_is_refused(suffix: str, grid: Path, tmp_path: Path) -> None:
    for window in ("7,7,8,8", "0,0,0.5,0.5"):  # beside all evidence; between
        why = refused(run("export", grid, "-o", tmp_path / f"map{suffix}", "--window", window))
        assert why == (
            f"{grid}: nothing in the window; all evidence lies within -1.00,-0.50,0.50,1.00"
        )
    assert set(files(tmp_path)) == {grid.name}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_grid_without_evidence_is_refused(suffix: str, tmp_path: Path) -> None:
    grid = write_grid(tmp_path / "empty.possmap", {})
    why = refused(run("export", grid, "-o", tmp_path / f"map{suffix}"))
    assert why == f"{grid}: holds no evidence, so there is nothing to show"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_islands_900_km_apart_are_refused_until_a_window_takes_one(
    suffix: str, tmp_path: Path
) -> None:
    cells = {**cells_of(["#."]), **cells_of(["#."], 1800, 1_800_000)}
    grid = write_grid(tmp_path / "far.possmap", cells)
    out = tmp_path / f"map{suffix}"
    why = refused(run("export", grid, "-o", out))
    assert why == (
        f"{grid}: 1801 × 1800002 cells, expected at most 10⁹; "
        "take a part of it: --window X0,Y0,X1,Y1"
    )
    assert run("export", grid, "-o", out, "--window", "0,0,1,1").exit_code == 0


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_single_cell_is_a_map_too(suffix: str, tmp_path: Path) -> None:
    grid = drawn_grid(tmp_path / "one.possmap", ["#"], -1, -1, 1e-6)
    assert run("export", grid, "-o", tmp_path / f"map{suffix}").exit_code == 0


@pytest.mark.parametrize(
    ("options", "suffix", "complaint"),
    [
        (["--mode", "raw"], ".png", "--mode belongs to .yaml, .yml, .mcap, not to .png."),
        (["--layer", "points"], ".yaml", "--layer belongs to .png, not to .yaml."),
        (["--free", "0.1"], ".svg", "--free belongs to .yaml, .yml, .mcap, .geojson, .bt,"),
        (
            ["--occupied", "0.1"],
            ".csv",
            "--occupied belongs to .yaml, .yml, .mcap, .geojson, .svg, .dxf, .bt",
        ),
        (["--base-rate", "0.1"], ".npz", "--base-rate belongs to .yaml, .yml, .mcap, .png"),
        (["--mode", "grey"], ".yaml", "'grey' is not one of 'trinary', 'scale', 'raw'"),
        (["--layer", "necesity"], ".png", 'unknown layer "necesity", did you mean "necessity"?'),
        (["--layer", "x"], ".png", 'unknown layer "x", expected one of necessity, possibility'),
        (["--occupied", "0"], ".yaml", "0.0 is not in the range 0<x<=1"),
        (["--free", "1"], ".yaml", "1.0 is not in the range 0<=x<1"),
        (["--occupied", "nan"], ".yaml", "occupied, found nan, expected a number from 0 to 1"),
    ],
)
def test_options_that_make_no_sense_are_wrong_usage(
    options: list[str], suffix: str, complaint: str, grid: Path, tmp_path: Path
) -> None:
    result = run("export", grid, "-o", tmp_path / f"map{suffix}", *options)
    assert complaint in result.stderr
    assert (result.stdout, result.exit_code) == ("", 2)
    assert set(files(tmp_path)) == {grid.name}


def test_mode_and_thresholds_reach_the_map(grid: Path, tmp_path: Path) -> None:
    out = tmp_path / "map.yaml"
    run("export", grid, "-o", out, "--mode", "scale", "--occupied", "0.8", "--free", "0.01")
    assert map_server.load(out).letters() == ["###", "#.?", "%?%"]
    assert set(files(tmp_path)) == {grid.name, "map.yaml", "map.png"}
    assert "belief >= 0.8, else free where plausibility <= 0.01" in out.read_text(encoding="utf-8")


@pytest.mark.parametrize("beside", ["map.pgm", "map.yaml"])
@pytest.mark.parametrize("link", [False, True])
def test_the_grid_itself_is_never_replaced(beside: str, link: bool, tmp_path: Path) -> None:
    """Not by the file that goes with the one asked for, and not through a link."""
    grid = drawn_grid(tmp_path / "site.possmap", DRAWN)
    named_so = tmp_path / beside
    if link:
        named_so.symlink_to(grid)
    else:
        grid = grid.rename(named_so)
    before = grid.read_bytes()
    why = refused(run("export", grid, "-o", tmp_path / "map.yaml", "--overwrite"))
    assert why == f"{named_so}: is the grid itself, expected another file"
    assert grid.read_bytes() == before


def test_a_folder_in_the_way_of_the_image_is_refused(grid: Path, tmp_path: Path) -> None:
    (tmp_path / "map.pgm").mkdir()
    why = refused(run("export", grid, "-o", tmp_path / "map.yaml", "--overwrite"))
    assert why == f"{tmp_path}/map.pgm: is a folder, expected a file"
    assert set(files(tmp_path)) == {grid.name}


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="there is no /proc")
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_folder_that_may_not_be_written_is_refused(suffix: str, grid: Path) -> None:
    """Not even root may write there."""
    why = refused(run("export", grid, "-o", f"/proc/map{suffix}"))
    assert why.startswith(f"/proc/map{suffix}") and ": cannot be written: " in why


def test_a_name_that_is_not_utf_8_cannot_stand_in_yaml(grid: Path, tmp_path: Path) -> None:
    out = tmp_path / os.fsdecode(b"\xff.yaml")
    why = refused(run("export", grid, "-o", out))
    assert why.endswith(".yaml: its name is not UTF-8, expected one for YAML")
    assert set(files(tmp_path)) == {grid.name}


def test_geojson_is_json_for_any_reader(grid: Path, tmp_path: Path) -> None:
    run("export", grid, "-o", tmp_path / "map.geojson")
    found = json.loads((tmp_path / "map.geojson").read_bytes())
    kinds = [one["properties"]["kind"] for one in found["features"]]
    assert kinds == ["outline", "occupied", "free"]


def test_a_box_far_larger_than_its_evidence_is_not_written_cell_by_cell(tmp_path: Path) -> None:
    grid = write_grid(tmp_path / "site.possmap", {(0, 0): (0.9, 1.0), (20000, 20000): (0.9, 1.0)})
    for suffix in (".npz", ".png"):
        why = refused(run("export", grid, "-o", tmp_path / f"map{suffix}"))
        assert "20001 × 20001 cells, of which tiles with evidence hold 0.0%; take a part" in why
    assert run("export", grid, "-o", tmp_path / "map.svg").exit_code == 0
    assert run("export", grid, "-o", tmp_path / "map.npz", "--window=0,0,5,5").exit_code == 0


def test_what_killed_exports_left_is_named(grid: Path, tmp_path: Path) -> None:
    (tmp_path / ".map.csv.0123abcd").write_text("half")
    (tmp_path / ".map.csv.0123abcx").write_text("another's")
    result = run("export", grid, "-o", tmp_path / "map.csv")
    left = f"{tmp_path}/.map.csv.0123abcd is left from an export that was stopped"
    assert (result.stderr, result.exit_code) == (f"possmap: {left}: remove it\n", 0)


def test_what_is_selected_is_written_as_from_a_grid_of_its_own(tmp_path: Path) -> None:
    logs = sorted((Path(__file__).parents[2] / "data/json").glob("*-r1-*.json"))
    for name, some in (("all", logs), ("one", logs[-1:])):
        assert run("fuse", *some, "-g", tmp_path / f"{name}.possmap").exit_code == 0
    for name, options in (("all", ("--excursions", "b", "--robots", "r1")), ("one", ())):
        out = tmp_path / f"{name}.csv"
        result = run("export", tmp_path / f"{name}.possmap", "-o", out, *options)
        assert result.exit_code == 0
    told = [(tmp_path / f"{name}.csv").read_text().splitlines() for name in ("all", "one")]
    assert "# excursions: excursions like b of r1" in told[0]
    assert [line for line in told[0] if not line.startswith("# excursions: ")] == told[1]


def test_a_geojson_stands_where_the_site_lies_on_earth(grid: Path, tmp_path: Path) -> None:
    here, there = tmp_path / "here.geojson", tmp_path / "there.geojson"
    assert run("export", grid, "-o", here).exit_code == 0
    placed = ["--epsg", "32633", "--offset", "500000.5,-20"]
    assert run("export", grid, "-o", there, *placed).exit_code == 0
    found, expected = json.loads(there.read_text()), json.loads(here.read_text())
    assert found["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::32633"
    assert "EPSG:32633; the site's (0, 0) lies at 500000.5, -20.0" in found["possmap"]["frame"]

    def points(one: object) -> list[list[float]]:
        if isinstance(one, list) and one and isinstance(one[0], float):
            return [one]
        return [point for part in one for point in points(part)] if isinstance(one, list) else []

    for moved, one in zip(found["features"], expected["features"], strict=True):
        assert moved["properties"] == one["properties"]
        pairs = zip(
            points(moved["geometry"]["coordinates"]),
            points(one["geometry"]["coordinates"]),
            strict=True,
        )
        assert [(a[0] - b[0], a[1] - b[1]) for a, b in pairs] == [(500000.5, -20.0)] * len(
            points(one["geometry"]["coordinates"])
        )
    assert run("export", grid, "-o", tmp_path / "here.png").exit_code == 0
    assert run("export", grid, "-o", tmp_path / "there.png", "--offset", "100,200").exit_code == 0
    x, y = (
        [float(v) for v in (tmp_path / f"{n}.pgw").read_text().split()[4:]]
        for n in ("here", "there")
    )
    assert (y[0] - x[0], y[1] - x[1]) == (100, 200)

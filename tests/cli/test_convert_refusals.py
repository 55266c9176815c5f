"""``possmap convert`` and bad input: one plain line, the exit code, nothing left behind."""

from __future__ import annotations

import gzip
import json
import os
import random
import resource
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from possmap.cli.main import main

CSV = "format: csv\ncolumns: {t: t, x: x, y: y, yaw: w}\nbeams: [{column: r, angle_deg: 0}]\n"
JSON = "format: json\ncolumns: {t: t, x: x, y: y}\n"
HEADER = "t,x,y,w,r\n"
SHIPPED = "crazyflie-bag, crazyflie-csv, intel-json, optiodom-ticks, optiodom-truth"
TWO_POSES = "gave fewer than two poses, expected a track"
FEW = "cannot be used, the first here, expected at most half"
NOTHING = "holds nothing that can be read, expected a recording"


def rows(count: int = 20, start: float = 0) -> str:
    return "".join(f"{start + t},{0.2 * t},0,0,1\n" for t in range(count))


def scan(t: float, reading: object = 1.0, kind: str = "FLASER", count: int = 181) -> str:
    return f"{kind} {count} {' '.join([str(reading)] * count)} {t} 0 0 {t} 0 0 {t} host {t}\n"


def run(*args: object) -> Result:
    return CliRunner().invoke(main, ["convert", *map(str, args)], catch_exceptions=False)


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand in a folder with a good recording of each text format, and mappings."""
    monkeypatch.chdir(tmp_path)
    Path("csv.yaml").write_text(CSV)
    Path("json.yaml").write_text(JSON)
    Path("good.csv").write_text(HEADER + rows())
    Path("good.log").write_text("".join(map(scan, range(20))))
    Path("good.json").write_text(json.dumps([{"t": t, "x": t, "y": 0} for t in range(20)]))
    return tmp_path


def put(text: str | bytes, name: str = "bad.csv") -> None:
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())


def refused(command: str, code: int = 1) -> str:
    """Return the one line of a refusal, after checking that nothing was left behind."""
    before = sorted(os.listdir())  # noqa: PTH208
    result = run(*command.split())
    assert (result.exit_code, result.stdout) == (code, ""), result.output
    assert sorted(os.listdir()) == before  # noqa: PTH208
    assert result.stderr.isprintable() or result.stderr.replace("\n", "").isprintable()
    if code == 1:
        assert result.stderr.startswith("possmap: ")
        assert result.stderr.count("\n") == 1
        return result.stderr.removeprefix("possmap: ").removesuffix("\n")
    return result.stderr.splitlines()[-1].removeprefix("Error: ")


def test_readings_that_nearly_all_get_lost_are_warned_of(files: Path) -> None:
    put(HEADER + rows().replace(",1\n", ",9\n"))
    put(HEADER + "".join(f"{t},{t / 10},0,0,0.2\n" for t in range(20)), "near.csv")
    for name, told in (
        ("near.csv", "17 of 20 readings were taken for the robot's own echo"),
        ("bad.csv", "no beam has a reading within reach, so the log is a track alone"),
    ):
        result = run(name, "--mapping", "csv.yaml", "-o", "out.jsonl", "--overwrite")
        assert result.exit_code == 0
        assert result.stderr.startswith(f"possmap: {name}: {told}")


# --- What is in the file -----------------------------------------------------------------------

WITH_CSV = "bad.csv --mapping csv.yaml -o out.jsonl"
WITH_JSON = "bad.json --mapping json.yaml -o out.jsonl"

CONTENTS: list[tuple[str, str | bytes, str]] = [
    # Files of nothing, and of something else
    ("bad.csv -o out.jsonl", "", f"bad.csv: {NOTHING}"),
    (WITH_CSV, "", f"bad.csv: {NOTHING}"),
    (WITH_CSV, HEADER, f"bad.csv: {TWO_POSES}"),
    ("bad.csv -o out.jsonl", HEADER + rows(),
     "bad.csv: its columns are not mapped, expected --mapping FILE or one of those that possmap "
     f"ships: {SHIPPED}"),
    ("bad.json -o out.jsonl", "[]",
     "bad.json: its columns are not mapped, expected --mapping FILE or one of those that possmap "
     f"ships: {SHIPPED}"),
    ("bad.bin -o out.jsonl", bytes(range(256)) * 9,
     "bad.bin: of no known format, expected CARMEN, a ROS bag, CSV or JSON"),
    ("bad.csv --format carmen -o out.jsonl", HEADER + rows(),
     "bad.csv: found no whole line of ODOM, FLASER, RLASER or ROBOTLASER1, expected a CARMEN log"),
    ("bad.csv --format json --mapping csv.yaml -o out.jsonl", HEADER + rows(),
     "bad.csv: is of the format json, but the mapping is for csv"),
    (WITH_JSON, scan(0) * 3, "bad.json: is of the format carmen, but the mapping is for json"),
    (WITH_JSON, HEADER + rows(), "bad.json:1: not JSON: Expecting '[' delimiter"),
    (WITH_CSV, (HEADER + rows()).encode("utf-16"),
     'bad.csv:1: column "t" is missing, found "\\ufffd\\ufffdt\\u0000", "\\u0000x\\u0000", '
     '"\\u0000y\\u0000", "\\u0000w\\u0000", "\\u0000r\\u0000"'),
    # Clocks
    (WITH_CSV, HEADER + rows(10, 1000) + rows(20), f"bad.csv:12: 20 of 30 rows {FEW}"),
    # Rows
    (WITH_CSV, HEADER + "a,b,c,d,e\n" * 5, f"bad.csv:2: 5 of 5 rows {FEW}"),
    (WITH_CSV, HEADER + "nan,0,0,0,1\n" * 5,
     f"bad.csv:2: 5 of 5 rows {FEW}; 5 rows with NaN or infinity for a pose, skipped (bad.csv:2)"),
    (WITH_CSV, HEADER + "1,9e9,0,0,1\n" * 5,
     f"bad.csv:2: 5 of 5 rows {FEW}; 5 rows with a place or heading beyond ±1e9, skipped"),
    (WITH_CSV, ",".join(["1"] * 500_000),
     'bad.csv:1: column "t" is missing, found ' + ", ".join(['"1"'] * 20)),
    (WITH_CSV, HEADER + "1,2,3,4" + "5" * 10_000_000 + "\n",
     f"bad.csv: {TWO_POSES}; 1 lines longer than 1 MiB, skipped (bad.csv:2)"),
    # CARMEN
    ("bad.log -o out.jsonl", scan(0) + (scan(1)[:300] + "\n") * 3, f"bad.log:2: 3 of 4 rows {FEW}"),
    ("bad.log -o out.jsonl", "FLASER 1000000000 1 2 3\n" * 3,
     "bad.log: found no whole line of ODOM, FLASER, RLASER or ROBOTLASER1, expected a CARMEN log"),
    ("bad.log --mapping csv.yaml -o out.jsonl", scan(0) * 3,
     'bad.log:1: column "t" is missing, found '),
    # JSON
    (WITH_JSON, '["' + "x" * 20_000_000 + '"]', "bad.json:1: a value of more than 16 MiB"),
    (WITH_JSON, '{"t": 0}\n', 'bad.json:1: column "x" is missing, found "t"'),
    # Compressed
    (WITH_CSV, gzip.compress(b"", mtime=0)[:5], f"bad.csv: {NOTHING}"),
    (WITH_CSV, b"\x1f\x8b\x08\x00" + b"\xff" * 99,
     "bad.csv: not a gzip file, or damaged: Error -3 while decompressing data: "),
    (WITH_CSV, gzip.compress((HEADER + rows()).encode())[:-8] + bytes(8),
     "bad.csv: not a gzip file, or damaged: CRC check failed "),
]  # fmt: skip


@pytest.mark.parametrize(("command", "content", "told"), CONTENTS)
def test_what_a_file_holds_is_refused_in_one_line(
    files: Path, command: str, content: str | bytes, told: str
) -> None:
    put(content, command.split()[0])
    assert refused(command).startswith(told)


# --- What is asked for -------------------------------------------------------------------------

GOOD = "good.csv --mapping csv.yaml"
ASKED: list[tuple[str, int, str]] = [
    # The output
    (f"{GOOD} -o good.json --overwrite --legs 1", 1,
     "good.json: a JSON file holds one log, expected .jsonl, .csv or a folder"),
    (f"{GOOD} good.json -o out.json", 1,
     "good.json: is of the format json, but the mapping is for csv"),
    ("good.log good.log -o out.json", 1,
     "out.json: a JSON file holds one log, expected .jsonl, .csv or a folder"),
    (f"{GOOD} -o out.xyz", 1,
     "out.xyz: unknown suffix, expected one of .json, .jsonl, .ndjson, .csv, perhaps with .gz, "
     "or a folder"),
    (f"{GOOD} -o good.json", 1, "good.json: exists already; --overwrite replaces it"),
    (f"{GOOD} -o good.csv --overwrite", 1,
     "good.csv: is the recording itself, expected the name of a log"),
    (f"{GOOD} -o no/out.jsonl", 1, "no/out.jsonl: the folder no does not exist"),
    (f"{GOOD} -o no/out", 1, "no/out: cannot be written: No such file or directory"),
    (f"{GOOD} -o .", 1,
     ".: holds something already; --overwrite replaces logs of the same outings"),
    (GOOD, 2, "Missing option '-o' / '--output'."),
    # Mappings
    ("good.csv --mapping intel-jsn -o out.jsonl", 1,
     '--mapping: "intel-jsn" is neither a file nor shipped, did you mean "intel-json"?'),
    ("good.csv --mapping good.csv -o out.jsonl", 1, 'good.csv:1: found "'),
    (f"{GOOD} --topic /odom -o out.jsonl", 2,
     "--topic and --mapping say the same thing, expected one of them"),
    ("good.log --format carmen --topic /odom -o out.jsonl", 1,
     "good.log: is of the format carmen, but the mapping is for ros"),
    # Starts
    ("good.log --start 0,0,0 --start 1,1,1 -o out.jsonl", 1,
     "--start: found 2 for 1 recording, expected one for each"),
    ("good.log --start nan,0,0 -o out.jsonl", 2,
     "Invalid value for '--start': found 'nan,0,0', expected X,Y,DEGREES"),
    ("good.log --start-error -1,0,0 -o out.jsonl", 2,
     "Invalid value for --start-error: expected half-widths >= 0"),
    # The model
    ("good.log --set drift -o out.jsonl", 2,
     "Invalid value for --set: 'drift', expected KEY=VALUE"),
    ("good.log --set drif=1 -o out.jsonl", 2,
     '--set: unknown setting "drif", did you mean "drift"?'),
    ("good.log --set scale=-1 -o out.jsonl", 2, '--set: scale, found "-1", expected a number > 0'),
    ("good.log --set resolution=0.1 -o out.jsonl", 2,
     '--set: "resolution" is no parameter of the error model, expected one of along, across, '),
    ("good.log --model csv.yaml -o out.jsonl", 1, "csv.yaml:1: "),
    # The rest
    ("none.log -o out.jsonl", 2, "Invalid value for 'SOURCE...': Path 'none.log' does not exist."),
    (". -o out.jsonl", 1, ".: is a folder without the metadata.yaml of a ROS 2 bag"),
    ("good.log --beams left -o out.jsonl", 2,
     "Invalid value for '--beams': found 'left', expected degrees parted by commas"),
    ("good.log --robot r/1 -o out.jsonl", 2,
     "Invalid value for --robot: found 'r/1', expected 1 to 64 characters of A-Z a-z 0-9 . _ : -"),
    (f"good.log --excursion {'e' * 60} --legs 1 -o out.jsonl", 1,
     "--excursion: found 60 characters, expected at most 50, for numbers are put behind the name"),
    ("good.log --legs 0 -o out.jsonl", 2, "Invalid value for '--legs': 0.0 is not in the range"),
    ("good.log --tolerance nan -o out.jsonl", 2, "Invalid value for '--tolerance': nan is not in"),
    ("good.log --reference good.csv -o out.jsonl", 1, "good.csv: its columns are not mapped"),
]  # fmt: skip


@pytest.mark.parametrize(("command", "code", "told"), ASKED)
def test_what_is_asked_for_is_refused_in_one_line(
    files: Path, command: str, code: int, told: str
) -> None:
    assert refused(command, code).startswith(told)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no such files here")
@pytest.mark.parametrize("options", ["", "--mapping csv.yaml", "--format carmen"])
def test_a_fifo_is_not_waited_for(files: Path, options: str) -> None:
    os.mkfifo("pipe.log")
    assert refused(f"pipe.log {options} -o out.jsonl") == (
        "pipe.log: not a regular file, expected the file of a recording"
    )


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="everything can be read here")
def test_a_file_that_may_not_be_read_is_refused(files: Path) -> None:
    Path("good.log").chmod(0)
    assert refused("good.log -o out.jsonl") == "good.log: cannot be read: Permission denied"


@pytest.mark.parametrize("name", ["a\x1b[31mred.csv", "a\nb.csv", "a\x07.csv", "a\u202eb.csv"])
def test_a_name_with_terminal_codes_is_shown_escaped(files: Path, name: str) -> None:
    put("x", name)
    result = run(name, "-o", "out.jsonl")
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert result.stderr.strip().isprintable()
    put(HEADER + rows() + "x\n", name)
    result = run(name, "-o", "out.jsonl", "--mapping", "csv.yaml")
    assert result.exit_code == 0
    assert result.stdout.replace("\n", "").isprintable()
    assert result.stdout.count("\n") == 5


# --- What is skipped, and counted --------------------------------------------------------------


def converted(*args: object) -> dict[str, int]:
    result = run(*args, "-o", "out.jsonl", "--overwrite", "--json")
    assert (result.exit_code, result.stderr) == (0, "")
    (one,) = json.loads(result.stdout)["recordings"]
    assert run_check("out.jsonl") == 0
    return {entry["what"]: entry["count"] for entry in one["counted"]}


def run_check(path: str) -> int:
    return CliRunner().invoke(main, ["check", path]).exit_code


@pytest.mark.parametrize("reading", ["nan", "inf", "-inf", "0", "-5", "1e308", "1" * 400])
def test_ranges_that_are_none_leave_the_track(files: Path, reading: str) -> None:
    put("".join(scan(t, reading) for t in range(20)), "bad.log")
    converted("bad.log")
    put(HEADER + rows().replace(",1\n", f",{reading}\n"))
    converted("bad.csv", "--mapping", "csv.yaml")


def test_single_bad_rows_are_counted_with_the_first_place(files: Path) -> None:
    text = HEADER + rows(10) + "cut,in\n" + rows(9, 10) + "1,2,3,4,5\n" + "nan,0,0,0,0\n"
    put(text + rows(5, 100))
    result = run("bad.csv", "--mapping", "csv.yaml", "-o", "out.jsonl")
    lines = [line.strip() for line in result.stdout.splitlines()]
    assert "counted    1 rows cut short or without numbers, skipped (first: bad.csv:12)" in lines
    assert "counted    1 rows whose clock ran backwards, skipped (first: bad.csv:22)" in lines
    assert "counted    1 rows with NaN or infinity for a pose, skipped (first: bad.csv:23)" in lines


WORDS = ["nan", "inf", "-inf", "1e308", "1e9", "0", "-1", "", "\0", '"', "{", "]", ",", "\n", "1_0",
         "1" * 400, "9" * 5000, "true", "null", "\udcff"]  # fmt: skip


@pytest.mark.parametrize("source", ["good.log", "good.csv", "good.json"])
def test_whatever_is_damaged_the_log_is_valid_or_the_refusal_one_line(
    files: Path, source: str
) -> None:
    whole = Path(source).read_text()
    suffix = Path(source).suffix
    options = [] if suffix == ".log" else ["--mapping", f"{suffix[1:]}.yaml"]
    for seed in range(80):
        chance = random.Random(seed)
        text = whole
        for _ in range(chance.choice([1, 2, 9])):
            at = chance.randrange(len(text))
            text = text[:at] + chance.choice(WORDS) + text[at + chance.choice([0, 1, 3, 99]) :]
        Path("bad").write_text(text, errors="surrogateescape")
        result = run("bad", *options, "-o", "out.jsonl", "--overwrite")
        if result.exit_code == 0:
            assert run_check("out.jsonl") == 0
        else:
            assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
            assert result.stderr.startswith("possmap: bad")


# --- What would take all memory, or all time ---------------------------------------------------


def peak_mib(*args: object) -> tuple[int, str, float]:
    """Return exit code, messages and peak memory [MiB] of a process that may not take much."""
    limit = 1200 << 20

    def set_limit() -> None:
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))

    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "from possmap.cli.main import main\n"
        "try:\n"
        "    main(sys.argv[1:])\n"
        "finally:\n"  # rusage would count what the tests' own process held when it forked
        "    status = Path('/proc/self/status').read_text()\n"
        "    print('peak', status.split('VmHWM:')[1].split()[0], file=sys.stderr)\n"
    )
    command = [sys.executable, "-c", code, "convert", *map(str, args)]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=100, preexec_fn=set_limit, check=False
    )
    *messages, last = done.stderr.splitlines()
    return done.returncode, "\n".join(messages), int(last.split()[1]) / 1024


def zeros(mebibytes: int, byte: bytes) -> bytes:
    return gzip.compress(byte * (1 << 20)) * mebibytes


def wide() -> bytes:
    names = ",".join(["t", "x", "y", "w", "r", *(f"c{n}" for n in range(100_000))])
    row = ",".join(["{t}", "0", "0", "0", "1", *["12345"] * 100_000])
    text = "\n".join([names, *(row.replace("{t}", str(t)) for t in range(400))])
    return gzip.compress(text.encode(), 1)


BOMBS: dict[str, tuple[str, Callable[[], bytes], str]] = {
    "zeros as CARMEN": ("--format carmen", lambda: zeros(1000, b"\0"), "found no whole line"),
    "line ends as CARMEN": ("--format carmen", lambda: zeros(10, b"\n"), "found no whole line"),
    "zeros as CSV": ("--mapping csv.yaml", lambda: zeros(1000, b"\0"), "holds no rows"),
    "spaces as JSON": ("--mapping json.yaml", lambda: zeros(1000, b" "), "of no known|too early"),
    "a string as JSON": ("--mapping json.yaml",
                         lambda: gzip.compress(b'["') + zeros(1000, b"x"), "more than 16 MiB"),
    "brackets as JSON": ("--mapping json.yaml", lambda: zeros(100, b"["), "nested too deep"),
    "very wide rows": ("--mapping csv.yaml", wide, ""),
}  # fmt: skip


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited and measured on Linux")
@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_takes_little_memory(files: Path, name: str) -> None:
    options, content, told = BOMBS[name]
    put(content(), "bomb.gz")
    code, messages, peak = peak_mib("bomb.gz", *options.split(), "-o", "out.jsonl")
    assert code == (1 if told else 0), messages
    assert any(part in messages for part in told.split("|"))
    assert "Traceback" not in messages
    assert peak < 400


def test_what_the_reader_of_logs_would_refuse_is_not_written(files: Path) -> None:
    """Nanoseconds that a mapping takes for seconds lie beyond the times of a log."""
    put(HEADER + "".join(f"{10**18 + t * 10**8},{0.2 * t},0,0,1\n" for t in range(20)))
    told = refused("bad.csv --mapping csv.yaml -o out.jsonl")
    assert told.startswith("bad.csv: would give a log that is refused: pose, t, found ")


def test_a_turn_is_said_to_be_one(files: Path) -> None:
    put(HEADER + rows() + "".join(f"{20 + t},3.8,{0.2 * t},1.57,\n" for t in range(9)))
    assert run("bad.csv", "--mapping", "csv.yaml", "-o", "out.jsonl").exit_code == 0
    records = map(json.loads, Path("out.jsonl").read_text().splitlines()[1:])
    poses = [record for record in records if record["kind"] == "pose"]
    turned = [pose.get("turned") for pose in poses]
    assert turned == [None, *(b["heading"] != a["heading"] or None for a, b in pairwise(poses))]
    assert turned.count(True) == 1

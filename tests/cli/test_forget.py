"""``possmap forget``: exact words, and the story of a lie that came first."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import sqlite3
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from teams import digest
from versions import WHOLE, changed, fused_digest, log_of, prefix, written

from possmap.cli.main import main
from possmap.errors import printable
from possmap.fusing.advice import how_to_forget
from possmap.release import version

ROOT = Path(__file__).parents[2]
AT = r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00"


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand in a folder with a grid of r1, r2 and r3; r2 carried most of what r3 recorded."""
    monkeypatch.chdir(tmp_path)
    carrier = {**log_of("r2", 4), "carried": [prefix(log_of("r3"), 4)]}
    written(Path(), r1=WHOLE, r2=carrier, r3=log_of("r3"))
    fuse("r1.json", "r2.json", "r3.json", "--resolution", 0.1)
    return Path("site.possmap")


def fuse(*args: object) -> Result:
    return run("fuse", *args, "-g", "site.possmap")


def at(text: str) -> str:
    """Return a text with every moment as AT."""
    return re.sub(AT, "AT", text)


def test_a_robot_is_forgotten_whoever_brought_it(site: Path) -> None:
    result = run("forget", site, "--robot", "r3")
    expected = fused_digest(Path(), WHOLE, log_of("r2", 4))
    assert result.stdout == (
        "site.possmap: forgot robot r3: 6 records of 1 excursion, 1 tile changed\n"
        "  r3 a: 6 records; nothing stays\n"
        f"digest {expected}\n"
    )
    assert (result.stderr, result.exit_code, digest(site)) == ("", 0, expected)


def test_what_a_forgotten_robot_carried_for_others_stays(site: Path) -> None:
    run("forget", site, "--robot", "r2")
    assert digest(site) == fused_digest(Path(), WHOLE, log_of("r3"))
    lines = run("info", site, "--excursions").stdout.splitlines()
    assert "    4 from r2.json, carried by r2 a" in lines
    assert at(lines[6]) == "forgotten   robot r2, AT: 4 records of 1 excursion"


def test_json_says_what_went(site: Path) -> None:
    result = run("forget", site, "--robot", "r3", "--excursion", "a", "--json")
    told = json.loads(result.stdout)
    assert re.fullmatch(AT, told["forgotten"].pop("forgotten_at"))
    assert told == {
        "grid": "site.possmap",
        "forgotten": {
            "robot": "r3",
            "excursion": "a",
            "source": None,
            "sha256": None,
            "excursions": 1,
            "records": 6,
            "version": version(),
        },
        "once": False,
        "dry_run": False,
        "excursions": [{"robot": "r3", "excursion": "a", "lost": 6, "kept": 0, "vanished": True}],
        "records": 6,
        "tiles": 1,
        "digest": digest(site),
    }
    (known,) = json.loads(run("info", site, "--json").stdout)["forgotten"]
    assert (known["robot"], known["excursion"], known["records"]) == ("r3", "a", 6)


def test_a_file_takes_with_it_only_what_nobody_else_brought(site: Path) -> None:
    result = run("forget", site, "--brought-by", "r3.json")
    carrier = {**log_of("r2", 4), "carried": [prefix(log_of("r3"), 4)]}
    assert result.stdout.splitlines()[:2] == [
        "site.possmap: forgot what r3.json brought: 2 records of 1 excursion, 1 tile changed",
        "  r3 a: 2 records; 4 stay, which others brought",
    ]
    assert digest(site) == fused_digest(Path(), WHOLE, carrier)
    sha256 = hashlib.sha256(Path("r3.json").read_bytes()).hexdigest()
    (known,) = json.loads(run("info", site, "--json").stdout)["forgotten"]
    assert (known["source"], known["sha256"], known["robot"]) == ("r3.json", sha256, None)


def test_what_a_later_file_proves_is_its_own_from_then_on(site: Path) -> None:
    run("forget", site, "--brought-by", "r2.json")
    assert digest(site) == fused_digest(Path(), WHOLE, log_of("r3"))
    text = run("info", site, "--excursions").stdout
    assert "r2.json" not in text.replace("what r2.json brought", "")
    assert "  r3 a: 6 records\n    6 from r3.json\n" in text


def test_a_copy_that_brought_nothing_new_keeps_what_it_held(site: Path) -> None:
    written(Path(), copy={**log_of("r4", 1), "carried": [prefix(WHOLE, 5)]})
    fuse("copy.json")
    run("forget", site, "--brought-by", "r1.json")
    text = run("info", site, "--excursions").stdout
    assert "  r1 a: 5 records\n    5 from copy.json, carried by r4 a\n" in text
    run("forget", site, "--brought-by", "copy.json")
    assert "r1 a" not in run("info", site, "--excursions").stdout


def test_fuse_leaves_out_what_is_forgotten_until_it_is_recalled(site: Path) -> None:
    whole = digest(site)
    run("forget", site, "--robot", "r3")
    way_in = "possmap forget site.possmap --robot r3 --recall lets it in again"
    result = fuse("r2.json", "r3.json")
    assert at(result.stderr) == (
        f"possmap: r2.json: 1 excursion left out: robot r3 was forgotten, AT; {way_in}\n"
        f"possmap: r3.json: not let in: robot r3 was forgotten, AT; {way_in}\n"
    )
    assert result.stdout == ("site.possmap: fused 0 logs (0 new records), 1 known, 1 refused\n")
    assert result.exit_code == 1
    as_json = fuse("r2.json", "r3.json", "--json")
    assert as_json.stderr == result.stderr
    assert [log["status"] for log in json.loads(as_json.stdout)["logs"]] == ["known", "refused"]
    done = run("forget", site, "--robot", "r3", "--recall")
    assert (done.stdout, done.exit_code) == (
        "site.possmap: robot r3 may come in again: fuse the logs that hold it\n",
        0,
    )
    assert fuse("r2.json", "r3.json").exit_code == 0
    assert digest(site) == whole
    assert "forgotten" not in run("info", site).stdout


def test_a_lie_that_came_first_does_not_lock_the_honest_robot_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    lie = {**log_of("r9", 2), "carried": [changed(WHOLE, 3, y=9.0)]}
    written(Path(), liar=lie, honest=WHOLE, other=log_of("r2"))
    assert fuse("liar.json", "other.json", "--resolution", 0.1).exit_code == 0

    refused = fuse("honest.json")
    assert refused.exit_code == 1
    way_in = "possmap forget site.possmap --robot r1 --excursion a --once"
    assert at(refused.stderr) == (
        "possmap: honest.json:1: excursion a of robot r1 disagrees with the version from "
        "liar.json, fused AT: the records of seq 3 differ; another outing needs another excursion "
        f"name; if the other version is false, {way_in} makes room for this one\n"
    )

    forgot = run(*way_in.split()[1:])
    assert forgot.stdout == (
        "site.possmap: forgot excursion a of robot r1: 6 records of 1 excursion, 1 tile changed\n"
        "  r1 a: 6 records; nothing stays\n"
        f"digest {fused_digest(tmp_path, log_of('r9', 2), log_of('r2'))}\n"
    )
    assert "forgotten" not in run("info", "site.possmap").stdout

    let_in = fuse("honest.json")
    assert (let_in.stderr, let_in.stdout) == (
        "",
        "site.possmap: fused 1 log (6 new records), 0 known, 0 refused\n"
        "5 of 5 records on the map used; 0.0% of 21 cells contested\n",
    )
    assert fuse("liar.json").stderr.startswith(
        "possmap: liar.json:1: excursion a of robot r1 disagrees with the version from honest.json"
    )
    assert run("forget", "site.possmap", "--brought-by", "liar.json").exit_code == 0
    assert digest(Path("site.possmap")) == fused_digest(tmp_path, WHOLE, log_of("r2"))

    again = fuse("liar.json")
    sha256 = hashlib.sha256(Path("liar.json").read_bytes()).hexdigest()
    assert at(again.stderr) == (
        "possmap: liar.json: not let in: what liar.json brought was forgotten, AT; possmap forget "
        f"site.possmap --brought-by {sha256[:12]} --recall lets it in again\n"
    )


def test_an_honest_carrier_of_a_lie_keeps_its_own_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    lie = changed(WHOLE, 3, y=9.0)
    carriers = {"liar": {**log_of("r9", 2), "carried": [lie]}}
    carriers["honest"] = {**log_of("r2"), "carried": [lie]}
    written(Path(), **carriers, r1=WHOLE)
    assert fuse("liar.json", "honest.json", "--resolution", 0.1).exit_code == 0
    (command,) = re.findall("possmap (forget .* --once) makes room", fuse("r1.json").stderr)
    assert run(*command.split()).exit_code == 0
    assert fuse("r1.json").exit_code == 0
    everybody = fused_digest(tmp_path, log_of("r9", 2), log_of("r2"), WHOLE)
    assert digest(Path("site.possmap")) == everybody


def test_the_advice_works_though_a_file_of_that_name_was_forgotten_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written(Path(), liar=log_of("r8"), other=log_of("r2"))
    assert fuse("liar.json", "other.json", "--resolution", 0.1).exit_code == 0
    assert run("forget", "site.possmap", "--brought-by", "liar.json").exit_code == 0
    written(Path(), liar={**log_of("r9", 2), "carried": [changed(WHOLE, 3, y=9.0)]}, r1=WHOLE)
    assert fuse("liar.json").exit_code == 0
    (command,) = re.findall("possmap (forget .* --once) makes room", fuse("r1.json").stderr)
    assert run(*command.split()).exit_code == 0
    assert (fuse("r1.json").stderr, fuse("r1.json").exit_code) == ("", 0)


def test_once_keeps_no_memory_of_a_file_either(site: Path) -> None:
    before = digest(site)
    done = run("forget", site, "--brought-by", "r3.json", "--once", "--json")
    told = json.loads(done.stdout)
    assert told["once"] is True and told["records"] == 2
    assert "forgotten" not in run("info", site).stdout
    assert fuse("r3.json").exit_code == 0
    assert digest(site) == before


def test_a_file_named_like_the_hash_of_another_does_not_stand_in_for_it(site: Path) -> None:
    sha256 = hashlib.sha256(Path("r3.json").read_bytes()).hexdigest()
    Path("logs").mkdir()
    (path,) = written(Path("logs"), log=log_of("r7"))
    with possmap_database(site, path) as database:
        database.execute("UPDATE source SET name = ? WHERE name = ?", (sha256[:12], str(path)))
    done = run("forget", site, "--brought-by", sha256[:12])
    assert "forgot what r3.json brought: 2 records" in done.stdout


@contextmanager
def possmap_database(site: Path, path: Path) -> Iterator[sqlite3.Connection]:
    """Fuse one more log, and open the grid as the database that it is."""
    assert fuse(path).exit_code == 0
    with closing(sqlite3.connect(site)) as database:
        yield database
        database.commit()


@pytest.mark.parametrize("name", ["it's\nhere", "red\x1b[31m", "a b", "back\\slash\n", "\udc80x"])
def test_the_command_of_a_message_names_the_grid_to_a_shell(name: str, tmp_path: Path) -> None:
    if shutil.which("bash") is None:
        pytest.skip("needs bash")
    command = how_to_forget(tmp_path / name, ("r1", "a"))
    assert command == printable(command)
    shown = subprocess.run(["bash", "-c", f"printf '%s|' {command}"], capture_output=True).stdout
    options = ["--robot", "r1", "--excursion", "a", "--once"]
    words = ["possmap", "forget", str(tmp_path / name), *options]
    assert shown == b"".join(os.fsencode(word) + b"|" for word in words)


def test_in_one_call_the_lie_is_named_too_unless_nothing_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    lie = {**log_of("r9", 2), "carried": [changed(WHOLE, 3, y=9.0)]}
    written(Path(), liar=lie, honest=WHOLE)
    strict = fuse("liar.json", "honest.json", "--strict")
    assert "makes room" not in strict.stderr and strict.exit_code == 1
    result = fuse("liar.json", "honest.json")
    assert "site.possmap --robot r1 --excursion a --once makes room" in result.stderr


def test_a_grid_fused_into_another_brings_what_is_left_and_forgets_nothing(site: Path) -> None:
    run("forget", site, "--robot", "r3")
    assert run("fuse", site, "-g", "new.possmap", "--resolution", 0.1).exit_code == 0
    assert digest(Path("new.possmap")) == digest(site)
    assert "forgotten" not in run("info", "new.possmap").stdout
    assert run("fuse", "r3.json", "-g", "new.possmap").exit_code == 0


def test_an_old_grid_does_not_bring_in_what_is_forgotten(site: Path) -> None:
    assert run("fuse", site, "-g", "old.possmap", "--resolution", 0.1).exit_code == 0
    run("forget", site, "--brought-by", "r3.json")
    before = digest(site)
    result = fuse("old.possmap")
    assert "old.possmap: 1 excursion left out: what r3.json brought was" in result.stderr
    assert (digest(site), result.exit_code) == (before, 0)


def test_a_repaired_grid_remembers_what_was_forgotten(site: Path) -> None:
    written(Path(), copy={**log_of("r4", 1), "carried": [prefix(WHOLE, 5)]})
    fuse("copy.json")
    run("forget", site, "--robot", "r3")
    assert run("repair", site, "-o", "new.possmap").exit_code == 0
    known = [json.loads(run("info", grid, "--json").stdout) for grid in (site, "new.possmap")]
    for one in known:
        del one["grid"], one["file_size"]
    assert known[0] == known[1]
    assert known[0]["forgotten"] and known[0]["excursions"][0]["again"]


def test_everything_may_go(site: Path) -> None:
    for robot in ("r1", "r2", "r3"):
        assert run("forget", site, "--robot", robot).exit_code == 0
    lines = run("info", site).stdout.splitlines()
    assert lines[2] == "map         nothing, 0 tiles"
    assert run("verify", site, "--full").exit_code == 0


def test_forgetting_twice_changes_nothing(site: Path) -> None:
    run("forget", site, "--robot", "r3")
    before = site.read_bytes()
    result = run("forget", site, "--robot", "r3")
    assert at(result.stdout) == (
        "site.possmap: robot r3 is forgotten since AT, and nothing of it is here\n"
    )
    assert (result.exit_code, site.read_bytes()) == (0, before)


def test_what_is_gone_with_something_forgotten_is_said_to_be_so(site: Path) -> None:
    run("forget", site, "--robot", "r2")
    result = run("forget", site, "--robot", "r2", "--excursion", "a")
    assert at(result.stderr) == (
        "possmap: site.possmap: knows no robot r2; robot r2 is forgotten since AT\n"
    )
    run("forget", site, "--robot", "r3", "--excursion", "a")
    result = run("forget", site, "--robot", "r3")
    assert at(result.stderr) == (
        "possmap: site.possmap: knows no robot r3; excursion a of robot r3 is forgotten since AT\n"
    )
    assert result.exit_code == 1


def test_a_message_names_no_more_than_a_few_of_many(site: Path) -> None:
    with closing(sqlite3.connect(site)) as database, database:
        for number in range(30):
            row = f"q{number:02}", f"{number:064x}"
            database.execute(
                "INSERT INTO forgotten VALUES (NULL, ?, NULL, NULL, NULL, 1, 1, 'once', '0')",
                row[:1],
            )
            database.execute(
                "INSERT INTO source VALUES (NULL, 'x', ?, 1, '2026-01-01T00:00:00+00:00', '0')",
                row[1:],
            )
    forgotten = run("forget", site, "--robot", "r1", "--recall").stderr
    assert forgotten.endswith(", robot q18, robot q19 and 10 more\n")
    files = run("forget", site, "--brought-by", "x").stderr
    assert ": 30 files are named x, expected one" in files
    assert files.endswith("000000000000 (x) and 10 more\n") and files.count("(x)") == 20


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--robot", "r33"), 'knows no robot r33, did you mean "r3"?'),
        (("--robot", "r3", "--excursion", "b"), "knows no excursion b of robot r3"),
        (
            ("--robot", "r3", "--excursion", "aa"),
            'knows no excursion aa of robot r3, did you mean "a"?',
        ),
        (("--robot", "r33", "--excursion", "a"), 'knows no robot r33, did you mean "r3"?'),
        (
            ("--brought-by", "r4.json"),
            'a file r4.json brought nothing to this grid, did you mean "r',
        ),
        (("--robot", "r3", "--recall"), "robot r3 is not forgotten; forgotten: nothing"),
        (("--brought-by", "r3.json", "--recall"), "a file r3.json is not forgotten"),
    ],
)
def test_what_is_not_there_is_refused_and_changes_nothing(
    options: tuple[str, ...], complaint: str, site: Path
) -> None:
    before = site.read_bytes()
    result = run("forget", site, *options)
    assert result.stderr.startswith(f"possmap: site.possmap: {complaint}")
    assert (result.stdout, result.exit_code) == ("", 1)
    assert site.read_bytes() == before


def test_of_two_files_with_one_name_the_hash_tells_which(site: Path) -> None:
    longer = changed(log_of("r1", 8), 7, x=3.0)
    written(Path(), r1=longer)
    assert fuse("r1.json").exit_code == 0
    result = run("forget", site, "--brought-by", "r1.json")
    assert result.exit_code == 1
    match = re.fullmatch(
        r"possmap: site.possmap: 2 files are named r1.json, expected one, or how its SHA-256 "
        r"begins: [0-9a-f]{12} \(r1.json\), ([0-9a-f]{12}) \(r1.json\)\n",
        result.stderr,
    )
    assert match
    done = run("forget", site, "--brought-by", match[1])
    assert "  r1 a: 2 records; 6 stay, which others brought\n" in done.stdout
    (found,) = re.findall(r"--brought-by (\w+) --recall", fuse("r1.json").stderr)
    assert found == match[1]


def test_a_file_is_known_by_its_bytes_under_any_name(site: Path) -> None:
    Path("r3.json").rename("moved.json")
    result = run("forget", site, "--brought-by", "moved.json")
    assert "forgot what r3.json brought: 2 records of 1 excursion" in result.stdout
    assert run("forget", site, "--brought-by", "moved.json", "--recall").exit_code == 0
    assert fuse("moved.json").exit_code == 0


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--robot", "r1", "--brought-by", "r1.json"),
        ("--excursion", "a"),
        ("--brought-by", "r1.json", "--excursion", "a"),
        ("--robot", ""),
        ("--robot", "r1", "--excursion", ""),
        ("--brought-by", ""),
        ("--robot", "r1", "--once", "--recall"),
    ],
)
def test_a_target_that_is_none_is_wrong_usage(options: tuple[str, ...], site: Path) -> None:
    result = run("forget", site, *options)
    assert result.exit_code == 2
    complaints = (
        "expected either --robot or --brought-by",
        "--excursion needs --robot",
        "is empty, expected a name",
        "--once and --recall exclude each other",
    )
    assert sum(complaint in result.stderr for complaint in complaints) == 1


def test_a_missing_grid_is_not_made(tmp_path: Path) -> None:
    assert run("forget", tmp_path / "no.possmap", "--robot", "r1").exit_code == 2
    (tmp_path / "empty.possmap").touch()
    result = run("forget", tmp_path / "empty.possmap", "--robot", "r1")
    assert result.exit_code == 1 and "empty.possmap: empty" in result.stderr
    assert (tmp_path / "empty.possmap").stat().st_size == 0


def test_names_with_terminal_codes_are_shown_escaped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("red\x1b[31m").mkdir()
    (path,) = written(Path("red\x1b[31m"), log=WHOLE)
    assert fuse(path, "--resolution", 0.1).exit_code == 0
    texts = [fuse(*written(Path(), other=changed(WHOLE, 1, y=0.4))).stderr]
    done = run("forget", "site.possmap", "--brought-by", path)
    texts += [done.stdout, fuse(path).stderr, run("info", "site.possmap").stdout]
    assert done.exit_code == 0 and all(texts)
    assert "\x1b" not in "".join(texts)
    assert "from red\\x1b[31m/log.json, fused " in texts[0]


def test_the_page_shows_what_the_commands_print(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs/trust.md").read_text(encoding="utf-8")
    for command in ("fuse data/json -g site.possmap", "forget site.possmap --robot r3"):
        shown = f"$ possmap {command}\n{run(*command.split()).stdout}"
        assert shown in page

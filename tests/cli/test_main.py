"""``possmap`` itself: help, versions, completion, and the one door through which errors leave."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import possmap.inspection.info
from possmap.cli.main import COMMANDS, main
from possmap.core import kernel
from possmap.errors import PossmapError

ROOT = Path(__file__).parents[2]
AS_A_PROGRAM = [
    sys.executable,
    "-c",
    "from possmap.cli.main import main; main(prog_name='possmap')",
]


def run(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False)


def example(command: str) -> str:
    """Return the command line that ends a command's help."""
    last = run(command, "--help").stdout.splitlines()[-1]
    assert last.startswith("  Example: possmap "), last
    return last.removeprefix("  Example: ")


def test_help_lists_every_command_with_its_line() -> None:
    text = run("--help").stdout
    listed = text.partition("\nCommands:\n")[2].partition("\n\n")[0]
    assert [line.split()[0] for line in listed.splitlines()] == list(COMMANDS)
    column = max(map(len, COMMANDS)) + 2
    for name, line in COMMANDS.items():
        assert f"  {name:<{column}}{line}\n" in text
    assert text.splitlines()[-1].startswith("  Example: possmap ")
    assert run("-h").stdout == text


@pytest.mark.parametrize("command", COMMANDS)
def test_every_commands_help_fits_a_terminal_and_its_list_says_what_it_does(command: str) -> None:
    result = run(command, "--help")
    assert (result.stderr, result.exit_code) == ("", 0)
    assert max(map(len, result.stdout.splitlines())) <= 80
    first = result.stdout.splitlines()[2].strip()
    assert first.split()[0] == COMMANDS[command].split()[0], "the same verb in both places"


@pytest.mark.thorough
@pytest.mark.default_profile
def test_the_examples_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "data").symlink_to(ROOT / "data")
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    monkeypatch.chdir(tmp_path)
    # What diff compares with: the grid as it was before the last log.
    logs = sorted(Path("data/json").iterdir())[:3]
    assert run("fuse", *logs, "-g", "before.possmap").exit_code == 0
    assert run(*shlex.split(run("--help").stdout.splitlines()[-1])[2:], "--dry-run").exit_code == 0
    for command in COMMANDS:
        line, _, output = example(command).partition(" > ")
        program, named, *args = shlex.split(line)
        assert (program, named) == ("possmap", command)
        result = run(named, *args)
        assert (result.stderr, result.exit_code) == ("", 0), line
        assert result.stdout, "an example shows something"
        if output:
            (tmp_path / output).write_text(result.stdout)
    assert {path.name for path in tmp_path.iterdir()} >= {"site.possmap", "site.npz", "site.yaml"}
    assert run("fuse", "data/json", "-g", "new.possmap", "--config", "site.yaml").exit_code == 0


def test_the_version_is_that_of_the_package() -> None:
    result = run("--version")
    assert (result.stdout, result.exit_code) == (f"possmap {version('possmap')}\n", 0)


@pytest.mark.parametrize("options", [("--version", "-v"), ("-v", "--version")])
def test_with_v_the_version_says_which_kernel_runs(options: tuple[str, str]) -> None:
    result = run(*options)
    kind = "compiled (C" if kernel.COMPILED else "plain (NumPy"
    kernel_line = f"kernel: {kind}, 16-bit integers)"
    assert result.stdout.splitlines() == [f"possmap {version('possmap')}", kernel_line]


def test_without_a_command_the_help_is_shown_as_wrong_usage() -> None:
    result = run()
    assert "Commands:" in result.output and result.exit_code == 2


@pytest.mark.parametrize(
    ("name", "guess"),
    [("fsue", ', did you mean "fuse"?'), ("Info", ', did you mean "info"?'), ("zzz", "")],
)
def test_an_unknown_command_is_wrong_usage_with_a_guess(name: str, guess: str) -> None:
    result = run(name)
    assert result.stderr.splitlines()[-1] == f"Error: No such command '{name}'{guess}"
    assert (result.stdout, result.exit_code) == ("", 2)


def test_an_error_of_the_input_is_one_line_and_exit_1(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(path: Path, *more: object) -> None:
        raise PossmapError("this file is odd")

    monkeypatch.setattr(possmap.inspection.info, "info", refuse)
    (tmp_path / "site.possmap").touch()
    result = run("info", tmp_path / "site.possmap")
    assert (result.stderr, result.stdout) == ("possmap: this file is odd\n", "")
    assert result.exit_code == 1


def test_a_bug_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def stumble(path: Path, *more: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(possmap.inspection.info, "info", stumble)
    (tmp_path / "site.possmap").touch()
    with pytest.raises(ZeroDivisionError, match="a bug"):
        run("info", tmp_path / "site.possmap")


def in_a_shell(**environment: str) -> str:
    """Run the program with an environment, and return what it prints."""
    done = subprocess.run(
        AS_A_PROGRAM,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    return done.stdout


def test_a_shell_gets_its_completion() -> None:
    script = in_a_shell(_POSSMAP_COMPLETE="bash_source")
    assert "complete -o nosort -F _possmap_completion possmap" in script


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("possmap ", list(COMMANDS)),
        ("possmap ex", ["export"]),
        ("possmap export --ov", ["--overwrite"]),
        ("possmap fuse --profile ", ["paper", "robust"]),
    ],
)
def test_commands_and_options_are_completed(words: str, expected: list[str]) -> None:
    position = str(len(words.split(" ")) - 1)
    text = in_a_shell(_POSSMAP_COMPLETE="bash_complete", COMP_WORDS=words, COMP_CWORD=position)
    assert [line.partition(",")[2] for line in text.splitlines()] == expected


def test_a_log_is_completed_as_a_file() -> None:
    text = in_a_shell(
        _POSSMAP_COMPLETE="bash_complete", COMP_WORDS="possmap fuse da", COMP_CWORD="2"
    )
    assert text == "file,da\n"


def test_help_starts_without_the_heavy_libraries() -> None:
    code = (
        "import sys\nfrom possmap.cli.main import main\nmain(['--help'], standalone_mode=False)\n"
        "print(sorted({'numpy', 'yaml', 'tqdm', 'PIL', 'sqlite3'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_verbose_and_quiet_are_known_to_every_command(tmp_path: Path) -> None:
    for switch in ("-v", "-vv", "-q"):
        assert run(switch, "config").exit_code == 0


def variable_and_threads(**variables: str) -> str:
    """Return OPENBLAS_NUM_THREADS and the number of threads after a command and NumPy's import."""
    code = (
        "import os\nfrom possmap.cli.main import main\nmain(['config'], standalone_mode=False)\n"
        "import numpy\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'], len(os.listdir('/proc/self/task')))"
    )
    env = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=env | variables,
    )
    return done.stdout.splitlines()[-1]


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads in /proc")
def test_a_command_starts_no_threads_for_linear_algebra() -> None:
    assert variable_and_threads() == "1 1"


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads in /proc")
def test_whoever_wants_such_threads_gets_them() -> None:
    assert variable_and_threads(OPENBLAS_NUM_THREADS="2").startswith("2 ")

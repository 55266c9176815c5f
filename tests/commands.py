"""Helpers of the tests of commands: run one, and look at what it says and leaves."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from possmap.cli.main import main


def run(*args: object, env: Mapping[str, str | None] | None = None) -> Result:
    """Run a command in this process; a bug is an exception."""
    return CliRunner().invoke(main, [str(arg) for arg in args], catch_exceptions=False, env=env)


def refused(result: Result, code: int = 1) -> str:
    """Return why a command refuses: one line or a hint at its usage, and no result."""
    assert (result.stdout, result.exit_code) == ("", code)
    if code == 1:
        assert result.stderr.startswith("possmap: ") and result.stderr.count("\n") == 1
        return result.stderr.removeprefix("possmap: ").removesuffix("\n")
    usage, hint, blank, error = result.stderr.splitlines()
    assert usage.startswith("Usage: ") and hint.startswith("Try ") and not blank
    return error.removeprefix("Error: ")


def files(folder: Path) -> dict[str, bytes]:
    """Return what lies in a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


def fused(grid: Path, *logs: Mapping[str, Any], options: Sequence[object] = ()) -> Path:
    """Fuse logs, which are written beside the grid."""
    paths = [grid.with_name(f"{grid.stem}-{number}.json") for number in range(len(logs))]
    for path, log in zip(paths, logs, strict=True):
        path.write_text(json.dumps(log))
    result = run("fuse", *paths, "-g", grid, *options)
    assert result.exit_code == 0, result.output
    return grid

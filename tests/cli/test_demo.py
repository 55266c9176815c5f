"""``possmap demo``: a mission simulated, fused and drawn; what it takes by name."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from possmap.cli.main import main

SHORT = """{minutes: 1, robots: 2, world: {walls: [[0, 0, 6, 0], [6, 0, 6, 4], [0, 4, 6, 4],
 [0, 0, 0, 4]], home: [3, 2]}}"""


@pytest.mark.parametrize(
    ("args", "folder"), [(["short.yaml"], "possmap-demo"), (["short.yaml", "out"], "out")]
)
def test_a_demo_of_any_mission(
    args: list[str], folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("short.yaml").write_text(SHORT)
    result = CliRunner().invoke(main, ["demo", *args])
    assert result.exit_code == 0, result.output
    assert f"{folder}/site.png: the map, with the true walls" in result.stdout
    assert Path(folder, "site.possmap").exists() and Path(folder, "truth.json").exists()
    again = CliRunner().invoke(main, ["demo", *args])
    assert again.stderr == f"possmap: {folder}: holds something already; --overwrite replaces it\n"


def test_too_much_or_nothing_of_that_name_is_wrong_usage() -> None:
    assert CliRunner().invoke(main, ["demo", "maze", "a", "b"]).exit_code == 2
    assert CliRunner().invoke(main, ["demo", "gone.yaml"]).exit_code == 2

"""docs/simulate.md is true: its keys are the program's, its examples run."""

from __future__ import annotations

import re
import shlex
import shutil
from dataclasses import fields
from pathlib import Path

import pytest
from click.testing import CliRunner

from possmap.cli.main import main
from possmap.lab.simulate.mission_file import read_mission
from possmap.lab.simulate.settings import MissionSettings
from possmap.lab.simulate.world_file import WorldFile

pytestmark = pytest.mark.default_profile

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/simulate.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def rows() -> dict[str, str]:
    """Return key -> default, of all tables with a column of defaults."""
    found = {}
    for line in PAGE.splitlines():
        if line.startswith("| `") and line.count("|") >= 5:
            keys, defaults, *_ = [cell.strip() for cell in line.strip("|").split("|")]
            names = re.findall(r"`(\w+)`", keys)
            for name, default in zip(names, defaults.split(", "), strict=True):
                found[name] = default
    return found


def test_the_page_names_every_setting_with_its_default() -> None:
    told = rows()
    assert sorted(told) == sorted(field.name for field in fields(MissionSettings))
    default = MissionSettings()
    for name, text in told.items():
        value = getattr(default, name)
        if name == "behaviours":
            assert len(value) == 6 and text == "all six"
        elif isinstance(value, bool):
            assert text == str(value).lower()
        else:
            number, _, over = text.replace(" ", "").partition("/")
            assert value == pytest.approx(float(number) / float(over or 1))


def test_the_page_names_every_key_of_a_world() -> None:
    worlds = PAGE.partition("## Worlds")[2].partition("##")[0]
    assert {field.name for field in fields(WorldFile)} <= set(re.findall(r"`(\w+)`", worlds))


def test_the_page_names_every_shipped_mission() -> None:
    for path in (ROOT / "configs/missions").glob("*.yaml"):
        assert f"| `{path.stem}` |" in PAGE


def test_the_missions_on_the_page_are_missions(tmp_path: Path) -> None:
    (text,) = blocks("yaml")
    (tmp_path / "m.yaml").write_text(text)
    assert read_mission(tmp_path / "m.yaml", {}).settings.robots == 2


def test_the_commands_on_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    monkeypatch.chdir(tmp_path)
    commands = [line for block in blocks("sh") for line in block.splitlines()]
    assert len(commands) >= 8
    for command in commands:
        program, *args = shlex.split(command)
        assert program == "possmap"
        shorter = ["--set", "minutes=2"] if args[0] == "simulate" else []
        result = CliRunner().invoke(main, [*args, *shorter], catch_exceptions=False)
        assert result.exit_code == 0, f"{command}\n{result.output}"

"""The README and the docs are true: what they show is what a user gets."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from possmap.cli.main import COMMANDS, main

pytestmark = pytest.mark.default_profile

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "docs/pictures/demo.png"
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with the shipped data, and stand in it."""
    shutil.copytree(ROOT / "data", tmp_path / "data")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def sessions(text: str) -> list[tuple[str, str]]:
    """Return each command of the console blocks with the output shown below it."""
    found: list[tuple[str, str]] = []
    for block in re.findall(r"^```console\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, _, output = part.partition("\n")
            found.append((command, output))
    return found


def matches(shown: str, got: str) -> bool:
    """Compare output; a line of three dots stands for any lines."""
    pattern = re.escape(shown).replace(re.escape("...\n"), "(?:.*\n)*?")
    return re.fullmatch(pattern, got) is not None


@pytest.mark.parametrize(
    "page",
    [
        "README.md",
        "docs/evaluate.md",
        "docs/diff.md",
        "docs/export.md",
        "docs/convert.md",
        "docs/calibrate.md",
    ],
)
def test_the_commands_of_a_page_print_what_it_shows(page: str, clone: Path) -> None:
    commands = sessions((ROOT / page).read_text(encoding="utf-8"))
    assert len(commands) >= 2
    for command, shown in commands:
        program, *arguments = shlex.split(command)
        assert program == "possmap"
        result = CliRunner().invoke(main, arguments, prog_name="possmap")
        assert result.exit_code == 0, result.output
        assert matches(shown, result.output), f"{command}\n{result.output}"


def test_the_python_of_the_readme_runs(clone: Path) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    assert blocks
    for block in blocks:
        exec(compile(block, "README.md", "exec"), {})


def test_the_picture_of_the_readme_is_the_one_its_command_draws(clone: Path) -> None:
    from PIL import Image, ImageChops

    for arguments in (
        ["fuse", "data/json", "-g", "site.possmap"],
        ["render", "site.possmap", "-o", "site.png"],
    ):
        assert CliRunner().invoke(main, arguments).exit_code == 0
    with Image.open("site.png") as drawn, Image.open(ROOT / "docs/pictures/site.png") as shown:
        assert drawn.info["possmap:digest"] == shown.info["possmap:digest"]
        assert drawn.size == shown.size
        apart = ImageChops.difference(drawn.convert("RGB"), shown.convert("RGB"))
        assert apart.getbbox() is None, "draw docs/pictures/site.png anew"


def test_the_report_in_the_docs_is_the_one_that_evaluate_draws(clone: Path) -> None:
    from PIL import Image, ImageChops

    for line in (
        "fuse data/json -g site.possmap",
        "evaluate site.possmap --truth data/truth.json --picture report.png",
    ):
        assert CliRunner().invoke(main, line.split()).exit_code == 0
    with Image.open("report.png") as drawn, Image.open(ROOT / "docs/pictures/report.png") as shown:
        assert drawn.size == shown.size
        apart = ImageChops.difference(drawn.convert("RGB"), shown.convert("RGB"))
        assert apart.getbbox() is None, "draw docs/pictures/report.png anew"


def test_the_picture_of_the_demo_is_the_one_that_it_draws(clone: Path) -> None:
    """Almost: a simulation's last digits, and so a few pixels, may differ between platforms."""
    import numpy as np
    from PIL import Image

    assert "pip install . && possmap demo\n" in README
    assert CliRunner().invoke(main, ["demo"]).exit_code == 0
    with Image.open("possmap-demo/site.png") as drawn, Image.open(DEMO) as shown:
        assert drawn.size == shown.size
        apart = np.asarray(drawn.convert("RGB")) != np.asarray(shown.convert("RGB"))
    assert apart.any(axis=2).mean() < 0.01, "draw docs/pictures/demo.png anew"


def test_the_picture_of_the_page_on_diff_is_the_one_its_commands_draw(clone: Path) -> None:
    from PIL import Image, ImageChops

    for command, _ in sessions((ROOT / "docs/diff.md").read_text(encoding="utf-8")):
        assert CliRunner().invoke(main, shlex.split(command)[1:]).exit_code == 0
    with Image.open("diff.png") as drawn, Image.open(ROOT / "docs/pictures/diff.png") as shown:
        apart = ImageChops.difference(drawn.convert("RGB"), shown.convert("RGB"))
        assert apart.getbbox() is None, "draw docs/pictures/diff.png anew"


def test_every_command_stands_in_the_readme() -> None:
    for command in COMMANDS:
        assert f"`possmap {command}" in README


def test_links_lead_somewhere() -> None:
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "data").glob("*.md")]:
        text = page.read_text(encoding="utf-8")
        for link in re.findall(r"\]\(([^)#\s]+)", text):
            if "://" not in link:
                assert (page.parent / link).exists(), f"{page.name}: {link}"


def test_the_picture_of_the_page_on_convert_is_the_one_its_commands_draw(clone: Path) -> None:
    from PIL import Image, ImageChops

    for command, _ in sessions((ROOT / "docs/convert.md").read_text(encoding="utf-8"))[:3]:
        assert CliRunner().invoke(main, shlex.split(command)[1:]).exit_code == 0
    with Image.open("hall.png") as drawn, Image.open(ROOT / "docs/pictures/hall.png") as shown:
        apart = ImageChops.difference(drawn.convert("RGB"), shown.convert("RGB"))
        assert apart.getbbox() is None, "draw docs/pictures/hall.png anew"

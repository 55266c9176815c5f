"""A grid that is taken away while it is written, and what else a machine may refuse: one line."""

from __future__ import annotations

import shutil
import sqlite3
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from click.testing import CliRunner
from teams import digest
from versions import SETTINGS, log_of, written

import possmap
from possmap.cli.main import main
from possmap.errors import GridError
from possmap.grid.copying import selected
from possmap.grid.grid import Grid
from possmap.grid.selection import Selection


@pytest.fixture
def site(tmp_path: Path) -> Path:
    grid = tmp_path / "site.possmap"
    for robot in ("r1", "r2", "r3"):
        possmap.fuse(written(tmp_path, **{robot: log_of(robot, 4)}), grid, SETTINGS)
    return grid


@pytest.mark.parametrize("is_replaced", [False, True])
def test_a_grid_taken_away_while_it_is_written_is_told(site: Path, is_replaced: bool) -> None:
    other = Path(shutil.copy(site, site.with_name("other.possmap")))

    def taken_away() -> None:
        with Grid(site, write=True) as grid, grid.transaction():
            site.unlink()
            if is_replaced:
                other.rename(site)

    with pytest.raises(GridError, match="was removed or replaced while it was written"):
        taken_away()
    assert site.exists() == is_replaced


def test_a_mistake_in_our_own_statements_keeps_its_traceback(site: Path) -> None:
    with Grid(site, write=True) as grid, pytest.raises(sqlite3.IntegrityError):
        grid.database.execute("INSERT INTO setting VALUES (NULL, NULL)")
    with Grid(site) as grid, pytest.raises(sqlite3.OperationalError, match="no such column"):
        grid.database.all("SELECT other FROM setting")


def test_a_selection_is_a_grid_of_its_own(site: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone.possmap"
    possmap.fuse(written(tmp_path, r2=log_of("r2", 4)), alone, SETTINGS)
    with selected(site, Selection(robots=("r2",))) as part:
        assert digest(part) == digest(alone)
    assert not part.exists()
    with selected(site, Selection()) as part:
        assert part == site


def test_excursions_are_selected_by_arrival_name_and_robot(site: Path) -> None:
    now = datetime.now(UTC)
    with Grid(site) as grid:

        def robots(**given: object) -> list[str]:
            return [entry.robot for entry in Selection(**given).entries(grid)]  # type: ignore[arg-type]

        assert robots(last=2) == ["r2", "r3"]
        assert robots(excursions="[ab]") == robots(since=now - timedelta(days=1)) == [
            "r1", "r2", "r3",
        ]  # fmt: skip
        assert robots(robots=("r3", "r1"), last=1, until=now + timedelta(days=1)) == ["r3"]
        with pytest.raises(GridError, match=r"until .*: none of its 3 excursions"):
            robots(until=now - timedelta(days=1))


def test_a_time_that_is_none_is_wrong_usage(site: Path) -> None:
    result = CliRunner().invoke(main, ["forget", str(site), "--since", "yesterday"])
    assert result.exit_code == 2 and "expected a time such as 2026-11-30T18:00" in result.stderr

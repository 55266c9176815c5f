"""Forgetting gives the grid that would be there, had it never come (docs/trust.md)."""

from __future__ import annotations

import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from literal.teams import Log, random_team
from teams import ROBUST, digest, flat_settings, fuse, write_logs

import possmap
from possmap.errors import GridError
from possmap.fusing.forget import ForgetSummary, Target, forget, recall
from possmap.grid.grid import Grid
from possmap.grid.selection import Selection
from possmap.grid.verify import verify
from possmap.settings.request import Request, in_force

INDEPENDENCES = ("detection", "excursion")
SEEDS = [
    *range(24),
    *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1000, 1300)),
]


class Team:
    """A random team's logs, in files, and a grid of them, fused in any order in a few calls."""

    def __init__(self, seed: int, independence: str, folder: Path) -> None:
        self.rng = np.random.default_rng(7000 + seed)
        self.folder = folder
        self.logs, given = random_team(self.rng)
        profile = dict(ROBUST) if seed % 2 else {}
        if seed % 2 and independence == "detection":  # discounts are of whole excursions
            profile |= {"certainty_power": 1.0, "pass_weight": 1.0}
        self.settings: dict[str, Any] = {**given, **profile, "independence": independence}
        self.paths = write_logs(folder / "logs", self.logs)
        self.grid = folder / "site.possmap"
        order = self.rng.permutation(len(self.paths)).tolist()
        stop = int(self.rng.integers(0, len(order) + 1))
        for some in (order[:stop], order[stop:]):
            if some:
                fuse([self.paths[number] for number in some], self.grid, self.settings)
        self.excursions = sorted(
            {(one["robot"], one["excursion"]) for log in self.logs for one in versions(log)}
        )
        self._numbers = iter(range(10**6))

    def copy(self) -> Path:
        """Return another file with the same grid."""
        return Path(shutil.copy(self.grid, self.folder / f"copy{next(self._numbers)}.possmap"))

    def expected(self, logs: Sequence[Log]) -> str:
        """Return the digest of a grid of other logs, or of nothing."""
        number = next(self._numbers)
        grid = self.folder / f"expected{number}.possmap"
        if logs:
            fuse(write_logs(self.folder / f"expected{number}", logs), grid, self.settings)
        else:
            settings = in_force(Request(overrides=asked(self.settings)).given(), None, grid)
            with Grid(grid, write=True) as empty, empty.transaction():
                empty.prepare(settings.evidence, settings.robots)
        return digest(grid)

    def without(self, target: Target) -> list[Log]:
        """Return the logs without what a target names; each version as a log of its own."""
        return [
            {**one, "possmap_log": 1, "carried": []}
            for log in self.logs
            for one in versions(log)
            if one["robot"] != target.robot or target.excursion not in (None, one["excursion"])
        ]


def asked(settings: dict[str, Any]) -> dict[str, Any]:
    from possmap.settings.setting_table import parse_setting

    return {
        name: parse_setting(name, str(value).lower() if value in (True, False) else str(value), "")
        for name, value in flat_settings(settings).items()
    }


def versions(log: Log) -> list[Log]:
    """Return all that a log holds."""
    return [log, *log.get("carried", [])]


def check(grid: Path, summary: ForgetSummary, expected: str) -> None:
    assert summary.digest == digest(grid) == expected
    found = verify(grid, full=True)
    assert found.is_sound, found.faults


def was_there(grid: Path, target: Target) -> bool:
    """Forget something; return whether anything of it was still there."""
    try:
        forget(grid, target)
    except GridError as error:
        if "knows no" in str(error) or "brought nothing" in str(error):
            return False
        raise
    return True


@pytest.fixture(params=INDEPENDENCES)
def independence(request: pytest.FixtureRequest) -> str:
    found: str = request.param
    return found


@pytest.mark.parametrize("seed", SEEDS)
def test_without_a_robot_or_an_excursion_the_grid_is_that_of_the_logs_without_it(
    seed: int, independence: str, tmp_path: Path
) -> None:
    team = Team(seed, independence, tmp_path)
    targets = [Target(robot) for robot in sorted({robot for robot, _ in team.excursions})]
    targets += [Target(*name) for name in team.excursions]
    for target in targets:
        grid = team.copy()
        summary = forget(grid, target)
        check(grid, summary, team.expected(team.without(target)))
        assert {(one.robot, one.excursion) for one in summary.excursions} == {
            name
            for name in team.excursions
            if name[0] == target.robot and target.excursion in (None, name[1])
        }


@pytest.mark.parametrize("seed", SEEDS)
def test_without_a_file_the_grid_is_that_of_the_others(
    seed: int, independence: str, tmp_path: Path
) -> None:
    team = Team(seed, independence, tmp_path)
    for number, path in enumerate(team.paths):
        grid = team.copy()
        others = [log for other, log in enumerate(team.logs) if other != number]
        expected = team.expected(others)
        if team.logs[number] in others:  # the same bytes under another name are the same file
            expected = team.expected([log for log in others if log != team.logs[number]])
        summary = forget(grid, Target(brought_by=str(path)))
        check(grid, summary, expected)


@pytest.mark.parametrize("seed", range(16))
def test_one_after_the_other_in_any_order_and_recalled_it_is_all_there_again(
    seed: int, independence: str, tmp_path: Path
) -> None:
    team = Team(100 + seed, independence, tmp_path)
    grid, whole = team.copy(), digest(team.grid)
    targets = [Target(robot) for robot in sorted({robot for robot, _ in team.excursions})]
    targets += [Target(*name) for name in team.excursions]
    targets += [Target(brought_by=path.name) for path in team.paths]
    done = []
    for number in team.rng.permutation(len(targets)).tolist():
        if team.rng.random() < 0.5 and was_there(grid, targets[number]):
            done.append(targets[number])
    assert verify(grid, full=True).is_sound
    again = possmap.fuse(team.paths, grid)
    assert verify(grid, full=True).is_sound
    assert done == [] or again.count("refused") or any(log.note for log in again.logs)
    for target in done:
        recall(grid, target)
    fuse(team.paths, grid, {})
    assert digest(grid) == whole
    assert verify(grid, full=True).is_sound
    with possmap.open_grid(grid) as opened:
        assert opened.ledger.forgotten.all() == ()


@pytest.mark.parametrize("seed", range(16))
def test_what_is_forgotten_does_not_come_in_again_with_the_same_logs(
    seed: int, independence: str, tmp_path: Path
) -> None:
    team = Team(200 + seed, independence, tmp_path)
    robot = team.excursions[-1][0]
    file = Target(brought_by=team.paths[0].name)
    for target in (Target(robot), file):
        grid = team.copy()
        gone = forget(grid, target).digest
        for path in team.paths:
            possmap.fuse([path], grid)
        expected = team.logs[1:] if target is file else team.without(target)
        if target is file:
            expected = [log for log in expected if log != team.logs[0]]
        assert digest(grid) == gone == team.expected(expected)


KILLED = """
import os, signal, sys
from pathlib import Path
from possmap.fusing.forget import Target, forget
from possmap.grid.arrivals import Arrivals

def kill(self, name, gone):
    self._database.execute("PRAGMA cache_size = 1")  # so that pages reach the file
    self._database.execute("UPDATE cells SET data = randomblob(100000)")
    os.kill(os.getpid(), signal.SIGKILL)

Arrivals.drop = kill
forget(Path(sys.argv[1]), Target(sys.argv[2]))
"""


def test_a_kill_in_the_middle_leaves_everything_as_it_was(tmp_path: Path) -> None:
    team = Team(1, "detection", tmp_path)
    before, whole = team.grid.read_bytes(), digest(team.grid)
    code = [sys.executable, "-c", KILLED, str(team.grid), team.excursions[0][0]]
    assert subprocess.run(code, check=False).returncode == -signal.SIGKILL
    assert team.grid.read_bytes() != before, "the file is half-written"
    assert digest(team.grid) == whole
    assert team.grid.read_bytes() == before


def test_what_cannot_be_subtracted_is_made_again_of_what_stays(tmp_path: Path) -> None:
    """As on a machine whose maths library computes places otherwise in the last unit."""
    team = Team(1, "detection", tmp_path)
    with sqlite3.connect(team.grid) as connection:
        connection.execute("UPDATE record SET half_x = half_x * 1.0000001 WHERE half_x > 0")
    connection.close()
    target = Target(team.excursions[0][0])
    assert forget(team.grid, target).digest == team.expected(team.without(target))


def test_a_record_that_nobody_can_read_can_be_forgotten(tmp_path: Path) -> None:
    team = Team(1, "detection", tmp_path)
    robot = team.excursions[0][0]
    with sqlite3.connect(team.grid) as connection:
        connection.execute(
            "UPDATE record SET kind = 'pole' WHERE excursion IN"
            " (SELECT id FROM excursion WHERE robot = ?)",
            (robot,),
        )
    connection.close()
    summary = forget(team.grid, Target(robot))
    check(team.grid, summary, team.expected(team.without(Target(robot))))


def test_a_dry_run_says_what_would_go_and_changes_nothing(tmp_path: Path) -> None:
    team = Team(1, "detection", tmp_path)
    before, target = team.grid.read_bytes(), Target(team.excursions[0][0])
    foreseen = forget(team.grid, target, dry_run=True)
    assert team.grid.read_bytes() == before
    done = forget(team.grid, target)
    assert (foreseen.digest, foreseen.excursions) == (done.digest, done.excursions)


def test_a_selection_forgets_what_came_last(tmp_path: Path) -> None:
    team = Team(1, "detection", tmp_path)
    with Grid(team.grid) as grid:
        last = Selection(last=1).entries(grid)[0].name
    summary = forget(team.grid, Selection(last=1))
    check(team.grid, summary, team.expected(team.without(Target(*last))))

"""The whole of METHOD, against a literal, slow reading of it: N and Π agree in every cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from literal.method import literal_grid
from literal.teams import random_team
from teams import cells, fuse, largest_difference, write_logs

TEAMS = 300
GROUPS = 10


@pytest.mark.parametrize("group", range(GROUPS))
def test_random_teams_fuse_to_what_the_literal_method_says(group: int, tmp_path: Path) -> None:
    for number in range(group, TEAMS, GROUPS):
        logs, settings = random_team(np.random.default_rng(number))
        grid = tmp_path / f"{number}.possmap"
        fuse(write_logs(tmp_path / str(number), logs), grid, settings)
        expected = literal_grid(logs, settings)
        necessity, possibility, points = cells(grid)
        assert largest_difference(necessity, expected.necessity, 0.0) < 1e-4, number
        assert largest_difference(possibility, expected.possibility, 1.0) < 1e-4, number
        assert largest_difference(points, expected.points, 0.0) < 1e-4, number

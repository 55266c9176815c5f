"""The whole of METHOD, against a literal, slow reading of it: N and Π agree in every cell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from literal.method import literal_grid, literal_half_widths
from literal.teams import random_team, telling_of_turns, walls_settings
from teams import ROBUST, cells, flat_settings, fuse, largest_difference, write_logs

import possmap
from possmap.core.correction import correct
from possmap.core.estimators import at_start
from possmap.core.propagation import propagate
from possmap.core.records import Pose
from possmap.core.track import stretches
from possmap.logs import read_log
from possmap.settings.limits import Limits
from possmap.settings.settings import assemble

TEAMS = 300
GROUPS = 10


@pytest.mark.parametrize("options", [{}, ROBUST], ids=["any", "robust"])
@pytest.mark.parametrize("group", range(GROUPS))
def test_random_teams_fuse_to_what_the_literal_method_says(
    group: int, options: Mapping[str, Any], tmp_path: Path
) -> None:
    """Any settings, and those of the profile ``robust`` with any error model."""
    for number in range(group, TEAMS, GROUPS):
        logs, drawn = random_team(np.random.default_rng(number))
        settings = {**drawn, **options}
        grid = tmp_path / f"{number}.possmap"
        fuse(write_logs(tmp_path / str(number), logs), grid, settings)
        expected = literal_grid(logs, settings)
        necessity, possibility, points = cells(grid)
        assert largest_difference(necessity, expected.necessity, 0.0) < 1e-4, number
        assert largest_difference(possibility, expected.possibility, 1.0) < 1e-4, number
        assert largest_difference(points, expected.points, 0.0) < 1e-4, number


@pytest.mark.parametrize("group", range(GROUPS))
def test_random_teams_whose_walls_measure_the_heading_fuse_as_the_literal_method_says(
    group: int, tmp_path: Path
) -> None:
    """Estimator `walls`, Dempster's free space, discounts; N, Π, Bel, Pl and λ, in two steps."""
    for number in range(group, TEAMS, GROUPS):
        team, drawn = random_team(np.random.default_rng(number))
        logs = telling_of_turns(team, number)
        settings = {**drawn, **walls_settings(np.random.default_rng([number, 18]))}
        grid = tmp_path / f"{number}.possmap"
        paths = write_logs(tmp_path / str(number), logs)
        fuse(paths[::2], grid, settings)
        fuse(paths[1::2], grid, {})
        expected = literal_grid(logs, settings)
        necessity, possibility, points = cells(grid)
        assert largest_difference(necessity, expected.necessity, 0.0) < 1e-4, number
        assert largest_difference(possibility, expected.possibility, 1.0) < 1e-4, number
        assert largest_difference(points, expected.points, 0.0) < 1e-4, number
        with possmap.open_grid(grid) as opened:
            window = opened.window
            views = [opened.view(name) for name in ("belief", "plausibility", "pignistic_logit")]
        for column, row in necessity.keys() | possibility.keys():
            assert window is not None
            at = row - window.row0, column - window.column0
            belief, plausibility, logit = expected.readouts((column, row))
            assert abs(views[0][at] - belief) < 2e-4, number
            assert abs(views[1][at] - plausibility) < 2e-4, number
            # Beside certainty a unit of 16 bits weighs much.
            close = min(1e-2, 1e-3 * math.exp(abs(logit))) if abs(logit) < 6 else 16.0
            assert abs(views[2][at] - logit) < max(1e-3, close), number


@pytest.mark.parametrize("group", range(GROUPS))
@pytest.mark.parametrize("estimator", ["linear", "heading"])
def test_random_tracks_have_the_errors_that_the_literal_method_says(
    estimator: str, group: int, tmp_path: Path
) -> None:
    """To 1e-9, squared where a difference of squares may be nothing but rounding."""
    for number in range(group, TEAMS, GROUPS):
        logs, drawn = random_team(np.random.default_rng(number))
        settings = {**drawn, "estimator": estimator}
        assembled = assemble(flat_settings(settings))
        for log, path in zip(logs, write_logs(tmp_path / str(number), logs), strict=True):
            version = read_log(path, Limits()).deliveries[0].version
            if not any(isinstance(record, Pose) for record in version.records):
                continue
            robot = assembled.robots.get(version.robot, {})
            model = assembled.evidence.model_in_force(version.model, robot)
            track = correct(stretches(version.records), model)
            first = next(record for record in version.records if isinstance(record, Pose))
            now = at_start(first, assembled.evidence.estimator)
            found = [now, *(error.after for error in propagate(now, track, model))]
            for error, expected in zip(found, literal_half_widths(log, settings), strict=True):
                rect = error.rectangle
                for half, literal in (
                    (rect.half_x, expected.half_x),
                    (rect.half_y, expected.half_y),
                    (error.heading_half, math.radians(expected.heading)),
                ):
                    close = abs(half - literal) < 1e-9
                    assert close or abs(half**2 - literal**2) < 1e-15, number

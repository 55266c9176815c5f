"""``possmap demo``: a shipped mission simulated, fused and drawn in one go."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from possmap.errors import OutputError, plural, printable
from possmap.fusing.fuse import FuseSummary, fuse
from possmap.lab.simulate.run import simulate
from possmap.lab.simulate.summary import Summary
from possmap.pictures.render import Look, render

MISSION = "figure8"
"""The mission shown unless another is asked for."""


@dataclass(frozen=True, slots=True)
class DemoSummary:
    """What the demo made. mission, fused: as the commands report; picture: the map."""

    folder: Path
    mission: Summary
    fused: FuseSummary
    picture: Path


def demo(
    path: Path,
    folder: Path,
    seed: int | None = None,
    overwrite: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> DemoSummary:
    """Simulate a mission into ``folder``, fuse its logs, draw the map beside the truth.

    Raises
    ------
    OutputError
        If the folder holds something already, or nobody came home.
    """
    overrides = {} if seed is None else {"seed": str(seed)}
    mission = simulate(path, folder, overrides, overwrite=overwrite, progress=progress)
    if not mission.home:
        raise OutputError(
            f"{printable(str(folder))}: nobody came home, so there is no map; try another --seed"
        )
    grid = folder / "site.possmap"
    if overwrite:
        grid.unlink(missing_ok=True)
    fused = fuse([str(folder / "logs")], grid)
    picture = folder / "site.png"
    truth = folder / "truth.json"
    told = json.loads(truth.read_text())
    x, y = told["home"]
    team = plural(len({robot["robot"] for robot in told["robots"]}), "robot")
    title = f"{team} from ({x:g}, {y:g})"
    look = Look(truth=truth, tracks=True, title=title, max_size=700)
    render(grid, picture, look, overwrite)
    return DemoSummary(folder, mission, fused, picture)

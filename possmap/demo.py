"""``possmap demo``: a shipped mission simulated, fused and drawn in one go."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from possmap.errors import OutputError, printable
from possmap.fusing.fuse import FuseSummary, fuse
from possmap.lab.simulate.run import simulate
from possmap.lab.simulate.summary import Summary
from possmap.pictures.render import Look, render
from possmap.settings.shipped import shipped

MISSION = "missions/figure8.yaml"


@dataclass(frozen=True, slots=True)
class DemoSummary:
    """What the demo made. mission, fused: as the commands report; picture: the map."""

    folder: Path
    mission: Summary
    fused: FuseSummary
    picture: Path


def demo(
    folder: Path,
    seed: int | None = None,
    overwrite: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> DemoSummary:
    """Simulate the shipped mission into ``folder``, fuse its logs, draw the map beside the truth.

    Raises
    ------
    OutputError
        If the folder holds something already, or nobody came home.
    """
    overrides = {} if seed is None else {"seed": str(seed)}
    mission = simulate(shipped(MISSION), folder, overrides, overwrite=overwrite, progress=progress)
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
    home = json.loads(truth.read_text())["home"]
    title = f"Three robots from I ({home[0]:g}, {home[1]:g})"
    render(grid, picture, Look(truth=truth, tracks=True, title=title), overwrite)
    return DemoSummary(folder, mission, fused, picture)

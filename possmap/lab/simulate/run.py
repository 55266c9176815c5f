"""``possmap simulate``: a mission driven, and written down as the host and the truth know it."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from PIL import Image

from possmap.atomic import check_output, replacing
from possmap.core.lattice import Lattice
from possmap.errors import OutputError, plural, printable
from possmap.lab.simulate.mission import Mission
from possmap.lab.simulate.mission_file import read_mission
from possmap.lab.simulate.summary import Summary, in_order, summarise
from possmap.pictures import overlays, palettes, raster
from possmap.pictures.frame import Panel, framed
from possmap.pictures.legend import Group, LegendEntry, circled, line, point
from possmap.pictures.overlays import Overlays
from possmap.pictures.palettes import write_png
from possmap.release import version

_PICTURE_RESOLUTION = 0.05


def simulate(
    path: Path,
    folder: Path,
    overrides: Mapping[str, str],
    *,
    picture: Path | None = None,
    overwrite: bool = False,
    progress: Any = None,
) -> Summary:
    """Drive a mission; write ``logs/``, ``truth.json`` and ``summary.json`` into a new folder.

    Parameters
    ----------
    path
        The mission file.
    overrides
        Values that beat the file's, as text.
    picture
        Where to draw the world, the true tracks and the meetings.
    progress
        Called with the simulated seconds gone and the mission's length.

    Raises
    ------
    SettingsError
        If the mission is wrong.
    OutputError
        If the folder cannot be made, or holds something already.
    """
    name = printable(str(folder))
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{name}: is no folder, expected one to be made")
    if folder.exists() and any(folder.iterdir()) and not overwrite:
        raise OutputError(f"{name}: holds something already; --overwrite replaces it")
    # A picture beside the logs has no folder yet.
    if picture is not None and picture.resolve().parent != folder.resolve():
        check_output(picture, overwrite)
    plan = read_mission(path, overrides)
    mission = Mission(plan.world, plan.settings)
    for time in mission:
        if progress is not None:
            progress(time, 60 * plan.settings.minutes)
    summary = summarise(mission)
    _write(folder, name, mission, summary)
    if picture is not None:
        with replacing(picture, overwrite) as stream:
            write_png(draw(mission, summary), stream, {"Software": f"possmap {version()}"})
    return summary


def _write(folder: Path, name: str, mission: Mission, summary: Summary) -> None:
    """Write everything beside, and only then into the folder."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        try:
            (beside / "logs").mkdir()
            came_home = [one for one in in_order(mission) if one.fate == "home"]
            for number, one in enumerate(came_home, 1):
                text = log_text(one.book.as_log())
                (beside / "logs" / f"{number:03d}-{one.excursion}.json").write_text(text)
            (beside / "truth.json").write_text(json.dumps(truth(mission)) + "\n")
            (beside / "summary.json").write_text(json.dumps(asdict(summary), indent=1) + "\n")
            _take_place(beside, folder)
        finally:
            shutil.rmtree(beside, ignore_errors=True)
    except OSError as error:
        raise OutputError(f"{name}: cannot be written: {error.strerror or error}") from error


def _take_place(beside: Path, folder: Path) -> None:
    """Move what was written into the folder; of what is there only earlier output makes room."""
    logs = folder / "logs"
    logs.mkdir(parents=True, exist_ok=True)
    for old in logs.glob("[0-9][0-9][0-9]-r*.json"):
        old.unlink()
    for log in sorted((beside / "logs").iterdir()):
        log.replace(logs / log.name)
    for name in ("truth.json", "summary.json"):
        (beside / name).replace(folder / name)


def log_text(log: Mapping[str, Any]) -> str:
    """Return a log as JSON that people can read: one record a line."""

    def lines(records: Iterable[Any]) -> str:
        return ",\n".join(f"    {json.dumps(record)}" for record in records)

    head = {key: value for key, value in log.items() if key not in ("records", "carried")}
    text = json.dumps(head)[:-1] + ',\n  "records": [\n' + lines(log["records"]) + "\n  ]"
    carried = [log_text(one).rstrip("\n") for one in log.get("carried", [])]
    if carried:
        text += ',\n  "carried": [\n' + ",\n".join(carried) + "\n  ]"
    return text + "}\n"


def truth(mission: Mission) -> dict[str, Any]:
    """Return what no robot knows (docs/logs.md, "The truth file")."""
    return {
        "possmap_truth": 1,
        "walls": mission.world.walls.tolist(),
        "home": list(mission.world.home),
        "robots": [one.as_truth() for robot in mission.robots for one in robot.excursions],
        "meetings": [
            [one.time, one.robot, one.peer, one.given, one.taken] for one in mission.meetings
        ],
    }


def draw(mission: Mission, summary: Summary) -> Image.Image:
    """Return a picture of the world, the true tracks and where robots met."""
    x0, y0, x1, y1 = mission.world.bounds
    window = Lattice(_PICTURE_RESOLUTION).window_of(x0, y0, x1, y1)
    chosen = raster.furnished_raster(window, False, None, None)
    image = Image.new("RGB", chosen.size, palettes.UNKNOWN)
    tracks = {
        robot.name: [[(row[1], row[2]) for row in one.track] for one in robot.excursions]
        for robot in mission.robots
    }
    drawn = Overlays(
        points=[(place, 1.0) for place in _meeting_places(mission)],
        homes=[mission.world.home],
        tracks=list(tracks.items()),
        truth=[tuple(wall) for wall in mission.world.walls.tolist()],
    )
    overlays.paint(image, drawn, chosen, _PICTURE_RESOLUTION)
    entries = [
        LegendEntry(line(palettes.TRUTH), "wall"),
        LegendEntry(circled("I"), "home"),
        LegendEntry(point, "meeting"),
        *(LegendEntry(line(colour), f"true track of {r}") for r, colour in drawn.robot_colours()),
    ]
    known = sum(outing.known for outing in summary.excursions)
    subtitle = (
        f"{plural(len(summary.excursions), 'excursion')}, {summary.home} home; "
        f"{plural(summary.meetings, 'meeting')}; the host knows {plural(known, 'record')}"
    )
    panel = Panel(image, chosen)
    return framed([panel], [Group(entries)], mission.world.name, subtitle, _PICTURE_RESOLUTION)


def _meeting_places(mission: Mission) -> list[tuple[float, float]]:
    """Return where robots met: where the first of the two truly was."""
    tracks = {
        robot.name: [row for one in robot.excursions for row in one.track]
        for robot in mission.robots
    }
    places = []
    for meeting in mission.meetings:
        row = min(tracks[meeting.robot], key=lambda row: abs(row[0] - meeting.time))
        places.append((row[1], row[2]))
    return places

"""Missions: what a file and the command line say, and what is refused in one line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from possmap.errors import SettingsError
from possmap.lab.simulate.floor_plan import united
from possmap.lab.simulate.mission_file import MissionPlan, read_mission
from possmap.lab.simulate.settings import MissionSettings
from possmap.settings.limits import Limits
from possmap.settings.shipped import shipped
from possmap.truth.truth import read_truth

MISSIONS = sorted(shipped("missions").glob("*.yaml"))
DATA = Path(__file__).resolve().parents[2] / "data"

HALL = "walls: [[0, 0, 6, 0], [6, 0, 6, 4], [0, 4, 6, 4], [0, 0, 0, 4]], home: [3, 2]"
"""A bare hall of 6 x 4 m."""
WITHOUT_HOME = HALL.partition(", home")[0]


def read(folder: Path, text: str, overrides: Mapping[str, str] | None = None) -> MissionPlan:
    path = folder / "site.yaml"
    path.write_text(text)
    return read_mission(path, overrides or {})


def refusal(folder: Path, text: str, overrides: Mapping[str, str] | None = None) -> str:
    """Return why a mission is refused, after the file's folder."""
    with pytest.raises(SettingsError) as caught:
        read(folder, text, overrides)
    message = str(caught.value)
    assert message.isprintable(), "one line, no terminal codes"
    return message.removeprefix(f"{folder}/")


def walls_of(mission: MissionPlan) -> set[tuple[float, ...]]:
    return {tuple(wall) for wall in mission.world.walls.tolist()}


def test_a_mission_is_a_world_and_flat_settings_and_all_else_the_papers(tmp_path: Path) -> None:
    mission = read(
        tmp_path,
        f"""
        robots: 5
        minutes: 2.5
        exchange: false
        behaviours: [normal-left, anxious-right]
        memory_bytes: 2400
        world: {{{HALL}}}
        """,
    )
    assert mission.settings == MissionSettings(
        robots=5,
        minutes=2.5,
        exchange=False,
        behaviours=("normal-left", "anxious-right"),
        memory_bytes=2400,
    )
    assert mission.world.name == "site"
    assert mission.world.home == (3, 2)
    assert walls_of(mission) == {(0, 0, 6, 0), (6, 0, 6, 4), (0, 4, 6, 4), (0, 0, 0, 4)}
    assert mission.world.drops.shape == (0, 4)


def test_the_command_line_beats_the_file(tmp_path: Path) -> None:
    text = f"robots: 5\nseed: 7\nworld: {{{HALL}}}"
    overrides = {
        "robots": "2",
        "log_ir": "true",
        "behaviours": "normal-left,routine-right",
        "world.home": "[1, 1]",
    }
    mission = read(tmp_path, text, overrides)
    assert mission.settings == MissionSettings(
        robots=2, seed=7, log_ir=True, behaviours=("normal-left", "routine-right")
    )
    assert mission.world.home == (1, 1)
    office = "world: {generate: office, size: [20, 10]}"
    larger = read(tmp_path, office, {"world.size": "30,20", "world.seed": "2"})
    assert larger.world.bounds == (0, 0, 30, 20)
    written = read(tmp_path, "world: {generate: office, size: [30, 20], seed: 2}")
    assert np.array_equal(larger.world.walls, written.world.walls)
    assert larger.world.home == written.world.home
    assert read(tmp_path, f"world: {{{HALL}}}", {"behaviours": "normal-left"}).settings.behaviours


def test_rooms_have_doors_that_open_every_wall_on_their_line(tmp_path: Path) -> None:
    mission = read(
        tmp_path,
        """
        world:
          walls: [[0, 4, 9, 4]]           # over the north of the rooms
          rooms:
            - at: [0, 0, 4, 4]
              doors: [[north, 1, 2], [east, 1, 1.8]]
            - at: [4, 0, 9, 4]            # its west side opens too
          obstacles: [[8, 0, 9, 1]]
          drops: [[6, 2, 7, 3]]
          home: [2, 2]
        """,
    )
    assert walls_of(mission) == {
        (0, 0, 9, 0),
        (0, 4, 1, 4),
        (2, 4, 9, 4),
        (0, 0, 0, 4),
        (4, 0, 4, 1),
        (4, 1.8, 4, 4),
        (9, 0, 9, 4),
        (8, 1, 9, 1),
        (8, 0, 8, 1),
    }
    assert mission.world.drops.tolist() == [[6, 2, 7, 3]]


def test_a_world_can_be_shared_and_added_to(tmp_path: Path) -> None:
    (tmp_path / "worlds").mkdir()
    (tmp_path / "worlds" / "hall.yaml").write_text(f"{{{HALL}}}")
    plain = read(tmp_path, "world: {file: worlds/hall.yaml}")
    assert walls_of(plain) == walls_of(read(tmp_path, f"world: {{{HALL}}}"))
    more = "world: {file: worlds/hall.yaml, obstacles: [[1, 1, 2, 2]], home: [5, 1]}"
    added = read(tmp_path, more)
    assert walls_of(added) == walls_of(plain) | {
        (1, 1, 2, 1),
        (1, 2, 2, 2),
        (1, 1, 1, 2),
        (2, 1, 2, 2),
    }
    assert added.world.home == (5, 1)


def test_a_world_can_be_an_image_or_a_ros_map(tmp_path: Path) -> None:
    image = np.zeros((6, 8), dtype=np.uint8)
    image[1:5, 1:7] = 255
    Image.fromarray(image).save(tmp_path / "plan.png")
    bare = read(tmp_path, "world: {image: plan.png, resolution: 1, home: [3, 3]}")
    assert bare.world.bounds == (1, 1, 7, 5)
    there = "world: {image: plan.png, resolution: 0.5, origin: [-2, -1], home: [0, 0]}"
    assert read(tmp_path, there).world.bounds == (-1.5, -0.5, 1.5, 1.5)
    (tmp_path / "map.yaml").write_text(
        "{image: plan.png, resolution: 1, origin: [-4, -3, 0], negate: 0, "
        "occupied_thresh: 0.65, free_thresh: 0.25}"
    )
    mapped = read(tmp_path, "world: {map: map.yaml, home: [0, 0]}")
    assert mapped.world.bounds == (-3, -2, 3, 2)
    for world in ("image: plan.png, resolution: 1, origin: [-4, -3]", "map: map.yaml"):
        found = refusal(
            tmp_path, f"world: {{{world}, home: [-3.5, 0], obstacles: [[-4, 4, 4, 5]]}}"
        )
        assert "home, found [-3.5, 0], inside a wall or an obstacle, expected free floor" in found


W = "site.yaml:1: world"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "site.yaml: is empty, expected a mission"),
        ("[1]", "site.yaml:1: found [1], expected keys of a mission"),
        ("robots: 3", "site.yaml: world is missing"),
        (f"robts: 3\nworld: {{{HALL}}}", 'site.yaml:1: unknown key "robts", did you mean "robot'),
        (f"seed: 1\nseed: 2\nworld: {{{HALL}}}", 'site.yaml:2: "seed" is given twice'),
        (f"\nrobots: 0\nworld: {{{HALL}}}", 'site.yaml:2: robots, found "0", expected a whole'),
        (f"speed: .nan\nworld: {{{HALL}}}", 'site.yaml:1: speed, found ".nan", expected a number'),
        (f"behaviours: [brave-left]\nworld: {{{HALL}}}", 'site.yaml:1: behaviours[0], found "brav'),
        (f"behaviours: []\nworld: {{{HALL}}}", "site.yaml:1: behaviours, found a list, expected o"),
        ("world: hall", 'site.yaml:1: world, found "hall", expected walls'),
        ("world: {}", f"{W}, found no walls, expected some"),
        ("world: {wals: []}", 'site.yaml:1: unknown key "wals" of world, did you mean "walls"?'),
        ("world: {walls: [[0, 0, 1]]}", f"{W}.walls[0], found [0, 0, 1], expected [x, y, x2, y2]"),
        ("world:\n  walls:\n    - [0, 0, 3, 2]", "site.yaml:3: world.walls[0], found [0, 0, 3, 2], "
         "expected a wall along x or y"),
        ("world: {walls: [[1, 1, 1, 1]]}", f"{W}.walls[0], found [1, 1, 1, 1], expected a wall w"),
        ("world: {rooms: [{doors: []}]}", f"{W}.rooms[0].at is missing, expected [x0, y0, x1, y1]"),
        ("world: {rooms: [{at: [0, 0, 0, 1]}]}", f"{W}.rooms[0].at, found [0, 0, 0, 1], expected"),
        ("world: {rooms: [{at: [0, 0, 3, 3], dors: []}]}", 'site.yaml:1: unknown key "dors" of '
         'world.rooms[0], did you mean "doors"?'),
        ("world: {rooms: [{at: [0, 0, 3, 3], doors: [[up, 1, 2]]}]}",
         f'{W}.rooms[0].doors[0].side, found "up", expected south, north, west or east'),
        ("world: {rooms: [{at: [0, 0, 3, 3], doors: [[north, 2, 4]]}]}",
         f"{W}.rooms[0].doors, found [north, 2, 4], expected from < to within 0 to 3"),
        ("world: {drops: [[1, 1, 0, 2]]}", f"{W}.drops[0], found [1, 1, 0, 2], expected"),
        (f"world: {{{WITHOUT_HOME}}}", "site.yaml: world.home is missing, expected [x, y]"),
        ("world: {generate: office}", f"{W}.size is missing, expected [x, y] in metres"),
        ("world: {generate: office, size: [1, 9]}", f'{W}.size.x, found "1", expected a number, 5'),
        ("world: {size: [9, 9]}", f"{W}.size, which only a world with generate: has"),
        ("world: {image: a.png, map: b.yaml}", f"{W}, found image and map, expected one of them"),
        ("world: {image: a.png, home: [0, 0]}", f"{W}.resolution is missing, expected the side"),
        ("world: {image: a.png, resolution: 1}", "a.png: cannot be read: No such file"),
        ("world: {map: map.yaml}", "map.yaml: cannot be read: No such file"),
        ('world: {file: ""}', f'{W}.file, found "", expected the path of a file'),
        ("world: {file: site.yaml}", 'site.yaml:1: unknown key "world" of world'),
    ],
)  # fmt: skip
def test_a_mission_that_is_none_is_refused(tmp_path: Path, text: str, problem: str) -> None:
    assert refusal(tmp_path, text).startswith(problem)


@pytest.mark.parametrize(
    ("home", "problem"),
    [
        ("[0, 2]", "0.00 m from a wall, expected at least 0.13 m, half the robot"),
        ("[0.1, 2]", "0.10 m from a wall, expected at least 0.13 m, half the robot"),
        ("[9, 2]", "outside the walls, expected within x 0 to 6 and y 0 to 4"),
        ("[4.5, 2.5]", "inside a wall or an obstacle, expected free floor"),
        ("[1.5, 3.5]", "where walls enclose a robot 0.15 m wide: it reaches 0."),
        ("[5.5, 0.5]", "at the drop [5.4, 0.4, 6, 1], expected 0.13 m off"),
        ("[5.3, 0.5]", "at the drop [5.4, 0.4, 6, 1], expected 0.13 m off"),
    ],
)
def test_home_must_be_a_place_to_set_out_from(tmp_path: Path, home: str, problem: str) -> None:
    text = f"""world:
  {WITHOUT_HOME.replace("walls: [", "walls: [[1, 3, 2, 3], [1, 3, 1, 4], [2, 3, 2, 4], ")}
  obstacles: [[4, 2, 5, 3]]
  drops: [[5.4, 0.4, 6, 1]]
  home: {home}
"""
    found = refusal(tmp_path, text)
    assert found.startswith(f"site.yaml:5: world.home, found {home}, {problem}")
    read(tmp_path, text, {"world.home": "3, 1"})


@pytest.mark.parametrize(
    ("overrides", "problem"),
    [
        ({"robts": "3"}, '--set: unknown key "robts", did you mean "robots"?'),
        ({"world.sise": "3"}, '--set: unknown key "world.sise", did you mean "world.size"?'),
        ({"world": "{}"}, '--set: unknown key "world"'),
        ({"world.walls": "[]"}, '--set: unknown key "world.walls"'),
        ({"robots": "many"}, '--set: robots, found "many", expected a whole number'),
        ({"robots": ""}, '--set: robots, found "", expected a value'),
        ({"robots": "[1"}, "--set robots:1: not YAML"),
        (
            {"robots": "10001"},
            '--set: robots, found "10001", expected a whole number >= 1, at mo',
        ),
        ({"world.home": "0, 0"}, "--set: world.home, found [0, 0], 0.00 m from a wall"),
        ({"world.home": "0"}, '--set: world.home, found "0", expected [x, y]'),
        ({"world.size": "9,9"}, "--set: world.size, which only a world with generate: has"),
    ],
)
def test_the_command_line_is_checked_as_the_file_is(
    tmp_path: Path, overrides: dict[str, str], problem: str
) -> None:
    assert refusal(tmp_path, f"world: {{{HALL}}}", overrides).startswith(problem)


def test_what_is_wrong_with_a_shared_world_is_said_of_its_own_file(tmp_path: Path) -> None:
    shared = tmp_path / "hall.yaml"
    for text, problem in (
        ("", "hall.yaml: is empty, expected a world"),
        ("\nwals: []", 'hall.yaml:2: unknown key "wals" of world, did you mean "walls"?'),
        ("file: hall.yaml", "hall.yaml:1: file, which a shared world cannot have again"),
        ("walls: []\nhome: [1]", "hall.yaml:2: world.home, found [1], expected [x, y]"),
    ):
        shared.write_text(text)
        assert refusal(tmp_path, "world: {file: hall.yaml}").startswith(problem)


def test_a_world_of_too_many_walls_is_refused(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(2, size=(400, 400), dtype=np.uint8) * 255
    Image.fromarray(noise).save(tmp_path / "noise.png")
    found = refusal(tmp_path, "world: {image: noise.png, resolution: 0.05, home: [10, 10]}")
    assert found.startswith("site.yaml:1: world, found ")
    assert found.endswith(" walls, expected at most 50000")


def test_doors_cannot_be_multiplied_without_end(tmp_path: Path) -> None:
    doors = ", ".join(["[south, 1, 2]"] * 300)
    rooms = f"{{at: [0, 0, 9, 9], doors: &d [{doors}]}}" + ", {at: [0, 0, 9, 9], doors: *d}" * 200
    found = refusal(tmp_path, f"world: {{rooms: [{rooms}], home: [3, 3]}}")
    assert found == "site.yaml:1: world.rooms, found a list, expected 50000 doors at most"


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.stem)
def test_shipped_missions_are_ready(path: Path) -> None:
    mission = read_mission(path, {})
    settings = mission.settings
    assert len(mission.world.walls) > 20
    assert mission.world.reachable(settings.width, 20.0) >= 20.0
    assert settings.robots % len(settings.behaviours) == 0 or settings.robots > 6
    assert path.read_text().startswith("# ")
    assert f"possmap simulate configs/missions/{path.name}" in path.read_text()


def test_figure_8_is_the_building_of_the_example_data() -> None:
    walls = read_truth(DATA / "truth.json", Limits()).walls
    drawn = [(min(x, x2), min(y, y2), max(x, x2), max(y, y2)) for x, y, x2, y2 in walls]
    mission = read_mission(shipped("missions/figure8.yaml"), {})
    assert mission.world.walls.tolist() == united(drawn).tolist()
    assert (mission.settings.robots, mission.world.home) == (3, (0.0, 0.0))

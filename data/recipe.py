"""Make the example data anew: three robots explore one orthogonal building.

``python data/recipe.py [OUTDIR]`` writes json/, jsonl/, csv/ and truth.json to OUTDIR (default: the
folder of this file). Same bytes on every run. Places are complex numbers, x + iy in metres; angles
are degrees, anticlockwise from +x. Each robot has two poses: where it truly is, which decides what
it senses, and where it believes to be, which is all that its log knows.
"""

import cmath
import csv
import io
import json
import math
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

SEED = 1998
SPEED = 0.6  # [m/s]
TURN_TIME = 1.0  # [s per 45 degrees]
GAP = (0.125, 0.145)  # from the robot's centre to a wall ahead at which it stops [m]
CONTACT = 0.105  # half the robot's length: what a bump switch feels [m]
HALF_BODY = 0.075  # half the robot's width [m]
REACH = 0.3  # of the proximity sensors to the side [m]
BEAM = 2.0  # of the ranging sensor [m]
# 95 % of two independent errors lie within 2.236 deviations: the paper's 2.5 x 11 in per 10 ft.
ALONG = 1.25 / 120 / 2.236  # deviation of a run's length, as a share of it
ACROSS = math.degrees(5.5 / 120 / 2.236)  # deviation of the heading of a free run [deg]
RECORD_BYTES, LINK = 24, 960  # a record on air [bytes], the infrared link [bytes/s]

Wall = tuple[complex, complex]
Value = float | int | str | bool
Record = dict[str, Value]


def polyline(*corners: float) -> list[Wall]:
    """Walls along x, y, x, y, ... [m]."""
    points = [complex(x, y) for x, y in zip(corners[::2], corners[1::2], strict=True)]
    return list(pairwise(points))


WALLS: list[Wall] = [
    *polyline(-7, -4, 7, -4, 7, 4, 4.5, 4, 4.5, 6, -7, 6, -7, -4),  # outside
    *polyline(-7, 0.9, -4.5, 0.9),  # north of the corridor: door of A, door of B between these
    *polyline(-3.4, 0.9, 2, 0.9),
    *polyline(3, 0.9, 7, 0.9),
    *polyline(-7, -0.9, -2.2, -0.9),  # south of the corridor: door of C, door of D
    *polyline(-1.2, -0.9, 4.2, -0.9),
    *polyline(5.3, -0.9, 7, -0.9),
    *polyline(-0.5, 0.9, -0.5, 3.6),  # between A and B, with a door
    *polyline(-0.5, 4.6, -0.5, 6),
    *polyline(2, -0.9, 2, -2.4),  # between C and D, with a door
    *polyline(2, -3.4, 2, -4),
    *polyline(-4.1, 6, -4.1, 5.5, -5.5, 5.5, -5.5, 6),  # cupboard in A
    *polyline(1.8, 4.2, 2.4, 4.2, 2.4, 4.8, 1.8, 4.8, 1.8, 4.2),  # pillar in B
    *polyline(-5.2, -2.9, -4.4, -2.9, -4.4, -2.2, -5.2, -2.2, -5.2, -2.9),  # crate in C
]

# Words of a route: a number runs so far; `ahead` runs up to an obstacle, `bump` into it; `left` and
# `right` follow the wall on that side to its end or to a corner, `right:1.2` for 1.2 m; `scan`
# takes ranges; `wait:3` stands still. The words below stand for several.
WORDS = {
    "roundR": "0.14 R90 0.2 right",  # about a convex corner
    "roundL": "0.14 L90 0.2 left",
    "endR": "0.14 R90 0.27 R90 0.16 right",  # about the end of a thin wall, to its other face
    "endL": "0.14 L90 0.27 L90 0.16 left",
}


def unit(degrees: float) -> complex:
    """Return the unit vector of an angle."""
    return cmath.rect(1, math.radians(degrees))


def wrap(degrees: float) -> float:
    """Return the angle within (-180, 180]."""
    return 180 - (180 - degrees) % 360


def ray(origin: complex, ahead: complex) -> float:
    """Return the distance from ``origin`` along the unit vector ``ahead`` to the nearest wall."""
    nearest = math.inf
    for wall in WALLS:
        a, b = ((end - origin) / ahead for end in wall)  # in the ray's frame: x ahead, y left
        if (a.imag > 0) != (b.imag > 0):
            crossing = a.real + (b.real - a.real) * a.imag / (a.imag - b.imag)
            nearest = min(nearest, crossing if crossing > 0 else math.inf)
    return nearest


def spot(first: complex, second: complex | None = None) -> dict[str, float]:
    """Return the coordinates of one or two places as a record has them, to the millimetre."""
    # Adding 0.0 makes a rounded -0.0 a plain zero.
    fields = {"x": round(first.real, 3) + 0.0, "y": round(first.imag, 3) + 0.0}
    if second is not None:
        fields |= {"x2": round(second.real, 3) + 0.0, "y2": round(second.imag, 3) + 0.0}
    return fields


class Robot:
    """One robot on one excursion.

    Parameters
    ----------
    name, excursion
        what its log is called.
    over_turn
        its fault: true turn minus commanded turn, to the left, per 45 degrees turned [deg].
    start, heading
        when it leaves home [s], and facing where [deg].
    """

    def __init__(
        self, name: str, excursion: str, over_turn: float, start: float, heading: float
    ) -> None:
        self.name, self.excursion, self.over_turn = name, excursion, over_turn
        self.rng = np.random.default_rng([SEED, *name.encode(), *excursion.encode()])
        self.t, self.true, self.believed = float(start), 0j, 0j
        self.true_heading = self.heading = float(heading)
        self.records: list[Record] = []
        self.carried: dict[tuple[str, str], list[Record]] = {}
        self.track: list[list[float]] = []
        self.last_corner = complex(math.inf)
        self.pose()

    def note(self, kind: str, t: float, **fields: Value) -> None:
        """Append a record to the log."""
        self.records.append({"seq": len(self.records), "kind": kind, "t": round(t, 2), **fields})

    def pose(self) -> None:
        """Log where the robot believes to be; keep where it is for the truth file."""
        here = spot(self.believed)
        self.note("pose", self.t, **here, heading=wrap(self.heading))
        true = (self.true.real, self.true.imag, wrap(self.true_heading))
        row = [round(self.t, 2), *(round(v, 4) for v in true), here["x"], here["y"]]
        self.track.append([*row, wrap(self.heading)])

    def logged(self, point: complex, done: float = 0, scale: float = 1) -> complex:
        """Return where the robot puts a true point that it senses ``done`` metres further on."""
        seen = (point - self.true - unit(self.true_heading) * done) / unit(self.true_heading)
        return self.believed + unit(self.heading) * (done / scale + seen)

    def move(self, distance: float, scale: float) -> None:
        """Drive straight on; the odometer reads ``distance / scale``."""
        self.true += unit(self.true_heading) * distance
        self.believed += unit(self.heading) * distance / scale
        self.t += abs(distance) / SPEED
        self.pose()

    def turn(self, degrees: float) -> None:
        """Turn on the spot, with the robot's fault."""
        self.heading += degrees
        self.true_heading += degrees + self.over_turn * abs(degrees) / 45
        self.t += TURN_TIME * abs(degrees) / 45
        self.pose()

    def free(self, length: float, gap: float) -> None:
        """Run ``length`` by the odometer, or up to ``gap`` before an obstacle."""
        self.true_heading += self.rng.normal(0, ACROSS)
        scale, ahead = 1 + self.rng.normal(0, ALONG), unit(self.true_heading)
        clear = min(ray(self.true + ahead * side * HALF_BODY * 1j, ahead) for side in (-1, 0, 1))
        distance = max(0.0, min(length * scale, clear - gap))
        for done, kind, fields in sorted(self.passing(distance, scale), key=lambda seen: seen[0]):
            self.note(kind, self.t + done / SPEED, **fields)
        if gap == CONTACT:
            bump = self.logged(self.true + ahead * clear, distance, scale)
            self.note("wall", self.t + distance / SPEED, **spot(bump, bump), followed=False)
        self.move(distance, scale)

    def passing(self, distance: float, scale: float) -> Iterator[tuple[float, str, Record]]:
        """Yield (metres run, kind, fields) of what is sensed to the sides of a free run."""
        ahead = unit(self.true_heading)
        for wall in WALLS:
            near, far = sorted(((p - self.true) / ahead for p in wall), key=lambda p: p.real)
            begin, end = max(near.real, 0), min(far.real, distance)
            if end - begin < 0.25 or abs(cmath.phase(far - near)) > math.radians(15):
                continue
            slope = (far - near).imag / (far - near).real
            p, q = (complex(s, near.imag + slope * (s - near.real)) for s in (begin, end))
            if p.imag * q.imag > 0 and max(abs(p.imag), abs(q.imag)) < REACH:
                ends = [self.logged(self.true + ahead * e, e.real, scale) for e in (p, q)]
                yield end, "wall", {**spot(*ends), "followed": False}
        if distance > 1.4:  # worth a look to both sides, half-way
            for side in (90, -90):
                yield distance / 2, "beam", self.beam(side, distance / 2, scale)

    def beam(self, bearing: float, done: float = 0, scale: float = 1) -> Record:
        """Return one range reading, ``bearing`` degrees left of the heading."""
        origin, direction = unit(self.true_heading) * done, unit(self.true_heading + bearing)
        reading = ray(self.true + origin, direction) + self.rng.normal(0, 0.005)
        hit = reading < BEAM
        sensor = self.true + origin
        ends = (sensor, sensor + direction * min(reading, BEAM))
        return {**spot(*(self.logged(end, done, scale) for end in ends)), "hit": hit}

    def scan(self) -> None:
        """Take five ranges at standstill, one per sensor; a second pose closes the list."""
        for bearing in (90, 45, 0, -45, -90):
            self.note("beam", self.t, **self.beam(bearing))
        self.wait(1.0)

    def wait(self, seconds: float) -> None:
        """Stand still."""
        self.t += seconds
        self.pose()

    def beside(self, side: int) -> Wall:
        """Return the wall close to the left (1) or right (-1), its ends in order of travel."""
        ahead = unit(self.true_heading)
        for wall in WALLS:
            begin, end = sorted(wall, key=lambda p: (p / ahead).real)
            near, far = (begin - self.true) / ahead, (end - self.true) / ahead
            if abs(cmath.phase(far - near)) > math.radians(20):
                continue
            sideways = near.imag - near.real * (far - near).imag / (far - near).real
            if near.real < 0.1 < far.real and 0.08 < side * sideways < 0.22:
                return begin, end
        raise RuntimeError(f"{self.name} has no wall beside it at {self.true:.2f}")

    def follow(self, side: int, limit: float) -> None:
        """Line up with a wall and follow it, up to 4 m a run, to its end, a corner or ``limit``."""
        begin, end = self.beside(side)
        # The wall sets the robot straight, and in an orthogonal building it knows how it stands.
        self.true_heading = math.degrees(cmath.phase(end - begin))
        self.heading = 90.0 * round(self.heading / 90)
        ahead, gap = unit(self.true_heading), self.rng.uniform(*GAP)
        foot = 1j * ((begin - self.true) / ahead).imag  # of the robot on the wall, seen from it
        edge, back = ((begin - self.true) / ahead).real, -ray(self.true, -ahead)
        first = max(edge, back) if max(edge, back) > -0.2 else 0.0  # just turned a corner: from it
        if edge > max(back, -0.2):
            self.corner(begin)
        turned = False
        while not turned:
            front, rest = ray(self.true, ahead), ((end - self.true) / ahead).real
            left = min(front - gap, rest, limit)
            distance = left if left < 4 else self.rng.uniform(2, 3.5)
            turned = distance == left
            last = min(front, rest) if turned and left < limit else distance
            scale = 1 + self.rng.normal(0, ALONG)
            tip = self.true + ahead * (last + foot)
            start = self.logged(self.true + ahead * (first + foot))
            stop = self.logged(tip, distance, scale)
            self.note("wall", self.t + distance / SPEED, **spot(start, stop), followed=True)
            if turned and left < limit:
                self.corner(tip, distance, scale, concave=front - gap < rest)
            self.move(distance, scale)
            limit, first = limit - distance, 0.0

    def corner(
        self, point: complex, done: float = 0, scale: float = 1, *, concave: bool = False
    ) -> None:
        """Log a singular point, unless it is the last one again, seen from its other side."""
        if abs(point - self.last_corner) > 0.01:
            walls = sum(abs(point - end) < 0.01 for wall in WALLS for end in wall)
            kind = "concave" if concave else "convex" if walls > 1 else "end"
            place = spot(self.logged(point, done, scale))
            self.note("corner", self.t + done / SPEED, **place, corner=kind)
        self.last_corner = point

    def drive(self, route: str) -> None:
        """Drive the words of a route."""
        for word in " ".join(WORDS.get(w, w) for w in route.split()).split():
            name, _, number = word.partition(":")
            match name:
                case "left" | "right":
                    self.follow(1 if name == "left" else -1, float(number or "inf"))
                case "ahead":
                    self.free(math.inf, self.rng.uniform(*GAP))
                case "bump":
                    self.free(math.inf, CONTACT)
                    self.move(-0.03, 1)  # room to turn
                case "scan":
                    self.scan()
                case "wait":
                    self.wait(float(number))
                case _ if name[0] in "LR":
                    self.turn(float(name[1:]) * (1 if name[0] == "L" else -1))
                case _:
                    self.free(float(name), self.rng.uniform(*GAP))


def meet(one: Robot, other: Robot) -> list[Value]:
    """Let two robots hand over their finished records, and what they carry; return the meeting."""
    start = max(one.t, other.t)  # who hears the other first, waits
    own = [(robot, list(robot.records)) for robot in (one, other)]
    bags = [{(robot.name, robot.excursion): log, **robot.carried} for robot, log in own]
    given = [0, 0]
    for i, robot in enumerate((one, other)):
        for key, log in bags[1 - i].items():
            known = robot.carried.get(key, [])
            if key != (robot.name, robot.excursion) and len(log) > len(known):
                given[1 - i] += len(log) - len(known)
                robot.carried[key] = log
    end = start + sum(given) * RECORD_BYTES / LINK
    for robot, (peer, log) in zip((one, other), reversed(own), strict=True):
        upto = len(log) - 1
        robot.note("meet", end, peer=peer.name, peer_excursion=peer.excursion, upto=upto)
        robot.wait(end - robot.t)
    return [round(end, 2), one.name, other.name, given[0], given[1]]


def mission() -> tuple[list[Robot], Robot, list[list[Value]]]:
    """Return the excursions in the order of their return, the lost one, and the meetings."""
    # r3 crosses the corridor, goes once around the pillar in B and makes for the door to A.
    r3 = Robot("r3", "a", 2.0, start=0, heading=0)
    r3.drive("2.5 L90 3.0 scan ahead L90 right roundR roundR roundR roundR 1.4")
    # r2 keeps the wall on its left, from the corridor into B, and meets r3 in the door to A.
    r2 = Robot("r2", "a", -1.2, start=12, heading=90)
    r2.drive("ahead R90 left endL R90 left")
    meetings = [meet(r2, r3)]
    # r1 keeps the wall on its right, from the corridor into A, where r3 comes from B.
    r1 = Robot("r1", "a", 1.5, start=5, heading=90)
    r1.drive("ahead L90 right endR L90 right 1.0 right L90 right L90 scan")
    r3.drive("wait:1 3.4 scan R90 ahead")
    meetings.append(meet(r1, r3))
    # What r3 sees from here on, nobody will know: a wheel jams in C.
    r3.drive("R90 R90 2.4 ahead R90 left 0.14 L90 0.27 L90 0.16 left:1.4 R90 2.5 R45 1.4")
    r1.drive("right roundR roundR L90 right L90 right:4 scan right L90 right endR")
    r1.drive("L90 right L90 right:2.4 scan right wait:6 2.2 L90 0.77")  # r2 goes home first
    r2.drive("1.0 left R90 left:2.4 scan left R90 left roundL R90 left R90 left endL")
    r2.drive("R90 left R90 left 3.0 left:2.3 R90 0.77")
    # Second outings, to the south: r1 into C with its crate, r2 into D and back by the corridor.
    r1b = Robot("r1", "b", 1.5, start=math.ceil(r1.t) + 30, heading=180)
    r1b.drive("3.4 L90 ahead L90 right 0.14 R90 0.27 R90 0.16 right:2.6 L90 bump")
    r1b.drive("R90 left roundL roundL roundL ahead L90 right L90 right L90 right:3.5 scan right")
    r1b.drive("L90 right 1.0 right L90 right 0.14 R90 0.27 R90 0.16 right:1.2 L90 0.77")
    r2b = Robot("r2", "b", -1.2, start=math.ceil(r2.t) + 45, heading=0)
    r2b.drive("2.0 R45 ahead L45 right endR L90 right 1.0 right L90 right:3.6 scan right")
    r2b.drive("L90 right L90 right 0.55 R90 bump L90 right 1.0 right:1.9 L90 0.77")
    return sorted([r1, r2, r1b, r2b], key=lambda robot: robot.t), r3, meetings


def readable(value: object, indent: str = "") -> str:
    """Return JSON for people: whatever holds no further lists, such as a record, on one line."""
    inner = indent + "  "
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    if not any(isinstance(part, (dict, list)) for part in parts):
        return json.dumps(value)
    if isinstance(value, dict):
        rows = [f"{inner}{json.dumps(key)}: {readable(v, inner)}" for key, v in value.items()]
    else:
        rows = [inner + readable(part, inner) for part in parts]
    first, last = "{}" if isinstance(value, dict) else "[]"
    return f"{first}\n" + ",\n".join(rows) + f"\n{indent}{last}"


def as_json(robot: Robot) -> str:
    """Return what a robot delivers to the host."""
    log: dict[str, object] = {"possmap_log": 1, **title(robot.name, robot.excursion)}
    log["records"] = robot.records
    log["carried"] = [{**title(*key), "records": known} for key, known in robot.carried.items()]
    return readable(log) + "\n"


def title(robot: str, excursion: str) -> dict[str, object]:
    """Return the name of an excursion."""
    return {"robot": robot, "excursion": excursion}


def as_jsonl(robots: list[Robot]) -> str:
    """Return all deliveries, one after the other."""
    rows: list[object] = []
    for robot in robots:
        rows += [{"possmap_log": 1, **title(robot.name, robot.excursion)}, *robot.records]
        for key, records in robot.carried.items():
            rows += [title(*key), *records]
    return "".join(json.dumps(row) + "\n" for row in rows)


def as_csv(robots: list[Robot]) -> str:
    """Return every excursion once, in the longest version that came home."""
    longest: dict[tuple[str, str], list[Record]] = {}
    for robot in robots:
        known = {(robot.name, robot.excursion): robot.records, **robot.carried}
        for key, records in known.items():
            longest[key] = max(longest.get(key, []), records, key=len)
    columns = "robot excursion seq kind t x y heading x2 y2 corner followed hit peer peer_excursion"
    text = io.StringIO()
    table = csv.DictWriter(text, f"{columns} upto".split(), lineterminator="\n")
    table.writeheader()
    for key, records in longest.items():
        for record in records:
            words = {k: str(v).lower() if isinstance(v, bool) else v for k, v in record.items()}
            table.writerow({**title(*key), **words})
    return text.getvalue()


def as_truth(robots: list[Robot], lost: Robot, meetings: list[list[Value]]) -> str:
    """Return what no robot knows."""
    truth: dict[str, object] = {"possmap_truth": 1, "home": [0.0, 0.0], "meetings": meetings}
    truth["walls"] = [[a.real, a.imag, b.real, b.imag] for a, b in WALLS]
    truth["robots"] = [
        {
            **title(robot.name, robot.excursion),
            "fate": "lost" if robot is lost else "home",
            "why": "a wheel jammed" if robot is lost else "its tour was done",
            "track": robot.track,
        }
        for robot in [*robots, lost]
    ]
    return readable(truth) + "\n"


def main() -> None:
    """Write the example data."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    robots, lost, meetings = mission()
    texts = {
        f"json/{i:02}-{robot.name}-{robot.excursion}.json": as_json(robot)
        for i, robot in enumerate(robots, 1)
    }
    texts["jsonl/team.jsonl"], texts["csv/team.csv"] = as_jsonl(robots), as_csv(robots)
    texts["truth.json"] = as_truth(robots, lost, meetings)
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()

"""Random teams: valid logs and flat settings, small enough for the literal reading.

Numbers have at most four decimals, so they are the same in every encoding of LOGS.md. Choices
that rounding errors alone would decide are left out: no wall lies in its run's own line, and none
lies on a border of cells (of the round resolutions), where the last bit says what it touches.
"""

from __future__ import annotations

import copy
import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")
Log = dict[str, Any]  # decoded JSON, as LOGS.md describes it

ROUND_RESOLUTIONS = (0.1, 0.125, 0.2, 0.25)
BORDER = 0.025  # every border of a round resolution's cells is a multiple of it [m]
CSV_COLUMNS = (
    "robot",
    "excursion",
    "seq",
    "kind",
    "t",
    "x",
    "y",
    "heading",
    "x2",
    "y2",
    "corner",
    "followed",
    "hit",
    "peer",
    "peer_excursion",
    "upto",
    "error_x",
    "error_y",
    "error_heading",
)

# Error-model parameters and the range from which a team draws them.
MODEL_RANGES: Mapping[str, tuple[float, float]] = {
    "along": (0.0, 0.03),
    "across": (0.0, 0.06),
    "turn_bias": (-2.5, 2.5),
    "turn_gain": (-0.06, 0.06),
    "turn_spread": (0.0, 2.5),
    "turn_noise": (0.0, 2.5),
    "drift": (-5.0, 5.0),
    "drift_spread": (0.0, 4.0),
    "scale": (0.93, 1.07),
    "alignment_spread": (0.0, 2.0),
    "sensor": (0.0, 0.05),
    "max_error": (0.3, 1.3),
    "factor": (1.0, 3.0),
}


def random_team(rng: np.random.Generator) -> tuple[list[Log], dict[str, Any]]:
    """Return the logs of one to three robots, with what they carried, and settings for them."""
    robots = ["r1", "r2", "Ada:3.b"][: int(rng.integers(1, 4))]
    excursions = []
    for robot in robots:
        for number in range(int(rng.choice([1, 1, 2, 3]))):
            log = random_excursion(rng, robot, f"2026-05-04-{'abc'[number]}")
            if rng.random() < 0.3:
                log["model"] = _random_model(rng, share=0.35)
            excursions.append(log)
    logs = [copy.deepcopy(log) for log in excursions]
    for log in logs:
        if rng.random() < 0.5:
            _load(rng, log, excursions)
    if rng.random() < 0.3:
        # A robot's half-finished log, delivered before the whole one or after it.
        logs.insert(int(rng.integers(len(logs) + 1)), _prefix(rng, _pick(rng, excursions)))
    if len(logs) > 1 and rng.random() < 0.25:
        # One that never came home: what is known of it is what others carry, if they do.
        logs.pop(int(rng.integers(len(logs))))
    return logs, _random_settings(rng, robots)


def random_excursion(rng: np.random.Generator, robot: str, excursion: str) -> Log:
    """One valid log without a model and without anything carried."""
    diary = _Diary(rng)
    log: Log = {
        "possmap_log": 1,
        "robot": robot,
        "excursion": excursion,
        "records": diary.records,
    }
    if rng.random() < 0.15:
        log["x_firmware"] = "0.9"
    if rng.random() < 0.04:
        return log  # "Empty records are valid."
    diary.leave_home()
    for _ in range(int(rng.integers(3, 10))):
        diary.take_step()
    if rng.random() < 0.4:
        diary.see(["wall", "beam", "corner"], diary.x, diary.y)  # waits for a pose that never comes
    return log


def as_jsonl(logs: Sequence[Log]) -> str:
    """Write the same logs as JSON Lines; of several versions in one log the longest is written."""
    lines: list[Mapping[str, Any]] = []
    for log in logs:
        versions = _longest([log, *log.get("carried", [])])
        for number, version in enumerate(versions):
            header = {key: version[key] for key in version if key not in ("records", "carried")}
            if number == 0:
                header["possmap_log"] = log["possmap_log"]
            else:
                header.pop("possmap_log", None)  # with it the line would begin a log of its own
            lines += [header, *version["records"]]
    return "".join(json.dumps(line) + "\n" for line in lines)


def as_csv(logs: Sequence[Log]) -> str:
    """Write the same excursions as one CSV, each once, the longest version; `x_` keys are left out.

    Raises
    ------
    ValueError
        If a log, or one that it carries, has a model: a CSV has none.
    """
    everything = [version for log in logs for version in (log, *log.get("carried", []))]
    for version in everything:
        if "model" in version:
            raise ValueError(f"a CSV has no models; {version['robot']} brings one")
    text = io.StringIO()
    table = csv.DictWriter(text, CSV_COLUMNS, lineterminator="\n")
    table.writeheader()
    for version in _longest(everything):
        for record in version["records"]:
            row = {key: _csv_field(record[key]) for key in record if not key.startswith("x_")}
            table.writerow({"robot": version["robot"], "excursion": version["excursion"], **row})
    return text.getvalue()


def _csv_field(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value)


def _longest(versions: Iterable[Log]) -> list[Log]:
    """Of each excursion the version with most records, in the order of first appearance."""
    longest: dict[tuple[str, str], Log] = {}
    for version in versions:
        name = (version["robot"], version["excursion"])
        if name not in longest or len(version["records"]) > len(longest[name]["records"]):
            longest[name] = version
    return list(longest.values())


# --- What robots hand over ------------------------------------------------------------------


def _load(rng: np.random.Generator, log: Log, excursions: Sequence[Log]) -> None:
    """Give ``log`` prefixes of other excursions to carry, some in two versions."""
    own = (log["robot"], log["excursion"])
    others = [other for other in excursions if (other["robot"], other["excursion"]) != own]
    carried = []
    for other in others:
        for _ in range(int(rng.choice([0, 1, 1, 2]))):
            carried.append(_prefix(rng, other))
    rng.shuffle(carried)
    for version in carried:
        if rng.random() < 0.5:
            del version["possmap_log"]
    if carried or rng.random() < 0.2:
        log["carried"] = carried


def _prefix(rng: np.random.Generator, log: Log) -> Log:
    """Return a version of ``log`` cut anywhere; one time in three right after a wall."""
    records = log["records"]
    cut = int(rng.integers(len(records) + 1))
    after_walls = [number + 1 for number, record in enumerate(records) if record["kind"] == "wall"]
    if after_walls and rng.random() < 1 / 3:
        cut = _pick(rng, after_walls)
    version = copy.deepcopy(log)
    version["records"] = version["records"][:cut]
    if rng.random() < 0.2:
        # "`x_` keys not compared": without them it is the same version.
        version["records"] = [
            {key: record[key] for key in record if not key.startswith("x_")}
            for record in version["records"]
        ]
    return version


# --- Settings -------------------------------------------------------------------------------


def _random_settings(rng: np.random.Generator, robots: Sequence[str]) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "resolution": _pick(rng, ROUND_RESOLUTIONS)
        if rng.random() < 0.5
        else _uniform(rng, 0.1, 0.25),
        **_random_model(rng, share=0.4),
    }
    settings.setdefault("max_error", _uniform(rng, 0.4, 1.0))
    if rng.random() < 0.75:
        settings["estimator"] = _pick(rng, ["linear", "heading", "heading"])
    if rng.random() < 0.7:
        settings["independence"] = _pick(rng, ["detection", "excursion"])
    for option in ("free_along_walls", "free_along_beams", "clip_coobserved"):
        if rng.random() < 0.75:
            settings[option] = bool(rng.random() < 0.7)
    if rng.random() < 0.4:
        settings["path_width"] = _uniform(rng, 0.02, 0.5)
    if rng.random() < 0.4:
        settings["accept_models"] = bool(rng.random() < 0.4)
    if rng.random() < 0.4:
        named = [robot for robot in (*robots, "nobody") if rng.random() < 0.5]
        settings["robots"] = {robot: _random_model(rng, share=0.25) for robot in named}
    return settings


def _random_model(rng: np.random.Generator, share: float) -> dict[str, float]:
    return {
        name: _uniform(rng, low, high)
        for name, (low, high) in MODEL_RANGES.items()
        if rng.random() < share
    }


# --- One excursion --------------------------------------------------------------------------


class _Diary:
    """Writes what a robot records while it believes to be at (x, y, heading in degrees)."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.records: list[dict[str, Any]] = []
        self.seq = 0
        self.clock = _uniform(rng, 0.0, 100.0)
        self.timed = bool(rng.random() < 0.7)
        at_home = rng.random() < 0.3
        self.x = 0.0 if at_home else _uniform(rng, -4.0, 4.0)
        self.y = 0.0 if at_home else _uniform(rng, -4.0, 4.0)
        self.heading = _pick(rng, [0.0, 90.0, -90.0, 180.0, 45.0, 359.0, _uniform(rng, -180, 360)])

    # Writing

    def write(self, kind: str, **fields: object) -> None:
        record: dict[str, Any] = {"seq": self.seq, "kind": kind}
        if self.timed and self.rng.random() < 0.9:
            record["t"] = round(self.clock, 4)
        record.update(fields)
        if self.rng.random() < 0.05:
            record["x_note"] = _pick(self.rng, ["seen by eye", 7, None, {"deep": [1, 2]}])
        self.records.append(record)
        self.seq += _pick(self.rng, [1, 1, 1, 1, 1, 2, 5])
        self.clock += _pick(self.rng, [0.0, 0.5, 1.25])

    def write_pose(self, **errors: float) -> None:
        self.write("pose", x=self.x, y=self.y, heading=self.heading, **errors)

    def maybe_meet(self) -> None:
        if self.rng.random() < 0.1:
            upto = {"upto": int(self.rng.integers(100))} if self.rng.random() < 0.5 else {}
            self.write("meet", peer="r9", peer_excursion="2026-05-04-z", **upto)

    def leave_home(self) -> None:
        self.maybe_meet()
        errors = {}
        if self.rng.random() < 0.4:
            errors["error_x"] = _uniform(self.rng, 0.0, 0.12)
            errors["error_y"] = _uniform(self.rng, 0.0, 0.12)
        if self.rng.random() < 0.3:
            errors["error_heading"] = _pick(
                self.rng, [0.5, 1.5, 4.0, 4.0, 4.0, 6.0, 6.0, 85.0, 120.0]
            )
        self.write_pose(**errors)

    # Moving

    def take_step(self) -> None:
        step = self.rng.random()
        if step < 0.65:
            self.run()
        elif step < 0.88:
            self.stand(turning=True)
        else:
            self.stand(turning=False)
        self.maybe_meet()

    def turn(self) -> None:
        """Change the heading: mostly as the paper's robots do, sometimes oddly."""
        odd = _uniform(self.rng, -179.0, 179.0)
        turn = _pick(self.rng, [45.0, -45.0, 90.0, -90.0, 45.0, -45.0, 180.0, -180.0, odd])
        full = _pick(self.rng, [0.0, 0.0, 0.0, 360.0, -360.0])  # a file need not wrap its angles
        self.heading = round(self.heading + turn + full, 4)

    def stand(self, turning: bool) -> None:
        """Record at one place, before the turn if there is one."""
        if self.rng.random() < 0.5:
            self.see(["beam", "beam", "wall", "corner"], self.x, self.y)
        if turning:
            self.turn()
        elif self.heading == round(self.heading) and self.rng.random() < 0.1:
            self.heading += 360.0  # the same heading in other words: no turn
        if turning and self.rng.random() < 0.1:
            # A later pose's errors count for nothing.
            self.write_pose(error_x=0.3, error_heading=20.0)
        else:
            self.write_pose()

    def run(self) -> None:
        """Run straight or nearly so, logged in one piece or in several."""
        rng = self.rng
        crab = _pick(rng, [0.0] * 8 + [180.0, 90.0, _uniform(rng, -60.0, 60.0)])
        direction = math.radians(self.heading + crab)
        length = _pick(rng, [0.5, 1.0, _uniform(rng, 0.2, 1.5), _uniform(rng, 0.2, 1.5)])
        pieces = _pick(rng, [1, 1, 1, 2, 3])
        # The third piece may differ by more than 1 degree from the first, not from the second.
        bend = math.radians(_pick(rng, [0.0, 0.0, 0.0, 0.6, -0.7, 1.5]))
        dx = round(length / pieces * math.cos(direction), 4)
        dy = round(length / pieces * math.sin(direction), 4)
        for piece in range(pieces):
            if piece and bend:
                dx = round(length / pieces * math.cos(direction + piece * bend), 4)
                dy = round(length / pieces * math.sin(direction + piece * bend), 4)
            self.see_on_the_way(dx, dy)
            self.x, self.y = round(self.x + dx, 4), round(self.y + dy, 4)
            last = piece == pieces - 1
            if rng.random() < (0.3 if last else 0.12):
                self.turn()  # "with both: it ran, then turned"
            self.write_pose()
            if not last and rng.random() < 0.15:
                self.stand(turning=False)

    # Seeing

    def see(self, kinds: Sequence[str], x: float, y: float) -> None:
        """Record one to four things around a place."""
        for _ in range(int(self.rng.integers(1, 5))):
            kind = _pick(self.rng, kinds)
            if kind == "beam":
                self.beam(x, y)
            elif kind == "corner":
                self.corner(x + self.offset(), y + self.offset())
            else:
                ends = [coordinate + self.offset() for coordinate in (x, y, x, y)]
                if self.rng.random() < 0.3:
                    ends[2:] = ends[:2]
                self.wall(ends)

    def see_on_the_way(self, dx: float, dy: float) -> None:
        """Record during the run that goes (dx, dy) from here."""
        style = self.rng.random()
        if 0.25 < style < 0.55:
            self.wall_beside(dx, dy, followed=True)
            if self.rng.random() < 0.2:
                self.wall_beside(dx, dy, followed=False)
        elif 0.55 <= style < 0.7:
            self.wall_beside(dx, dy, followed=False)
        elif 0.7 <= style < 0.8:
            # Any way round; the run's line may meet it.
            ends = [c + self.offset() for c in (self.x, self.y, self.x + dx, self.y + dy)]
            self.wall(ends)
        elif style >= 0.8:
            self.bump(dx, dy)
        share = self.rng.random()
        x, y = self.x + share * dx, self.y + share * dy
        if self.rng.random() < 0.3:
            for _ in range(int(self.rng.integers(1, 5))):
                self.beam(x, y)
        if self.rng.random() < 0.2:
            self.corner(x + self.offset(), y + self.offset())

    def wall_beside(self, dx: float, dy: float, followed: bool) -> None:
        """Write a wall along the run, on either side; its ends may reach beyond the run's."""
        length = math.hypot(dx, dy)
        gap = _pick(self.rng, [-1, 1]) * _uniform(self.rng, 0.08, 0.4)
        slope = 0.0 if followed else _uniform(self.rng, -0.06, 0.06)
        ends = []
        for share in (_uniform(self.rng, -0.2, 0.4), _uniform(self.rng, 0.5, 1.2)):
            aside = gap + slope * share
            ends += [self.x + share * dx - aside * dy / length]
            ends += [self.y + share * dy + aside * dx / length]
        if self.rng.random() < 0.5:
            ends = ends[2:] + ends[:2]
        self.wall(ends, followed=followed)

    def bump(self, dx: float, dy: float) -> None:
        """Write a wall of zero length: on the run, at its end, ahead of it or aside."""
        length = math.hypot(dx, dy)
        ahead = 1.0 + _uniform(self.rng, 0.05, 0.3) / length
        middle = _pick(self.rng, [_uniform(self.rng, 0.1, 0.4), _uniform(self.rng, 0.6, 0.9)])
        aside = _pick(self.rng, [-1, 1]) * _uniform(self.rng, 0.05, 0.3) / length
        share, aside = _pick(self.rng, [(middle, 0.0), (1.0, 0.0), (ahead, 0.0), (middle, aside)])
        # Both parts rounded alone: a point of a run along an axis or a diagonal stays on it.
        x = self.x + round(share * dx, 4) - round(aside * dy, 4)
        y = self.y + round(share * dy, 4) + round(aside * dx, 4)
        if aside:
            x, y = _off_border(x), _off_border(y)
        elif _on_border(x) or _on_border(y):
            x, y = x + round(0.0213 * dx, 4), y + round(0.0213 * dy, 4)
        x, y = round(x, 4), round(y, 4)
        self.write("wall", x=x, y=y, x2=x, y2=y, **self.claim(_pick(self.rng, [True, False])))

    def wall(self, ends: Sequence[float], followed: bool | None = None) -> None:
        """Write a wall, off the borders of cells."""
        if followed is None:
            followed = bool(self.rng.random() < 0.5)
        x, y, x2, y2 = map(_off_border, ends)
        self.write("wall", x=x, y=y, x2=x2, y2=y2, **self.claim(followed))

    def claim(self, followed: bool) -> dict[str, bool]:
        """`followed` may be left to its default, true."""
        return {} if followed and self.rng.random() < 0.6 else {"followed": followed}

    def beam(self, x: float, y: float) -> None:
        """Write a range reading from near (x, y); some are shorter than their own error."""
        x, y = x + self.offset() / 5, y + self.offset() / 5
        phi = _uniform(self.rng, -math.pi, math.pi)
        r = _pick(self.rng, [0.0, 0.03, 0.15] + [_uniform(self.rng, 0.2, 2.0)] * 6)
        hit = bool(self.rng.random() < 0.6)
        self.write(
            "beam",
            x=round(x, 4),
            y=round(y, 4),
            x2=round(x + r * math.cos(phi), 4),
            y2=round(y + r * math.sin(phi), 4),
            **({} if hit and self.rng.random() < 0.6 else {"hit": hit}),
        )

    def corner(self, x: float, y: float) -> None:
        kind = _pick(self.rng, ["concave", "convex", "end"])
        self.write("corner", x=round(x, 4), y=round(y, 4), corner=kind)

    def offset(self) -> float:
        return _uniform(self.rng, -0.5, 0.5)


def _on_border(coordinate: float) -> bool:
    return abs(math.remainder(coordinate, BORDER)) < 1e-6


def _off_border(coordinate: float) -> float:
    return round(coordinate + 0.0013 if _on_border(round(coordinate, 4)) else coordinate, 4)


def _uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return round(float(rng.uniform(low, high)), 4)


def _pick(rng: np.random.Generator, options: Sequence[T]) -> T:
    """Draw one of ``options`` as it is; ``rng.choice`` would make a NumPy scalar of it."""
    return options[int(rng.integers(len(options)))]


# --- What only the estimator `walls` reads ------------------------------------------------------


def telling_of_turns(logs: Sequence[Log], seed: int) -> list[Log]:
    """Return logs whose poses say whether they turned, or take no time; prefixes stay prefixes."""
    told = copy.deepcopy(list(logs))
    for log in told:
        for version in (log, *log.get("carried", [])):
            name = sum(map(ord, version["robot"] + version["excursion"]))
            last, between = None, []
            for record in version["records"]:
                between.append(record)
                if record["kind"] == "pose":
                    if last is not None and record["heading"] != last["heading"]:
                        draw = np.random.default_rng([seed, name, record["seq"]]).random()
                        _tell(last, record, between, draw)
                    last, between = record, []
    return told


def knowing_fixes(logs: Sequence[Log], seed: int, share: float = 0.3) -> list[Log]:
    """Return logs with fixes after some poses, the same ones in every version of an excursion."""
    found = copy.deepcopy(list(logs))
    for log in found:
        for version in (log, *log.get("carried", [])):
            name = sum(map(ord, version["robot"] + version["excursion"]))
            records = []
            for record in version["records"]:
                record["seq"] *= 2  # room for a fix
                records.append(record)
                rng = np.random.default_rng([seed, name, record["seq"], 7])
                if record["kind"] == "pose" and rng.random() < share:
                    records.append(_fix(record, rng))
            version["records"] = records
    return found


def _fix(pose: Log, rng: np.random.Generator) -> Log:
    fix = {"seq": pose["seq"] + 1, "kind": "fix"}
    for name in ("x", "y"):
        fix[f"error_{name}"] = _uniform(rng, 0.01, 0.6)
        fix[name] = pose[name] + _uniform(rng, -0.5, 0.5)
    if rng.random() < 0.4:
        fix["heading"] = pose["heading"] + _pick(rng, [0.0, 360.0, _uniform(rng, -15, 15)])
        fix["error_heading"] = _uniform(rng, 0.2, 10)
    return fix


def _tell(last: Log, pose: Log, between: Sequence[Log], draw: float) -> None:
    stands = (pose["x"], pose["y"]) == (last["x"], last["y"])
    if draw < 0.2:
        pose["turned"] = True
    elif draw < 0.35 and stands:
        pose["turned"] = False
    elif draw < 0.6 and "t" in last and not any("t" in record for record in between[:-1]):
        pose["t"] = last["t"]  # what lies between stays: a shorter version may end there


def walls_settings(rng: np.random.Generator) -> dict[str, Any]:
    """Return settings for the estimator `walls`, and for what came with it."""
    settings: dict[str, Any] = {"estimator": "walls"}
    if rng.random() < 0.75:
        settings["orthogonal"] = True
        settings["axes"] = _pick(rng, [0.0, 0.0, 90.0, _uniform(rng, -180.0, 180.0)])
    if rng.random() < 0.5:
        settings["wall_noise"] = _uniform(rng, 0.0, 0.1)
        settings["wall_tilt"] = _uniform(rng, 0.5, 8.0)
    if rng.random() < 0.7:
        settings["free_fusion"] = _pick(rng, ["minimum", "dempster", "dempster"])
    settings["independence"] = _pick(rng, ["detection", "excursion", "excursion"])
    if settings["independence"] == "excursion":
        settings["certainty_power"] = _pick(rng, [1.0, 1.5, 2.0])
        if settings.get("free_fusion") == "dempster":
            settings["pass_weight"] = _pick(rng, [1.0, 0.5, _uniform(rng, 0.1, 1.0)])
    return settings

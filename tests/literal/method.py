"""METHOD.md sections 0 to 4, read aloud (estimator `walls` in `literal.walls`).

Slow on purpose: plain doubles, one cell after the other, in the order in which the method is
written down: correction (section 1), propagation (section 1), evidence (section 2), fusion
(section 3). A grid cell is named (column, row); row 0 is the lowest y.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from literal.walls import Pair, filtered

Cell = tuple[int, int]
Layer = dict[Cell, float]
JsonObject = Mapping[str, object]

# Section 1, the table.
DEFAULT_MODEL: Mapping[str, float] = {
    "along": 1.25 / 120,
    "across": 5.5 / 120,
    "turn_bias": 0.0,
    "turn_gain": 0.0,
    "turn_spread": 2.0,
    "turn_noise": 0.0,
    "drift": 0.0,
    "drift_spread": 0.0,
    "scale": 1.0,
    "alignment_spread": 0.0,
    "wall_noise": 0.045,
    "wall_tilt": 4.5,
    "sensor": 0.0,
    "max_error": 1.0,
    "factor": 2.236,
}
HALF_TURN_TOLERANCE_DEG = 1e-6  # section 0
CELL_TOLERANCE = 1e-6  # section 0, and the number of stamps in section 2; a share of a cell
ON_THE_RUN_M = 1e-9  # our reading of "where it lies on it": rounding must not choose the line


@dataclass(frozen=True)
class LiteralGrid:
    """The fused grid: N where > 0, Pi where < 1, and N of the layer of singular points.

    for_wall, against : w and v of section 4, where > 0; a value of certainty weighs 16.
    """

    necessity: dict[Cell, float]
    possibility: dict[Cell, float]
    points: dict[Cell, float]
    for_wall: dict[Cell, float]
    against: dict[Cell, float]

    def readouts(self, cell: Cell) -> tuple[float, float, float]:
        """Bel, Pl and lambda of section 4."""
        w, v = self.for_wall.get(cell, 0.0), self.against.get(cell, 0.0)
        # "computed after e^(-min(w, v)) is taken out of each term"
        least = min(w, v)
        d = math.exp(least - w) + math.exp(least - v) - math.exp(least - w - v)
        belief = (1 - math.exp(-w)) * math.exp(least - v) / d
        plausibility = math.exp(least - v) / d
        logit = (w + math.log(1 - math.exp(-w) / 2)) - (v + math.log(1 - math.exp(-v) / 2))
        return belief, plausibility, logit


class PoseErrors(NamedTuple):
    """A corrected pose's place [m], half-widths [m] and heading half-width [deg]."""

    x: float
    y: float
    half_x: float
    half_y: float
    heading: float


def literal_grid(logs: Sequence[JsonObject], settings: JsonObject) -> LiteralGrid:
    """Fuse decoded JSON ``logs``, with what they carry, under the flat ``settings`` of CLI.md."""
    shape = _shape(settings)
    independence = str(settings.get("independence", "detection"))
    power = _number(settings.get("certainty_power", 1.0))
    share = _number(settings.get("pass_weight", 1.0))
    by_dempster = settings.get("free_fusion", "minimum") == "dempster"
    for_wall: Layer = {}
    against: Layer = {}
    for_point: Layer = {}
    for log in _longest_versions(logs):
        found = _evidence(log, _model_in_force(log, settings), shape)
        for layer, detections in ((for_wall, found.walls), (for_point, found.points)):
            for independent in _independent(detections, independence):
                for cell, value in independent.items():
                    layer[cell] = layer.get(cell, 0.0) + _weight(_sixteen_bits(value) ** power)
        # Section 3, free space: inside an excursion the maximum of the denials counts.
        (denied,) = _independent(found.paths, "excursion")
        for cell, denial in denied.items():
            value = _sixteen_bits(denial)
            if by_dempster:
                against[cell] = against.get(cell, 0.0) + _weight(share * value)
            else:  # "min over everything"
                against[cell] = max(against.get(cell, 0.0), _weight(value))
    return LiteralGrid(
        {cell: 1 - math.exp(-w) for cell, w in for_wall.items() if w > 0.0},
        {
            cell: 0.0 if v == 16.0 and not by_dempster else math.exp(-v)
            for cell, v in against.items()
            if v > 0.0
        },
        {cell: 1 - math.exp(-w) for cell, w in for_point.items() if w > 0.0},
        for_wall,
        against,
    )


def literal_half_widths(log: JsonObject, settings: JsonObject) -> list[PoseErrors]:
    """Every pose of ``log`` as corrected, with the errors it has once its turn is done."""
    model = _model_in_force(log, settings)
    records = _records(log)
    poses = [record for record in records if record.kind == "pose"]
    if not poses:
        return []
    errors = [_first_errors(poses[0])]
    places = [Point(poses[0].x, poses[0].y)]
    legs, states = _laid_out(records, poses[0], model, _shape(settings))
    for leg, (_, _, turned) in zip(legs, states, strict=True):
        places.append(leg.last)
        errors.append(turned)
    return [
        PoseErrors(place.x, place.y, error.half_x, error.half_y, error.heading)
        for place, error in zip(places, errors, strict=True)
    ]


# --- Settings and versions ------------------------------------------------------------------


@dataclass(frozen=True)
class _Shape:
    """The settings that are not parameters of the error model."""

    estimator: str
    orthogonal: bool
    axes: float
    resolution: float
    free_along_walls: bool
    free_along_beams: bool
    clip_coobserved: bool
    path_width: float


def _shape(settings: JsonObject) -> _Shape:
    return _Shape(
        str(settings.get("estimator", "linear")),
        bool(settings.get("orthogonal", False)),
        _number(settings.get("axes", 0.0)),
        _number(settings.get("resolution", 0.05)),
        bool(settings.get("free_along_walls", False)),
        bool(settings.get("free_along_beams", False)),
        bool(settings.get("clip_coobserved", False)),
        _number(settings.get("path_width", 0.0)),
    )


def _model_in_force(log: JsonObject, settings: JsonObject) -> dict[str, float]:
    """Return the error model: the log's beats `robots:` beats the general value (CLI.md)."""
    levels = [
        settings,
        _object(_object(settings.get("robots", {})).get(str(log["robot"]), {})),
    ]
    if settings.get("accept_models", True):
        levels.append(_object(log.get("model", {})))
    model = dict(DEFAULT_MODEL)
    for level in levels:
        model.update({name: _number(level[name]) for name in DEFAULT_MODEL if name in level})
    return model


def _longest_versions(logs: Sequence[JsonObject]) -> list[JsonObject]:
    """Section 3, Identity and Versions: the longest list of records stands for its prefixes."""
    longest: dict[tuple[str, str], JsonObject] = {}
    for log in logs:
        for version in (log, *map(_object, _array(log.get("carried", [])))):
            name = (str(version["robot"]), str(version["excursion"]))
            known = longest.get(name)
            if known is None or len(_array(version["records"])) > len(_array(known["records"])):
                longest[name] = version
    return list(longest.values())


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"expected a number, got {value!r}")
    return float(value)


def _object(value: object) -> JsonObject:
    if not isinstance(value, Mapping):
        raise TypeError(f"expected an object, got {value!r}")
    return value


def _array(value: object) -> Sequence[object]:
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise TypeError(f"expected an array, got {value!r}")
    return value


# --- Records and the legs between poses (LOGS.md) -------------------------------------------


class Point(NamedTuple):
    """A place in the site frame [m]."""

    x: float
    y: float


@dataclass(frozen=True)
class _Record:
    """One record with LOGS.md's defaults filled in; a single place is its own second end."""

    kind: str
    x: float
    y: float
    x2: float
    y2: float
    heading: float
    error_x: float
    error_y: float
    error_heading: float
    followed: bool
    hit: bool
    raw: JsonObject

    @property
    def start(self) -> Point:
        return Point(self.x, self.y)

    @property
    def end(self) -> Point:
        return Point(self.x2, self.y2)

    def moved(self, place: Callable[[Point], Point]) -> _Record:
        """Return the record with both ends taken to where ``place`` puts them."""
        start, end = place(self.start), place(self.end)
        return replace(self, x=start.x, y=start.y, x2=end.x, y2=end.y)


def _records(log: JsonObject) -> list[_Record]:
    """All records but the meetings, which say nothing about the site."""
    records = []
    for raw in map(_object, _array(log["records"])):
        if raw["kind"] == "meet":
            continue
        x, y = _number(raw["x"]), _number(raw["y"])
        records.append(
            _Record(
                kind=str(raw["kind"]),
                x=x,
                y=y,
                x2=_number(raw.get("x2", x)),
                y2=_number(raw.get("y2", y)),
                heading=_number(raw.get("heading", 0.0)),
                error_x=_number(raw.get("error_x", 0.0)),
                error_y=_number(raw.get("error_y", 0.0)),
                error_heading=_number(raw.get("error_heading", 0.0)),
                followed=bool(raw.get("followed", True)),
                hit=bool(raw.get("hit", True)),
                raw=raw,
            )
        )
    return records


@dataclass(frozen=True)
class _Leg:
    """Two poses in a row, as logged or as corrected: first the run, then the turn.

    length, direction : of the run [m, rad]; a leg at standstill has length 0.
    logged_direction : the same before any correction [rad].
    turn : logged, in (-180, 180] [deg].
    poses : the two records as logged.
    """

    first: Point
    last: Point
    standstill: bool
    length: float
    direction: float
    logged_direction: float
    turn: float
    seen: tuple[_Record, ...]
    poses: tuple[JsonObject, JsonObject]
    fixes: tuple[JsonObject, ...] = ()

    @property
    def walls(self) -> list[_Record]:
        return [record for record in self.seen if record.kind == "wall"]

    @property
    def followed(self) -> bool:
        """LOGS.md: a run with a followed wall; at standstill `followed` claims nothing."""
        return not self.standstill and any(wall.followed for wall in self.walls)

    def share(self, point: Point) -> float:
        """Section 2, Walls: where ``point`` projects onto the run, clamped; 0 is its start."""
        if self.standstill:
            return 0.0
        along = (point.x - self.first.x) * math.cos(self.direction)
        along += (point.y - self.first.y) * math.sin(self.direction)
        return min(1.0, max(0.0, along / self.length))


def _legs(records: Iterable[_Record]) -> list[_Leg]:
    """Cut the records at the poses; what comes after the last pose waits and yields nothing."""
    legs: list[_Leg] = []
    pose: _Record | None = None
    seen: list[_Record] = []
    for record in records:
        if record.kind == "fix":  # it stands after the pose that ends the leg
            if legs:
                legs[-1] = replace(legs[-1], fixes=(*legs[-1].fixes, record.raw))
            continue
        if record.kind != "pose":
            seen.append(record)
            continue
        if pose is not None:
            dx, dy = record.x - pose.x, record.y - pose.y
            legs.append(
                _Leg(
                    first=pose.start,
                    last=record.start,
                    standstill=dx == 0.0 and dy == 0.0,
                    length=math.hypot(dx, dy),
                    direction=math.atan2(dy, dx),
                    logged_direction=math.atan2(dy, dx),
                    turn=_angle_difference(record.heading - pose.heading),
                    seen=tuple(seen),
                    poses=(pose.raw, record.raw),
                )
            )
        pose, seen = record, []
    return legs


def _angle_difference(degrees: float) -> float:
    """Section 0: wrapped to (-180, 180]; what is nearly a half turn is one to the left."""
    wrapped = math.remainder(degrees, 360.0)
    if abs(abs(wrapped) - 180.0) <= HALF_TURN_TOLERANCE_DEG:
        return 180.0
    return wrapped


# --- Section 1, Correction ------------------------------------------------------------------


def _corrected(legs: Sequence[_Leg], model: Mapping[str, float]) -> list[_Leg]:
    """Apply what is known: turn_bias, turn_gain, drift and scale."""
    corrected: list[_Leg] = []
    corr = 0.0  # [deg]
    place = legs[0].first if legs else Point(0.0, 0.0)
    for leg in legs:
        if leg.standstill:
            # "At standstill offsets are rotated by corr as it is before the turn."
            movement = _laying(leg.first, 0.0, place, math.radians(corr), 1.0)
            after = replace(leg, first=place, last=place)
        else:
            if leg.followed:
                corr = 0.0  # "the robot has lined up: corr is 0 before, during and after, u = 0"
                u = 0.0
            else:
                u = math.radians(model["drift"] * leg.length / 2.0)
            # "length scale d sin(u)/u (scale d for u = 0) and direction theta + corr + u"
            stretch = model["scale"] * (math.sin(u) / u if u != 0.0 else 1.0)
            length = stretch * leg.length
            direction = leg.direction + math.radians(corr) + u
            if not leg.followed:
                corr += model["drift"] * leg.length
            movement = _laying(leg.first, leg.direction, place, direction, stretch)
            after = replace(
                leg,
                first=place,
                last=Point(
                    place.x + length * math.cos(direction),
                    place.y + length * math.sin(direction),
                ),
                length=length,
                direction=direction,
            )
        # "a turn of t degrees: corr += turn_gain t + turn_bias |t|/45", after the run
        corr += model["turn_gain"] * leg.turn + model["turn_bias"] * abs(leg.turn) / 45.0
        corrected.append(replace(after, seen=tuple(record.moved(movement) for record in leg.seen)))
        place = after.last
    return corrected


def _laying(
    logged_first: Point,
    logged_direction: float,
    first: Point,
    direction: float,
    stretch: float,
) -> Callable[[Point], Point]:
    """Return the movement of what was recorded on a leg.

    The offset from the logged first pose, split along and across the logged run, is laid along
    and across the corrected one; only the part along it is stretched.
    """

    def lay(point: Point) -> Point:
        dx, dy = point.x - logged_first.x, point.y - logged_first.y
        along = dx * math.cos(logged_direction) + dy * math.sin(logged_direction)
        across = -dx * math.sin(logged_direction) + dy * math.cos(logged_direction)
        along *= stretch
        return Point(
            first.x + along * math.cos(direction) - across * math.sin(direction),
            first.y + along * math.sin(direction) + across * math.cos(direction),
        )

    return lay


# --- Section 1, Propagation -----------------------------------------------------------------


class _Errors(NamedTuple):
    """The state: half-widths of the rectangle [m] and of the heading [deg]."""

    half_x: float
    half_y: float
    heading: float


def _first_errors(pose: _Record) -> _Errors:
    """Return the first pose's own error; those of later poses do not count."""
    return _Errors(pose.error_x, pose.error_y, min(90.0, pose.error_heading))


_States = list[tuple[_Errors, _Errors, _Errors]]


def _laid_out(
    records: Sequence[_Record], first: _Record, model: Mapping[str, float], shape: _Shape
) -> tuple[list[_Leg], _States]:
    """Return the legs as corrected, and per leg the errors that `_propagated` returns."""
    legs = _legs(records)
    if shape.estimator != "walls":
        corrected = _corrected(legs, model)
        return corrected, _propagated(corrected, first, model, shape.estimator)
    laid, _ = filtered(
        [_pair(leg) for leg in legs], first.raw, model, shape.orthogonal, shape.axes,
        _fixes_of_the_first(records),
    )  # fmt: skip
    laid = laid[len(laid) - len(legs) :]
    moved, states = [], []
    for leg, at in zip(legs, laid, strict=True):
        start, end = Point(*at.start[0][:2].tolist()), Point(*at.end[0][:2].tolist())
        direction = float(at.start[0][2]) if leg.standstill else at.direction
        movement = _laying(
            leg.first, 0.0 if leg.standstill else leg.direction, start, direction, at.stretch
        )
        moved.append(
            replace(
                leg,
                first=start,
                last=end,
                length=abs(at.stretch) * leg.length,
                direction=at.direction,
                seen=tuple(record.moved(movement) for record in leg.seen),
            )
        )
        before, after = (
            _Errors(
                model["factor"] * math.sqrt(max(0.0, p[0, 0])),
                model["factor"] * math.sqrt(max(0.0, p[1, 1])),
                _heading_half(p[2, 2], model),
            )
            for _, p in (at.start, at.end)
        )
        states.append((before, after, after._replace(heading=_heading_half(at.after[1], model))))
    return moved, states


def _fixes_of_the_first(records: Sequence[_Record]) -> list[JsonObject]:
    """Return the fixes before the second pose."""
    found: list[JsonObject] = []
    for record in records[next(n for n, one in enumerate(records) if one.kind == "pose") + 1 :]:
        if record.kind == "pose":
            break
        if record.kind == "fix":
            found.append(record.raw)
    return found


def _heading_half(variance: float, model: Mapping[str, float]) -> float:
    return min(90.0, math.degrees(model["factor"] * math.sqrt(max(0.0, variance))))


def _pair(leg: _Leg) -> Pair:
    walls = [(one.x, one.y, one.x2, one.y2, one.followed) for one in leg.walls]
    return Pair(*leg.poses, leg.length, leg.direction, leg.turn, walls, leg.fixes)


def _propagated(
    legs: Sequence[_Leg], first: _Record, model: Mapping[str, float], estimator: str
) -> _States:
    """Return per corrected leg the errors at its start, after its run and after its turn."""
    if estimator == "linear":
        return _linear(legs, first, model)
    if estimator == "heading":
        return _heading(legs, first, model)
    raise ValueError(f"estimator is linear or heading, not {estimator!r}")


def _linear(legs: Sequence[_Leg], first: _Record, model: Mapping[str, float]) -> _States:
    states: _States = []
    errors = _first_errors(first)
    # "consecutive runs that follow no wall, with no turn between them, count as one run":
    # the heading half-width where it began and the distance since then.
    heading_at_start, gone = errors.heading, 0.0
    for leg in legs:
        after_run = errors
        cos, sin = abs(math.cos(leg.direction)), abs(math.sin(leg.direction))
        if leg.followed:
            # "H = alignment_spread; hx += |cos theta| along d, hy += |sin theta| along d"
            after_run = _Errors(
                errors.half_x + cos * model["along"] * leg.length,
                errors.half_y + sin * model["along"] * leg.length,
                min(90.0, model["alignment_spread"]),
            )
        elif not leg.standstill:
            a_before, b_before = _growth(gone, heading_at_start, model)
            gone += leg.length
            a_after, b_after = _growth(gone, heading_at_start, model)
            a, b = a_after - a_before, b_after - b_before
            # "hx += |cos theta| a + |sin theta| b, hy += |sin theta| a + |cos theta| b"
            after_run = _Errors(
                errors.half_x + cos * a + sin * b,
                errors.half_y + sin * a + cos * b,
                min(90.0, heading_at_start + model["drift_spread"] * gone),
            )
        # "a turn of t degrees: H += turn_spread |t|/45"
        turned = after_run._replace(
            heading=min(90.0, after_run.heading + model["turn_spread"] * abs(leg.turn) / 45.0)
        )
        states.append((errors, after_run, turned))
        errors = turned
        if leg.followed or leg.turn != 0.0:
            heading_at_start, gone = errors.heading, 0.0
    return states


def _growth(
    distance: float, heading_at_start: float, model: Mapping[str, float]
) -> tuple[float, float]:
    """Return a and b of a run in free space at ``distance`` from its start."""
    h = math.radians(min(90.0, heading_at_start + model["drift_spread"] * distance / 2.0))
    return (
        model["along"] * distance + distance * (1.0 - math.cos(h)),
        model["across"] * distance + distance * math.sin(h),
    )


# --- Section 1, Estimator heading -----------------------------------------------------------

X, Y, HEADING, OVERTURN, DRIFT = range(5)
SAME_RUN_DEG = 1.0
_Matrix = NDArray[np.float64]


def _heading(legs: Sequence[_Leg], first: _Record, model: Mapping[str, float]) -> _States:
    """Carry the covariance P of the errors of (x, y, heading, over-turn per 45 deg, drift)."""
    f = model["factor"]
    along, across = model["along"], model["across"]  # "`across` read as radians"
    turn_noise, alignment = (
        math.radians(model[name]) for name in ("turn_noise", "alignment_spread")
    )
    # "P = diag(error_x, error_y, error_heading, turn_spread, drift_spread)^2 / f^2"
    half_widths = [
        first.error_x,
        first.error_y,
        math.radians(first.error_heading),
        math.radians(model["turn_spread"]),
        math.radians(model["drift_spread"]),
    ]
    p = np.diag(np.square(half_widths)) / f**2
    first_piece: _Leg | None = None  # of the run so far
    gone = 0.0  # L
    states: _States = []
    for leg in legs:
        at_first = _read_off(p, f)
        if not leg.standstill:
            if first_piece is None or _begins(leg, first_piece):
                first_piece, gone, begins = leg, 0.0, True
            else:
                begins = False
            d, theta = leg.length, leg.direction
            if d < 0.0:  # a drift beyond a full circle: the displacement points backwards
                d, theta = -d, theta + math.pi
            if leg.followed:
                # "first row and column of heading become 0"
                p[HEADING, :] = 0.0
                p[:, HEADING] = 0.0
                p[HEADING, HEADING] = (alignment / f) ** 2
            else:
                if begins:
                    p[HEADING, HEADING] += (across / f) ** 2
                step = np.eye(5)
                step[X, HEADING] = -d * math.sin(theta)
                step[Y, HEADING] = d * math.cos(theta)
                step[X, DRIFT] = -0.5 * d**2 * math.sin(theta)
                step[Y, DRIFT] = 0.5 * d**2 * math.cos(theta)
                step[HEADING, DRIFT] = d
                p = step @ p @ step.T
            # "v = (along/f)^2 ((L+d)^2 - L^2)"
            v = (along / f) ** 2 * ((gone + d) ** 2 - gone**2)
            p[X, X] += v * math.cos(theta) ** 2
            p[Y, Y] += v * math.sin(theta) ** 2
            p[X, Y] += v * math.sin(theta) * math.cos(theta)
            p[Y, X] += v * math.sin(theta) * math.cos(theta)
            gone += d
        after_run = _read_off(p, f)
        # "Turn t: P <- F P F^T, F the identity with F[heading, over-turn] = |t|/45"
        turn = np.eye(5)
        turn[HEADING, OVERTURN] = abs(leg.turn) / 45.0
        p = turn @ p @ turn.T
        p[HEADING, HEADING] += (turn_noise / f) ** 2 * abs(leg.turn) / 45.0
        states.append((at_first, after_run, _read_off(p, f)))
    return states


def _begins(leg: _Leg, first_piece: _Leg) -> bool:
    """Tell whether a run begins: its logged direction is another, or following begins or ends."""
    aside = _angle_difference(math.degrees(leg.logged_direction - first_piece.logged_direction))
    return leg.followed != first_piece.followed or abs(aside) > SAME_RUN_DEG


def _read_off(p: _Matrix, f: float) -> _Errors:
    """Return hx = f sqrt(P_xx), hy = f sqrt(P_yy), H = min(90 deg, f sqrt(P_heading))."""
    half_x, half_y, heading = (f * math.sqrt(max(0.0, p[k, k])) for k in (X, Y, HEADING))
    return _Errors(half_x, half_y, min(90.0, math.degrees(heading)))


# --- Section 2, Evidence --------------------------------------------------------------------


class _Rectangle(NamedTuple):
    half_x: float
    half_y: float

    def towards(self, other: _Rectangle, share: float) -> _Rectangle:
        return _Rectangle(
            self.half_x + share * (other.half_x - self.half_x),
            self.half_y + share * (other.half_y - self.half_y),
        )

    def grown(self, more_x: float, more_y: float) -> _Rectangle:
        return _Rectangle(self.half_x + more_x, self.half_y + more_y)


@dataclass(frozen=True)
class _Found:
    """What one excursion says: one layer per detection, and one per free path."""

    walls: list[Layer]
    points: list[Layer]
    paths: list[Layer]


class _Stamper(NamedTuple):
    """Stamps pyramids at one resolution under one `max_error`."""

    c: float
    max_error: float

    def stamp(self, layer: Layer, point: Point, rectangle: _Rectangle) -> None:
        """Put one position's pyramid into ``layer``, by max (section 3, inside a detection)."""
        column, row = self._index(point.x), self._index(point.y)
        columns = self._profile(rectangle.half_x)
        rows = self._profile(rectangle.half_y)
        for columns_away, n_x in columns.items():
            for rows_away, n_y in rows.items():
                cell = (column + columns_away, row + rows_away)
                layer[cell] = max(layer.get(cell, 0.0), min(n_x, n_y))  # N = min(N_x, N_y)

    def segment(
        self, layer: Layer, p0: Point, p1: Point, start: _Rectangle, end: _Rectangle
    ) -> None:
        """Stamp along the segment; its value in a cell is the maximum over the stamps."""
        dx, dy = p1.x - p0.x, p1.y - p0.y
        # n = max(1, ceil(max(|dx|, |dy|) / c - 1e-6))
        n = max(1, math.ceil(max(abs(dx), abs(dy)) / self.c - CELL_TOLERANCE))
        for k in range(n + 1):
            point = Point(p0.x + k / n * dx, p0.y + k / n * dy)
            self.stamp(layer, point, start.towards(end, k / n))

    def _index(self, coordinate: float) -> int:
        """Section 0: cell of a point: floor(p / c + 1e-6)."""
        return math.floor(coordinate / self.c + CELL_TOLERANCE)

    def _profile(self, half: float) -> dict[int, float]:
        """N_x by columns away (or N_y by rows away), only where positive."""
        height = max(0.0, 1.0 - half / self.max_error)
        if height == 0.0:
            return {}
        reach = math.ceil(half / self.c + 0.5)
        profile = {
            k: height * max(0.0, 1.0 - abs(k) * self.c / (half + self.c / 2.0))
            for k in range(-reach, reach + 1)
        }
        return {k: value for k, value in profile.items() if value > 0.0}


def _evidence(log: JsonObject, model: Mapping[str, float], shape: _Shape) -> _Found:
    found = _Found([], [], [])
    records = _records(log)
    if not records:
        return found
    legs, states = _laid_out(records, records[0], model, shape)
    stamper = _Stamper(shape.resolution, model["max_error"])
    for leg, (at_first, after_run, _) in zip(legs, states, strict=True):
        start = _Rectangle(at_first.half_x, at_first.half_y)
        end = _Rectangle(after_run.half_x, after_run.half_y)
        _walls_and_corners(found, leg, start, end, model["sensor"], stamper)
        _beams(found, leg, start, end, after_run.heading, model["sensor"], shape, stamper)
        if not leg.standstill:
            _free_path(found, leg, start, end, shape, stamper, model["factor"])
    return found


def _walls_and_corners(
    found: _Found,
    leg: _Leg,
    start: _Rectangle,
    end: _Rectangle,
    sensor: float,
    stamper: _Stamper,
) -> None:
    """Section 2, Walls and Singular points: each record a detection, rectangles plus `sensor`."""
    for record in leg.seen:
        at_start = start.towards(end, leg.share(record.start)).grown(sensor, sensor)
        at_end = start.towards(end, leg.share(record.end)).grown(sensor, sensor)
        detection: Layer = {}
        if record.kind == "wall":
            # Of zero length it is a single stamp: the segment's two stamps are then one.
            stamper.segment(detection, record.start, record.end, at_start, at_end)
            found.walls.append(detection)
        elif record.kind == "corner":
            stamper.stamp(detection, record.start, at_start)
            found.points.append(detection)


def _beams(
    found: _Found,
    leg: _Leg,
    start: _Rectangle,
    end: _Rectangle,
    heading_half_width: float,
    sensor: float,
    shape: _Shape,
    stamper: _Stamper,
) -> None:
    """Section 2, Beams: the hits of one leg are together one detection.

    heading_half_width : H at the end of the run, before the turn [deg].
    """
    hits: Layer = {}
    h = math.radians(heading_half_width)
    for beam in leg.seen:
        if beam.kind != "beam":
            continue
        dx, dy = beam.x2 - beam.x, beam.y2 - beam.y
        r, phi = math.hypot(dx, dy), math.atan2(dy, dx)
        sin, cos = abs(math.sin(phi)), abs(math.cos(phi))
        at_start = start.towards(end, leg.share(beam.start)).grown(sensor, sensor)
        # "|sin phi| r sin H + |cos phi| r (1 - cos H) in x", exchanged in y
        at_end = at_start.grown(
            sin * r * math.sin(h) + cos * r * (1.0 - math.cos(h)),
            cos * r * math.sin(h) + sin * r * (1.0 - math.cos(h)),
        )
        if beam.hit:
            stamper.stamp(hits, beam.end, at_end)
        if not shape.free_along_beams:
            continue
        path: Layer = {}
        if not beam.hit:
            stamper.segment(path, beam.start, beam.end, at_start, at_end)
        else:
            # "to c + max(hx, hy) short of a hit (nothing if the beam is shorter)"; the
            # rectangle at the last point is that of the beam's full length.
            short = shape.resolution + max(at_end.half_x, at_end.half_y)
            if r >= short:
                left = (r - short) / r
                last = Point(beam.x + left * dx, beam.y + left * dy)
                stamper.segment(path, beam.start, last, at_start, at_end)
        found.paths.append(path)
    found.walls.append(hits)


def _free_path(
    found: _Found,
    leg: _Leg,
    start: _Rectangle,
    end: _Rectangle,
    shape: _Shape,
    stamper: _Stamper,
    factor: float,
) -> None:
    """Section 2, Free space: the run is one segment, its possibility 1 - value."""
    if leg.walls and not shape.free_along_walls:
        return
    path: Layer = {}
    if shape.path_width:
        path = _swath(leg, start, end, shape, factor, stamper.max_error)
    else:
        stamper.segment(path, leg.first, leg.last, start, end)
    if shape.clip_coobserved:
        for wall in leg.walls:
            clipped = _clip_line(wall, leg)
            path = {
                cell: value
                for cell, value in path.items()
                if not clipped.takes(cell, leg, shape.resolution)
            }
    found.paths.append(path)


def _swath(
    leg: _Leg, start: _Rectangle, end: _Rectangle, shape: _Shape, factor: float, max_error: float
) -> Layer:
    """docs/method.md, "The swath of a body": cell by cell, every cell that may matter."""
    c = shape.resolution
    half = max(shape.path_width, c) / 2.0 + CELL_TOLERANCE * c
    dx, dy = leg.last.x - leg.first.x, leg.last.y - leg.first.y
    length = math.hypot(dx, dy)
    ahead_x, ahead_y = (dx / length, dy / length) if length else (1.0, 0.0)
    n = max(1, math.ceil(max(abs(dx), abs(dy)) / c - CELL_TOLERANCE))
    far = 2.0 * max_error + half + c
    low_x, high_x = sorted((leg.first.x, leg.last.x))
    low_y, high_y = sorted((leg.first.y, leg.last.y))
    path: Layer = {}
    for i in range(math.floor((low_x - far) / c), math.ceil((high_x + far) / c)):
        for j in range(math.floor((low_y - far) / c), math.ceil((high_y + far) / c)):
            x, y = (i + 0.5) * c - leg.first.x, (j + 0.5) * c - leg.first.y
            a, d = x * ahead_x + y * ahead_y, abs(y * ahead_x - x * ahead_y)
            near = start.towards(end, min(1.0, max(0.0, a / length)) if length else 0.0)
            if near.half_x >= max_error or near.half_y >= max_error:
                continue
            share = min(1.0, max(0.0, a / length)) if length else 0.0
            stamps = [min(n, math.floor(share * n) + k) / n for k in (0, 1)]
            rectangles = [start.towards(end, stamp) for stamp in stamps]
            if all(max(r.half_x, r.half_y) >= max_error for r in rectangles):
                continue
            across = abs(ahead_y) * near.half_x + abs(ahead_x) * near.half_y
            along = abs(ahead_x) * near.half_x + abs(ahead_y) * near.half_y
            if d > across + half or max(-a, a - length) > along + half:
                continue
            sd_across = math.hypot(ahead_y * near.half_x, ahead_x * near.half_y)
            sd_along = math.hypot(ahead_x * near.half_x, ahead_y * near.half_y)
            sd_across, sd_along = (max(sd, 1e-12) / factor for sd in (sd_across, sd_along))
            value = _normal((half - d) / sd_across) - _normal((-half - d) / sd_across)
            ends = _normal((a + half) / sd_along) - _normal((a - length - half) / sd_along)
            if value * ends > 0.0:
                path[i, j] = value * ends
    return path


def _normal(z: float) -> float:
    return (1.0 + math.erf(z / math.sqrt(2.0))) / 2.0


class _Line(NamedTuple):
    """The infinite line of the points p with normal . p = offset; the normal has length 1."""

    normal_x: float
    normal_y: float
    offset: float

    def distance(self, point: Point) -> float:
        """Return the signed distance, positive on the normal's side."""
        return self.normal_x * point.x + self.normal_y * point.y - self.offset

    def takes(self, cell: Cell, leg: _Leg, c: float) -> bool:
        """Whether the line touches ``cell`` or hides it from the run's farther end."""
        centre = Point((cell[0] + 0.5) * c, (cell[1] + 0.5) * c)
        distance = self.distance(centre)
        touch = c / 2.0 * (abs(self.normal_x) + abs(self.normal_y)) + CELL_TOLERANCE * c
        if abs(distance) <= touch:
            return True
        at_first, at_last = self.distance(leg.first), self.distance(leg.last)
        seen_from = at_first if abs(at_first) >= abs(at_last) else at_last
        # A run that lies in the line sees nothing beyond it: the product is then 0.
        return distance * seen_from < 0.0


def _clip_line(wall: _Record, leg: _Leg) -> _Line:
    """Section 2, Free space: the line through a corrected wall record of the run ``leg``."""
    if wall.start != wall.end:
        along_x, along_y = wall.x2 - wall.x, wall.y2 - wall.y
        normal_x, normal_y = -along_y, along_x
    else:
        # "the line perpendicular to its shortest connection with the run": the connection is
        # the normal. "Perpendicular to the run, where it lies on it": the run is the normal.
        share = leg.share(wall.start)
        normal_x = wall.x - (leg.first.x + share * (leg.last.x - leg.first.x))
        normal_y = wall.y - (leg.first.y + share * (leg.last.y - leg.first.y))
        if math.hypot(normal_x, normal_y) <= ON_THE_RUN_M:
            normal_x, normal_y = math.cos(leg.direction), math.sin(leg.direction)
    length = math.hypot(normal_x, normal_y)
    normal_x, normal_y = normal_x / length, normal_y / length
    return _Line(normal_x, normal_y, normal_x * wall.x + normal_y * wall.y)


# --- Section 3, Fusion ----------------------------------------------------------------------


def _independent(detections: list[Layer], independence: str) -> list[Layer]:
    """Return the layers of one excursion that count as independent of each other."""
    if independence == "detection":
        return detections
    if independence != "excursion":
        raise ValueError(f"independence is detection or excursion, not {independence!r}")
    whole: Layer = {}
    for detection in detections:
        for cell, value in detection.items():
            whole[cell] = max(whole.get(cell, 0.0), value)
    return [whole]


def _sixteen_bits(value: float) -> float:
    """Section 3, Exact arithmetic: "floor(65535 N + 0.5)"."""
    return math.floor(65535 * value + 0.5) / 65535


def _weight(value: float) -> float:
    """Return -ln(1 - value), which turns S(x, y) = x + y - xy into a sum; 16 of certainty."""
    return 16.0 if value == 1.0 else -math.log(1 - value)

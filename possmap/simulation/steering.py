"""Steering: makes the body follow what navigation asks for, and the log tell it (paper §2.4).

Motions are events: each is asked for as a whole, and yielded with the time that it takes; whoever
runs the mission answers how much of it was done before something came in between.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import TypeAlias

from possmap.core.records import CornerKind
from possmap.simulation.body import Body, Place
from possmap.simulation.logbook import Logbook
from possmap.simulation.perception import Perception, Sighting
from possmap.simulation.settings import MissionSettings

Track: TypeAlias = list[list[float]]
Believed: TypeAlias = Callable[[float, float], tuple[float, float]]
"""Turns a place in the robot's frame into one in its believed map [m]."""


@dataclass(frozen=True, slots=True)
class Motion:
    """A straight motion, a turn or a wait, as it will truly happen.

    seconds : how long it takes.
    start, end : true places.
    moves : whether the robot changes its place.
    """

    seconds: float
    start: Place
    end: Place
    moves: bool = False

    def at(self, share: float) -> Place:
        """Return the true place when a share of it is done."""
        return Place(
            self.start.x + share * (self.end.x - self.start.x),
            self.start.y + share * (self.end.y - self.start.y),
            self.start.heading + share * (self.end.heading - self.start.heading),
        )


@dataclass(frozen=True, slots=True)
class Done:
    """How a motion ended.

    time : when [s].
    share : how much of it was done; only runs are ever cut short.
    hold : how long to stand still now, for a talk or to give way [s].
    """

    time: float
    share: float = 1.0
    hold: float = 0.0


Steps: TypeAlias = Generator[Motion, Done, None]


class Steering:
    """Executes runs and turns, and writes down what was believed and seen."""

    def __init__(self, settings: MissionSettings, body: Body, perception: Perception) -> None:
        self._settings = settings
        self.body = body
        self.perception = perception
        self.book: Logbook | None = None
        self.track: Track = []
        self.trail: list[tuple[float, float]] = []
        self.time = 0.0
        self.was_stopped = False

    def log(self) -> Logbook:
        """Return the log of the present excursion."""
        if self.book is None:
            raise ValueError("no excursion is under way")
        return self.book

    def note_pose(self, x: float, y: float, heading_deg: float) -> None:
        """Write a pose into the log, and both it and the truth into the track."""
        book, place = self.log(), self.body.place
        ir = self.perception.five(place) if self._settings.log_ir else None
        book.pose(self.time, x, y, heading_deg, ir)
        pose = book.belief.logged
        self.trail.append(book.belief.corrected.place)
        self.track.append(
            [
                round(self.time, 2), round(place.x, 4), round(place.y, 4),
                round(math.degrees(place.heading), 2), pose.x, pose.y, pose.heading_deg,
            ]
        )  # fmt: skip

    def _after(self, done: Done) -> None:
        self.time = done.time
        self.was_stopped = done.share < 1

    def wait(self, seconds: float) -> Steps:
        """Stand still."""
        place = self.body.place
        self._after((yield Motion(seconds, place, place)))

    def turn(self, asked_deg: float) -> Steps:
        """Turn on the spot; what is believed is what was asked for."""
        if not asked_deg:
            return
        start = self.body.place
        end = self.body.turned(asked_deg)
        seconds = abs(asked_deg) / self._settings.turn_rate
        done = yield Motion(seconds, start, end)
        self.body.place = end
        self._after(done)
        pose = self.log().belief.logged
        self.note_pose(pose.x, pose.y, pose.heading_deg + asked_deg)

    def line_up(self, true_heading: float) -> Steps:
        """Turn parallel to a wall by its readings; what is believed is what the wheels count.

        Only a run along the wall makes it a right angle, since only that run tells the host.
        """
        start = self.body.place
        away = math.remainder(true_heading - start.heading, 2 * math.pi)
        end = replace(start, heading=start.heading + away)
        done = yield Motion(abs(math.degrees(away)) / self._settings.turn_rate, start, end)
        self.body.place = end
        self._after(done)
        counted = round(self.body.counted_turn(math.degrees(away)), 2)
        if counted:
            pose = self.log().belief.logged
            self.note_pose(pose.x, pose.y, pose.heading_deg + counted)

    def run(self, distance: float, lined_up: bool = False, wall_side: int = 0) -> Steps:
        """Run straight, at most so far [m], and write down where it ended and what passed by.

        The run sets out a little off the heading that navigation looked along, so it ends earlier
        if something stands in its true way.

        Parameters
        ----------
        lined_up
            Whether the robot keeps its direction by a wall.
        wall_side
            The side of that wall, +1 left or -1 right.
        """
        body, set_out = self.body, self.time
        body.begin_run(lined_up)
        start = body.place
        bend = body.bend(distance, lined_up)
        chord = replace(start, heading=start.heading + bend / 2)
        way, _, _ = self.perception.way_ahead(chord, distance)
        self.was_stopped = False
        if way <= 0:
            return
        bend, distance = bend * way / distance, way
        # Along a circle, ends lie nearer than the way between them (METHOD §1).
        x, y = chord.at(distance * (math.sin(bend / 2) / (bend / 2) if bend else 1.0), 0.0)
        end = Place(x, y, start.heading + bend)
        done = yield Motion(distance / self._settings.speed, start, end, moves=True)
        self._after(done)
        ran = distance * done.share
        pieces = list(self.perception.beside(chord, ran)) if ran > 0 else []
        followed = wall_side if lined_up else 0
        if any(piece.side == followed for piece in pieces):
            self._believe_right_angle(set_out)
        body.place = Motion(1.0, start, end).at(done.share)
        self._write_run(ran, pieces, followed)
        if done.hold:
            yield from self.wait(done.hold)
            self.was_stopped = True

    def _believe_right_angle(self, since: float) -> None:
        """Write down, as of the run's start, that it went along a wall."""
        belief = self.log().belief
        right_angle = 90.0 * round(math.degrees(belief.heading) / 90.0)
        pose = belief.logged
        if math.remainder(right_angle - pose.heading_deg, 360.0):
            now, self.time = self.time, since
            self.note_pose(pose.x, pose.y, right_angle)
            self.time = now

    def _write_run(self, ran: float, pieces: list[Sighting], followed: int) -> None:
        """Write down what passed by, then the pose, in the frame of what is believed."""
        pose = self.log().belief.logged
        counted = self.body.logged(ran)
        stretch = counted / ran if ran else 1.0
        cos, sin = (
            math.cos(math.radians(pose.heading_deg)),
            math.sin(math.radians(pose.heading_deg)),
        )

        def believed(ahead: float, left: float) -> tuple[float, float]:
            ahead *= stretch
            return pose.x + ahead * cos - left * sin, pose.y + ahead * sin + left * cos

        for piece in pieces:
            self._write_piece(piece, believed, piece.side == followed)
        if counted:
            self.note_pose(pose.x + counted * cos, pose.y + counted * sin, pose.heading_deg)

    def _write_piece(self, piece: Sighting, believed: Believed, followed: bool) -> None:
        book = self.log()
        at, to = believed(piece.x, piece.y), believed(piece.x2, piece.y2)
        book.wall(self.time, *at, *to, followed)
        if piece.ended is not None:
            x, y, kind = piece.ended
            book.corner(self.time, *believed(x, y), kind)

    def note_ahead(self, reading: float, corner: tuple[float, float] | None) -> None:
        """Write down a wall ahead, seen at standstill, and perhaps the corner that it makes.

        reading : from the nose [m]; corner : in the robot's frame [m].
        """
        pose = self.log().belief.logged
        cos, sin = (
            math.cos(math.radians(pose.heading_deg)),
            math.sin(math.radians(pose.heading_deg)),
        )
        ahead = self._settings.length / 2 + reading
        x, y = pose.x + ahead * cos, pose.y + ahead * sin
        self.log().wall(self.time, x, y, x, y, followed=False)
        if corner is not None:
            kind: CornerKind = "concave"
            x = pose.x + corner[0] * cos - corner[1] * sin
            y = pose.y + corner[0] * sin + corner[1] * cos
            self.log().corner(self.time, x, y, kind)

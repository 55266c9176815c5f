"""Steering: makes the body follow what navigation asks for, and the log tell it (paper §2.4).

Motions are events: each is asked for as a whole, and yielded with the time that it takes; whoever
runs the mission answers how much of it was done before something came in between.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from possmap.lab.simulate.body import Body, Place
from possmap.lab.simulate.logbook import Logbook
from possmap.lab.simulate.perception import Perception, SeenPiece
from possmap.lab.simulate.settings import MissionSettings

Track: TypeAlias = list[list[float]]


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
        (x, y, heading), (x2, y2, heading2) = self.start, self.end
        return Place(
            x + share * (x2 - x), y + share * (y2 - y), heading + share * (heading2 - heading)
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
    """Executes runs and turns, and writes down what was believed and seen.

    book, track, trail : of the excursion under way: its log, the truth file's rows, and the places
    where the robot believes it was.
    time : when the last motion ended [s].
    was_stopped : whether it was cut short.
    bumped : which side of the front touched something at the last run, 0 for none.
    """

    book: Logbook

    def __init__(self, settings: MissionSettings, body: Body, perception: Perception) -> None:
        self._settings = settings
        self.body = body
        self.perception = perception
        self.track: Track = []
        self.trail: list[tuple[float, float]] = []
        self.time = 0.0
        self.was_stopped = False
        self.bumped = 0

    def set_out(self, book: Logbook, home: Place) -> None:
        """Begin an excursion."""
        self.book, self.track, self.trail = book, [], []
        self.body.set_down(home)
        self.note_pose(home.x, home.y, math.degrees(home.heading))

    def note_pose(self, x: float, y: float, heading_deg: float, turned: bool | None = None) -> None:
        """Write a pose into the log, and both it and the truth into the track."""
        place = self.body.place
        ir = self.perception.five(place) if self._settings.log_ir else None
        self.book.pose(self.time, x, y, heading_deg, turned, ir)
        belief, true_deg = self.book.belief, round(math.degrees(place.heading), 2)
        true = [round(self.time, 2), round(place.x, 4), round(place.y, 4), true_deg]
        self.track.append([*true, belief.logged.x, belief.logged.y, belief.logged.heading_deg])
        self.trail.append(belief.corrected.place)

    def _note_heading(self, heading_deg: float, turned: bool) -> None:
        pose = self.book.belief.logged
        self.note_pose(pose.x, pose.y, heading_deg, turned)

    def _after(self, done: Done) -> None:
        self.time = done.time
        self.was_stopped = done.share < 1

    def wait(self, seconds: float) -> Steps:
        """Stand still."""
        place = self.body.place
        self._after((yield Motion(seconds, place, place)))

    def turn(self, asked_deg: float) -> Steps:
        """Turn on the spot; what is believed is what was asked for."""
        if asked_deg:
            self.bumped = 0
            end = self.body.turned(asked_deg)
            yield from self._turn_to(end, abs(asked_deg))
            self._note_heading(self.book.belief.logged.heading_deg + asked_deg, turned=True)

    def line_up(self, true_heading: float) -> Steps:
        """Turn parallel to a wall by its readings; what is believed is what the wheels count.

        It errs by its misalignment, which the wheels count as well. Only a run along the wall makes
        it a right angle, since only that run tells the host.
        """
        place, off = self.body.place, self.body.misalignment()
        away = math.remainder(true_heading - place.heading, 2 * math.pi) + off
        yield from self._turn_to(place.turned(away), abs(math.degrees(away)))
        self.body.off = off
        counted = round(self.body.counted_turn(math.degrees(away)), 2)
        if counted:
            self._note_heading(self.book.belief.logged.heading_deg + counted, turned=True)

    def _turn_to(self, end: Place, degrees: float) -> Steps:
        done = yield Motion(degrees / self._settings.turn_rate, self.body.place, end)
        self.body.place = end
        self._after(done)

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
        start = body.along_wall if lined_up else body.place
        bend = body.bend(distance, lined_up)
        chord = start.turned(bend / 2)
        way = self.perception.way_ahead(chord, distance)
        self.was_stopped, self.bumped = False, 0
        if way.distance > 0:
            bend, distance = bend * way.distance / distance, way.distance
            # Along a circle, ends lie nearer than the way between them (METHOD §1).
            chord_length = distance * (math.sin(bend / 2) / (bend / 2) if bend else 1.0)
            end = Place(*chord.at(chord_length, 0.0), start.heading + bend)
            done = yield from self._move(end, distance)
            ran = distance * done.share
            pieces = list(self.perception.beside(chord, ran)) if ran > 0 else []
            followed = wall_side if lined_up else 0
            if any(piece.side == followed for piece in pieces):
                self._believe_right_angle(set_out)
            body.place = Motion(1.0, start, end).at(done.share).turned(body.off)
            self._write_run(ran, pieces, followed)
            yield from self._hold(done)
        if way.stop == "bump" and not self.was_stopped:
            yield from self._back_off(way.across)

    def _move(self, end: Place, distance: float) -> Generator[Motion, Done, Done]:
        done = yield Motion(distance / self._settings.speed, self.body.place, end, moves=True)
        self._after(done)
        return done

    def _hold(self, done: Done) -> Steps:
        if done.hold:
            yield from self.wait(done.hold)
            self.was_stopped = True

    def _back_off(self, across: float) -> Steps:
        """After a bump, write down what was touched, and go back far enough to turn.

        across : where the front touches it, left positive [m].
        """
        self.bumped = 1 if across >= 0 else -1
        self._note_touched(self._settings.length / 2, across)
        start = self.body.place
        way = self.perception.way_ahead(start.turned(math.pi), self._settings.gap)
        if way.distance <= 0:
            return
        end = start.moved(-way.distance)
        done = yield from self._move(end, way.distance)
        self.body.place = Motion(1.0, start, end).at(done.share)
        self._write_run(-way.distance * done.share, [], 0)
        yield from self._hold(done)

    def _believe_right_angle(self, since: float) -> None:
        """Write down, as of the run's start, that it went along a wall."""
        belief = self.book.belief
        right_angle = 90.0 * round(math.degrees(belief.heading) / 90.0)
        if math.remainder(right_angle - belief.logged.heading_deg, 360.0):
            now, self.time = self.time, since
            self._note_heading(right_angle, turned=False)
            self.time = now

    def _write_run(self, ran: float, pieces: Sequence[SeenPiece], followed: int) -> None:
        """Write down walls that passed by, and their ends, then the pose, as is believed."""
        counted = self.body.logged(ran)
        stretch = counted / ran if ran else 1.0  # as the wheels count, way ahead is stretched
        for piece in pieces:
            at = self._believed(piece.x * stretch, piece.y)
            to = self._believed(piece.x2 * stretch, piece.y2)
            self.book.wall(self.time, *at, *to, piece.side == followed)
            if piece.ended is not None:
                x, y, kind = piece.ended
                self.book.corner(self.time, *self._believed(x * stretch, y), kind)
        if counted:
            self.note_pose(*self._believed(counted, 0.0), self.book.belief.logged.heading_deg)

    def note_ahead(self, reading: float, beside: float | None) -> None:
        """Write down a wall ahead, seen at standstill, and perhaps the corner that it makes.

        reading : from the nose [m]; beside: where the wall of the corner is, left positive [m].
        """
        ahead = self._settings.length / 2 + reading
        self._note_touched(ahead, 0.0)
        if beside is not None:
            self.book.corner(self.time, *self._believed(ahead, beside), "concave")

    def _note_touched(self, ahead: float, left: float) -> None:
        """Write down a single reading of a wall, in the robot's frame [m]."""
        at = self._believed(ahead, left)
        self.book.wall(self.time, *at, *at, followed=False)

    def _believed(self, ahead: float, left: float) -> tuple[float, float]:
        """Return where something in the robot's frame [m] is believed to be."""
        pose = self.book.belief.logged
        return Place(pose.x, pose.y, math.radians(pose.heading_deg)).at(ahead, left)

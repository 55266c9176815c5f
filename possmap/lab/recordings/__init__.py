"""Recordings of robots that already exist: one interface to CARMEN, ROS bags, CSV and JSON."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

from possmap.errors import RecordingError, printable
from possmap.lab.recordings.carmen import PoseOf, looks_like, open_carmen
from possmap.lab.recordings.leaps import Jump
from possmap.lab.recordings.mapping import FOLDER, Mapping, Table, find_mapping, read_mapping
from possmap.lab.recordings.recording import Handling, Recording
from possmap.lab.recordings.stream import head_of
from possmap.lab.recordings.tables import open_tables
from possmap.lab.recordings.tick_geometry import geometry_beside
from possmap.settings.shipped import shipped_names

__all__ = [
    "FORMATS",
    "Mapping",
    "Recording",
    "Source",
    "find_mapping",
    "open_recordings",
    "read_mapping",
]

Format: TypeAlias = Literal["carmen", "ros", "csv", "json"]
FORMATS: tuple[Format, ...] = ("carmen", "ros", "csv", "json")

_BAGS = (b"#ROSBAG", b"\x89MCAP", b"SQLite format 3\0")


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """How recordings are to be read.

    format : None: told by what is inside. mapping : of columns or topics.
    beams : angles of the beams used [rad].
    pose_of : CARMEN: whose pose to believe. clock : bags: the messages' own, or the recorder's.
    guard : a step that differs more from the velocity is replaced [m]; None: the mapping's.
    jump, max_speed : what becomes of steps that no robot can make, such as faster ones [m/s].
    sparse : whether few rows hold anything, of places far apart.
    """

    format: Format | None = None
    mapping: Mapping | None = None
    beams: tuple[float, ...] = ()
    pose_of: PoseOf = "odometry"
    clock: Literal["header", "bag"] = "header"
    guard: float | None = None
    jump: Jump = "bridge"
    max_speed: float | None = None
    sparse: bool = False

    @property
    def handling(self) -> Handling:
        """What becomes of steps that no robot can make."""
        return Handling(self.jump, self.max_speed, self.sparse)


def open_recordings(paths: Sequence[Path], source: Source) -> list[Recording]:
    """Open recordings, in the order given.

    Of a recording of several files any may be named: the mapping knows the others.

    Raises
    ------
    RecordingError, SettingsError
        If one cannot be read, or its columns are not mapped.
    """
    mapping = source.mapping
    if mapping is not None and source.guard is not None:
        mapping = replace(mapping, guard=source.guard)
        source = replace(source, mapping=mapping)
    if mapping is not None and mapping.format != "ros" and len(mapping.tables) > 1:
        groups = list(_groups(paths, mapping.tables))
        for _, group in groups:
            for path in group:
                _format_of(path, source)
        return [
            open_tables(group, mapping, source.beams, source.handling, star)
            for star, group in groups
        ]
    return [_open(path, source) for path in paths]


def _open(path: Path, source: Source) -> Recording:
    mapping = source.mapping
    found = _format_of(path, source)
    if found == "ros":
        from possmap.lab.recordings.rosbag.recording import open_bag

        return open_bag(path, source.beams, mapping, source.clock, source.handling)
    if found == "carmen":
        return open_carmen(path, source.beams, source.pose_of, source.handling)
    if mapping is None:
        raise RecordingError(
            str(path),
            "its columns are not mapped, expected --mapping FILE or one of those that possmap "
            f"ships: {', '.join(shipped_names(FOLDER))}",
        )
    ticks = mapping.ticks
    geometry = geometry_beside(path) if ticks is not None else None
    if ticks is None or geometry is None:
        return open_tables([path], mapping, source.beams, source.handling)
    ticks = replace(geometry.ticks, wrap=ticks.wrap, cumulative=ticks.cumulative)
    mapping = replace(mapping, ticks=ticks)
    return open_tables([path], mapping, source.beams, source.handling, note=geometry.said)


def _format_of(path: Path, source: Source) -> str:
    """Return the format that a recording is read in.

    Raises
    ------
    RecordingError, SettingsError
        If it cannot be read, or its mapping is for another format.
    """
    mapping = source.mapping
    if mapping is None:
        return source.format or guessed(path)
    told = mapping.format
    if source.format is None and told == "ros":  # what is no bag is said there
        return told
    found = source.format or _recognised(path) or told
    if source.format is None and (found, told) == ("carmen", "csv"):
        return told  # some tables have such words in them
    if found != told:
        problem = f"is of the format {found}, but the mapping is for {told}"
        raise RecordingError(str(path), problem)
    return found


def guessed(path: Path) -> Format:
    """Return a recording's format, told by what is inside.

    Raises
    ------
    RecordingError
        If the file cannot be read, is empty, or is of no known format.
    """
    found = _recognised(path)
    if found is None and b"\0" in head_of(path):
        raise RecordingError(
            str(path), "of no known format, expected CARMEN, a ROS bag, CSV or JSON"
        )
    return found or "csv"


def _recognised(path: Path) -> Format | None:
    """Return a format that has marks of its own; None for what may be CSV, or nothing."""
    if path.is_dir():
        if (path / "metadata.yaml").exists():
            return "ros"
        raise RecordingError(str(path), "is a folder without the metadata.yaml of a ROS 2 bag")
    head = head_of(path)
    if not head:
        raise RecordingError(str(path), "holds nothing that can be read, expected a recording")
    if head.startswith(_BAGS):
        return "ros"
    if looks_like(head):
        return "carmen"
    start = head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1]
    return "json" if start in (b"{", b"[") else None


def _groups(paths: Sequence[Path], tables: Sequence[Table]) -> Iterator[tuple[str, list[Path]]]:
    """Yield name and files of each recording, one file for each table of the mapping."""
    seen: set[tuple[Path, str]] = set()
    for path in paths:
        found = (_star(path.name, table.source) for table in tables)
        stars = [star for star in found if star is not None]
        if not stars:
            patterns = ", ".join(table.source for table in tables)
            raise RecordingError(str(path), f"is no file of this mapping, expected {patterns}")
        groups = [[path.parent / table.source.replace("*", s) for table in tables] for s in stars]
        missing = [[one for one in group if not one.is_file()] for group in groups]
        whole = next((number for number, lack in enumerate(missing) if not lack), None)
        if whole is None:
            raise RecordingError(str(missing[0][0]), f"is missing beside {printable(path.name)}")
        if (path.parent, stars[whole]) not in seen:
            seen.add((path.parent, stars[whole]))
            yield stars[whole], groups[whole]


def _star(name: str, pattern: str) -> str | None:
    """Return what the star of a pattern stands for in a name; None if it does not match."""
    before, star, after = pattern.partition("*")
    found = re.fullmatch(re.escape(before) + ("(.*)" if star else "()") + re.escape(after), name)
    return found.group(1) if found else None

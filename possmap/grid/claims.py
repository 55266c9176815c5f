"""What a grid file says outside its hashes, held against all that could contradict it.

Nothing proves settings, own models, sources and lists of tiles. But they were written by one
program, and hang together: docs/trust.md says how far that reaches.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime, timedelta

from possmap.core.model import PARAMETERS
from possmap.core.settings import EvidenceSettings, RobotModels
from possmap.errors import brief, shown
from possmap.grid.arrivals import Event, Part
from possmap.grid.checks import json_value, own_model
from possmap.grid.database import Database
from possmap.grid.forgotten import Forgotten
from possmap.grid.ledger import Entry, Ledger
from possmap.logs.fields import NAME
from possmap.settings.setting_table import ROBOT, SHAPING

MOST_STRAYS = 20
"""Rows without a place that are named of each kind; more of them say nothing new."""

_SHA256 = re.compile("[0-9a-f]{64}")
_TIME = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}\+00:00")


class Claims:
    """Looks at one grid file, and yields each contradiction as one line."""

    def __init__(self, database: Database) -> None:
        self._database, self._ledger = database, Ledger(database)

    def settings(self) -> Iterator[str]:
        """Yield what is wrong with the stored settings, of which each can be read by itself."""
        for name, text in self._database.all("SELECT name, value FROM setting ORDER BY name"):
            if name not in SHAPING and not str(name).startswith(ROBOT):
                yield f"setting {brief(str(name))}: no grid keeps it"
                continue
            with self._database.sound(f"setting {brief(str(name))}"):
                value = json_value(text)
            parameter = name.rpartition(".")[2] if name.startswith(ROBOT) else name
            expected = _JSON_TYPES.get(parameter, (float, int))
            if type(value) not in expected:
                yield f"setting {brief(name)}: found {shown(value)}, which possmap never writes"

    def own_model(self, entry: Entry, settings: EvidenceSettings) -> Iterator[str]:
        """Yield where an excursion's model in force is not the one that its log gave itself."""
        for name, value in self._own(entry).items():
            found = getattr(entry.model, name)
            if settings.accept_models and found != value:
                yield f"fused with {name} {found}, but its own model says {value}"

    def model(self, entry: Entry, settings: EvidenceSettings, robots: RobotModels) -> Iterator[str]:
        """Yield where it is not the one of the settings.

        What ``robots:`` says of its robot may have been something else when it came: such
        parameters are left out.
        """
        known = {*robots.get(entry.robot, {})}
        if settings.accept_models:
            known |= self._own(entry).keys()
        for name in PARAMETERS:
            found, value = getattr(entry.model, name), getattr(settings.model, name)
            if name not in known and found != value:
                yield f"fused with {name} {found}, but the grid's setting is {value}"

    def _own(self, entry: Entry) -> dict[str, float]:
        row = self._database.one("SELECT own_model FROM excursion WHERE id = ?", (entry.identity,))
        with self._database.sound("its own model"):
            return dict(own_model(row[0] if row else None))

    def strays(self) -> Iterator[str]:
        """Yield rows that belong to nothing, in tables of which SQLite does not know it."""
        for row, column, excursion, number in self._database.all(
            "SELECT tile_row, tile_column, excursion, number FROM touched"
            " LEFT JOIN excursion ON excursion.id = touched.excursion"
            " WHERE excursion.id IS NULL OR typeof(number) <> 'integer'"
            f" OR number < 0 OR number >= records LIMIT {MOST_STRAYS}"
        ):
            yield (
                f"tile {_short(row)}, {_short(column)}: touched by record {_short(number)} of "
                f"excursion number {_short(excursion)}, which is not there"
            )
        for identity, layer in self._database.all(
            f"SELECT id, layer FROM tile WHERE layer NOT IN (0, 1, 2) LIMIT {MOST_STRAYS}"
        ):
            yield f"row {identity} of table tile: there is no layer {_short(layer)}"
        tables = ("part", "again") if self._database.format > 1 else ("part",)
        used = " UNION ALL ".join(f"SELECT source FROM {table}" for table in tables)
        for identity, name in self._database.all(
            f"SELECT id, name FROM source WHERE id NOT IN ({used}) ORDER BY id LIMIT {MOST_STRAYS}"
        ):
            yield f"source number {identity}, {brief(str(name))}: nothing came by it"

    def forgotten(self) -> Iterator[str]:
        """Yield what is wrong with what is said to be forgotten."""
        seen: set[tuple[str | None, ...]] = set()
        for one in self._ledger.forgotten.all():
            yield from forgotten_faults(one)
            key = one.robot, one.excursion, one.sha256
            if key in seen:
                yield f"{one.title} was forgotten twice"
            seen.add(key)


_JSON_TYPES: dict[str, tuple[type, ...]] = {
    "estimator": (str,), "independence": (str,), "free_along_walls": (bool,),
    "free_along_beams": (bool,), "clip_coobserved": (bool,), "accept_models": (bool,),
    "orthogonal": (bool,), "free_fusion": (str,),
}  # fmt: skip
"""Of the settings that are no numbers."""


def forgotten_faults(one: Forgotten) -> Iterator[str]:
    """Yield what cannot be true of something forgotten, each behind its title."""
    for name in (one.robot, one.excursion):
        if name is not None and not NAME.fullmatch(name):
            yield f"{one.title} was forgotten: found {shown(name)}, expected a name"
    if one.sha256 is not None and not _SHA256.fullmatch(one.sha256):
        yield f"{one.title} was forgotten: found {shown(one.sha256)}, expected a SHA-256"
    if not _is_utc(one.forgotten_at):
        yield f"{one.title} was forgotten: found {shown(one.forgotten_at)}, expected a time"


def origin_faults(event: Event) -> Iterator[str]:
    """Yield what cannot be true of what came by a file."""
    what, origin = event.what, event.what.origin
    where = f"source number {event.source}, {brief(origin.name)}"
    if not _SHA256.fullmatch(origin.sha256):
        yield f"{where}: found {shown(origin.sha256)}, expected a SHA-256"
    if origin.size < 0:
        yield f"{where}: found a size of {origin.size} bytes"
    if not _is_utc(event.fused_at):
        yield f"{where}: found {shown(event.fused_at)}, expected a time"
    if isinstance(what, Part) and what.first and not what.count:
        yield f"{where}: brought nothing new"
    for one in what.carrier or ():
        if not NAME.fullmatch(one):
            yield f"{where}: carried by {shown(one)}, expected a name"


def _is_utc(text: str) -> bool:
    """Whether it is a time as possmap writes it; Python's own reader looks past a NUL."""
    if not _TIME.fullmatch(text):
        return False
    try:
        return datetime.fromisoformat(text).utcoffset() == timedelta(0)
    except ValueError:
        return False


def _short(value: object) -> str:
    return str(value) if type(value) is int else shown(value)

"""What in a grid file is not as possmap writes it: structure, hashes, ledger (docs/trust.md)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cached_property
from itertools import groupby
from operator import itemgetter

import numpy as np

from possmap.core.evidence import Layer
from possmap.core.lattice import TILE, TileKey, Window
from possmap.core.model import PARAMETERS
from possmap.core.plan import Touched
from possmap.core.records import NAME, PartialMap
from possmap.core.settings import EvidenceSettings, RobotModels
from possmap.errors import GridError, brief, printable
from possmap.grid.arrivals import Arrival
from possmap.grid.encoding import decode, encode
from possmap.grid.forgotten import Bans, Forgotten
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.grid.rows import excursion_hash
from possmap.logs.delivery import path_text
from possmap.logs.fields import Fault
from possmap.logs.rechecking import rechecked
from possmap.settings.setting_table import ROBOT, SHAPING

LAYER_WORDS = {Layer.WALLS: "walls", Layer.FREE: "free space", Layer.POINTS: "points"}

_SHA256 = re.compile("[0-9a-f]{64}")
_TIME = re.compile(r"[0-9]{4}-[01][0-9]-[0-3][0-9]T[0-2][0-9]:[0-5][0-9]:[0-5][0-9]\+00:00")
_UNSOUND = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError)

ANY_NESTING = 10_000
"""The limit on it belongs to the call that read the log, and may have been any."""


class Soundness:
    """Looks at one state of a grid, and yields each fault as one line.

    Some of it is read once for all excursions: make another one when the file has changed.
    """

    def __init__(self, grid: Grid) -> None:
        self._grid, self._database, self._ledger = grid, grid.database, grid.ledger

    def structure(self) -> Iterator[str]:
        """Yield what SQLite finds wrong with the file as a database, its types too.

        After a fault nothing should be read on: a table whose pages are counted twice may seem to
        have any number of rows.
        """
        return self._database.structure_faults()

    def strays(self) -> Iterator[str]:
        """Yield rows that belong to nothing."""
        yield from self._database.orphans()
        for table, sql in (
            ("touched", "FROM touched JOIN excursion ON id = excursion WHERE number >= records"),
            ("source", "FROM source WHERE id NOT IN (SELECT source FROM arrival)"),
            (
                "tile",
                "FROM tile WHERE id NOT IN (SELECT tile FROM cells) OR layer NOT IN (0, 1, 2)",
            ),
        ):
            if found := (self._database.one(f"SELECT count(*) {sql}") or (0,))[0]:
                yield f"{found} rows of table {table} belong to nothing"
        for one in self._ledger.forgotten.all():
            if not is_sound(one):
                yield f"{one.title} was forgotten: not as possmap writes it"

    def settings(self) -> Iterator[str]:
        """Yield what is wrong with the stored settings."""
        try:
            names = self._grid.stored_settings()
        except GridError as error:
            yield self._database.bare(error)
            return
        for name in names:
            if name not in SHAPING and not name.startswith(ROBOT):
                yield f"setting {brief(name)}: no grid keeps it"

    def tiles(self) -> Iterator[str]:
        """Yield each tile whose cells are not what was written, one row after the other."""
        for row in self._grid.tiles.directory.rows():
            for layer, column, *bounds, digest, data in self._database.all(
                'SELECT layer, "column", row0, row1, column0, column1, hash, data'
                " FROM tile JOIN cells ON cells.tile = tile.id"
                ' WHERE layer IN (0, 1, 2) AND row = ? ORDER BY layer, "column"',
                (row,),
            ):
                key, at = TileKey(row, column), Window(*bounds)
                fault = self._tile_fault(Layer(layer), key, at, digest, data)
                if fault:
                    yield f"tile {row}, {column}, {LAYER_WORDS[layer]}: {fault}"

    def _tile_fault(
        self, layer: Layer, key: TileKey, bounds: Window, digest: bytes, data: bytes
    ) -> str | None:
        if bounds != bounds.intersection(Window(0, TILE, 0, TILE)) or not bounds.cells:
            return "bounds outside the tile"
        try:
            cells = decode(bounds, data)
        except ValueError as error:
            return printable(str(error))
        whole = np.zeros((TILE, TILE), dtype=cells.dtype)
        whole[bounds.row0 : bounds.row1, bounds.column0 : bounds.column1] = cells
        sound = cells.any() and not (cells < 0).any()
        if not sound or encode(layer, key, whole)[:2] != (bounds, digest):
            return "its hash is not that of its cells"
        return None

    def excursion(self, identity: int) -> Iterator[str]:
        """Yield what is wrong with one excursion of the ledger, but for its model."""
        where = f"excursion number {identity}"
        try:
            entry = self._ledger.entry_of(identity)
            if entry is None:
                yield f"{where}: is not there"
                return
            where = entry.title
            yield from (f"{where}: {fault}" for fault in self._excursion(entry))
        except GridError as error:
            yield f"{where}: {self._database.bare(error)}"
        except _UNSOUND as error:  # a value of another type than its column's
            yield f"{where}: damaged: {printable(str(error))[:200]}"

    def _excursion(self, entry: Entry) -> Iterator[str]:
        version = self._ledger.version(entry)
        yield from faults_of(version)
        stored = self._database.one("SELECT hash FROM excursion WHERE id = ?", (entry.identity,))
        if stored != (excursion_hash(version, entry.model),):
            yield "its hash is not that of its records"
        came = self._ledger.came.of(entry.name)
        held = max((one.records for one in came), default=-1)
        if held < entry.records:
            yield f"nothing says what brought record {max(0, held)}"
        for one in came:
            if not is_sound(one):
                where = f"source number {one.source}, {brief(one.origin.name)}"
                yield f"{where}: not as possmap writes it"
            if one.records > entry.records:
                yield f"{brief(one.origin.name)} is said to have held more records"
            ban = self._bans.on(entry.name, one.origin.sha256)
            if ban is not None:
                yield f"{ban.title} was forgotten, and is here"

    def model(self, entry: Entry) -> Iterator[str]:
        """Yield where an excursion's model in force is not what its log and the settings say.

        What ``robots:`` says of its robot may have been something else when it came: such
        parameters are left out.
        """
        own = dict(self._ledger.version(entry, 0).model)
        expected = self._settings.model_in_force(tuple(own.items()), {})
        believed = own if self._settings.accept_models else {}
        hearsay = self._robots.get(entry.robot, {}).keys() - believed.keys()
        for name in PARAMETERS:
            found, value = getattr(entry.model, name), getattr(expected, name)
            if found != value and name not in hearsay:
                whose = "its own model says" if name in believed else "the grid's setting is"
                yield f"{entry.title}: fused with {name} {found}, but {whose} {value}"

    def is_touched(self, entry: Entry, touched: Touched) -> bool:
        """Whether these are the tiles that the ledger says an excursion's records touch.

        touched : sorted.
        """
        # The table begins with the tile: to ask for all tiles of an excursion would scan it.
        if self._touches.get(entry.identity, 0) != len(touched):
            return False
        return all(
            self._ledger.numbers_in(TileKey(*place), entry) == {number for *_, number in of_tile}
            for place, of_tile in groupby(touched, key=itemgetter(0, 1))
        )

    @cached_property
    def _touches(self) -> dict[int, int]:
        """How many tiles each excursion's records touch, each record's counted by itself."""
        return dict(
            self._database.all("SELECT excursion, count(*) FROM touched GROUP BY excursion")
        )

    @cached_property
    def _settings(self) -> EvidenceSettings:
        return self._grid.settings

    @cached_property
    def _robots(self) -> RobotModels:
        return self._grid.robots

    @cached_property
    def _bans(self) -> Bans:
        return Bans(self._ledger.forgotten.all())


def is_sound(what: Arrival | Forgotten) -> bool:
    """Whether a note of the ledger is of the form that its table asks for."""
    if isinstance(what, Arrival):
        names = tuple(what.carrier or ())
        sha256, time = what.origin.sha256, what.fused_at
        counts = (what.records, what.origin.size)
    else:
        names = tuple(one for one in (what.robot, what.excursion) if one is not None)
        sha256, time = what.sha256 or "0" * 64, what.forgotten_at
        counts = (what.excursions, what.records)
        if (what.robot is None) == (what.sha256 is None):
            return False
    return (
        all(type(one) is int and one >= 0 for one in counts)
        and all(type(one) is str for one in (*names, sha256, time, what.version))
        and all(map(NAME.fullmatch, names))
        and bool(_SHA256.fullmatch(sha256) and _TIME.fullmatch(time))
    )


def faults_of(version: PartialMap) -> Iterator[str]:
    """Yield what no reading of a log could have given."""
    try:
        rechecked(version, ANY_NESTING)
    except Fault as fault:
        yield ": ".join(filter(None, (path_text(fault.path), fault.problem)))

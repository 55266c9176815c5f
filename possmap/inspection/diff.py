"""``possmap diff``: in what two grids differ, tile by tile, so that they may be of any size."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from possmap.atomic import check_output, replacing
from possmap.core.lattice import Window
from possmap.errors import OutputError, SettingsError, printable
from possmap.exports.job import Metres, refuse_itself
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.inspection.changes import Change, ChangedCells, Largest, changes_in_row
from possmap.inspection.difference_picture import Canvas, raster_for
from possmap.pictures.palettes import write_png
from possmap.pictures.render import check_suffix
from possmap.progress import Progress, quiet
from possmap.release import version
from possmap.settings.setting_table import Value

T = TypeVar("T")


class Pair(NamedTuple, Generic[T]):
    """Something of A and of B."""

    a: T
    b: T

    @property
    def differ(self) -> bool:
        """Whether they are not the same."""
        return self.a != self.b


@dataclass(frozen=True, slots=True)
class ExcursionDiff:
    """An excursion that both grids know, but not the same of it.

    records : how many.
    model : the parameters in force that differ.
    """

    robot: str
    excursion: str
    records: Pair[int]
    model: dict[str, Pair[float | None]]


@dataclass(frozen=True, slots=True)
class DiffSummary:
    """In what two grids differ.

    settings : those that differ; None where a grid has none of that name.
    records : of all excursions.
    equal_excursions : how many are the same in both.
    cells : None if the digests are equal, for then no cell differs.
    largest : the largest changes, the largest first.
    picture : width and height of what was drawn [pixels].
    """

    a: Path
    b: Path
    digests: Pair[str]
    settings: dict[str, Pair[Value | None]]
    records: Pair[int]
    equal_excursions: int
    only_a: tuple[Entry, ...]
    only_b: tuple[Entry, ...]
    changed: tuple[ExcursionDiff, ...]
    cells: ChangedCells | None
    largest: tuple[Change, ...] = ()
    picture: tuple[int, int] | None = None

    @property
    def equal(self) -> bool:
        """Whether both hold the same evidence."""
        return not self.digests.differ


def diff(
    a: Path,
    b: Path,
    *,
    largest: int = 5,
    window_m: Metres | None = None,
    picture: Path | None = None,
    overwrite: bool = False,
    progress: Progress = quiet,
) -> DiffSummary:
    """Compare two grids of one resolution.

    Parameters
    ----------
    largest
        How many of the largest changes to name.
    window_m
        Compare only the cells of this rectangle.
    picture
        A PNG file to draw the changes into.

    Raises
    ------
    SettingsError
        If the grids have different resolutions.
    GridError
        If one of them cannot be read.
    OutputError
        If the picture cannot be written, or there is nothing to draw.
    """
    if picture is not None:
        # Before the work rather than after it.
        check_suffix(picture, (".png",), ".png")
        for grid_path in (a, b):
            refuse_itself(grid_path, picture)
        check_output(picture, overwrite)
    with ExitStack() as stack:
        of_a, of_b = (stack.enter_context(Grid(path)) for path in (a, b))
        for grid in (of_a, of_b):
            stack.enter_context(grid.snapshot())
        if of_a.resolution != of_b.resolution:
            raise SettingsError(
                f"{printable(str(b))}: resolution {of_b.resolution!r}, where "
                f"{printable(str(a))} has {of_a.resolution!r}: their cells cannot be compared"
            )
        window = _window(of_a, of_b, window_m)
        canvas = None
        if picture is not None:
            if window is None:
                raise OutputError(
                    f"{printable(str(picture))}: neither grid holds evidence"
                    f"{' in the window' if window_m else ''}, so there is nothing to show"
                )
            canvas = Canvas(raster_for(window, exact=window_m is not None))
        digests = Pair(of_a.digest(), of_b.digest())
        cells, best = ChangedCells(), Largest(largest, of_a.lattice)
        if window is not None and (digests.differ or canvas is not None):
            rows = {row for grid in (of_a, of_b) for row in grid.tiles.directory.rows(window)}
            for row in progress(sorted(rows), "row"):
                for found in changes_in_row(row, of_a, of_b, window):
                    cells.add(found)
                    best.add(found)
                    if canvas is not None:
                        canvas.add(found)
        size = None
        if picture is not None and canvas is not None:
            image = canvas.drawn((a.stem, b.stem), of_a.resolution, best.chosen())
            size = image.size
            text = {
                "Software": f"possmap {version()}",
                "possmap:digests": ",".join(digests),
                "possmap:view": "difference",
                "possmap:resolution": repr(of_a.resolution),
            }
            with replacing(picture, overwrite) as stream:
                write_png(image, stream, text)
        in_a, in_b = dict(_hashed(of_a)), dict(_hashed(of_b))
        both = [(in_a[name], in_b[name]) for name in in_a if name in in_b]
        changed = [(one[0], other[0]) for one, other in both if one[1] != other[1]]
        return DiffSummary(
            a=a,
            b=b,
            digests=digests,
            settings=_changed(of_a.stored_settings(), of_b.stored_settings()),
            records=Pair(*(sum(one.records for one, _ in of.values()) for of in (in_a, in_b))),
            equal_excursions=len(both) - len(changed),
            only_a=tuple(entry for name, (entry, _) in in_a.items() if name not in in_b),
            only_b=tuple(entry for name, (entry, _) in in_b.items() if name not in in_a),
            changed=tuple(_differ(one, other) for one, other in changed),
            cells=cells if digests.differ else None,
            largest=best.chosen(),
            picture=size,
        )


def _window(a: Grid, b: Grid, window_m: Metres | None) -> Window | None:
    """Return the cells to compare: what holds the evidence of both, or what was asked for."""
    held = [grid.window for grid in (a, b) if grid.window is not None]
    if not held:
        return None
    everything = held[0].union(held[-1])
    if window_m is None:
        return everything
    window = a.lattice.window_of(*window_m)
    return window if window.intersection(everything).cells else None


def _changed(a: Mapping[str, T], b: Mapping[str, T]) -> dict[str, Pair[T | None]]:
    pairs = {name: Pair(a.get(name), b.get(name)) for name in (*a, *b)}
    return {name: pair for name, pair in pairs.items() if pair.differ}


def _hashed(grid: Grid) -> Iterator[tuple[tuple[str, str], tuple[Entry, bytes]]]:
    """Yield each excursion by its name, with the hash of its records."""
    entries = sorted(grid.ledger.entries(), key=lambda entry: entry.name)
    for entry, digest in zip(entries, grid.ledger.hashes(), strict=True):
        yield entry.name, (entry, digest)


def _differ(a: Entry, b: Entry) -> ExcursionDiff:
    model = _changed(asdict(a.model), asdict(b.model))
    return ExcursionDiff(a.robot, a.excursion, Pair(a.records, b.records), model)

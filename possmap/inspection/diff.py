"""``possmap diff``: in what two grids differ, tile by tile, so that they may be of any size."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

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


@dataclass(frozen=True, slots=True)
class ExcursionDiff:
    """An excursion that both grids know, but not the same of it.

    records : how many, in A and in B.
    model : the parameters in force that differ, in A and in B.
    """

    robot: str
    excursion: str
    records: tuple[int, int]
    model: dict[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class ExcursionsDiff:
    """Whose excursions the grids hold.

    equal : how many are the same in both.
    records : of all excursions, in A and in B.
    """

    only_a: tuple[Entry, ...]
    only_b: tuple[Entry, ...]
    changed: tuple[ExcursionDiff, ...]
    equal: int
    records: tuple[int, int]


@dataclass(frozen=True, slots=True)
class DiffSummary:
    """In what two grids differ.

    settings : those that differ; None where a grid has none of that name.
    cells : None if the digests are equal, for then no cell differs.
    largest : the largest changes, the largest first.
    picture : width and height of what was drawn [pixels].
    """

    a: Path
    b: Path
    digest_a: str
    digest_b: str
    settings: dict[str, tuple[Value | None, Value | None]]
    excursions: ExcursionsDiff
    cells: ChangedCells | None
    largest: tuple[Change, ...] = ()
    picture: tuple[int, int] | None = None

    @property
    def equal(self) -> bool:
        """Whether both hold the same evidence."""
        return self.digest_a == self.digest_b


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
        digests = of_a.digest(), of_b.digest()
        cells, best = ChangedCells(), Largest(largest, of_a.lattice)
        differ = digests[0] != digests[1]
        if window is not None and (differ or canvas is not None):
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
        return DiffSummary(
            a=a,
            b=b,
            digest_a=digests[0],
            digest_b=digests[1],
            settings=_settings(of_a, of_b),
            excursions=_excursions(of_a, of_b),
            cells=cells if differ else None,
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


def _settings(a: Grid, b: Grid) -> dict[str, tuple[Value | None, Value | None]]:
    in_a, in_b = a.stored_settings(), b.stored_settings()
    names = [*in_a, *(name for name in in_b if name not in in_a)]
    return {
        name: (in_a.get(name), in_b.get(name)) for name in names if in_a.get(name) != in_b.get(name)
    }


def _excursions(a: Grid, b: Grid) -> ExcursionsDiff:
    in_a, in_b = dict(_hashed(a)), dict(_hashed(b))
    both = [name for name in in_a if name in in_b]
    changed = [name for name in both if in_a[name][1] != in_b[name][1]]
    return ExcursionsDiff(
        only_a=tuple(entry for name, (entry, _) in in_a.items() if name not in in_b),
        only_b=tuple(entry for name, (entry, _) in in_b.items() if name not in in_a),
        changed=tuple(_differ(in_a[name][0], in_b[name][0]) for name in changed),
        equal=len(both) - len(changed),
        records=(
            sum(entry.records for entry, _ in in_a.values()),
            sum(entry.records for entry, _ in in_b.values()),
        ),
    )


def _hashed(grid: Grid) -> Iterator[tuple[tuple[str, str], tuple[Entry, bytes]]]:
    """Yield each excursion by its name, with the hash of its records."""
    entries = sorted(grid.ledger.entries(), key=lambda entry: entry.name)
    for entry, digest in zip(entries, grid.ledger.hashes(), strict=True):
        yield entry.name, (entry, digest)


def _differ(a: Entry, b: Entry) -> ExcursionDiff:
    of_a, of_b = asdict(a.model), asdict(b.model)
    model = {name: (of_a[name], of_b[name]) for name in of_a if of_a[name] != of_b[name]}
    return ExcursionDiff(a.robot, a.excursion, (a.records, b.records), model)

"""``possmap diff``: in what two grids differ, tile by tile, so that they may be of any size."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from possmap.atomic import check_output, replacing
from possmap.core.lattice import Window
from possmap.errors import OutputError, SettingsError, printable, shown
from possmap.exports.job import refuse_itself
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.inspection.changes import Change, ChangedCells, Largest, changes, pairs
from possmap.inspection.difference_picture import Canvas, raster_for
from possmap.pictures.palettes import write_png
from possmap.progress import Progress, quiet
from possmap.release import version
from possmap.settings.setting_table import Value

Metres = tuple[float, float, float, float]


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
        _check_picture(picture, (a, b), overwrite)
    with ExitStack() as stack:
        of_a, of_b = (stack.enter_context(Grid(path)) for path in (a, b))
        for grid in (of_a, of_b):
            stack.enter_context(grid.snapshot())
        return _compared(of_a, of_b, largest, window_m, picture, overwrite, progress)


def _check_picture(picture: Path, grids: tuple[Path, Path], overwrite: bool) -> None:
    """Refuse a picture before the work rather than after it."""
    if picture.suffix.lower() != ".png":
        raise OutputError(
            f"{printable(str(picture))}: unknown suffix {shown(picture.suffix)}, expected .png"
        )
    for grid in grids:
        refuse_itself(grid, picture)
    check_output(picture, overwrite)


def _compared(
    a: Grid,
    b: Grid,
    largest: int,
    window_m: Metres | None,
    picture: Path | None,
    overwrite: bool,
    progress: Progress,
) -> DiffSummary:
    if a.resolution != b.resolution:
        raise SettingsError(
            f"{printable(str(b.path))}: resolution {b.resolution!r}, where "
            f"{printable(str(a.path))} has {a.resolution!r}: their cells cannot be compared"
        )
    digest_a, digest_b = a.digest(), b.digest()
    window = _window(a, b, window_m)
    canvas = None
    if picture is not None:
        if window is None:
            raise OutputError(
                f"{printable(str(picture))}: neither grid holds evidence"
                f"{' in the window' if window_m else ''}, so there is nothing to show"
            )
        canvas = Canvas(raster_for(window, exact=window_m is not None))
    cells, best = ChangedCells(), Largest(largest, a.lattice)
    differ = digest_a != digest_b
    if window is not None and (differ or canvas is not None):
        fusions = a.settings.free_fusion, b.settings.free_fusion
        rows = {row for grid in (a, b) for row in grid.tiles.directory.rows(window)}
        for row in progress(sorted(rows), "row"):
            for pair in pairs(row, a, b, window):
                found = changes(pair, fusions)
                cells.add(pair, found)
                if canvas is not None:
                    canvas.add(pair, found)
                best.add(found)
    size = None
    if picture is not None and canvas is not None:
        image = canvas.drawn((a.path.stem, b.path.stem), a.resolution, best.chosen())
        size = image.size
        with replacing(picture, overwrite) as stream:
            text = {
                "Software": f"possmap {version()}",
                "possmap:digests": f"{digest_a},{digest_b}",
                "possmap:view": "difference",
                "possmap:resolution": repr(a.resolution),
            }
            write_png(image, stream, text)
    return DiffSummary(
        a=a.path,
        b=b.path,
        digest_a=digest_a,
        digest_b=digest_b,
        settings=_settings(a, b),
        excursions=_excursions(a, b),
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

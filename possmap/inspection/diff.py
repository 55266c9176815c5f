"""``possmap diff``: in what two grids differ, tile by tile, so that they may be of any size."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

from possmap.atomic import check_output, replacing
from possmap.budget import Budget
from possmap.core.lattice import TileKey, Window
from possmap.errors import OutputError, SettingsError, plural, printable, shown
from possmap.exports.run import refuse_itself
from possmap.grid.grid import Grid
from possmap.grid.ledger import Entry
from possmap.inspection.diff_summary import Cells, DiffSummary, ExcursionDiff, Excursions
from possmap.inspection.difference import QUANTITIES, Changes, Tally, changes
from possmap.inspection.difference_picture import Canvas, Mark, drawn, raster_for
from possmap.inspection.largest import Largest
from possmap.inspection.pairs import TilePairs
from possmap.pictures.png import write_png
from possmap.progress import Progress, quiet
from possmap.release import version
from possmap.settings.setting_table import Value

Metres = tuple[float, float, float, float]


def diff(
    a: Path,
    b: Path,
    *,
    largest: int = 5,
    window_m: Metres | None = None,
    picture: Path | None = None,
    overwrite: bool = False,
    progress: Progress = quiet,
    budget: Budget | None = None,
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
    BudgetError
        If the grids' excursions do not fit into the memory allowed.
    """
    budget = budget or Budget()
    if picture is not None:
        _check_picture(picture, (a, b), overwrite)
    with ExitStack() as stack:
        of_a, of_b = (stack.enter_context(Grid(path, budget=budget)) for path in (a, b))
        for grid in (of_a, of_b):
            stack.enter_context(grid.snapshot())
        _check_fits(of_a, of_b, budget)
        return _compared(of_a, of_b, largest, window_m, picture, overwrite, progress)


_EXCURSION_BYTES = 4000
"""An excursion of either grid, with its hash and as text."""


def _check_fits(a: Grid, b: Grid, budget: Budget) -> None:
    known = a.excursion_count + b.excursion_count
    budget.check_held(
        f"{printable(str(b.path))}: comparing {plural(known, 'excursion')}",
        known * _EXCURSION_BYTES,
    )


def _check_picture(picture: Path, grids: tuple[Path, Path], overwrite: bool) -> None:
    """Refuse a picture before the work rather than after it."""
    name = printable(str(picture))
    if picture.suffix.lower() != ".png":
        raise OutputError(f"{name}: unknown suffix {shown(picture.suffix)}, expected .png")
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
    cells = None
    if digest_a != digest_b or canvas is not None:
        pairs = TilePairs(a.tiles, b.tiles, window or Window(0, 0, 0, 0))
        cells = _cells(pairs, Largest(largest, a.lattice), canvas, progress)
    size = None
    if picture is not None and canvas is not None and cells is not None:
        image = drawn(
            canvas,
            (a.path.stem, b.path.stem),
            a.resolution,
            [
                Mark(number, one.x, one.y, one.quantity)
                for number, one in enumerate(cells.largest, 1)
            ],
        )
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
        cells=None if digest_a == digest_b else cells,
        picture=size,
    )


def _window(a: Grid, b: Grid, window_m: Metres | None) -> Window | None:
    """Return the cells to compare: what holds the evidence of both, or what was asked for."""
    bounds = [grid.window for grid in (a, b)]
    held = [one for one in bounds if one is not None]
    if not held:
        return None
    everything = held[0].union(held[-1])
    if window_m is None:
        return everything
    window = a.lattice.window_of(*window_m)
    return window if window.intersection(everything).cells else None


def _cells(pairs: TilePairs, largest: Largest, canvas: Canvas | None, progress: Progress) -> Cells:
    tally = Tally()
    for row in progress(pairs.rows(), "row"):
        for key, pair in pairs.row(row):
            found = changes(pair)
            tally.add(pair, found)
            if key is not None:
                largest.offer(key, found)
            if canvas is not None:
                canvas.add(pair, found)

    def again(key: TileKey) -> Changes:
        return changes(pairs.read(key))

    return Cells(
        in_a=tally.in_a,
        in_b=tally.in_b,
        in_both=tally.in_both,
        in_either=tally.in_either,
        beyond={
            name: tuple(int(count) for count in counts)
            for name, counts in zip(QUANTITIES, tally.beyond, strict=True)
        },
        mean={
            name: float(moved) / max(1, tally.in_either)
            for name, moved in zip(QUANTITIES, tally.moved, strict=True)
        },
        became_contradicted=tally.became,
        ceased_contradicted=tally.ceased,
        largest=largest.choose(again),
    )


def _settings(a: Grid, b: Grid) -> dict[str, tuple[Value | None, Value | None]]:
    in_a, in_b = a.stored_settings(), b.stored_settings()
    names = [*in_a, *(name for name in in_b if name not in in_a)]
    return {
        name: (in_a.get(name), in_b.get(name)) for name in names if in_a.get(name) != in_b.get(name)
    }


def _excursions(a: Grid, b: Grid) -> Excursions:
    in_a, in_b = dict(_hashed(a)), dict(_hashed(b))
    both = [name for name in in_a if name in in_b]
    changed = [name for name in both if in_a[name][1] != in_b[name][1]]
    return Excursions(
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

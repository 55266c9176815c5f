"""Floor plans drawn as images, bare or with a ROS map.yaml: the outlines of what is not free."""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from possmap.core.ranges import Number, Share, at_least
from possmap.errors import SettingsError, printable
from possmap.settings.binder import FileName, bind_file

LARGEST_PIXELS = 25_000_000
MOST_WALLS = 1_000_000
"""Straight pieces in the outline of one plan."""
FINEST = 0.001
"""Smallest side of a pixel [m]."""
FINE = f"expected metres per pixel, {FINEST} or more"
FORMATS = ("PNG", "PPM", "BMP")  # PPM: PGM and PBM too
FREE_THRESH = 0.196
"""Darkness up to which a pixel of a bare image is free: ROS draws the unknown just beyond."""
_LEVEL = 1e-9  # [rad]; programs write a yaw of 1e-17

FreeCells = NDArray[np.bool_]
Segments = NDArray[np.float64]
"""Walls as x, y, x2, y2 [m], shape (n, 4); each is parallel to an axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A floor plan of square cells.

    Attributes
    ----------
    free
        Shape (rows, columns), row 0 at the lowest y; what lies outside is not free.
    resolution
        Side of a cell [m].
    origin
        Lower left corner of cell [0, 0] [m].
    name
        Of its image, for messages.
    """

    free: FreeCells
    resolution: float
    origin: tuple[float, float]
    name: str = "a plan"

    def is_free(self, x: float, y: float) -> bool:
        """Whether a place lies in a free cell."""
        column = math.floor((x - self.origin[0]) / self.resolution)
        row = math.floor((y - self.origin[1]) / self.resolution)
        rows, columns = self.free.shape
        return 0 <= row < rows and 0 <= column < columns and bool(self.free[row, column])

    def walls(self) -> Segments:
        """Return the borders between free cells and others, as few straight segments as can be.

        Raises
        ------
        SettingsError
            If they are more than MOST_WALLS: no building's plan, but noise.
        """
        padded = np.pad(self.free, 1)
        level = padded[1:, 1:-1] != padded[:-1, 1:-1]
        upright = (padded[1:-1, 1:] != padded[1:-1, :-1]).T
        count = _count_runs(level) + _count_runs(upright)
        if count > MOST_WALLS:
            raise SettingsError(
                f"{self.name}: found {count} walls in the image, expected at most {MOST_WALLS}"
            )
        lines, begins, ends = _runs(level)
        rows = np.stack([begins, lines, ends, lines], axis=1)
        lines, begins, ends = _runs(upright)
        columns = np.stack([lines, begins, lines, ends], axis=1)
        corners = np.concatenate([rows, columns]) * self.resolution
        # To the nanometre: no 0.15000000000000002.
        walls: Segments = np.round(corners + np.array([*self.origin, *self.origin]), 9) + 0.0
        return walls


@dataclass(frozen=True, slots=True)
class _Shading:
    """What makes a pixel free.

    free_thresh : darkness, 0 to 1, up to which it is.
    negate : black is free.
    on_paper : what is transparent is white; else what is not opaque is unknown.
    """

    free_thresh: float = FREE_THRESH
    negate: bool = False
    on_paper: bool = True


def _count_runs(borders: FreeCells) -> int:
    """Return how many runs of borders there are; each row of the array is a line."""
    return int(borders[:, :1].sum()) + int((borders[:, 1:] & ~borders[:, :-1]).sum())


def _runs(borders: FreeCells) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Return line, begin and end of each run of borders; each row of the array is a line."""
    steps = np.diff(np.pad(borders, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    lines, begins = np.nonzero(steps == 1)
    return lines, begins, np.nonzero(steps == -1)[1]


def read_image(path: Path, resolution: float, origin: tuple[float, float] = (0.0, 0.0)) -> Plan:
    """Read a bare image: white is free, all else is not; the first row has the highest y.

    Parameters
    ----------
    resolution
        Side of a pixel [m].
    origin
        Lower left corner of the image [m].

    Raises
    ------
    SettingsError
        If it is no image, or too large.
    """
    return Plan(_free(path, _Shading()), resolution, origin, printable(str(path)))


class _Origin(NamedTuple):
    x: Number
    y: Number
    yaw: Number


def _level(origin: _Origin) -> _Origin:
    if abs(origin.yaw) > _LEVEL:
        raise ValueError("expected a yaw of 0, walls along x or y")
    return origin


@dataclass(frozen=True, slots=True, kw_only=True)
class _RosMap:
    """The keys of a map.yaml; map_server ignores those that it does not know."""

    image: FileName
    resolution: Annotated[float, at_least(FINEST)]
    origin: Annotated[_Origin, _level]
    negate: Literal["0", "1", "true", "false"]
    occupied_thresh: Share
    free_thresh: Share
    mode: Annotated[str, str.lower] = "trinary"

    def __post_init__(self) -> None:
        if not self.free_thresh < self.occupied_thresh:
            raise ValueError(
                f"free_thresh, found {self.free_thresh:g}, expected less than occupied_thresh, "
                f"{self.occupied_thresh:g}"
            )
        if self.mode not in ("trinary", "scale"):
            raise ValueError(f"mode, found {printable(self.mode)}, expected trinary or scale")


def read_ros_map(path: Path) -> Plan:
    """Read a ROS ``map.yaml`` and its image, as nav2's map_server does; unknown is not free.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    given = bind_file(path, _RosMap, "a ROS map", ignore=True)
    shading = _Shading(given.free_thresh, given.negate in ("1", "true"), on_paper=False)
    image, (x, y, _) = path.parent / given.image, given.origin
    return Plan(_free(image, shading), given.resolution, (x, y), printable(str(image)))


def _free(path: Path, shading: _Shading) -> FreeCells:
    """Return which pixels are free, the lowest row of the image first."""
    name = printable(str(path))
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise SettingsError(f"{name}: is no regular file, expected an image")
    try:
        with warnings.catch_warnings():
            # Pillow's own limits lie higher than ours, or lower if somebody set them so.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path, formats=FORMATS) as image:
                width, height = image.size
                if width * height > LARGEST_PIXELS:
                    raise SettingsError(
                        f"{name}: found {width} x {height} pixels, expected at most "
                        f"{LARGEST_PIXELS // 10**6} million"
                    )
                free = _classified(image, shading)[::-1]
    except Image.DecompressionBombError:
        raise SettingsError(
            f"{name}: too many pixels, expected at most {LARGEST_PIXELS // 10**6} million"
        ) from None
    except UnidentifiedImageError:
        raise SettingsError(f"{name}: not an image, expected PNG, PGM or BMP") from None
    except OSError as error:
        problem = " ".join(str(error.strerror or error).split())
        raise SettingsError(f"{name}: cannot be read: {printable(problem)}") from None
    except (ValueError, SyntaxError, EOFError, OverflowError, struct.error, zlib.error) as error:
        problem = printable(" ".join(str(error).split()))
        raise SettingsError(f"{name}: a damaged image: {problem}") from None
    if not free.any():
        raise SettingsError(
            f"{name}: nothing in the image is free, expected some floor, light and opaque"
        )
    return free


def _classified(image: Image.Image, shading: _Shading) -> FreeCells:
    """Return which pixels are free, as the image has them."""
    if image.mode.startswith(("I", "F")):  # 16 bits: Pillow would clip, not scale
        deep = np.asarray(image) >> 8 if image.mode != "F" else np.asarray(image)
        image = Image.fromarray(np.clip(deep, 0, 255).astype(np.uint8))
    clear = image.has_transparency_data
    pixels = np.asarray(image.convert("RGBA" if clear else "RGB"))
    light = pixels[:, :, :3].sum(axis=2, dtype=np.uint16)
    if clear and shading.on_paper:
        opaque = pixels[:, :, 3].astype(np.uint32)
        light = ((light * opaque + 3 * 255 * (255 - opaque)) // 255).astype(np.uint16)
    levels = np.arange(3 * 255 + 1) / (3 * 255)
    darkness = levels if shading.negate else 1 - levels
    free: FreeCells = (darkness <= shading.free_thresh)[light]
    if clear and not shading.on_paper:
        free &= pixels[:, :, 3] == 255
    return free

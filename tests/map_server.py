"""How nav2's map_server reads a map, told again from its rules, with nothing of possmap's.

An image's shade is the mean of its colours, 0 black to 1 white; in mode trinary, transparency (as
opacity) is averaged in. What is published is row 0 first, the image's lowest row.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from PIL import Image


@dataclass(frozen=True)
class OccupancyGrid:
    """What is published: -1 unknown, 0 free … 100 occupied; ``data[row][column]``, row 0 lowest."""

    width: int
    height: int
    resolution: float
    origin: tuple[float, float, float]
    data: list[list[int]]

    def letters(self) -> list[str]:
        """Draw it, the highest row first."""
        marks = {-1: "?", 0: ".", 100: "#"}
        return ["".join(marks.get(cell, "%") for cell in row) for row in self.data[::-1]]


def load(path: Path) -> OccupancyGrid:
    """Read a ``map.yaml`` and its image."""
    doc: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    image_name = doc["image"]
    assert isinstance(image_name, str) and image_name
    image_path = Path(image_name) if image_name[0] == "/" else path.parent / image_name
    resolution, origin = as_double(doc["resolution"]), [as_double(one) for one in doc["origin"]]
    assert len(origin) == 3
    free_thresh, occupied_thresh = as_double(doc["free_thresh"]), as_double(doc["occupied_thresh"])
    mode = doc.get("mode", "trinary")
    assert type(doc["negate"]) in (int, bool)
    with Image.open(image_path) as image:
        width, height = image.size
        matte = "A" in image.getbands()
        pixels = image.convert("RGBA").load()
    assert pixels is not None
    data = [[0] * width for _ in range(height)]
    for y in range(height):
        for x in range(width):
            red, green, blue, opacity = pixels[x, y]  # type: ignore[misc]
            channels = [red, green, blue]
            if mode == "trinary" and matte:
                channels.append(opacity)
            shade = sum(channels) / len(channels) / 255
            occ = shade if doc["negate"] else 1.0 - shade
            if mode == "trinary":
                if occupied_thresh < occ:
                    cell = 100
                elif occ < free_thresh:
                    cell = 0
                else:
                    cell = -1
            elif mode == "scale":
                if opacity != 255:
                    cell = -1
                elif occupied_thresh < occ:
                    cell = 100
                elif occ < free_thresh:
                    cell = 0
                else:
                    cell = round((occ - free_thresh) / (occupied_thresh - free_thresh) * 100.0)
            else:
                assert mode == "raw"
                percent = round(shade * 255)
                cell = percent if 0 <= percent <= 100 else -1
            data[height - y - 1][x] = cell
    x0, y0, yaw = origin
    return OccupancyGrid(width, height, resolution, (x0, y0, yaw), data)


def as_double(value: object) -> float:
    """Return a number as yaml-cpp would; text is none (PyYAML reads 1e-06 as text)."""
    assert type(value) in (int, float)
    return float(value)  # type: ignore[arg-type]

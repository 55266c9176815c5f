"""The table of formats: which suffix is written how, and which options it knows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

from possmap.exports.cells_csv import write_cells
from possmap.exports.dxf import write_dxf
from possmap.exports.geojson import write_geojson
from possmap.exports.job import Choices, Job
from possmap.exports.layer_png import write_layer
from possmap.exports.npz import write_npz
from possmap.exports.octomap import write_occupied, write_probabilities
from possmap.exports.ros_map import image_beside, write_ros_map
from possmap.exports.svg import write_svg


@dataclass(frozen=True, slots=True)
class Format:
    """How one suffix is written.

    write : a job, into a stream for each of its outputs.
    options : names of the Choices that it heeds.
    beside : the files that go with the one asked for.
    may_be_empty : whether a window without evidence is a result too.
    """

    write: Callable[[Job, Sequence[BinaryIO]], None]
    options: frozenset[str] = frozenset()
    beside: Callable[[Path, Choices], tuple[Path, ...]] = lambda output, choices: ()
    may_be_empty: bool = False


_ROS = Format(
    write_ros_map, frozenset({"mode", "occupied", "free", "base_rate"}), beside=image_beside
)

FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        ".npz": Format(write_npz, may_be_empty=True),
        ".yaml": _ROS,
        ".yml": _ROS,
        ".geojson": Format(write_geojson),
        ".csv": Format(write_cells),
        ".png": Format(
            write_layer,
            frozenset({"layer", "base_rate"}),
            beside=lambda output, choices: (output.with_suffix(".pgw"),),
        ),
        ".svg": Format(write_svg, frozenset({"occupied"})),
        ".dxf": Format(write_dxf, frozenset({"occupied"})),
        ".bt": Format(write_occupied, frozenset({"occupied", "free"})),
        ".ot": Format(write_probabilities, frozenset({"base_rate"})),
    }
)
"""By suffix, in lower case."""

WRITTEN_WITH = MappingProxyType({".pgm": ".yaml", ".pgw": ".png"})
"""Suffixes that somebody may ask for, with the one that writes them too."""

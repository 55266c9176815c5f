"""possmap: honest maps from robots that only know their wheels.

>>> import possmap
>>> summary = possmap.fuse(["data/json"], "site.possmap")
>>> with possmap.open_grid("site.possmap") as grid:
...     walls = grid.necessity()
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from possmap.api import (
        VIEWS,
        DiffSummary,
        Evaluation,
        Grid,
        PossmapError,
        Window,
        diff,
        evaluate,
        fuse,
        open_grid,
        version,
    )

__all__ = [
    "VIEWS",
    "DiffSummary",
    "Evaluation",
    "Grid",
    "PossmapError",
    "Window",
    "diff",
    "evaluate",
    "fuse",
    "open_grid",
    "version",
]


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    # Imported only when asked for: the command line starts without numpy.
    if name in __all__:
        from possmap import api

        return getattr(api, name)
    raise AttributeError(f"module 'possmap' has no attribute {name!r}")

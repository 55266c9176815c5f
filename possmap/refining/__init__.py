"""The same wall is one wall: tracks moved so that sightings of it agree (METHOD §8)."""

from __future__ import annotations

import importlib.util

from possmap.errors import MissingExtra


def check_extra(what: str) -> None:
    """Raise MissingExtra unless the library is there that refining needs.

    what : what needs it, as a message begins.
    """
    if importlib.util.find_spec("scipy") is None:
        raise MissingExtra(what, "refine")

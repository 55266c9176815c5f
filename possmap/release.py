"""Which possmap this is."""

from __future__ import annotations

VERSION = "0.1.0"
"""The only copy; pyproject.toml takes it from here. To ask importlib.metadata costs 13 ms."""


def version() -> str:
    """Return the version of this package."""
    return VERSION

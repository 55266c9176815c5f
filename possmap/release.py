"""Which possmap this is."""

from __future__ import annotations


def version() -> str:
    """Return the installed version; pyproject.toml holds the only copy."""
    from importlib.metadata import version as installed  # slow to import, seldom needed

    return installed("possmap")

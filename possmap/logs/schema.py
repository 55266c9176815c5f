"""The JSON Schema of the log format, shipped so that others can write loggers."""

from __future__ import annotations

from pathlib import Path


def text() -> str:
    """Return the schema, a JSON document."""
    return Path(__file__).with_name("log.schema.json").read_text(encoding="utf-8")

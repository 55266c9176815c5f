"""A version of an excursion that comes from elsewhere, held to what a log is (docs/logs.md)."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields
from operator import attrgetter
from typing import Any, NamedTuple

from possmap.core.records import KINDS, PartialMap, Record
from possmap.errors import shown
from possmap.logs.excursion import GrowingExcursion, header_of
from possmap.logs.fields import RULES, Fault, Rule, as_object, own_keys, unique_keys


class _Rules(NamedTuple):
    """A kind of record: how to take its values out of one, and how to check each."""

    content: Callable[[Record], tuple[Any, ...]]
    checks: tuple[Rule, ...]


_RULES = {
    kind: _Rules(
        attrgetter(*(one.name for one in fields(kind) if one.name != "extra")),
        RULES[name],
    )
    for name, kind in KINDS.items()
}
"""RULES follow the attributes."""


def rechecked(version: PartialMap, nesting: int) -> PartialMap:
    """Return a version if reading a log can give it.

    Parameters
    ----------
    version
        Of any content, but of values of the types that a record has.
    nesting
        How deep ``x_`` values may be nested.

    Raises
    ------
    Fault
        With the path inside the log, the value found and what was expected.
    """
    builder = GrowingExcursion()
    for index, record in enumerate(version.records):
        try:
            _check_record(record, nesting)
            builder.add(record)
        except Fault as fault:
            raise fault.below("records", index) from None
    _check_own(version.extra, nesting)
    name = {"robot": version.robot, "excursion": version.excursion}
    header_of({**name, "model": dict(version.model)}, nesting, needs_version=False)
    return version


def _check_record(record: Record, nesting: int) -> None:
    content, checks = _RULES[type(record)]
    for (name, check, is_required, _, least, most), found in zip(
        checks, content(record), strict=True
    ):
        if type(found) is float and least <= found <= most:  # as most of them
            continue
        if found is not None or is_required:
            check(name, found)
    if record.extra:
        _check_own(record.extra, nesting)


def _check_own(text: str, nesting: int) -> None:
    """Check the JSON text of ``x_`` keys."""
    if not text:
        return
    try:
        own = as_object(json.loads(text, object_pairs_hook=unique_keys))
    except (ValueError, RecursionError):
        raise Fault((), f"found {shown(text)}, expected an object of x_ keys") from None
    if not all(key.startswith("x_") for key in own):
        raise Fault((), f"found {shown(text)}, expected an object of x_ keys")
    own_keys(own, set(), "a record", nesting)

"""The JSON Schema of the log format, made of the records' classes, for who writes loggers."""

from __future__ import annotations

import json
import re
from typing import Any, TypeAlias

from possmap.core import ranges
from possmap.core.model import PARAMETERS, RANGES
from possmap.core.ranges import Range
from possmap.core.records import FIELDS, KINDS, NAME, Field

Schema: TypeAlias = dict[str, Any]

_DEFINED: dict[Range | re.Pattern[str], str] = {
    ranges.WITHIN: "number",
    ranges.NOT_NEGATIVE: "not_negative",
    ranges.POSITIVE: "positive",
    ranges.HALF_WIDTH: "half_width",
    ranges.TIME: "time",
    ranges.SEQ: "seq",
    NAME: "name",
}
"""What has a definition of its own, by its name there."""

_ABOUT = (
    "What one robot delivers after one excursion. Metres, degrees, seconds. This schema cannot say "
    "that seq and t never fall, that a pose comes first, that a pose with turned: false has the "
    "place of the one before, and that a fix has heading and error_heading or neither; possmap "
    "check does."
)
_IN_ORDER = "in order of seq; the first is 0, and the first that is not a meet is a pose"
_CARRIED = "excursions that were handed over when robots met"
_LINE = "JSON Lines: begins a log (with possmap_log), or a carried excursion"


def text() -> str:
    """Return the schema of draft 2020-12, a JSON document."""
    return json.dumps(_schema(), indent=2) + "\n"


def _ref(name: str) -> Schema:
    return {"$ref": f"#/$defs/{name}"}


def _schema() -> Schema:
    head = {"possmap_log": {"const": 1}, "robot": _ref("name"), "excursion": _ref("name")}
    head["model"] = _ref("model")
    records = {"description": _IN_ORDER, "type": "array", "items": _ref("record")}
    carried = {"description": _CARRIED, "type": "array", "items": _ref("carried")}
    whole = {**head, "records": records}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "possmap partial-map log, version 1",
        "description": _ABOUT,
        **_object({**whole, "carried": carried}, ["possmap_log", "robot", "excursion", "records"]),
        "$defs": {
            **{name: _values(allowed) for allowed, name in _DEFINED.items()},
            "own": {"description": "a user's own keys; kept, not compared"},
            "model": {
                "description": "error-model parameters that override the host's",
                "type": "object",
                "properties": {name: _ref(_DEFINED[RANGES[name]]) for name in PARAMETERS},
                "additionalProperties": False,
            },
            "record": {
                "type": "object",
                "required": ["kind"],
                "properties": {"kind": {"enum": list(KINDS)}},
                "oneOf": [_ref(kind) for kind in KINDS],
            },
            **{kind: _record(kind) for kind in KINDS},
            "carried": _object(whole, ["robot", "excursion", "records"]),
            "header_line": {"description": _LINE, **_object(head, ["robot", "excursion"])},
            "line": {
                "description": "one line of JSON Lines",
                "anyOf": [_ref("record"), _ref("header_line")],
            },
        },
    }


def _object(properties: Schema, required: list[str]) -> Schema:
    """Return an object that may also have a user's own keys."""
    return {
        "type": "object",
        "required": required,
        "properties": properties,
        "patternProperties": {"^x_": _ref("own")},
        "additionalProperties": False,
    }


def _record(kind: str) -> Schema:
    fields = FIELDS[kind]
    properties = {"kind": {"const": kind}} | {field.name: _field(field) for field in fields}
    required = ["kind", *(field.name for field in fields if field.is_required)]
    return {"description": KINDS[kind].__doc__, **_object(properties, required)}


def _field(field: Field) -> Schema:
    match field.allowed:
        case None:
            found: Schema = {"type": "boolean"}
        case tuple() as words:
            found = {"enum": list(words)}
        case Range() | re.Pattern() as allowed:
            found = _ref(_DEFINED[allowed])
    if field.meaning:
        found = {"description": field.meaning, **found}
    if field.default is not None:
        found["default"] = field.default
    return found


def _values(allowed: Range | re.Pattern[str]) -> Schema:
    if isinstance(allowed, re.Pattern):
        return {"type": "string", "pattern": f"^{allowed.pattern}$"}
    least = "exclusiveMinimum" if allowed.is_open else "minimum"
    kind = "integer" if allowed is ranges.SEQ else "number"
    return {"type": kind, least: allowed.least, "maximum": allowed.most}

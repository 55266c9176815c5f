"""One record's fields, checked one by one: the same door for all three encodings (docs/logs.md)."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

from possmap.core.model import LARGEST, PARAMETERS, check_parameter
from possmap.core.records import CORNER_KINDS, KINDS, OwnModel, Record
from possmap.errors import did_you_mean, shown

LARGEST_SEQ = 2**53 - 1
NAME = re.compile(r"[A-Za-z0-9._:-]{1,64}", re.ASCII)

Step: TypeAlias = str | int
"""A key of an object or an index of a list."""


class Fault(Exception):
    """Something wrong at a path inside a log; the reader that knows the file adds file and line."""

    def __init__(self, path: tuple[Step, ...], problem: str) -> None:
        super().__init__(problem)
        self.path = path
        self.problem = problem

    def below(self, *steps: Step) -> Fault:
        """Return the same fault, seen from further up."""
        return Fault((*steps, *self.path), self.problem)


class RepeatedKey(dict[str, object]):
    """An object that held ``key`` twice."""

    key: str


def unique_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Make an object of its pairs, and remember if a key came twice (hook for the JSON decoder)."""
    members = dict(pairs)
    if len(members) == len(pairs):
        return members
    repeated = RepeatedKey(members)
    seen: set[str] = set()
    for key, _ in pairs:
        if key in seen:
            repeated.key = key
        seen.add(key)
    return repeated


def too_many(limit: int) -> Fault:
    """Return what is wrong with a file of more excursions than it may hold."""
    return Fault((), f"found more than {limit} excursions (setting limit_file_excursions)")


def as_object(value: object) -> dict[str, object]:
    """Return ``value`` if it is a JSON object without repeated keys.

    Raises
    ------
    Fault
        Otherwise.
    """
    if isinstance(value, RepeatedKey):
        raise Fault((value.key,), f"the key {shown(value.key)} is given twice")
    if not isinstance(value, dict):
        raise Fault((), f"found {shown(value)}, expected an object")
    return value


def number(name: str, value: object) -> float:
    """Return a finite number within ±1e6; -0 becomes 0, so that equal logs have equal bytes."""
    if (type(value) is float or type(value) is int) and -LARGEST <= value <= LARGEST:
        return value + 0.0
    found = finite(name, value)
    if not -LARGEST <= found <= LARGEST:
        raise Fault((name,), f"found {shown(value)}, expected a number within ±1e6")
    return found


def finite(name: str, value: object) -> float:
    """Return a finite number of any size."""
    if type(value) is float or type(value) is int:
        try:
            found = float(value) + 0.0
        except OverflowError:
            found = math.inf
        if math.isfinite(found):
            return found
        raise Fault((name,), f"found {shown(value)}, expected a finite number")
    raise Fault((name,), f"found {shown(value)}, expected a number")


def _error(name: str, value: object) -> float:
    found = number(name, value)
    if found < 0:
        raise Fault((name,), f"found {shown(value)}, expected a half-width >= 0")
    return found


def sequence_number(name: str, value: object) -> int:
    """Return a whole number that a seq may be: 0 … 2⁵³ - 1."""
    if type(value) is not int:
        raise Fault((name,), f"found {shown(value)}, expected a whole number")
    if not 0 <= value <= LARGEST_SEQ:
        raise Fault((name,), f"found {shown(value)}, expected 0 to 2^53 - 1")
    return value


def name_of(name: str, value: object) -> str:
    """Return the name of a robot or an excursion."""
    if isinstance(value, str) and NAME.fullmatch(value):
        return value
    expected = "expected 1 to 64 characters of A-Z a-z 0-9 . _ : -"
    raise Fault((name,), f"found {shown(value)}, {expected}")


def _flag(name: str, value: object) -> bool:
    if isinstance(value, bool):
        return value
    raise Fault((name,), f"found {shown(value)}, expected true or false")


def _corner(name: str, value: object) -> str:
    if isinstance(value, str) and value in CORNER_KINDS:
        return value
    guess = did_you_mean(value, CORNER_KINDS) if isinstance(value, str) else ""
    raise Fault((name,), f"found {shown(value)}, expected concave, convex or end{guess}")


Check: TypeAlias = Callable[[str, object], object]


class FieldRule(NamedTuple):
    """A field of a kind of record; unless ``required`` it may be absent: ``default`` then."""

    name: str
    check: Check
    required: bool = True
    default: object = None


_PLACE = (FieldRule("x", number), FieldRule("y", number))
_LINE = (*_PLACE, FieldRule("x2", number), FieldRule("y2", number))
_ANY = (FieldRule("seq", sequence_number), FieldRule("t", finite, False))

RULES: dict[str, tuple[FieldRule, ...]] = {
    "pose": (
        *_ANY,
        *_PLACE,
        FieldRule("heading", number),
        FieldRule("error_x", _error, False, 0.0),
        FieldRule("error_y", _error, False, 0.0),
        FieldRule("error_heading", _error, False, 0.0),
    ),
    "wall": (*_ANY, *_LINE, FieldRule("followed", _flag, False, True)),
    "beam": (*_ANY, *_LINE, FieldRule("hit", _flag, False, True)),
    "corner": (*_ANY, *_PLACE, FieldRule("corner", _corner)),
    "meet": (
        *_ANY,
        FieldRule("peer", name_of),
        FieldRule("peer_excursion", name_of),
        FieldRule("upto", sequence_number, False),
    ),
}
"""Each kind's fields, in the order of its class's attributes."""

_RULES: dict[str, list[tuple[str, Check, bool, object]]] = {
    kind: [(rule.name, rule.check, rule.required, rule.default) for rule in rules]
    for kind, rules in RULES.items()
}
"""The same as plain tuples, which Python takes apart in half the time."""

_ALLOWED = {kind: {"kind", *(rule.name for rule in rules)} for kind, rules in RULES.items()}
_MISSING = object()


def record_of(value: object, nesting: int) -> Record:
    """Check one record and return it.

    Parameters
    ----------
    value
        Decoded JSON, or a CSV row turned into the same.
    nesting
        How deep ``x_`` values may be nested.

    Raises
    ------
    Fault
        With the field, the value found and what was expected.
    """
    fields = as_object(value)
    kind = fields.get("kind", _MISSING)
    if not isinstance(kind, str) or kind not in RULES:
        if kind is _MISSING:
            raise Fault((), f"kind is missing, expected one of {', '.join(RULES)}")
        guess = did_you_mean(kind, RULES) if isinstance(kind, str) else ""
        raise Fault(("kind",), f"found {shown(kind)}, expected one of {', '.join(RULES)}{guess}")
    allowed = _ALLOWED[kind]
    extra = ""
    if not allowed.issuperset(fields):
        extra = own_keys(fields, allowed, f"a {kind}", nesting)
    values: list[object] = []
    get, keep = fields.get, values.append
    for name, check, required, default in _RULES[kind]:
        found = get(name, _MISSING)
        if found is _MISSING:
            if required:
                raise Fault((), f"{name} is missing, a {kind} needs it")
            keep(default)
        # Most values are such numbers: ``number`` would say the same, and later.
        elif check is number and type(found) is float and -LARGEST <= found <= LARGEST:
            keep(found + 0.0)
        else:
            keep(check(name, found))
    make: Callable[..., Record] = KINDS[kind]  # RULES follow the attributes
    return make(*values, extra)


def own_keys(fields: Mapping[str, object], allowed: set[str], whose: str, nesting: int) -> str:
    """Return the user's own ``x_`` keys as JSON text, and refuse every other unknown key."""
    own: dict[str, object] = {}
    for key, value in fields.items():
        if key in allowed:
            continue
        if not key.startswith("x_"):
            guess = did_you_mean(key, allowed)
            raise Fault((key,), f"unknown key {shown(key)} of {whose}{guess or _expected(allowed)}")
        _check_own(key, value, nesting)
        own[key] = value
    return json.dumps(own, separators=(",", ":")) if own else ""


def _expected(allowed: set[str]) -> str:
    return f", expected {', '.join(sorted(allowed))} or a key that begins with x_"


def _check_own(key: str, value: object, nesting: int) -> None:
    """Refuse what JSON cannot hold (NaN) or what is nested too deep, without recursing."""
    level: list[object] = [value]
    depth = 0
    while level:
        below: list[object] = []
        for one in level:
            if isinstance(one, float) and not math.isfinite(one):
                raise Fault((key,), f"found {shown(one)}, expected a finite number")
            if isinstance(one, RepeatedKey):
                raise Fault((key,), f"the key {shown(one.key)} is given twice")
            if isinstance(one, (dict, list)):
                if depth >= nesting:
                    raise Fault((key,), "nested too deep (setting limit_nesting)")
                below += one.values() if isinstance(one, dict) else one
        level = below
        depth += 1


def model_of(value: object) -> OwnModel:
    """Check a log's own error model and return its parameters, sorted by name."""
    parameters: list[tuple[str, float]] = []
    for name, found in as_object(value).items():
        if name not in PARAMETERS:
            guess = did_you_mean(name, PARAMETERS) or f", expected one of {', '.join(PARAMETERS)}"
            raise Fault((name,), f"unknown parameter {shown(name)}{guess}")
        checked = number(name, found)
        try:
            check_parameter(name, checked)
        except ValueError as error:
            raise Fault((name,), str(error).partition(", ")[2]) from None
        parameters.append((name, checked))
    return tuple(sorted(parameters))

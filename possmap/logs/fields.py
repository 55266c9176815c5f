"""One record's fields, checked one by one: the same door for all three encodings (docs/logs.md)."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

from possmap.core import ranges
from possmap.core.model import PARAMETERS, RANGES
from possmap.core.ranges import LARGEST_SEQ as LARGEST_SEQ
from possmap.core.ranges import Range
from possmap.core.records import FIELDS, KINDS, Field, OwnModel, Record
from possmap.core.records import NAME as NAME
from possmap.errors import did_you_mean, shown

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


def number(name: str, value: object, allowed: Range = ranges.WITHIN) -> float:
    """Return a finite number; -0 becomes 0, so that equal logs have equal bytes.

    Raises
    ------
    Fault
        For another value, and for a number that is not ``allowed``.
    """
    if type(value) is not float and type(value) is not int:
        raise Fault((name,), f"found {shown(value)}, expected a number")
    if value in allowed:
        return value + 0.0
    if not -sys.float_info.max <= value <= sys.float_info.max:
        raise Fault((name,), f"found {shown(value)}, expected a finite number")
    raise Fault((name,), f"found {shown(value)}, expected {allowed.expected_for(value)}")


def _whole_number(name: str, value: object, allowed: Range) -> int:
    if type(value) is not int:
        raise Fault((name,), f"found {shown(value)}, expected a whole number")
    if value not in allowed:
        raise Fault((name,), f"found {shown(value)}, expected {allowed.expected}")
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


def _word(name: str, value: object, words: tuple[str, ...]) -> str:
    if isinstance(value, str) and value in words:
        return value
    guess = did_you_mean(value, words) if isinstance(value, str) else ""
    expected = f"{', '.join(words[:-1])} or {words[-1]}"
    raise Fault((name,), f"found {shown(value)}, expected {expected}{guess}")


Check: TypeAlias = Callable[[str, object], object]


def _check(field: Field) -> Check:
    """Return what checks a field's values; it returns them as a record holds them."""
    match field.allowed:
        case Range() as numbers:
            checked = number if field.type is float else _whole_number
            return lambda name, value: checked(name, value, numbers)
        case tuple() as words:
            return lambda name, value: _word(name, value, words)
        case None:
            return _flag
        case _:
            return name_of


class Rule(NamedTuple):
    """A field of a kind of record: unless ``is_required`` it may be absent, ``default`` then.

    least, most : a float between them passes, as ``check`` would say, and later.
    """

    name: str
    check: Check
    is_required: bool
    default: object
    least: float
    most: float


def _rule(field: Field) -> Rule:
    least, most = math.inf, -math.inf
    if field.type is float and isinstance(field.allowed, Range):
        least, most = field.allowed.least, field.allowed.most
    return Rule(field.name, _check(field), field.is_required, field.default, least, most)


RULES: dict[str, tuple[Rule, ...]] = {
    kind: tuple(_rule(field) for field in fields) for kind, fields in FIELDS.items()
}
"""Each kind's fields, in the order of its class's attributes."""

_RULES: dict[str, list[tuple[str, Check, bool, object, float, float]]] = {
    kind: [(*rule,) for rule in rules] for kind, rules in RULES.items()
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
        extra = own_text(own_keys(fields, allowed, f"a {kind}", nesting))
    values: list[object] = []
    get, keep = fields.get, values.append
    for name, check, is_required, default, least, most in _RULES[kind]:
        found = get(name, _MISSING)
        if type(found) is float and least <= found <= most:  # as most of them
            keep(found + 0.0)
        elif found is _MISSING:
            if is_required:
                raise Fault((), f"{name} is missing, a {kind} needs it")
            keep(default)
        else:
            keep(check(name, found))
    make: Callable[..., Record] = KINDS[kind]  # RULES follow the attributes
    return make(*values, extra)


def own_keys(
    fields: Mapping[str, object], allowed: set[str], whose: str, nesting: int
) -> dict[str, object]:
    """Return the user's own ``x_`` keys, and refuse every other unknown key."""
    own = {key: value for key, value in fields.items() if key not in allowed}
    for key, value in own.items():
        if not key.startswith("x_"):
            guess = did_you_mean(key, allowed)
            raise Fault((key,), f"unknown key {shown(key)} of {whose}{guess or _expected(allowed)}")
        _check_own(key, value, nesting)
    return own


def own_text(own: Mapping[str, object]) -> str:
    """Return a user's own keys as they are kept: JSON text, empty if there are none."""
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
        parameters.append((name, number(name, found, RANGES[name])))
    return tuple(sorted(parameters))

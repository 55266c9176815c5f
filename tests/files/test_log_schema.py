"""The shipped JSON Schema and the reader accept the same logs, but for what no schema can say."""

from __future__ import annotations

import copy
import json
import random
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from literal.teams import Log, as_jsonl, random_team

from possmap.errors import LogError
from possmap.logs import read_log
from possmap.logs.schema import text
from possmap.settings.limits import Limits

SCHEMA = json.loads(text())
VALIDATOR = Draft202012Validator(SCHEMA)
LINE = Draft202012Validator({"$ref": "#/$defs/line", "$defs": SCHEMA["$defs"]})

MUTATIONS = 800

# The only reasons for which the reader may refuse what the schema accepts. Whole numbers: to a
# schema 1.0 is an integer, and whether it is one to a JSON library differs; the reader wants 1.
BEYOND_A_SCHEMA = {
    "the first seq is 0": r"seq: found \d+, expected 0, the first record's seq",
    "seq rises": r"seq: found \d+, expected more than \d+, the one before",
    "t never falls": r"t: found \S+, expected \S+ or later",
    "a pose comes first": r"kind: expected a pose before the first (wall, corner or beam|fix)",
    "a fix has a whole heading": r"(error_)?heading is missing, a fix with \w+ needs it",
    "a pose that did not turn stays": r"turned: found false at .*, expected the place of .*",
    "a whole number has no point": r"(seq|upto): found -?\d+\.0, expected a whole number",
    "a version has no point": r"possmap_log: found 1\.0, expected 1",
    "a number is finite": r"\S+: found (NaN|-?Infinity|9+\.\.\.), expected a finite number",
    "a name has no line end after it": r'\S+: found "r1\\n", expected 1 to 64 characters .*',
    "nesting has a limit": r"\S+: nested too deep \(setting limit_nesting\)",
    "a key stands once": r'\S+: the key ("x" )?is given twice',
    "a number has at most 4300 digits": r"\S+: a number of more than 4300 digits",
}


def refusal(path: Path, log: str) -> str | None:
    """Return why the reader refuses a log, without file and line; None if it does not."""
    path.write_text(log)
    try:
        read_log(path, Limits())
    except LogError as error:
        return error.problem
    return None


def reason_of(problem: str) -> str | None:
    for reason, pattern in BEYOND_A_SCHEMA.items():
        if re.fullmatch(pattern, problem.rpartition("].")[2]):
            return reason
    return None


# --- Random mutations of valid logs -----------------------------------------------------------

DEEP: list[Any] = []
for _ in range(20):
    DEEP = [DEEP]
ODD: list[Any] = [
    None, True, False, 0, 1, 2, -1, 1.0, 3.0, 1.5, -0.5, -0.0, 1e6, -1e6, 1000000.5, 1e300, -1e300,
    2**53 - 1, 2**53, 10**400 - 1, float("nan"), float("inf"), -float("inf"),
    "", "1", "true", "r1", "r1\n", "a b", "ä", "n" * 64, "n" * 65,
    "pose", "wall", "beam", "corner", "meet", "end", "convex", "End",
    [], {}, [1], {"x": 1}, [{}], {"x_a": 1}, DEEP,
]  # fmt: skip


def small_log(seed: int) -> Log:
    """Return a valid log of a few records and at most two carried ones."""
    log = random_team(np.random.default_rng(seed))[0][0]
    carried = log.pop("carried", None)
    log["records"] = log["records"][:6]
    if carried is not None:
        log["carried"] = carried[:2]
        for version in log["carried"]:
            version["records"] = version["records"][:3]
    if seed % 3 == 0:
        log["model"] = {"scale": 1.01, "along": 0.0, "turn_bias": -2.0}
    return log


def objects(value: object) -> Iterator[dict[str, Any]]:
    """Yield every object inside, itself included."""
    if isinstance(value, dict):
        yield value
    for inner in value.values() if isinstance(value, dict) else value:  # type: ignore[attr-defined]
        if isinstance(inner, (dict, list)):
            yield from objects(inner)


KEYS = sorted(
    {key for seed in range(50) for one in objects(small_log(seed)) for key in one}
    | {"carried", "model", "factor", "x_", "x_mine", "X_mine", "x2", "head", "upto", "hit"}
)


def mutated(rng: random.Random, log: Log) -> Log:
    """Drop a key, add one, or replace a value, anywhere."""
    log = copy.deepcopy(log)
    for _ in range(rng.choice([1, 1, 1, 2])):
        target = rng.choice(list(objects(log)))
        action = rng.random()
        if action < 0.2 and target:
            del target[rng.choice(list(target))]
        elif action < 0.45 or not target:
            target[rng.choice(KEYS)] = rng.choice(ODD)
        elif action < 0.55 and isinstance(target.get("records"), list) and target["records"]:
            records = target["records"]
            records.insert(rng.randrange(len(records)), copy.deepcopy(rng.choice([*records, *ODD])))
        else:
            target[rng.choice(list(target))] = copy.deepcopy(rng.choice(ODD))
    return log


def test_schema_and_reader_agree_on_mutated_logs(tmp_path: Path) -> None:
    rng = random.Random(1)
    seen: Counter[str] = Counter()
    logs = [small_log(seed) for seed in range(60)]
    for _ in range(MUTATIONS):
        log = mutated(rng, rng.choice(logs))
        problem = refusal(tmp_path / "log.json", json.dumps(log))
        accepted = VALIDATOR.is_valid(log)
        if problem is None:
            assert accepted, (log, next(VALIDATOR.iter_errors(log)).message)
            seen["both accept"] += 1
        elif accepted:
            reason = reason_of(problem)
            assert reason is not None, (log, problem)
            seen[reason] += 1
        else:
            seen["both refuse"] += 1
    # The mutations are worth something only if they reach all of it.
    assert seen["both accept"] > MUTATIONS / 20 and seen["both refuse"] > MUTATIONS / 2, seen
    assert seen.keys() >= {"seq rises", "t never falls", "a number is finite"}, seen


# --- One by one -------------------------------------------------------------------------------


def test_the_schema_is_one_of_draft_2020_12() -> None:
    assert SCHEMA["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("seed", range(4))
def test_what_random_robots_write_is_valid(seed: int) -> None:
    logs = random_team(np.random.default_rng(seed))[0]
    for log in logs:
        VALIDATOR.validate(log)
    for line in as_jsonl(logs).splitlines():
        LINE.validate(json.loads(line))


@pytest.mark.parametrize(
    "line",
    [
        {},
        {"robot": "r1"},
        {"robot": "r1", "excursion": "a", "records": []},
        {"robot": "r1", "excursion": "a", "carried": []},
        {"robot": "r1", "excursion": "a", "kind": "pose", "seq": 0, "x": 0, "y": 0, "heading": 0},
        {"kind": "pose", "seq": 0, "x": 0, "y": 0},
    ],
)
def test_neither_takes_a_line_that_is_no_header_and_no_record(
    line: dict[str, object], tmp_path: Path
) -> None:
    header = '{"possmap_log": 1, "robot": "r0", "excursion": "a"}\n'
    assert not LINE.is_valid(line)
    assert refusal(tmp_path / "log.jsonl", header + json.dumps(line) + "\n") is not None


POSE = '{"seq": 0, "kind": "pose", "x": 0, "y": 0, "heading": 0}'
LATER = '{"seq": 1, "t": 5, "kind": "pose", "x": 0, "y": 0, "heading": 0}'
STILL = LATER.replace('"x": 0', '"x": 1, "turned": false')
TWICE = POSE.replace("}", ', "x": 0}')
WALL = '{"seq": 0, "kind": "wall", "x": 0, "y": 0, "x2": 0, "y2": 0}'
TOP = '{"possmap_log": 1, "robot": "r1", "excursion": "a", "records": '


@pytest.mark.parametrize(
    ("reason", "log"),
    [
        ("the first seq is 0", f"{TOP}[{LATER}]}}"),
        ("seq rises", f"{TOP}[{POSE}, {LATER}, {LATER}]}}"),
        ("t never falls", f"{TOP}[{POSE}, {LATER}, {LATER.replace('1', '2').replace('5', '4')}]}}"),
        ("a pose comes first", f"{TOP}[{WALL}]}}"),
        ("a pose that did not turn stays", f"{TOP}[{POSE}, {STILL}]}}"),
        ("a whole number has no point", f"{TOP}[{POSE.replace('0', '0.0')}]}}"),
        ("a version has no point", f"{TOP.replace('1,', '1.0,')}[]}}"),
        ("a number is finite", f"{TOP}[{POSE.replace('0}', 'NaN}')}]}}"),
        ("a name has no line end after it", TOP.replace('r1"', 'r1\\n"') + "[]}"),
        ("nesting has a limit", f'{TOP}[], "x_a": {"[" * 16}{"]" * 16}}}'),
        ("a key stands once", f'{TOP}[], "robot": "r1"}}'),
        ("a key stands once", f"{TOP}[{TWICE}]}}"),
    ],
)
def test_what_a_schema_cannot_say_the_reader_says(reason: str, log: str, tmp_path: Path) -> None:
    problem = refusal(tmp_path / "log.json", log)
    assert VALIDATOR.is_valid(json.loads(log))
    assert problem is not None and reason_of(problem) == reason, problem


def test_a_number_of_thousands_of_digits_is_for_the_reader_alone(tmp_path: Path) -> None:
    problem = refusal(tmp_path / "log.json", f'{TOP}[], "x_a": {"9" * 5000}}}')
    assert problem is not None and reason_of(problem) == "a number has at most 4300 digits"

"""Settings as YAML: what is read, what is refused and where, and the way there and back."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest
from hypothesis import example, given
from hypothesis import settings as budget
from hypothesis import strategies as st

from possmap.core.model import PARAMETERS
from possmap.errors import SettingsError
from possmap.logs.fields import NAME
from possmap.settings.request import ROBUST
from possmap.settings.setting_table import KNOWN, SHAPING
from possmap.settings.settings import Settings, assemble
from possmap.settings.settings_yaml import read_settings, to_yaml
from possmap.settings.shipped import shipped


def read(folder: Path, text: str | bytes) -> dict[str, Any]:
    """Return the values of a settings file, by flat name."""
    path = folder / "site.yaml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return {name: value for name, (value, _) in read_settings(path).items()}


def refusal(folder: Path, text: str | bytes) -> str:
    """Return why a settings file is refused, after the file's name."""
    with pytest.raises(SettingsError) as caught:
        read(folder, text)
    message = str(caught.value)
    assert message.isprintable(), "one line, no terminal codes"
    assert message.startswith(f"{folder / 'site.yaml'}:")
    return message.removeprefix(f"{folder / 'site.yaml'}:")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", {}),
        ("# nothing\n---\n", {}),
        ("resolution: 0.1", {"resolution": 0.1}),
        ("\ufeffresolution: 0.1\n", {"resolution": 0.1}),
        ("resolution: 0.1\r\ndrift: -2 # to the right\r\n", {"resolution": 0.1, "drift": -2.0}),
        ("{resolution: 1e-3, drift: +1E-3}", {"resolution": 0.001, "drift": 0.001}),
        ("along: 1e-3\nacross: .5\nsensor: 1.\n", {"along": 0.001, "across": 0.5, "sensor": 1.0}),
        ("along: &small 0.25\nacross: *small\n", {"along": 0.25, "across": 0.25}),
        ("limit_nesting: 4", {"limit_nesting": 4}),
        (
            "free_along_walls: true\naccept_models: false",
            {"free_along_walls": True, "accept_models": False},
        ),
        ("robots:\nresolution: 1", {"resolution": 1.0}),
        ("robots: {}", {}),
        (
            "robots: {r1: {drift: 1}, 7: {scale: 2}}",
            {"robots.r1.drift": 1.0, "robots.7.scale": 2.0},
        ),
        ('robots:\n  "a.b:c": {drift: 1}', {"robots.a.b:c.drift": 1.0}),
        (
            "robots:\n  r1: &twins {drift: 1}\n  r2: *twins\n",
            {"robots.r1.drift": 1.0, "robots.r2.drift": 1.0},
        ),
    ],
)
def test_a_settings_file_is_read(text: str, expected: dict[str, Any], tmp_path: Path) -> None:
    found = read(tmp_path, text)
    assert found == expected
    assert {name: type(value) for name, value in found.items()} == {
        name: type(value) for name, value in expected.items()
    }


def test_each_value_knows_its_line(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text("# mine\nresolution: 0.1\nrobots:\n  r1:\n    drift: 1\n    scale: 2\n")
    origins = {name: given.origin for name, given in read_settings(path).items()}
    assert origins == {
        "resolution": f"{path}:2",
        "robots.r1.drift": f"{path}:5",
        "robots.r1.scale": f"{path}:6",
    }


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: 1", '1: unknown setting "a"; possmap config lists the known ones'),
        ("\n\nresolutoin: 1", '3: unknown setting "resolutoin", did you mean "resolution"?'),
        ("robot: {}", '1: unknown setting "robot", did you mean "robots"?'),
        ("drift: 1\nscale: 1\ndrift: 1", '3: "drift" is given twice'),
        ("resolution: fine", '1: resolution, found "fine", expected a number'),
        ("resolution:", '1: resolution, found "", expected a number'),
        ("resolution: 0", '1: resolution, found "0", expected a number >= 1e-6'),
        ("resolution: nan", '1: resolution, found "nan", expected a number'),
        ("resolution: 1e999", '1: resolution, found "1e999", expected a number within ±1e6'),
        ("resolution: 1_", '1: resolution, found "1_", expected a number'),
        ("resolution: [1]", "1: resolution, found [1], expected one value"),
        ("along: -1e-9", '1: along, found "-1e-9", expected a number >= 0'),
        ("free_along_walls: 1", '1: free_along_walls, found "1", expected true or false'),
        ("limit_nesting: 1.5", '1: limit_nesting, found "1.5", expected a whole number >= 1'),
        ("base_rate: 1", '1: base_rate, found "1", expected a number between 0 and 1'),
        (
            "estimator: haeding",
            '1: estimator, found "haeding", expected linear, heading or walls, '
            'did you mean "heading"?',
        ),
        (
            "independence: excursoin",
            '1: independence, found "excursoin", expected detection or excursion,'
            ' did you mean "excursion"?',
        ),
        ("42", '1: found "42", expected name: value'),
        ("- drift: 1", "1: found a list, expected name: value"),
        ("robots: 3", '1: robots, found "3", expected robot: {parameter: value}'),
        ("robots: [r1]", "1: robots, found [r1], expected robot: {parameter: value}"),
        ("robots:\n  r1: 3", '2: robots.r1, found "3", expected parameter: value'),
        (
            "robots: {r 1: {drift: 1}}",
            '1: robots, found "r 1", expected robots.NAME.PARAMETER',
        ),
        (
            "robots:\n  r1:\n    dirft: 1",
            '3: unknown parameter "dirft" of robot r1, did you mean "drift"?',
        ),
        ("robots:\n  r1:\n    scale: 0", '3: robots.r1.scale, found "0", expected a number > 0'),
        ("robots:\n  r1: {drift: 1,\n    drift: 1}", '3: "drift" is given twice'),
        ("robots: &me {r1: *me}", "1: an alias inside of what it names"),
        ("drift: 1\nscale: [", "2: not YAML: "),
        ("drift: 1\n\tscale: 1", "2: not YAML: "),
        ("drift: '\\e[31m", "1: not YAML: "),
        ("drift: " + "[" * 5000, "1: nested too deep, expected name: value"),
        ("drift:\n" + "".join(" " * n + "- \n" for n in range(1, 12)), "9: nested too deep"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(text: str, expected: str, tmp_path: Path) -> None:
    assert refusal(tmp_path, text).startswith(expected)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"drift: \xff1", " not UTF-8 text, expected a settings file"),
        ("drift: 1".encode("utf-16"), " not UTF-8 text, expected a settings file"),
        (b"drift: 1\n" + b"#" * 2**20, " larger than 1 MiB, expected a settings file"),
        (b"drift: \0", " not YAML: "),
    ],
)
def test_what_is_no_text_is_refused(data: bytes, expected: str, tmp_path: Path) -> None:
    assert refusal(tmp_path, data).startswith(expected)


YAML_BITS = st.sampled_from(
    [
        *KNOWN,
        *("robots", "r1", ": ", "\n", "  ", "- ", "{", "}", "[", "]", ",", "&a ", "*a", "!!x "),
        *("'", '"', "#", "|", "> ", "---\n", "%YAML 1.1\n", "? ", "1_", "1e3", "true", "<<"),
        *("\\U99999999", "\t", "\x85", "\x1b", "~", "\u2028", "\\x41", "0b1", "=", "`"),
    ]
)


@given(text=st.lists(YAML_BITS, max_size=12).map("".join) | st.text(max_size=40))
@example(text='resolution: "\\UFFFFFFFF"')
@budget(max_examples=150, deadline=None)
def test_any_text_is_read_or_refused_in_one_line(
    text: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_text(text, newline="", errors="replace")
    try:
        found = read_settings(path)
    except SettingsError as error:
        problem = str(error)
    else:
        problem = f"{path}"
        assert found.keys() <= {*KNOWN, *(f"robots.r1.{name}" for name in PARAMETERS)}
    assert problem.isprintable() and problem.startswith(str(path))


def values(name: str) -> st.SearchStrategy[Any]:
    """Return the values that a setting may have, as its declaration says."""
    kind = KNOWN[name]
    if get_origin(kind.of) is Literal:
        return st.sampled_from(get_args(kind.of))
    if kind.of is bool:
        return st.booleans()
    least, most, is_open = kind.range.least, kind.range.most, kind.range.is_open
    if kind.of is int:
        return st.integers(int(least), int(most))
    return st.floats(least, most, exclude_min=is_open)


ROBOTS = st.dictionaries(
    st.from_regex(NAME, fullmatch=True),
    st.sets(st.sampled_from(PARAMETERS), min_size=1).flatmap(
        lambda names: st.fixed_dictionaries({name: values(name) for name in sorted(names)})
    ),
    max_size=3,
)


def going_together(flat: dict[str, Any]) -> dict[str, Any]:
    """Take discounts away where the other settings give them no meaning."""
    if flat["independence"] != "excursion":
        flat = {**flat, "certainty_power": 1.0, "pass_weight": 1.0}
    return flat if flat["free_fusion"] == "dempster" else {**flat, "pass_weight": 1.0}


FLAT = st.fixed_dictionaries({name: values(name) for name in KNOWN}).map(going_together)


@given(flat=FLAT, robots=ROBOTS)
@budget(max_examples=30, deadline=None)
def test_what_config_prints_gives_the_same_settings_back(
    flat: dict[str, Any],
    robots: dict[str, dict[str, float]],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    entries = {f"robots.{r}.{n}": value for r, own in robots.items() for n, value in own.items()}
    printed = to_yaml(assemble({**flat, **entries}))
    back = assemble(read(tmp_path_factory.getbasetemp(), printed))
    assert back == assemble({**flat, **entries})
    assert to_yaml(back) == printed


def test_the_default_profile_is_the_file_that_says_why() -> None:
    told = {name: value for name, (value, _) in read_settings(shipped("robust.yaml")).items()}
    assert dict(ROBUST) == told


def test_the_profile_paper_is_the_default_and_names_all_that_shapes_evidence() -> None:
    given_there = read_settings(shipped("paper.yaml"))
    shaping = [name for name in SHAPING if not name.startswith("frame_")]  # which is a robot's own
    assert list(given_there) == shaping, "in the same order as possmap config prints them"
    assert assemble({name: value for name, (value, _) in given_there.items()}) == Settings()


NO_EXCURSION = "expected 1 without independence: excursion"


@pytest.mark.parametrize(
    ("flat", "problem"),
    [
        (
            {"certainty_power": 1.5},
            f"certainty_power, found 1.5, {NO_EXCURSION}",
        ),
        (
            {"pass_weight": 0.5},
            f"pass_weight, found 0.5, {NO_EXCURSION}",
        ),
        (
            {"pass_weight": 0.5, "independence": "excursion"},
            "pass_weight, found 0.5, expected 1 without free_fusion: dempster",
        ),
    ],
)
def test_discounts_that_mean_nothing_are_refused(flat: dict[str, Any], problem: str) -> None:
    with pytest.raises(SettingsError, match=f"^settings: {problem}$"):
        assemble(flat)

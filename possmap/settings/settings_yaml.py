"""Settings as YAML: read with the line of each value, and written with its meaning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

from possmap.core.model import PARAMETERS
from possmap.settings.kinds import Kind
from possmap.settings.setting_table import (
    OF_A_CALL,
    SHAPING,
    Given,
    GivenSettings,
    known_setting,
    parse_setting,
)
from possmap.settings.settings import Settings, flat, scalar
from possmap.settings.shipped import shipped
from possmap.settings.yaml_file import is_null, members, place, read_yaml, refusal

_DIGITS = 6
"""As many digits as trials can tell, and a few more."""
PROFILES = {
    "robust": "robots calibrated or not, walls at right angles; holds for months",
    "paper": "to repeat the paper to the letter",
}
"""Which shipped profile suits whom."""


def read_profile(name: str) -> GivenSettings:
    """Return the settings of a shipped profile."""
    given = read_settings(shipped(f"{name}.yaml"))
    return {key: Given(value, f"--profile {name}") for key, (value, _) in given.items()}


def read_settings(path: Path) -> GivenSettings:
    """Read a settings file.

    Raises
    ------
    SettingsError
        ``file:line: name, value found, what was expected``.
    """
    root = read_yaml(path, "a settings file")
    if root is None:
        return {}
    given: dict[str, Given] = {}
    for key, node, name in members(root, "expected name: value"):
        if key != "robots":
            known_setting(key, place(name))
            given[key] = _given(key, node, name)
        elif not is_null(node):
            for robot, own, _ in members(node, "expected robot: {parameter: value}", key):
                for parameter, value, at in members(
                    own, "expected parameter: value", f"robots.{robot}"
                ):
                    flat_name = f"robots.{robot}.{parameter}"
                    given[flat_name] = _given(flat_name, value, at)
    return given


def _given(key: str, node: yaml.Node, name: yaml.Node) -> Given:
    if not isinstance(node, yaml.ScalarNode):
        raise refusal(node, key, "expected one value")
    return parse_setting(key, str(node.value), place(name))


def to_yaml(settings: Settings) -> str:
    """Return all settings as commented YAML that can be edited and given back with ``--config``."""
    values = flat(settings)

    def lines(table: Mapping[str, Kind]) -> list[str]:
        return [
            f"{f'{name}: {scalar(values[name])}':<36} # {table[name].meaning}" for name in table
        ]

    robots = [
        f'  "{robot}": {{{", ".join(f"{name}: {scalar(v)}" for name, v in sorted(own.items()))}}}'
        for robot, own in sorted(settings.robots.items())
    ]
    return "\n".join(
        [
            *(f"# --profile {name}: {whom}" for name, whom in PROFILES.items()),
            "",
            "# What shapes evidence: a grid keeps these from its first fuse.",
            *lines(SHAPING),
            "",
            "# What the host knows of single robots: any parameter of the error model.",
            *(["robots:", *robots] if robots else ["robots: {}"]),
            "",
            "# What belongs to each call.",
            *lines(OF_A_CALL),
            "",
        ]
    )


def model_yaml(
    general: Mapping[str, float],
    robots: Mapping[str, Mapping[str, float]],
    comments: Sequence[str],
) -> str:
    """Return the YAML of a calibrated model: for any robot, and for those calibrated.

    Parameters
    ----------
    general
        Parameters of a robot of which nothing else is known.
    robots
        By name.
    comments
        Lines above, what it is and where it comes from.
    """

    def entries(own: Mapping[str, float]) -> dict[str, str]:
        known = (name for name in PARAMETERS if name in own)
        return {name: f"{name}: {scalar(float(f'{own[name]:.{_DIGITS}g}'))}" for name in known}

    lines = [*(f"# {line}".rstrip() for line in comments)]
    if general:
        lines += [""]
    lines += [f"{text:<30} # {SHAPING[name].meaning}" for name, text in entries(general).items()]
    lines += ["", "robots:"]
    for robot, own in sorted(robots.items()):
        lines += [f'  "{robot}":', *(f"    {text}" for text in entries(own).values())]
    return "\n".join(lines) + "\n"

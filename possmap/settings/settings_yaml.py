"""Settings read from a YAML file, each value with the line that gave it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import yaml

from possmap.errors import printable
from possmap.settings.setting_table import Given, GivenSettings, known_setting, parse_setting
from possmap.settings.shipped import shipped
from possmap.settings.yaml_nodes import is_null, members, read_yaml, scalar_text


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
    name = printable(str(path))
    root = read_yaml(path, "a settings file")
    settings: dict[str, Given] = {}
    for key, text_value, line in _flattened(root, name):
        origin = f"{name}:{line}"
        settings[key] = parse_setting(key, text_value, origin)
    return settings


def _flattened(root: yaml.Node | None, name: str) -> Iterator[tuple[str, str, int]]:
    """Yield flat name, text and line of each value; scalars keep the text that was written."""
    if root is None:
        return
    for key, node, line in members(root, name, "expected name: value"):
        if key != "robots":
            known_setting(key, f"{name}:{line}")
            yield key, scalar_text(node, f"{name}:{line}", key), line
            continue
        if is_null(node):
            continue
        for robot, parameters, _ in members(node, name, "expected robot: {parameter: value}"):
            inside = "expected parameter: value"
            for parameter, value, at in members(parameters, name, inside):
                flat = f"robots.{robot}.{parameter}"
                yield flat, scalar_text(value, f"{name}:{at}", flat), at

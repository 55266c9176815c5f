"""Settings read from a YAML file, each value with the line that gave it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import yaml

from possmap.errors import NotYetError, SettingsError, printable, shown
from possmap.files.setting_table import Given, GivenSettings, known_setting, parse_setting

LARGEST_BYTES = 1 << 20
DEEPEST = 8


def shipped(name: str) -> Path:
    """Return a file of ``configs/``: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent.parent
    inside = package / "configs" / name
    return inside if inside.exists() else package.parent / "configs" / name


def read_profile(name: str) -> GivenSettings:
    """Return the settings of a shipped profile.

    Raises
    ------
    SettingsError
        For ``robust``, which this version does not have yet.
    """
    path = shipped(f"{name}.yaml")
    if not path.exists():
        raise NotYetError(
            f"--profile, found {shown(name)}, which this version does not have yet; it has paper"
        )
    given = read_settings(path)
    return {key: Given(value, f"--profile {name}") for key, (value, _) in given.items()}


def read_settings(path: Path) -> GivenSettings:
    """Read a settings file.

    Raises
    ------
    SettingsError
        ``file:line: name, value found, what was expected``.
    """
    name = printable(str(path))
    try:
        with path.open("rb") as stream:
            data = stream.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise SettingsError(f"{name}: cannot be read: {error.strerror or error}") from error
    if len(data) > LARGEST_BYTES:
        raise SettingsError(f"{name}: larger than 1 MiB, expected a settings file")
    try:
        text = data.decode("utf-8-sig")
        _check_depth(text, name)
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except UnicodeDecodeError as error:
        raise SettingsError(f"{name}: not UTF-8 text, expected a settings file") from error
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        problem = ": ".join(part for part in (error.context, error.problem) if part)
        raise SettingsError(f"{name}:{line}: not YAML: {problem}") from error
    except yaml.YAMLError as error:
        raise SettingsError(f"{name}: not YAML: {' '.join(str(error).split())}") from error
    except (ValueError, OverflowError) as error:  # PyYAML lets some numbers of its own pass
        raise SettingsError(f"{name}: not YAML: {error}") from error
    settings: dict[str, Given] = {}
    for key, text_value, line in _flattened(root, name):
        origin = f"{name}:{line}"
        settings[key] = parse_setting(key, text_value, origin)
    return settings


def _check_depth(text: str, name: str) -> None:
    """Refuse deep nesting before anything recurses over it."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > DEEPEST:
                line = event.start_mark.line + 1 if event.start_mark else 1
                raise SettingsError(f"{name}:{line}: nested too deep, expected name: value")
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def _flattened(root: yaml.Node | None, name: str) -> Iterator[tuple[str, str, int]]:
    """Yield flat name, text and line of each value; scalars keep the text that was written."""
    if root is None or _is_null(root):
        return
    for key, node, line in _members(root, name, "expected name: value"):
        if key != "robots":
            known_setting(key, f"{name}:{line}")
            yield key, _text(node, f"{name}:{line}", key), line
            continue
        if _is_null(node):
            continue
        for robot, parameters, _ in _members(node, name, "expected robot: {parameter: value}"):
            inside = "expected parameter: value"
            for parameter, value, at in _members(parameters, name, inside):
                flat = f"robots.{robot}.{parameter}"
                yield flat, _text(value, f"{name}:{at}", flat), at


def _members(node: yaml.Node, name: str, expected: str) -> Iterator[tuple[str, yaml.Node, int]]:
    line = node.start_mark.line + 1
    if not isinstance(node, yaml.MappingNode):
        raise SettingsError(f"{name}:{line}: found {_kind(node)}, {expected}")
    seen: set[str] = set()
    for key, value in node.value:
        line = key.start_mark.line + 1
        if not isinstance(key, yaml.ScalarNode):
            raise SettingsError(f"{name}:{line}: found {_kind(key)} for a name, {expected}")
        if key.value in seen:
            raise SettingsError(f"{name}:{line}: {shown(key.value)} is given twice")
        seen.add(key.value)
        yield key.value, value, line


def _is_null(node: yaml.Node) -> bool:
    return isinstance(node, yaml.ScalarNode) and node.tag == "tag:yaml.org,2002:null"


def _text(node: yaml.Node, origin: str, key: str) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise SettingsError(f"{origin}: {key}, found {_kind(node)}, expected one value")
    return str(node.value)


def _kind(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return shown(node.value)
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"

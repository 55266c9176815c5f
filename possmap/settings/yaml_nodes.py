"""YAML as nodes that still know their line, read so that a hostile file harms nobody."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from stat import S_ISREG

import yaml

from possmap.core.model import LARGEST
from possmap.errors import SettingsError, printable, shown

LARGEST_BYTES = 1 << 20
DEEPEST = 8
MOST_VALUES = 300_000
"""In one file, those behind aliases counted wherever an alias names them."""

_SHORT = 6  # entries of a list that a message repeats
NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")


def read_yaml(path: Path, expected: str) -> yaml.Node | None:
    """Return the root node of a YAML file; None if it says nothing.

    Parameters
    ----------
    expected
        What the file should be, for messages: ``a settings file``.

    Raises
    ------
    SettingsError
        ``file:line: what is wrong``.
    """
    name = printable(str(path))
    try:
        with path.open("rb") as stream:
            data = stream.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise SettingsError(f"{name}: cannot be read: {error.strerror or error}") from error
    if len(data) > LARGEST_BYTES:
        raise SettingsError(f"{name}: larger than 1 MiB, expected {expected}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SettingsError(f"{name}: not UTF-8 text, expected {expected}") from error
    return parse_yaml(text, name)


def parse_yaml(text: str, name: str) -> yaml.Node | None:
    """Return the root node of YAML text; None if it says nothing.

    Raises
    ------
    SettingsError
        ``name:line: what is wrong``.
    """
    try:
        root = yaml.compose(text, Loader=_BoundedLoader)
    except _Unbounded as fault:
        raise SettingsError(f"{name}:{fault.line}: {fault.problem}") from None
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        problem = ": ".join(part for part in (error.context, error.problem) if part)
        raise SettingsError(f"{name}:{line}: not YAML: {problem}") from error
    except yaml.YAMLError as error:
        raise SettingsError(f"{name}: not YAML: {' '.join(str(error).split())}") from error
    except (ValueError, OverflowError) as error:  # PyYAML lets some numbers of its own pass
        raise SettingsError(f"{name}: not YAML: {error}") from error
    return None if root is None or is_null(root) else root


class _Unbounded(Exception):
    """More than a file may say, at a line."""

    def __init__(self, node_or_event: yaml.Node | yaml.Event, problem: str) -> None:
        super().__init__(problem)
        self.line = node_or_event.start_mark.line + 1 if node_or_event.start_mark else 1
        self.problem = problem


class _BoundedLoader(yaml.SafeLoader):
    """Composes nodes, and stops before they are too many or nested too deep."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0
        self._count = 0
        self._sizes: dict[yaml.Node, int] = {}  # with all that a node holds

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: yaml.Event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.CollectionStartEvent):
            if self._depth == DEEPEST:
                raise _Unbounded(event, "nested too deep, expected name: value")
            self._depth += 1
            node = super().compose_node(parent, index)
            self._depth -= 1
        else:
            node = super().compose_node(parent, index)
        if node is not None:
            self._weigh(node, event)
        return node

    def _weigh(self, node: yaml.Node, event: yaml.Event) -> None:
        if isinstance(event, yaml.AliasEvent):
            if node not in self._sizes:
                raise _Unbounded(event, "an alias inside of what it names")
            self._count += self._sizes[node]
        else:
            self._count += 1
            size = 1
            if isinstance(node, yaml.SequenceNode):
                size += sum(self._sizes[part] for part in node.value)
            elif isinstance(node, yaml.MappingNode):
                size += sum(self._sizes[part] for pair in node.value for part in pair)
            self._sizes[node] = size
        if self._count > MOST_VALUES:
            raise _Unbounded(event, f"found more than {MOST_VALUES} values, with all aliases")


def members(node: yaml.Node, name: str, expected: str) -> Iterator[tuple[str, yaml.Node, int]]:
    """Yield key, value and line of a mapping, each key once.

    Raises
    ------
    SettingsError
        ``name:line: what is wrong``, if it is no mapping, or gives a key twice.
    """
    line = node.start_mark.line + 1
    if not isinstance(node, yaml.MappingNode):
        raise SettingsError(f"{name}:{line}: found {kind(node)}, {expected}")
    seen: set[str] = set()
    for key, value in node.value:
        line = key.start_mark.line + 1
        if not isinstance(key, yaml.ScalarNode):
            raise SettingsError(f"{name}:{line}: found {kind(key)} for a name, {expected}")
        if key.value in seen:
            raise SettingsError(f"{name}:{line}: {shown(key.value)} is given twice")
        seen.add(key.value)
        yield key.value, value, line


def is_null(node: yaml.Node) -> bool:
    """Whether a node says nothing."""
    return isinstance(node, yaml.ScalarNode) and node.tag == "tag:yaml.org,2002:null"


def scalar_text(node: yaml.Node, origin: str, key: str) -> str:
    """Return a single value as it was written.

    Raises
    ------
    SettingsError
        ``origin: key, what was found``, for a list or a mapping.
    """
    if not isinstance(node, yaml.ScalarNode):
        raise SettingsError(f"{origin}: {key}, found {kind(node)}, expected one value")
    return str(node.value)


def kind(node: yaml.Node) -> str:
    """Return what a node is, for messages."""
    if isinstance(node, yaml.ScalarNode):
        return shown(node.value)
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"


def place(node: yaml.Node, name: str) -> str:
    """Return where a node stands, ``file:line``; an option of the command line has no lines."""
    return name if name.startswith("--") else f"{name}:{node.start_mark.line + 1}"


def items(node: yaml.Node, name: str, key: str, expected: str) -> list[yaml.Node]:
    """Return the entries of a list; none if it says nothing.

    Raises
    ------
    SettingsError
        ``name:line: key, what was found, expected``.
    """
    if is_null(node):
        return []
    if not isinstance(node, yaml.SequenceNode):
        raise refusal(node, name, key, expected)
    entries: list[yaml.Node] = node.value
    return entries


def number(node: yaml.Node, name: str, key: str, expected: str = "expected a number") -> float:
    """Return a number within ±1e6.

    Raises
    ------
    SettingsError
        ``name:line: key, what was found, expected``.
    """
    if not (isinstance(node, yaml.ScalarNode) and NUMBER.fullmatch(node.value)):
        raise refusal(node, name, key, expected)
    value = float(node.value)
    if not -LARGEST <= value <= LARGEST:
        raise refusal(node, name, key, "expected a number within ±1e6")
    return value + 0.0


def numbers(node: yaml.Node, name: str, key: str, expected: str, count: int) -> list[float]:
    """Return a list of so many numbers.

    Raises
    ------
    SettingsError
        ``name:line: key, what was found, expected``.
    """
    entries = items(node, name, key, expected)
    if len(entries) != count:
        raise refusal(node, name, key, expected)
    try:
        return [number(entry, name, key, expected) for entry in entries]
    except SettingsError:
        raise refusal(node, name, key, f"{expected}, numbers within ±1e6") from None


def file_path(node: yaml.Node, name: str, key: str, folder: Path) -> Path:
    """Return the path that a node names, relative to a folder.

    Raises
    ------
    SettingsError
        ``name:line: key, what was found``, for what cannot be a path.
    """
    text = scalar_text(node, place(node, name), key)
    if not text or "\0" in text:
        raise refusal(node, name, key, "expected the path of a file")
    path = folder / text
    try:
        mode = path.stat().st_mode
    except OSError:
        return path  # opening it says why
    if not S_ISREG(mode):  # opening a FIFO, or a terminal, would wait for ever
        raise refusal(node, name, key, "expected the path of a file, a regular one")
    return path


def refusal(node: yaml.Node, name: str, key: str, expected: str) -> SettingsError:
    """Return the error for a value that is not what was expected."""
    found = kind(node)
    if isinstance(node, yaml.SequenceNode) and 0 < len(node.value) <= _SHORT:
        words = [entry.value for entry in node.value if isinstance(entry, yaml.ScalarNode)]
        if len(words) == len(node.value):
            found = shown(words).replace('"', "")
    return SettingsError(f"{place(node, name)}: {key}, found {found}, {expected}")

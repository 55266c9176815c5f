"""YAML as nodes that know their file and line, read so that a hostile file harms nobody."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import yaml

from possmap.errors import SettingsError, printable, shown

LARGEST_BYTES = 1 << 20
DEEPEST = 8
MOST_VALUES = 300_000
"""In one file, those behind aliases counted wherever an alias names them."""

_SHORT = 6  # entries of a list that a message repeats


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
        if path.exists() and not (path.is_file() or path.is_dir()):
            # A FIFO, or a terminal, would let us wait for ever.
            raise SettingsError(f"{name}: is no regular file, expected {expected}")
        with path.open("rb") as stream:
            data = stream.read(LARGEST_BYTES + 1)
    except (OSError, ValueError) as error:
        raise SettingsError(
            f"{name}: cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from error
    if len(data) > LARGEST_BYTES:
        raise SettingsError(f"{name}: larger than 1 MiB, expected {expected}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SettingsError(f"{name}: not UTF-8 text, expected {expected}") from error
    return parse_yaml(text, name)


def required_yaml(path: Path, expected: str) -> yaml.Node:
    """Return the root node of a YAML file as ``read_yaml`` does, but refuse one without any."""
    root = read_yaml(path, expected)
    if root is None:
        raise SettingsError(f"{printable(str(path))}: is empty, expected {expected}")
    return root


def parse_yaml(text: str, name: str) -> yaml.Node | None:
    """Return the root node of YAML text; None if it says nothing.

    Raises
    ------
    SettingsError
        ``name:line: what is wrong``.
    """
    try:
        root = _composed(text, name)
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


def _composed(text: str, name: str) -> yaml.Node | None:
    loader = _BoundedLoader(text)
    loader.name = name  # each node's mark has it
    try:
        root: yaml.Node | None = loader.get_single_node()
    finally:
        loader.dispose()
    return root


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


def members(
    node: yaml.Node, expected: str, key: str = ""
) -> Iterator[tuple[str, yaml.Node, yaml.Node]]:
    """Yield name, value and the node of the name of a mapping, each name once.

    Raises
    ------
    SettingsError
        ``file:line: what is wrong``, if it is no mapping, or gives a name twice.
    """
    if not isinstance(node, yaml.MappingNode):
        raise refusal(node, key, expected)
    seen: set[str] = set()
    for name, value in node.value:
        if not isinstance(name, yaml.ScalarNode):
            raise SettingsError(f"{place(name)}: found {kind(name)} for a name, {expected}")
        if name.value in seen:
            raise SettingsError(f"{place(name)}: {shown(name.value)} is given twice")
        seen.add(name.value)
        yield name.value, value, name


def is_null(node: yaml.Node) -> bool:
    """Whether a node says nothing."""
    return isinstance(node, yaml.ScalarNode) and node.tag == "tag:yaml.org,2002:null"


def kind(node: yaml.Node) -> str:
    """Return what a node is, for messages."""
    if isinstance(node, yaml.ScalarNode):
        return shown(node.value)
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"


def place(node: yaml.Node) -> str:
    """Return where a node stands, ``file:line``; an option of the command line has no lines."""
    name = node.start_mark.name
    option = name.startswith("--")
    return name.partition(" ")[0] if option else f"{name}:{node.start_mark.line + 1}"


def refusal(node: yaml.Node, key: str, expected: str) -> SettingsError:
    """Return the error for a value that is not what was expected."""
    found = kind(node)
    if isinstance(node, yaml.SequenceNode) and 0 < len(node.value) <= _SHORT:
        words = [entry.value for entry in node.value if isinstance(entry, yaml.ScalarNode)]
        if len(words) == len(node.value):
            found = shown(words).replace('"', "")
    about = f"{key}, " if key else ""
    return SettingsError(f"{place(node)}: {about}found {found}, {expected}")

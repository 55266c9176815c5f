"""Mappings read from YAML, each value refused with its line (docs/convert.md, "Mappings")."""

from __future__ import annotations

import math
from pathlib import Path

import yaml

from possmap.errors import SettingsError, did_you_mean, printable, shown
from possmap.lab.convert.samples import Mount
from possmap.lab.recordings.mapping import (
    ROLES,
    STANDARD_UNITS,
    UNITS,
    Beam,
    Mapping,
    Readable,
    Scan,
    Table,
    Ticks,
    fault_of,
)
from possmap.lab.recordings.mapping_values import (
    Nodes,
    column_of,
    delimiter_of,
    flag,
    given,
    known_members,
    need,
    not_negative,
    positive,
    text_of,
    word,
)
from possmap.settings.shipped import shipped
from possmap.settings.yaml_nodes import (
    items,
    number,
    place,
    read_yaml,
    refusal,
)

FOLDER = "recordings"
"""Where in configs/ the shipped mappings lie."""

FORMATS = ("csv", "json", "ros")
_IN_TABLE = ("columns", "beams", "scan")
_MOUNT = "mount"
_KEYS = (
    "format", "tables", *_IN_TABLE, "rows", "delimiter", "header", "comment", "units", "ticks",
    "nothing", "invalid", "period", "velocity_in_body", "guard", "gap",
)  # fmt: skip
_OF_FORMAT = {"rows": ("json",), **dict.fromkeys(("delimiter", "header", "comment"), ("csv",))}
_FARTHEST_M = 10.0
_MOST_BEAMS = 100_000
_MOST_TABLES = 100


def known_mappings() -> list[str]:
    """Return the names of the mappings that possmap ships."""
    return sorted(path.stem for path in shipped(FOLDER).glob("*.yaml"))


def find_mapping(name: str) -> Path:
    """Return the file of a mapping: a path, or the name of a shipped one.

    Raises
    ------
    SettingsError
        If there is neither.
    """
    path, inside = Path(name), shipped(FOLDER) / f"{name}.yaml"
    if path.is_file():
        return path
    if path.name == name and inside.is_file():
        return inside
    known = known_mappings()
    guess = did_you_mean(name, known) or f"; possmap ships {', '.join(known)}"
    raise SettingsError(f"--mapping: {shown(name)} is neither a file nor shipped{guess}")


def read_mapping(path: Path) -> Mapping:
    """Read a mapping file.

    Raises
    ------
    SettingsError
        ``file:line: key, value found, what was expected``.
    """
    name = printable(str(path))
    root = read_yaml(path, "a mapping of a recording's columns")
    if root is None:
        raise SettingsError(f"{name}: is empty, expected a mapping with format and columns")
    nodes = known_members(root, name, _KEYS)
    if "format" not in nodes:
        raise SettingsError(f"{name}: format is missing, expected one of {', '.join(FORMATS)}")
    form = word(nodes["format"], name, "format", FORMATS)
    _check_of_format(nodes, name, form)
    tables = _tables(root, nodes, name, form)
    ticks = given(nodes, "ticks", lambda node: _ticks(node, name), None)
    in_body = given(
        nodes, "velocity_in_body", lambda node: flag(node, name, "velocity_in_body"), False
    )
    # A bag's standard types say themselves what they hold: it is checked when the bag is open.
    fault = None if form == "ros" else fault_of(tables, ticks, in_body)
    if fault is not None:
        raise SettingsError(f"{place(nodes.get('tables', root), name)}: {fault}")
    times = all("t" in table.columns for table in tables)
    period = given(nodes, "period", lambda node: positive(node, name, "period"), None)
    if form != "ros" and not times and period is None:
        which = "no column t" if len(tables) == 1 else "a table without a column t"
        raise SettingsError(f"{name}: {which}, expected one, or the key period in seconds")
    return Mapping(
        format=form,
        tables=tables,
        rows=given(nodes, "rows", lambda node: text_of(node, name, "rows"), ""),
        delimiter=given(nodes, "delimiter", lambda node: delimiter_of(node, name), ","),
        header=given(nodes, "header", lambda node: flag(node, name, "header"), True),
        comment=given(nodes, "comment", lambda node: text_of(node, name, "comment"), "#"),
        units=given(nodes, "units", lambda node: _units(node, name), STANDARD_UNITS),
        ticks=ticks,
        readable=_readable(nodes, name),
        period=period,
        velocity_in_body=in_body,
        guard=given(nodes, "guard", lambda node: not_negative(node, name, "guard"), 0.05),
        gap=given(nodes, "gap", lambda node: positive(node, name, "gap"), 1.0),
    )


def _check_of_format(nodes: Nodes, name: str, form: str) -> None:
    """Refuse keys that say nothing for the format: somebody expects them to."""
    for key, of in _OF_FORMAT.items():
        if key in nodes and form not in of:
            where = place(nodes[key], name)
            raise SettingsError(f"{where}: {key} is for {' and '.join(of)}, the format is {form}")


def _tables(root: yaml.Node, nodes: Nodes, name: str, form: str) -> tuple[Table, ...]:
    if "tables" not in nodes:
        return (_table({key: nodes[key] for key in _IN_TABLE if key in nodes}, root, name),)
    for key in _IN_TABLE:
        if key in nodes:
            raise refusal(nodes[key], name, key, "expected it inside tables")
    source = "topic" if form == "ros" else "file"
    tables = []
    listed = items(nodes["tables"], name, "tables", "expected a list of tables")
    if len(listed) > _MOST_TABLES:
        raise refusal(nodes["tables"], name, "tables", f"expected at most {_MOST_TABLES}")
    for node in listed:
        known = (source, *_IN_TABLE, *((_MOUNT,) if form == "ros" else ()))
        parts = known_members(node, name, known)
        if len(listed) > 1:
            need(parts, (source,), node, name)
        if (
            source == "file"
            and source in parts
            and text_of(parts[source], name, source).count("*") > 1
        ):
            raise refusal(parts[source], name, source, "expected at most one *")
        tables.append(_table(parts, node, name))
    return tuple(tables)


def _table(parts: Nodes, node: yaml.Node, name: str) -> Table:
    columns: dict[str, str] = {}
    if "columns" in parts:
        for role, value in known_members(parts["columns"], name, ROLES).items():
            columns[role] = column_of(value, name, role)
    source = ""
    for key in ("file", "topic"):
        if key in parts:
            source = text_of(parts[key], name, key)
    beams: tuple[Beam, ...] = ()
    if "beams" in parts:
        listed = items(parts["beams"], name, "beams", "expected a list of beams")
        beams = tuple(_beam(beam, name) for beam in listed)
    scan = _scan(parts["scan"], name) if "scan" in parts else None
    if beams and scan is not None:
        raise refusal(node, name, "beams", "expected beams or a scan, not both")
    mount = _mount(parts[_MOUNT], name) if _MOUNT in parts else None
    if mount is not None and (columns.keys() - {"t"} or beams or scan is not None):
        expected = "expected it in a table of a standard topic, without columns, beams or scan"
        raise refusal(parts[_MOUNT], name, _MOUNT, expected)
    return Table(source, columns, beams, scan, mount)


def _mount(node: yaml.Node, name: str) -> Mount:
    parts = known_members(node, name, ("angle_deg", "x", "y"))
    angle = number(parts["angle_deg"], name, "angle_deg") if "angle_deg" in parts else 0.0
    return Mount(math.radians(angle), *_sensor(parts, name))


def _beam(node: yaml.Node, name: str) -> Beam:
    parts = known_members(node, name, ("column", "angle_deg", "x", "y"))
    need(parts, ("column", "angle_deg"), node, name)
    angle = math.radians(number(parts["angle_deg"], name, "angle_deg"))
    column = column_of(parts["column"], name, "column")
    return Beam(column, Mount(angle, *_sensor(parts, name)))


def _scan(node: yaml.Node, name: str) -> Scan:
    parts = known_members(node, name, ("column", "first_deg", "step_deg", "count", "x", "y"))
    need(parts, ("column", "first_deg", "step_deg"), node, name)
    count = None
    if "count" in parts:
        told = number(parts["count"], name, "count")
        count = int(told)
        if count != told or not 1 <= count <= _MOST_BEAMS:
            expected = f"expected a whole number, 1 to {_MOST_BEAMS}"
            raise refusal(parts["count"], name, "count", expected)
    first, step = (math.radians(number(parts[key], name, key)) for key in ("first_deg", "step_deg"))
    column = column_of(parts["column"], name, "column")
    return Scan(column, first, step, count, *_sensor(parts, name))


def _sensor(parts: Nodes, name: str) -> tuple[float, float]:
    found = []
    for key in ("x", "y"):
        value = number(parts[key], name, key) if key in parts else 0.0
        if abs(value) > _FARTHEST_M:
            expected = f"expected at most {_FARTHEST_M:g} m from the robot's middle"
            raise refusal(parts[key], name, key, expected)
        found.append(value)
    x, y = found
    return x, y


def _ticks(node: yaml.Node, name: str) -> Ticks:
    known = ("metres_per_tick", "left", "right", "track", "wrap", "cumulative")
    parts = known_members(node, name, known)
    both = given(parts, "metres_per_tick", lambda n: positive(n, name, "metres_per_tick"), None)
    left = given(parts, "left", lambda n: positive(n, name, "left"), both)
    right = given(parts, "right", lambda n: positive(n, name, "right"), both)
    if left is None or right is None:
        raise refusal(node, name, "ticks", "expected metres_per_tick, or left and right")
    need(parts, ("track",), node, name)
    return Ticks(
        left,
        right,
        positive(parts["track"], name, "track"),
        given(parts, "wrap", lambda n: positive(n, name, "wrap"), None),
        given(parts, "cumulative", lambda n: flag(n, name, "cumulative"), True),
    )


def _readable(nodes: Nodes, name: str) -> Readable:
    def parts_of(key: str, *known: str) -> Nodes:
        return known_members(nodes[key], name, known) if key in nodes else {}

    nothing = parts_of("nothing", "values", "above")
    invalid = parts_of("invalid", "values", "above", "below")

    def values(parts: Nodes) -> tuple[float, ...]:
        if "values" not in parts:
            return ()
        listed = items(parts["values"], name, "values", "expected a list of numbers")
        return tuple(number(node, name, "values") for node in listed)

    def bound(parts: Nodes, key: str, default: float) -> float:
        return given(parts, key, lambda node: number(node, name, key), default)

    return Readable(
        values(nothing),
        bound(nothing, "above", math.inf),
        values(invalid),
        bound(invalid, "above", math.inf),
        bound(invalid, "below", 0.0),
    )


def _units(node: yaml.Node, name: str) -> dict[str, str]:
    units = dict(STANDARD_UNITS)
    for quantity, value in known_members(node, name, UNITS).items():
        units[quantity] = word(value, name, quantity, tuple(UNITS[quantity]))
    return units

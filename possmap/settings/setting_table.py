"""The table of all settings: flat name, how its text is read, what it means (docs/settings.md)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

from possmap.core.model import LARGEST, PARAMETERS, check_parameter
from possmap.errors import SettingsError, did_you_mean, shown
from possmap.logs.fields import NAME

Value: TypeAlias = bool | int | float | str


class Given(NamedTuple):
    """A value that somebody gave, and where: ``site.yaml:3`` or ``--set``."""

    value: Value
    origin: str


GivenSettings: TypeAlias = Mapping[str, Given]
"""Flat name -> value; a robot's parameter is named ``robots.NAME.parameter``."""


class _Wrong(Exception):
    """A value that does not fit its setting; the message says what was expected."""


_NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")


def _number(text: str) -> float:
    if not _NUMBER.fullmatch(text):
        raise _Wrong("expected a number")
    value = float(text)
    if not -LARGEST <= value <= LARGEST:
        raise _Wrong("expected a number within ±1e6")
    return value + 0.0


def _resolution(text: str) -> float:
    value = _number(text)
    if value < 1e-6:
        raise _Wrong("expected a number >= 1e-6")
    return value


def _positive(text: str) -> float:
    value = _number(text)
    if value <= 0:
        raise _Wrong("expected a number > 0")
    return value


def _count(text: str) -> int:
    if not re.fullmatch(r"[0-9]{1,15}", text) or int(text) == 0:
        raise _Wrong("expected a whole number > 0")
    return int(text)


def _share(text: str) -> float:
    value = _number(text)
    if not 0 < value < 1:
        raise _Wrong("expected a number between 0 and 1")
    return value


def _power(text: str) -> float:
    value = _number(text)
    if value < 1:
        raise _Wrong("expected a number >= 1")
    return value


def _part(text: str) -> float:
    value = _number(text)
    if not 0 < value <= 1:
        raise _Wrong("expected a number above 0, at most 1")
    return value


def _flag(text: str) -> bool:
    if text not in ("true", "false"):
        raise _Wrong("expected true or false")
    return text == "true"


def _parameter(name: str) -> Callable[[str], float]:
    def parse(text: str) -> float:
        value = _number(text)
        try:
            check_parameter(name, value)
        except ValueError as error:
            raise _Wrong(str(error).rpartition(", ")[2]) from None
        return value

    return parse


WIDEST = 10.0
"""Body of a robot [m]."""


def _width(text: str) -> float:
    value = _number(text)
    if not 0 <= value <= WIDEST:
        raise _Wrong(f"expected 0 to {WIDEST:g} metres")
    return value


def _one_of(*words: str) -> Callable[[str], str]:
    def parse(text: str) -> str:
        if text not in words:
            raise _Wrong(f"expected {' or '.join(words)}{did_you_mean(text, words)}")
        return text

    return parse


class Setting(NamedTuple):
    """One setting: how its text is read, and what it is, for people."""

    parse: Callable[[str], Value]
    meaning: str


SHAPING: Mapping[str, Setting] = MappingProxyType(
    {
        "resolution": Setting(_resolution, "metres per cell"),
        "estimator": Setting(
            _one_of("linear", "heading", "walls"),
            "linear: the paper's; heading: needs turn_spread <= 0.5; walls: needs none",
        ),
        "orthogonal": Setting(_flag, "the building's walls stand at right angles (walls)"),
        "axes": Setting(_number, "direction of any one of its walls [deg] (walls)"),
        "independence": Setting(
            _one_of("detection", "excursion"), "what counts as independent: detection or excursion"
        ),
        "free_fusion": Setting(
            _one_of("minimum", "dempster"), "how several excursions deny a wall together"
        ),
        "certainty_power": Setting(
            _power, "an excursion's N counts as N to this power (independence: excursion)"
        ),
        "pass_weight": Setting(
            _part, "share of an excursion's denial that counts (free_fusion: dempster)"
        ),
        "free_along_walls": Setting(_flag, "runs past walls deny walls on their path"),
        "free_along_beams": Setting(_flag, "the paths of range readings deny walls"),
        "clip_coobserved": Setting(_flag, "such a run spares the walls that it saw itself"),
        "path_width": Setting(_width, "width of floor that a path clears [m]; 0: pyramids"),
        "accept_models": Setting(_flag, "a log's own error model is believed"),
        "along": Setting(_parameter("along"), "half-width gained along a run [m per m]"),
        "across": Setting(_parameter("across"), "half-width gained across a run [m per m]"),
        "turn_bias": Setting(_parameter("turn_bias"), "known over-turn to the left per 45° [deg]"),
        "turn_gain": Setting(_parameter("turn_gain"), "known over-turn, as a share of the turn"),
        "turn_spread": Setting(
            _parameter("turn_spread"), "half-width of the unknown over-turn per 45° [deg]"
        ),
        "turn_noise": Setting(
            _parameter("turn_noise"), "what changes from turn to turn [deg]; linear ignores it"
        ),
        "drift": Setting(_parameter("drift"), "known turn to the left per metre run [deg/m]"),
        "drift_spread": Setting(
            _parameter("drift_spread"), "half-width of its unknown part [deg/m]"
        ),
        "scale": Setting(_parameter("scale"), "true distance over logged distance"),
        "alignment_spread": Setting(
            _parameter("alignment_spread"), "heading half-width after lining up with a wall [deg]"
        ),
        "wall_noise": Setting(
            _parameter("wall_noise"), "half-width of a seen wall's end across it [m] (walls)"
        ),
        "wall_tilt": Setting(
            _parameter("wall_tilt"), "half-width of a wall's deviation from the axes [deg] (walls)"
        ),
        "sensor": Setting(_parameter("sensor"), "half-width of the range sensor's error [m]"),
        "max_error": Setting(
            _parameter("max_error"), "half-width beyond which data is irrelevant [m]"
        ),
        "factor": Setting(_parameter("factor"), "standard deviations that a half-width stands for"),
    }
)
"""The settings that shape evidence; a grid keeps those of its first fuse."""

OF_A_CALL: Mapping[str, Setting] = MappingProxyType(
    {
        "base_rate": Setting(_share, "probability of a wall where nothing is known"),
        "limit_file_mib": Setting(_positive, "largest log, decompressed [MiB]"),
        "limit_nesting": Setting(_count, "deepest nesting of a log's JSON"),
        "limit_file_objects": Setting(_count, "most objects and lists in a log's JSON"),
        "limit_file_excursions": Setting(_count, "most excursions that one log may hold"),
        "limit_record_cells": Setting(_count, "most cells of work of one record"),
        "limit_file_cells": Setting(_count, "most cells of work of one log"),
        "transaction_records": Setting(_count, "records read between two commits"),
    }
)
"""The settings that belong to each call."""

KNOWN: Mapping[str, Setting] = MappingProxyType({**SHAPING, **OF_A_CALL})

ROBOT = "robots."
"""What the flat name of a robot's parameter begins with."""


def parse_setting(name: str, text: str, origin: str) -> Given:
    """Read the text of one setting.

    Parameters
    ----------
    name
        Flat; a robot's parameter is ``robots.NAME.parameter``.
    origin
        Where it was given, for messages.

    Raises
    ------
    SettingsError
        ``origin: name, value found, what was expected``.
    """
    setting = known_setting(name, origin)
    try:
        return Given(setting.parse(text), origin)
    except _Wrong as wrong:
        raise SettingsError(f"{origin}: {name}, found {shown(text)}, {wrong}") from None


def known_setting(name: str, origin: str) -> Setting:
    """Return the setting of that name.

    Raises
    ------
    SettingsError
        If there is none, with the closest that there is.
    """
    if name == "robots" or name.startswith(ROBOT):
        robot, _, parameter = name.removeprefix("robots").removeprefix(".").rpartition(".")
        if not NAME.fullmatch(robot):
            found = shown(robot or parameter)
            raise SettingsError(f"{origin}: robots, found {found}, expected robots.NAME.PARAMETER")
        if parameter not in PARAMETERS:
            guess = did_you_mean(parameter, PARAMETERS)
            raise SettingsError(
                f"{origin}: unknown parameter {shown(parameter)} of robot {robot}"
                f"{guess or ', expected one of ' + ', '.join(PARAMETERS)}"
            )
        return SHAPING[parameter]
    if name not in KNOWN:
        guess = did_you_mean(name, [*KNOWN, "robots"])
        known = "; possmap config lists the known ones"
        raise SettingsError(f"{origin}: unknown setting {shown(name)}{guess or known}")
    return KNOWN[name]


def merged(levels: Iterable[GivenSettings]) -> dict[str, Given]:
    """Merge levels, the weakest first; a robot's entries merge parameter by parameter."""
    result: dict[str, Given] = {}
    for level in levels:
        result.update(level)
    return result

"""The table of all settings, as their dataclasses declare them (docs/settings.md)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

from possmap.core.model import PARAMETERS, ErrorModel
from possmap.core.records import NAME
from possmap.core.settings import EvidenceSettings
from possmap.errors import SettingsError, did_you_mean, shown
from possmap.settings.kinds import Kind, kind_of, kinds_of
from possmap.settings.kinds import Value as Value
from possmap.settings.limits import BaseRate, Limits


class Given(NamedTuple):
    """A value that somebody gave, and where: ``site.yaml:3`` or ``--set``."""

    value: Value
    origin: str


GivenSettings: TypeAlias = Mapping[str, Given]
"""Flat name -> value; a robot's parameter is named ``robots.NAME.parameter``."""

SHAPING: Mapping[str, Kind] = MappingProxyType(
    {
        name: kind
        for name, kind in (kinds_of(EvidenceSettings) | kinds_of(ErrorModel)).items()
        if name != "model"
    }
)
"""The settings that shape evidence; a grid keeps those of its first fuse."""

OF_A_CALL: Mapping[str, Kind] = MappingProxyType(
    {"base_rate": kind_of(BaseRate), **kinds_of(Limits)}
)
"""The settings that belong to each call."""

KNOWN: Mapping[str, Kind] = MappingProxyType({**SHAPING, **OF_A_CALL})

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
    except ValueError as wrong:
        raise SettingsError(f"{origin}: {name}, found {shown(text)}, {wrong}") from None


def known_setting(name: str, origin: str) -> Kind:
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

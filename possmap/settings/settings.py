"""Settings as values: built of flat names, and printed as YAML (docs/settings.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from possmap.core.model import PARAMETERS, ErrorModel
from possmap.core.records import OwnModel
from possmap.core.settings import NO_ROBOTS, EvidenceSettings, RobotModels
from possmap.errors import SettingsError
from possmap.settings.limits import BaseRate, Limits
from possmap.settings.setting_table import OF_A_CALL, ROBOT, SHAPING, Value


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """All settings of one call.

    evidence : what belongs to the grid.
    robots : what the host knows of single robots.
    limits : how much one input may take.
    base_rate : probability of a wall where nothing is known, for the view ``probability``.
    """

    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    robots: RobotModels = field(default_factory=lambda: NO_ROBOTS)
    limits: Limits = field(default_factory=Limits)
    base_rate: BaseRate = 0.5

    def model_in_force(self, robot: str, own: OwnModel) -> ErrorModel:
        """Return the model under which an excursion not yet known is fused."""
        return self.evidence.model_in_force(own, self.robots.get(robot, {}))


def assemble(given: Mapping[str, Value], origins: Mapping[str, str] | None = None) -> Settings:
    """Build settings of flat values; what is not given has its default.

    Parameters
    ----------
    origins
        Where values were given, for messages.

    Raises
    ------
    SettingsError
        If they do not go together.
    """
    robots: dict[str, dict[str, float]] = {}
    for name, value in given.items():
        if name.startswith(ROBOT):
            robot, _, parameter = name.removeprefix(ROBOT).rpartition(".")
            robots.setdefault(robot, {})[parameter] = float(value)
    flat: dict[str, Any] = dict(given)

    def of(cls: Any) -> dict[str, Any]:
        return {one.name: flat[one.name] for one in fields(cls) if one.name in flat}

    try:
        evidence = EvidenceSettings(**of(EvidenceSettings), model=ErrorModel(**of(ErrorModel)))
    except ValueError as error:
        origin = (origins or {}).get(str(error).partition(",")[0], "settings")
        raise SettingsError(f"{origin}: {error}") from None
    return Settings(**of(Settings), evidence=evidence, robots=robots, limits=Limits(**of(Limits)))


def flat_evidence(settings: EvidenceSettings) -> dict[str, Value]:
    """Return the settings that shape evidence, flat, in the order of SHAPING."""
    return {
        name: getattr(settings.model if name in PARAMETERS else settings, name) for name in SHAPING
    }


def flat(settings: Settings) -> dict[str, Value]:
    """Return all settings but ``robots``, flat, in the order of KNOWN."""
    of_call = {
        name: settings.base_rate if name == "base_rate" else getattr(settings.limits, name)
        for name in OF_A_CALL
    }
    return {**flat_evidence(settings.evidence), **of_call}


def scalar(value: Value) -> str:
    """Return a value as settings spell it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value + 0.0) if isinstance(value, float) else str(value)


def flat_robots(robots: RobotModels) -> dict[str, Value]:
    """Return robots' entries under flat names."""
    return {
        f"robots.{robot}.{name}": value
        for robot, parameters in sorted(robots.items())
        for name, value in sorted(parameters.items())
    }

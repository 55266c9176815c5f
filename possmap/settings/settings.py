"""Settings as values: built of flat names, and printed as YAML (docs/settings.md)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from possmap.core.model import PARAMETERS, ErrorModel
from possmap.core.records import OwnModel
from possmap.core.settings import NO_ROBOTS, EvidenceSettings, RobotModels
from possmap.errors import SettingsError
from possmap.settings.limits import Limits
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
    base_rate: float = 0.5

    def model_in_force(self, robot: str, own: OwnModel) -> ErrorModel:
        """Return the model under which an excursion not yet known is fused."""
        return self.evidence.model_in_force(own, self.robots.get(robot, {}))


def assemble(given: Mapping[str, Value]) -> Settings:
    """Build settings of flat values; what is not given has its default.

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

    def of(cls: type[object]) -> dict[str, Any]:
        names = [f.name for f in dataclasses.fields(cls)]  # type: ignore[arg-type]
        return {name: flat[name] for name in names if name in flat}

    model = ErrorModel(**of(ErrorModel))
    try:
        evidence = EvidenceSettings(**of(EvidenceSettings), model=model)
    except ValueError as error:
        raise SettingsError(f"settings: {error}") from None
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


def to_yaml(settings: Settings) -> str:
    """Return all settings as commented YAML that can be edited and given back with ``--config``."""
    lines: list[str] = []
    lines += ["# What shapes evidence: a grid keeps these from its first fuse."]
    values = flat(settings)
    lines += [_yaml_line(name, values[name], SHAPING[name].meaning) for name in SHAPING]
    lines += ["", "# What the host knows of single robots: any parameter of the error model."]
    if settings.robots:
        lines += ["robots:"]
        for robot, parameters in sorted(settings.robots.items()):
            entries = ", ".join(f"{name}: {scalar(v)}" for name, v in sorted(parameters.items()))
            lines += [f'  "{robot}": {{{entries}}}']
    else:
        lines += ["robots: {}"]
    lines += ["", "# What belongs to each call."]
    lines += [_yaml_line(name, values[name], OF_A_CALL[name].meaning) for name in OF_A_CALL]
    return "\n".join(lines) + "\n"


def _yaml_line(name: str, value: Value, meaning: str) -> str:
    return f"{f'{name}: {scalar(value)}':<39} # {meaning}"


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

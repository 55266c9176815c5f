"""The settings in force: which level beats which, and what a grid keeps (docs/settings.md)."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from possmap.errors import SettingsError, printable
from possmap.settings.setting_table import SHAPING, Given, GivenSettings, Value
from possmap.settings.settings import Settings, assemble, scalar

DEFAULT_PROFILE = "robust"
"""Of grids that are new."""

ROBUST: Mapping[str, Value] = MappingProxyType(
    {
        "estimator": "walls",
        "orthogonal": True,
        "independence": "excursion",
        "free_fusion": "dempster",
        "certainty_power": 2.0,
        "pass_weight": 0.5,
        "free_along_walls": True,
        "clip_coobserved": True,
        "free_along_beams": True,
        "path_width": 0.15,
        "turn_noise": 0.7,
    }
)
"""What configs/robust.yaml says, for calls that would read no other YAML: it is slow to import."""


@dataclass(frozen=True, slots=True)
class Request:
    """What a user asks of the settings, from the weakest level to the strongest.

    profile : name of a shipped profile.
    config : a settings file.
    flags, overrides : from options of their own (``--resolution``), and from ``--set``.
    """

    profile: str | None = None
    config: Path | None = None
    flags: GivenSettings = field(default_factory=dict)
    overrides: GivenSettings = field(default_factory=dict)

    def given(self) -> dict[str, Given]:
        """Return every value that was given, the strongest of each name.

        Raises
        ------
        SettingsError
            For a profile or a file that cannot be used.
        """
        levels = [self.flags, self.overrides]
        if self.profile or self.config:
            # YAML is slow to import, and most calls need none of it.
            from possmap.settings.settings_yaml import read_profile, read_settings

            profile = read_profile(self.profile) if self.profile else {}
            config = read_settings(self.config) if self.config else {}
            levels = [profile, config, *levels]
        return {name: one for level in levels for name, one in level.items()}


def in_force(
    given: Mapping[str, Given], stored: Mapping[str, Value] | None = None, grid: Path | None = None
) -> Settings:
    """Return the settings of a call.

    Parameters
    ----------
    given
        What the user gave; a new grid has the default profile below it.
    stored
        What the grid keeps; None without a grid, or for a new one.

    Raises
    ------
    SettingsError
        If a value differs from one that the grid keeps, with both values; if values do not go
        together.
    """
    if stored is None:
        given = {**_default(given), **given}
    else:
        differing = [
            name for name in SHAPING if name in given and given[name].value != stored[name]
        ]
        if differing:
            raise _refused(given, stored, grid, differing)
    values = {name: value for name, (value, _) in given.items()}
    origins = {name: origin for name, (_, origin) in given.items()}
    return assemble({**(stored or {}), **values}, origins)


def _default(given: Mapping[str, Given]) -> GivenSettings:
    if DEFAULT_PROFILE == "paper" or any(one.origin.startswith("--prof") for one in given.values()):
        return {}  # the paper's values are those of the dataclasses
    origin = f"the default profile {DEFAULT_PROFILE} (--profile paper has no discounts)"
    return {name: Given(value, origin) for name, value in ROBUST.items()}


def _refused(
    given: Mapping[str, Given],
    stored: Mapping[str, Value],
    grid: Path | None,
    differing: Sequence[str],
) -> SettingsError:
    """Return the error for settings that a grid does not have, and how to get one that has them."""
    name, path = differing[0], printable(str(grid))
    value, origin = given[name]
    more = f" ({len(differing) - 1} more differ)" if len(differing) > 1 else ""
    asked = dict.fromkeys(_argument(name, *one) for name, one in given.items())
    return SettingsError(
        f"{origin}: {name}, found {scalar(value)}, but {path} was made with "
        f"{scalar(stored[name])} and keeps it{more}; to fuse its logs anew: "
        f"possmap fuse {shlex.quote(path)} -g NEW.possmap {' '.join(asked)}"
    )


def _argument(name: str, value: Value, origin: str) -> str:
    """Return what gives a value on the command line, as it was given."""
    if origin.startswith("--profile "):
        return origin
    if origin == f"--{name}":
        return f"{origin} {scalar(value)}"
    if path := origin.rpartition(":")[0]:
        return f"--config {shlex.quote(path)}"
    return f"--set {shlex.quote(f'{name}={scalar(value)}')}"

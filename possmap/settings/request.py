"""The settings in force: which level beats which, and what a grid keeps (docs/settings.md)."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from possmap.errors import SettingsError, printable
from possmap.settings.setting_table import SHAPING, Given, GivenSettings, Value, merged
from possmap.settings.settings import Settings, assemble, scalar


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
        return merged(levels)


def in_force(
    given: Mapping[str, Given], stored: Mapping[str, Value] | None = None, grid: Path | None = None
) -> Settings:
    """Return the settings of a call.

    Parameters
    ----------
    given
        What the user gave.
    stored
        What the grid keeps; None without a grid, or for a new one.

    Raises
    ------
    SettingsError
        If a value differs from one that the grid keeps; with both values.
    """
    values: dict[str, Value] = {name: value for name, (value, _) in given.items()}
    if stored is None:
        return assemble(values)
    for name in SHAPING:
        if name in values and values[name] != stored[name]:
            _, origin = given[name]
            path, value = printable(str(grid)), scalar(values[name])
            raise SettingsError(
                f"{origin}: {name}, found {value}, but {path} was made with "
                f"{scalar(stored[name])} and keeps it; to fuse its logs anew: "
                f"possmap fuse {shlex.quote(path)} -g NEW.possmap --set {name}={value}"
            )
    return assemble({**stored, **values})

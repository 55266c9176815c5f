"""What ``possmap convert`` is asked for: readers, names, models and starts of recordings."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from possmap.core.model import PARAMETERS
from possmap.errors import SettingsError, shown
from possmap.lab.convert.legs import KnownPlace, Start
from possmap.lab.convert.settings import ConvertSettings
from possmap.lab.recordings import Recording, Source
from possmap.settings.setting_table import ROBOT, parse_setting
from possmap.settings.settings_yaml import read_settings

LONGEST_NAME = 64
"""Characters of a robot's or an excursion's name (docs/logs.md)."""
_NOT_OF_A_NAME = re.compile(r"[^A-Za-z0-9._:-]+")


@dataclass(frozen=True, slots=True)
class Models:
    """Parameters of the error model that are given: for any robot, for some, and above all.

    general : of a settings file. robots : of its ``robots:``. sets : of the command line.
    places : where robots' frames lie in the site, by name.
    """

    general: Mapping[str, float] = field(default_factory=dict)
    robots: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    sets: Mapping[str, float] = field(default_factory=dict)
    places: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def is_silent_on(self, robot: str) -> bool:
        """Whether the file names robots, but neither this one nor values for any."""
        return bool(self.robots) and robot not in self.robots and not self.general

    def of(self, robot: str) -> dict[str, float]:
        """Return what holds for a robot."""
        return {
            **self.general, **self.robots.get(robot, {}), **self.sets, **self.places.get(robot, {})
        }  # fmt: skip


def models_of(
    path: Path | None,
    sets: Mapping[str, str],
    places: Iterable[tuple[str, Mapping[str, str]]] = (),
) -> Models:
    """Return the models of a settings file, as ``possmap calibrate`` writes it, and of options.

    places : of ``--place``, robot and parameters.

    Raises
    ------
    SettingsError
        If one is unknown, out of range, or no parameter of the error model.
    """
    general: dict[str, float] = {}
    robots: dict[str, dict[str, float]] = {}
    for name, (value, origin) in read_settings(path).items() if path is not None else ():
        robot, _, parameter = name.removeprefix(ROBOT).rpartition(".")
        if name.startswith(ROBOT):
            robots.setdefault(robot, {})[parameter] = float(value)
        else:
            general[_parameter(name, origin)] = float(value)
    given: dict[str, float] = {}
    for name, text in sets.items():
        value, origin = parse_setting(name, text, "--set")
        given[_parameter(name, origin)] = float(value)
    laid = {
        robot: {k: float(parse_setting(k, text, "--place").value) for k, text in parameters.items()}
        for robot, parameters in places
    }
    return Models(general, robots, given, laid)


def _parameter(name: str, origin: str) -> str:
    if name in PARAMETERS:
        return name
    raise SettingsError(
        f"{origin}: {shown(name)} is no parameter of the error model, expected one of "
        f"{', '.join(PARAMETERS)}"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ConvertRequest:
    """What ``possmap convert`` is asked for.

    Attributes
    ----------
    source
        How the recordings are read.
    settings
        How they become logs.
    models
        Parameters of the error model; what is applied here is not in the log.
    robot, excursion
        Names; without, the recording's own.
    starts
        Where each recording begins, in their order; none: where they have it themselves.
    fixes
        What is known of where each recording ends, in their order; one that goes by the reference
        is for all; none: nothing.
    errors
        Half-widths of where each leg begins, x, y [m] and heading [deg].
    reference, reference_source
        A recording of known poses, and how it is read.
    """

    source: Source = field(default_factory=Source)
    settings: ConvertSettings = field(default_factory=ConvertSettings)
    models: Models = field(default_factory=lambda: Models())
    robot: str | None = None
    excursion: str | None = None
    starts: tuple[Start, ...] = ()
    fixes: tuple[KnownPlace, ...] = ()
    errors: tuple[float, float, float] = (0.0, 0.0, 0.0)
    reference: Path | None = None
    reference_source: Source = field(default_factory=Source)

    @property
    def is_cut(self) -> bool:
        """Whether a recording may become several excursions."""
        return self.settings.legs is not None or self.source.jump == "split"


def names_of(recordings: Sequence[Recording], request: ConvertRequest) -> list[tuple[str, str]]:
    """Return a robot and an excursion for each recording, no pair twice.

    Raises
    ------
    SettingsError
        If the excursion's name becomes too long with what is put behind it.
    """
    numbered = len(recordings) > 1 or request.is_cut
    longest = LONGEST_NAME - len("-123-leg-12345")
    if request.excursion is not None and numbered and len(request.excursion) > longest:
        raise SettingsError(
            f"--excursion: found {len(request.excursion)} characters, expected at most {longest}, "
            "for numbers are put behind the name"
        )
    found: list[tuple[str, str]] = []
    for recording in recordings:
        own = _NOT_OF_A_NAME.sub("-", Path(recording.name.removesuffix(".gz")).stem).strip("-")
        own = own[:40] or "robot"
        robot = request.robot or own
        base = request.excursion or (own if request.robot else "1")
        excursion, number = base, 1
        while (robot, excursion) in found:
            number += 1
            excursion = f"{base}-{number}" if request.excursion or request.robot else str(number)
        found.append((robot, excursion))
    return found

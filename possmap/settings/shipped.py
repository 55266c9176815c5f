"""What possmap ships in ``configs/``: profiles, missions, mappings of recordings, found by name."""

from __future__ import annotations

from pathlib import Path

from possmap.errors import SettingsError, did_you_mean, shown


def shipped(name: str) -> Path:
    """Return a file of ``configs/``: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent.parent
    inside = package / "configs" / name
    return inside if inside.exists() else package.parent / "configs" / name


def shipped_names(folder: str) -> list[str]:
    """Return the names of the YAML files that a folder of ``configs/`` holds."""
    return sorted(path.stem for path in shipped(folder).glob("*.yaml"))


def find_shipped(folder: str, name: str, option: str) -> Path:
    """Return a file: that of a path, or the shipped one of that name.

    Parameters
    ----------
    folder
        Of ``configs/``: ``missions`` or ``recordings``.
    option
        Where the name was given, for messages: ``--mapping``.

    Raises
    ------
    SettingsError
        If there is neither, with the closest name that there is.
    """
    path, inside = Path(name), shipped(folder) / f"{name}.yaml"
    if path.is_file():
        return path
    if path.name == name and inside.is_file():
        return inside
    known = shipped_names(folder)
    guess = did_you_mean(name, known) or f"; possmap ships {', '.join(known)}"
    raise SettingsError(f"{option}: {shown(name)} is neither a file nor shipped{guess}")

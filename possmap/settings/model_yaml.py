"""A calibrated model as a settings file that ``fuse --config`` takes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from possmap.core.model import PARAMETERS
from possmap.settings.setting_table import SHAPING
from possmap.settings.settings import scalar

DIGITS = 6


def model_yaml(
    general: Mapping[str, float],
    robots: Mapping[str, Mapping[str, float]],
    comments: Sequence[str],
) -> str:
    """Return the YAML of a model: for any robot, and for those calibrated.

    Parameters
    ----------
    general
        Parameters of a robot of which nothing else is known.
    robots
        By name.
    comments
        Lines above, what it is and where it comes from.
    """
    return "\n".join(_lines(general, robots, comments)) + "\n"


def _lines(
    general: Mapping[str, float],
    robots: Mapping[str, Mapping[str, float]],
    comments: Sequence[str],
) -> Iterator[str]:
    yield from (f"# {line}".rstrip() for line in comments)
    if general:
        yield ""
    for name in PARAMETERS:
        if name in general:
            value = scalar(rounded(general[name]))
            yield f"{f'{name}: {value}':<30} # {SHAPING[name].meaning}"
    yield ""
    yield "robots:"
    for robot, own in sorted(robots.items()):
        yield f'  "{robot}":'
        yield from (
            f"    {name}: {scalar(rounded(own[name]))}" for name in PARAMETERS if name in own
        )


def rounded(value: float) -> float:
    """Return a number with as many digits as trials can tell, and a few more."""
    return float(f"{value:.{DIGITS}g}")

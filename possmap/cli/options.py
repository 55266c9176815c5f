"""Options that several commands share, each defined once."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from possmap.budget import Budget
    from possmap.settings.request import Request
    from possmap.settings.setting_table import GivenSettings

F = TypeVar("F", bound=Callable[..., Any])

EXISTING_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


class _Log(click.Path):
    """A log, a folder of logs, ``-`` or a grid; it exists, or the command line is wrong."""

    name = "log"


class Named(click.types.StringParamType):
    """One of some names; a misspelt one gets a guess.

    what : they are names of. names : all of them, in time: to know them may take imports.
    """

    name = "name"

    def __init__(self, what: str, names: Callable[[], Collection[str]]) -> None:
        self._what, self._names = what, names

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name if it is one."""
        from possmap.errors import did_you_mean, shown

        names = self._names()
        if value not in names:
            guess = did_you_mean(value, names) or f", expected one of {', '.join(names)}"
            self.fail(f"unknown {self._what} {shown(value)}{guess}", param, ctx)
        return value

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the names that begin so."""
        return [CompletionItem(name) for name in self._names() if name.startswith(incomplete)]


logs = click.argument(
    "logs", nargs=-1, required=True, type=_Log(exists=True, allow_dash=True), metavar="LOG..."
)
grid_argument = click.argument("grid", type=EXISTING_FILE, metavar="SITE.possmap")
as_json = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
allow_truncated = click.option(
    "--allow-truncated",
    is_flag=True,
    help="Use JSON Lines whose last line was cut short, without that line.",
)
overwrite = click.option("--overwrite", is_flag=True, help="Replace OUT if it exists.")
window = click.option(
    "--window",
    metavar="X0,Y0,X1,Y1",
    callback=lambda ctx, param, value: _window(value),
    help="Only this rectangle, in metres.  [default: all that holds evidence]",
)


def mission_of(name: str) -> Path:
    """Return the file of a mission, or the shipped one of that name.

    Raises
    ------
    click.BadParameter
        If there is neither.
    """
    from possmap.errors import SettingsError
    from possmap.settings.shipped import find_shipped

    try:
        return find_shipped("missions", name, "MISSION")
    except SettingsError as error:
        told = str(error).removeprefix("MISSION: ")
        raise click.BadParameter(told, param_hint="MISSION") from None


def _budget(ctx: click.Context, param: click.Parameter, mib: int) -> Budget:
    from possmap.budget import Budget

    try:
        return Budget(mib)
    except ValueError as error:
        raise click.BadParameter(str(error)) from None


def memory_of(default: int, each: str = "") -> Callable[[F], F]:
    """Add ``--memory``, which becomes ``budget``."""
    return click.option(
        "--memory",
        "budget",
        type=int,
        default=default,
        show_default=True,
        metavar="MIB",
        callback=_budget,
        help=f"Memory that the command{each} may take; what does not fit is refused.",
    )


memory = memory_of(1024)


def selection(command: F) -> F:
    """Add ``--since``, ``--until``, ``--last``, ``--excursions``, ``--robots``: ``selection``."""

    @functools.wraps(command)
    def with_selection(
        *args: Any,
        since: datetime | None,
        until: datetime | None,
        last: int | None,
        excursions: str | None,
        robots: tuple[str, ...],
        **kwargs: Any,
    ) -> Any:
        from possmap.grid.selection import Selection

        chosen = Selection(since, until, excursions, robots, last)
        return command(*args, selection=chosen, **kwargs)

    for option in (
        click.option(
            "--robots", multiple=True, metavar="R", help="Only of this robot; again for more."
        ),
        click.option(
            "--excursions",
            metavar="GLOB",
            help="Only excursions whose name looks so: * stands for any text, ? for a letter.",
        ),
        click.option(
            "--last", type=click.IntRange(min=1), metavar="N", help="Only the N that came last."
        ),
        click.option(
            "--until",
            callback=_time,
            metavar="TIME",
            help="Only what first came until then, as --since says it.",
        ),
        click.option(
            "--since",
            callback=_time,
            metavar="TIME",
            help="Only excursions that first came to the grid since then, a day or a time, here or"
            " with an offset: 2026-11-30, 2026-11-30T18:00, 2026-11-30T18:00Z.",
        ),
    ):
        option(with_selection)
    return with_selection  # type: ignore[return-value]


def _time(ctx: click.Context, param: click.Parameter, value: str | None) -> datetime | None:
    """Return a day or a time in ISO 8601; without an offset it is one of this machine's clock."""
    if value is None:
        return None
    try:
        found = datetime.fromisoformat(value)
        if len(value) == len("2026-11-30") and param.name == "until":
            found += timedelta(days=1, seconds=-1)  # a day is over at its end
        return found.astimezone()
    except (ValueError, OverflowError):
        told = f"found {value!r:.40}, expected a time such as 2026-11-30T18:00"
        raise click.BadParameter(told) from None


def base_rate(command: F) -> F:
    """Add ``--config`` and ``--base-rate``, which become ``base_rate``."""
    rate = click.option(
        "--base-rate",
        type=click.FloatRange(0, 1, min_open=True, max_open=True),
        help="Probability of a wall where nothing is known, for the view probability."
        "  [default: 0.5]",
    )
    config = click.option(
        "--config", type=EXISTING_FILE, help="A YAML file of settings, for its base_rate."
    )
    return config(rate(command))


def chosen_base_rate(config: Path | None, base_rate: float | None) -> float:
    """Return the base rate: of the option, else of the settings file, else the default."""
    from possmap.settings.request import Request, in_force

    return in_force(Request(config=config).given()).base_rate if base_rate is None else base_rate


places = click.option(
    "--place",
    "places",
    multiple=True,
    metavar="NAME=X,Y,DEG",
    help="Where the frame of a robot's logs lies in the site, in metres and degrees; once for each "
    "robot. A grid keeps it for what comes of that robot, a log has it in its model.",
)


def settings(command: F) -> F:
    """Add ``--profile``, ``--config``, ``--resolution``, ``--set`` and ``--place``: ``request``."""
    for option in (
        places,
        click.option(
            "--set",
            "overrides",
            multiple=True,
            metavar="KEY=VALUE",
            help="Give one setting; again for more. A robot's: robots.NAME.PARAMETER=VALUE.",
            shell_complete=lambda ctx, param, begun: _settings_like(begun),
        ),
        click.option("--resolution", metavar="M", help="Metres per cell.  [default: 0.05]"),
        click.option("--config", type=EXISTING_FILE, help="A YAML file of settings."),
        click.option(
            "--profile",
            type=click.Choice(["paper", "robust"]),
            help="A shipped set of settings: robust, for any robot that sees walls; or the paper's."
            "  [default: robust]",
        ),
    ):
        command = option(command)
    return command


def _settings_like(begun: str) -> list[str]:
    from possmap.settings.setting_table import KNOWN

    return [f"{name}=" for name in KNOWN if name.startswith(begun)]


def request(
    profile: str | None,
    config: Path | None,
    resolution: str | None,
    overrides: tuple[str, ...],
    places: tuple[str, ...] = (),
) -> Request:
    """Return what the settings options ask for.

    Raises
    ------
    click.UsageError
        For an option whose text is not a setting.
    """
    from possmap.settings.request import Request

    flags = {} if resolution is None else _given("resolution", resolution, "--resolution")
    sets: dict[str, Any] = {}
    for text in overrides:
        sets |= _given(*pair(text), "--set")
    for text in places:
        robot, numbers = place(text)
        for name, number in numbers.items():
            sets |= _given(f"robots.{robot}.{name}", number, "--place")
    return Request(profile, config, flags, sets)


def pair(text: str) -> tuple[str, str]:
    """Return key and value of what stands behind ``--set``.

    Raises
    ------
    click.BadParameter
        If there is no equals sign.
    """
    name, equals, value = text.partition("=")
    if not equals:
        raise click.BadParameter(f"{text!r}, expected KEY=VALUE", param_hint="--set")
    return name.strip(), value.strip()


def place(text: str) -> tuple[str, dict[str, str]]:
    """Return the robot and the parameters of what stands behind ``--place``.

    Raises
    ------
    click.BadParameter
        If it is no name with three numbers.
    """
    from possmap.core.model import FRAME

    robot, _, numbers = text.rpartition("=")
    found = numbers.split(",")
    if not robot or len(found) != 3:
        raise click.BadParameter(f"{text!r}, expected NAME=X,Y,DEG", param_hint="--place")
    return robot.strip(), dict(zip(FRAME, found, strict=True))


def _given(name: str, text: str, origin: str) -> GivenSettings:
    from possmap.errors import SettingsError
    from possmap.settings.setting_table import parse_setting

    try:
        return {name: parse_setting(name, text, origin)}
    except SettingsError as error:
        raise click.UsageError(str(error)) from error


def _window(text: str | None) -> tuple[float, float, float, float] | None:
    if text is None:
        return None
    try:
        x0, y0, x1, y1 = (float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"found {text!r}, expected X0,Y0,X1,Y1 in metres") from None
    if not all(abs(value) <= 1e6 for value in (x0, y0, x1, y1)):
        raise click.BadParameter(f"found {text!r}, expected metres within ±1e6")
    if not (x0 < x1 and y0 < y1):
        raise click.BadParameter(f"found {text!r}, expected X0 < X1 and Y0 < Y1")
    return x0, y0, x1, y1

"""Libraries that only some formats need, imported where they are used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from possmap.errors import OutputError, printable
from possmap.exports.job import Job


def extra(library: str, name: str, job: Job) -> Any:
    """Return a library that comes with an extra of possmap.

    Raises
    ------
    OutputError
        If it is not installed, with the command that installs it, or if it does not work.
    """
    output = printable(str(job.outputs[0]))
    try:
        return import_module(library)
    except ModuleNotFoundError as error:
        if error.name != library:
            raise OutputError(f"{output}: {library} does not work: {error}") from error
        raise OutputError(
            f"{output}: needs {library}, which is not installed: pip install 'possmap[{name}]'"
        ) from None
    except ImportError as error:  # a shared library that is not there, say
        reason = " ".join(str(error).split())
        raise OutputError(f"{output}: {library} does not work: {printable(reason)}") from error

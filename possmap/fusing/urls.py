"""Logs at URLs, by whatever store fsspec knows: ``s3://…``, ``file://…`` (extra ``cluster``)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from possmap.errors import LogError, MissingExtra, printable, shown
from possmap.logs import SUFFIXES, LogFile, encoding_of, read_open
from possmap.settings.limits import Limits

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

TYPICAL_SIZE = 1 << 16
"""Bytes of a log, where nobody has asked."""

_PASSWORD = re.compile(r"(://[^/@:?#]*):[^/?#]*(?=@)")
_SECRET = re.compile(
    r"(?<=[?&])([^=&]*(?:password|secret|token|sig|signature|key|credential))=[^&#]*", re.IGNORECASE
)

_BLOCK = 1 << 20
"""Bytes that a store is asked for at once."""


def is_url(name: str) -> bool:
    """Whether a name is that of a log in a store."""
    return "://" in name


def public(name: str) -> str:
    """Return a name as it may be printed and kept: a URL's without its password, or what is one."""
    if not is_url(name):
        return name
    return _PASSWORD.sub(r"\1", _SECRET.sub(r"\1=...", name))


def expand(url: str) -> Iterator[str]:
    """Yield the logs of a folder by name; of what cannot be one, or has none, the URL itself.

    Raises
    ------
    MissingExtra
        If fsspec is not installed.
    """
    _need_fsspec(url)
    logs: list[str] = []
    if encoding_of(Path(_path_of(url))) is None:
        try:
            store, path = _store_of(url)
            if store.isdir(path):
                found = store.ls(path, detail=False)
                logs = [one for one in found if encoding_of(Path(one)) is not None]
                logs = [store.unstrip_protocol(one) for one in sorted(logs)]
        except Exception:  # every store has errors of its own; reading it says why
            logs = []
    yield from logs or [url]


def read(url: str, limits: Limits, allow_truncated: bool) -> LogFile:
    """Read one log, and of a large one no more than the limit.

    Raises
    ------
    LogError
        If the store does not give it, or it cannot be trusted.
    MissingExtra
        If fsspec is not installed.
    """
    _need_fsspec(url)
    with _blamed(url):
        store, path = _store_of(url)
        about = store.info(path)
        if about.get("type") == "directory":
            expected = f"expected files of {', '.join(SUFFIXES)}"
            raise LogError(public(url), f"the folder holds no logs, {expected}")
        if about.get("type") != "file":
            raise LogError(public(url), "not a regular file")
        size = about.get("size")
        if isinstance(size, int) and size > limits.limit_file_mib * 2**20:
            limit = f"{limits.limit_file_mib:g} MiB"
            raise LogError(public(url), f"larger than {limit} (setting limit_file_mib)")
        with store.open(path, "rb", block_size=_BLOCK) as stream:
            return read_open(public(url), _path_of(path), stream, limits, allow_truncated)


@contextmanager
def _blamed(url: str) -> Iterator[None]:
    """Turn whatever goes wrong in a store into the refusal of its log."""
    try:
        yield
    except (LogError, MemoryError):
        raise
    except Exception as error:  # a store raises what its library does: no class holds them all
        problem = getattr(error, "strerror", None) or str(error) or type(error).__name__
        problem = public(problem.replace(url, public(url)))  # a library may well quote it
        problem = printable(" ".join(problem.split()))[:200]
        raise LogError(public(url), f"cannot be read: {problem}") from error


def _store_of(url: str) -> tuple[AbstractFileSystem, str]:
    from fsspec.core import url_to_fs

    store, path = url_to_fs(url)
    return store, path


def _path_of(url: str) -> str:
    """Return the part of a URL whose suffixes tell the encoding."""
    return urlsplit(url).path if url.startswith(("http://", "https://")) else url


def _need_fsspec(url: str) -> None:
    try:
        import fsspec  # noqa: F401
    except ImportError:
        raise MissingExtra(f"a log at a URL ({shown(public(url))})", "cluster") from None

"""Permission of a person for a file from elsewhere: to run the Python code that it names, or read files outside.

What was allowed is remembered by a hash of what it is, in `allowed.json` in the user's configuration folder, or in the
folder that the environment variable SWIM2REAL_CONFIG names.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from swimbase.errors import ConsentError
from swimbase.store import locked, read_json, write_json

CODE, OUTSIDE = "--allow-code", "--allow-outside"
OPTIONS = (CODE, OUTSIDE)
FOLDER = "SWIM2REAL_CONFIG"  # environment variable
FILE = "allowed.json"
_FORMAT = 1
_LOCK_TIME = 5.0  # s

_options: tuple[str, ...] = ()  # that the present command was given
_marks: set[str] = set()  # what was allowed in this process


@dataclass(frozen=True)
class Request:
    """Something that happens only after a person has allowed it.

    Attributes:
        option: Option that allows it: `CODE` or `OUTSIDE`.
        mark: Hash of all that is allowed, by which it is remembered.
        what: What would happen, as a sentence without its full stop.
    """

    option: str
    mark: str
    what: str


@contextmanager
def allowing(options: Iterable[str]) -> Generator[None]:
    """Allows everything that one of these options allows, within a `with` block."""
    global _options
    before, _options = _options, tuple(options)
    try:
        yield
    finally:
        _options = before


def require(request: Request, *, allowed: bool = False) -> None:
    """Goes on only with what is allowed, now or before.

    Args:
        request: What is to happen.
        allowed: Whether it is allowed now, which is remembered.

    Raises:
        ConsentError: It isn't allowed.
    """
    if allowed or request.option in _options:
        _remember(request)
    elif request.mark in _marks or request.mark in _remembered():
        _marks.add(request.mark)
    else:
        argument = request.option.removeprefix("--").replace("-", "_")
        raise ConsentError(
            f"{request.what}; if you trust it, allow it with {request.option} (in Python: {argument}=True), which is "
            f"remembered until it changes"
        )


def marks() -> tuple[str, ...]:
    """Marks of what this process was allowed, for processes that it gives work."""
    return tuple(_marks)


def trust(marks: Collection[str]) -> None:
    """Allows, in this process, what another process was allowed that gives it work."""
    _marks.update(marks)


def folder() -> Path:
    """Folder that remembers permissions."""
    given = os.environ.get(FOLDER)
    if given:
        return Path(given)
    from platformdirs import user_config_path

    return user_config_path("swim2real", appauthor=False)


def _remember(request: Request) -> None:
    _marks.add(request.mark)
    if request.mark in _remembered():
        return
    try:
        with locked(folder(), _LOCK_TIME):
            entry = {"allowed": datetime.now(UTC).isoformat(timespec="seconds"), "what": request.what}
            write_json(folder() / FILE, {"format": _FORMAT, "allowed": {**_remembered(), request.mark: entry}})
    except OSError:  # then it is asked for again
        return


def _remembered() -> Mapping[str, Any]:
    """Permissions given before, by mark; none if the file is damaged."""
    try:
        content = read_json(folder() / FILE)
    except (OSError, ValueError):
        return {}
    allowed = content.get("allowed") if isinstance(content, dict) and content.get("format") == _FORMAT else None
    return allowed if isinstance(allowed, dict) else {}

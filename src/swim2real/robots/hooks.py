"""Functions that a robot file names: `python:MODULE:NAME`, or `python:FILE.py:NAME` for a file beside it."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swim2real.errors import RobotError
from swim2real.robots.table import Table


def hook(table: Table, key: str, folder: Path) -> Callable[..., Any]:
    """The function that a key names. It is the user's code and runs as such.

    Raises:
        RobotError: It can't be imported or is no function.
    """
    text = table.text(key)
    parts = text.split(":")
    if len(parts) != 3 or parts[0] != "python":
        raise table.wrong(key, text, "must be python:MODULE:FUNCTION or python:FILE.py:FUNCTION")
    module, name = parts[1:]
    try:
        found = getattr(_load(folder / module) if module.endswith(".py") else importlib.import_module(module), name)
    except (ImportError, AttributeError, OSError) as error:
        raise RobotError(f"{table.where}: {key} '{text}' can't be imported: {error}") from error
    if not callable(found):
        raise table.wrong(key, text, "must name a function")
    return found


def _load(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"no Python file '{path}'")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module

"""Functions that a robot file names: `python:MODULE:NAME`, or `python:FILE.py:NAME` for a file beside it."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from swim2real.errors import RobotError
from swim2real.robots.table import Table


def called(table: Table, key: str, folder: Path) -> Any:
    """What the function that a key names returns. It is the user's code and runs as such.

    Raises:
        RobotError: It can't be imported, is no function, or fails.
    """
    function = hook(table, key, folder)
    try:
        return function()
    except Exception as error:
        raise RobotError(f"{table.where}: {key} '{table.text(key)}' failed: {_said(error)}") from error


def hook(table: Table, key: str, folder: Path) -> Callable[..., Any]:
    """The function that a key names.

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
    except Exception as error:  # whatever the user's code does
        raise RobotError(f"{table.where}: {key} '{text}' can't be imported: {_said(error)}") from error
    if not callable(found):
        raise table.wrong(key, text, "must name a function")
    return found


def hook_file(text: str) -> str | None:
    """The file that a hook is in; None for a module, or what is no hook."""
    parts = text.split(":")
    return parts[1] if len(parts) == 3 and parts[0] == "python" and parts[1].endswith(".py") else None


def _load(path: Path) -> Any:
    name = f"swim2real_robot_file.{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"no Python file '{path}'")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"

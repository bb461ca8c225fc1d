"""Tables of a TOML file, read key by key with errors that say where."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swim2real.errors import RobotError


@dataclass(frozen=True)
class Table:
    """A table of a file.

    Attributes:
        content: As read.
        where: File and place, for messages.
    """

    content: Mapping[str, Any]
    where: str

    def allow(self, *keys: str) -> None:
        """Refuses keys that mean nothing.

        Raises:
            RobotError: There is one; names the nearest that does.
        """
        for key in self.content:
            if key not in keys:
                near = difflib.get_close_matches(key, keys, n=1)
                hint = f"did you mean '{near[0]}'? " if near else ""
                raise RobotError(f"{self.where}: '{key}' means nothing here; {hint}there are {', '.join(keys)}")

    def text(self, key: str, default: str | None = None) -> str:
        value = self._get(key, default)
        if not isinstance(value, str) or not value.strip():
            raise self.wrong(key, value, "must be a text")
        return value

    def number(self, key: str, default: float | None = None) -> float:
        value = self._get(key, default)
        if not _finite(value):
            raise self.wrong(key, value, "must be a finite number")
        return float(value)

    def truth(self, key: str, default: bool = False) -> bool:
        value = self.content.get(key, default)
        if not isinstance(value, bool):
            raise self.wrong(key, value, "must be true or false")
        return value

    def one_of(self, key: str, allowed: Sequence[str], default: str) -> str:
        value = self.text(key, default)
        if value not in allowed:
            raise self.wrong(key, value, f"must be one of {', '.join(allowed)}")
        return value

    def texts(self, key: str, count: int | None = None) -> tuple[str, ...]:
        value = self._get(key, None)
        number = "" if count is None else f"{count} "
        if not _texts(value) or (count is not None and len(value) != count):
            raise self.wrong(key, value, f"must be a list of {number}names")
        return tuple(value)

    def numbers(self, key: str, count: int, what: str) -> list[float]:
        value = self._get(key, None)
        if not isinstance(value, list) or len(value) != count or not all(map(_finite, value)):
            raise self.wrong(key, value, f"must be {count} finite numbers, {what}")
        return [float(one) for one in value]

    def table(self, key: str) -> Table:
        """A table within; empty where there is none."""
        value = self.content.get(key, {})
        if not isinstance(value, dict):
            raise self.wrong(key, value, f"must be a table, [{key}]")
        return Table(value, f"{self.where}, [{key}]")

    def list(self, key: str) -> list[Any]:
        """A list; empty where there is none."""
        value = self.content.get(key, [])
        if not isinstance(value, list):
            raise self.wrong(key, value, "must be a list")
        return value

    def wrong(self, key: str, value: Any, allowed: str) -> RobotError:
        """What to raise for a value that isn't allowed."""
        return RobotError(f"{self.where}: {key} is {value!r}; it {allowed}")

    def _get(self, key: str, default: Any) -> Any:
        value = self.content.get(key, default)
        if value is None:
            raise RobotError(f"{self.where}: {key} is missing")
        return value


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _texts(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(one, str) for one in value)


def read_toml(path: Path) -> Table:
    """The whole of a TOML file.

    Raises:
        RobotError: Not there, or not TOML; with line and column.
    """
    try:
        with path.open("rb") as file:
            return Table(tomllib.load(file), f"robot file '{path}'")
    except FileNotFoundError:
        raise RobotError(f"robot file '{path}' is not there; `swim2real init MODEL.xml` writes one") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RobotError(f"robot file '{path}' can't be read as TOML: {error}") from error

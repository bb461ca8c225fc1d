"""Content of files from anywhere: JSON and TOML, of which what no file of ours holds is refused."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterable
from typing import Any, cast

_MOST_DIGITS = 40  # of a whole number; the state of a random stream has 39


def from_json(content: bytes | str) -> Any:
    """Parses a JSON text.

    Raises:
        ValueError: It isn't JSON in UTF-8, or it holds what no file of ours does: a name with two values, numbers
            that aren't finite or have more than 40 digits, or texts with NUL or with half a character. The message
            says what.
    """
    text = content.decode() if isinstance(content, bytes) else content
    try:
        constants: list[str] = []

        def kept(name: str) -> float:
            constants.append(name)
            return float(name)

        found = json.loads(
            text, parse_constant=kept, parse_float=_finite, parse_int=_whole, object_pairs_hook=named_once
        )
        if constants:
            raise ValueError(f"{_place_of_constant(found)} is {constants[0]}; it must be finite")
        if "\\u" in text:
            _check_values(found)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    return found


def from_toml(content: bytes) -> dict[str, Any]:
    """Parses a TOML text.

    Raises:
        ValueError: It isn't TOML in UTF-8, is nested too deeply, or holds a number with more than 40 digits or a text
            with NUL. The message says what.
    """
    try:
        found = tomllib.loads(content.decode())
        _check_values(found)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    return found


def _check_values(content: Any) -> None:
    if isinstance(content, dict):
        for key, value in cast("dict[str, object]", content).items():
            _check_values(key)
            _check_values(value)
    elif isinstance(content, list):
        for value in cast("list[Any]", content):
            _check_values(value)
    elif isinstance(content, str):
        if "\0" in content:
            raise ValueError("a text in it holds a NUL")
        try:
            content.encode()
        except UnicodeEncodeError:
            raise ValueError("a text in it holds half a character, a surrogate by itself") from None
    elif isinstance(content, int) and abs(content) >= 10**_MOST_DIGITS:
        raise ValueError(f"a number in it has more than {_MOST_DIGITS} digits")


def _place_of_constant(content: Any) -> str:
    """Place of the first number that isn't finite, as in `'lens.points[1]'`."""
    place, entry = "", content
    while not isinstance(entry, float):
        entries: Iterable[tuple[Any, Any]] = entry.items() if isinstance(entry, dict) else enumerate(entry)
        key, entry = next(item for item in entries if _holds_constant(item[1]))
        place += f"[{key}]" if isinstance(key, int) else f".{key}" if place else str(key)
    return f"'{place}'" if place else "the number"


def _holds_constant(entry: Any) -> bool:
    if isinstance(entry, dict | list):
        values = cast("dict[str, object]", entry).values() if isinstance(entry, dict) else cast("list[Any]", entry)
        return any(map(_holds_constant, values))
    return isinstance(entry, float) and not math.isfinite(entry)


def named_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The entries of a JSON object, of which Python would take the last of a name and other programs the first.

    Raises:
        ValueError: A name has two values.
    """
    content = dict(pairs)
    for name, value in pairs if len(content) < len(pairs) else []:
        if content[name] != value and not (isinstance(value, float) and math.isnan(value)):
            raise ValueError(f"'{name[:60]}' stands there twice")
    return content


def _finite(digits: str) -> float:
    number = float(digits)
    if not math.isfinite(number):
        raise ValueError(f"{digits[:20]} is no finite number")
    return number


def _whole(digits: str) -> int:
    if len(digits) > _MOST_DIGITS:
        raise ValueError(f"{digits[:20]}… has {len(digits)} digits; at most {_MOST_DIGITS} are read")
    return int(digits)

"""Reads what a VLM or a person answered: strict about numbers, patient with everything around them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from swim2real.errors import AdvisorError
from swim2real.parameters import ParameterSpace
from swim2real.parameters.space import unknown_name

SAME = 1e-3  # relative: a value that is repeated as it was shown, rounded, is no change
_LONGEST_TEXT = 20_000  # characters that are kept of a diagnosis
_MOST_BRACES = 500  # at which a JSON object is looked for
_MANY = 6  # problems that one message lists


class ReplyError(AdvisorError):
    """A reply that no proposal can be made of; the message says why, to whoever wrote it."""


@dataclass(frozen=True)
class Understood:
    """What a usable reply says.

    Attributes:
        values: Of all parameters, within bounds.
        diagnosis: What differs.
        reasoning: Which parameters are responsible.
        ignored: Names that aren't parameters.
        missing: Parameters without a value, which keep theirs.
        clipped: Values out of bounds, as they were given.
    """

    values: dict[str, float]
    diagnosis: str
    reasoning: str
    ignored: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    clipped: Mapping[str, float] = field(default_factory=dict[str, float])

    def notes(self) -> dict[str, Any]:
        """What was mended in silence, ready for JSON."""
        found = {"ignored": list(self.ignored), "missing": list(self.missing), "clipped": dict(self.clipped)}
        return {name: value for name, value in found.items() if value}

    def point(self, space: ParameterSpace, incumbent: NDArray[np.float64]) -> NDArray[np.float64]:
        """In the unit cube; coordinates of parameters that keep their values are the incumbent's own. Shape (d,)."""
        current = space.to_values(incumbent)
        moved = np.array([not is_same(self.values[name], current[name]) for name in space.names])
        return np.where(moved, space.to_cube(self.values), incumbent)


def _joined(value: Any) -> Any:
    """Some answer with a list of sentences."""
    lines: Any = value
    return "\n".join(lines) if isinstance(value, list) and all(isinstance(line, str) for line in lines) else value


Words = Annotated[str, BeforeValidator(_joined)]


class _Answer(BaseModel):
    model_config = ConfigDict(strict=True, extra="ignore")

    diagnosis: Words = ""
    reasoning: Words = ""
    parameters: dict[str, Any]


def reply_schema(space: ParameterSpace, bounds: bool = False) -> dict[str, Any]:
    """JSON schema of a reply.

    Args:
        space: Whose parameters are asked for.
        bounds: Whether it says what a value may be. Services refuse schemas with many bounds.
    """
    numbers: dict[str, Any] = {}
    for one in space:
        limits = {"minimum": one.lower, "maximum": one.upper} if bounds else {}
        numbers[one.name] = {"type": "number", "description": one.unit, **limits}
    words = {"diagnosis": "what differs, seen and measured", "reasoning": "which parameters are responsible, and why"}
    return {
        "type": "object",
        "properties": {
            **{name: {"type": "string", "description": text} for name, text in words.items()},
            "parameters": {
                "type": "object",
                "properties": numbers,
                "required": list(numbers),
                "additionalProperties": False,
            },
        },
        "required": ["diagnosis", "reasoning", "parameters"],
        "additionalProperties": False,
    }


def is_same(value: float, current: float) -> bool:
    """Whether a value only repeats the current one, as rounded as it was shown."""
    return abs(value - current) <= SAME * abs(current)


def understand(text: str, space: ParameterSpace, current: Mapping[str, float]) -> Understood:
    """Makes values of a reply.

    JSON may stand in a fence or among prose. Unknown names are ignored, missing ones (or null) keep their value, values
    out of bounds are clipped; each is noted.

    Args:
        text: The reply.
        space: Names and bounds.
        current: Values of the incumbent.

    Raises:
        ReplyError: No JSON object with parameters, a value that is no finite number, no known name, or no change.
    """
    content = _json_object(text)
    try:
        answer = _Answer.model_validate(content)
    except ValidationError as error:
        raise ReplyError(_fields(error)) from None
    values, clipped, wrong = dict(current), dict[str, float](), list[str]()
    given = {name: value for name, value in answer.parameters.items() if value is not None}
    known = [name for name in space.names if name in given]
    for name in known:
        value, one = given[name], space[name]
        number = _number(value)
        if number is None:
            wrong.append(f"'{name}' is {_short(value)}; it must be a finite number from {one.lower:g} to {one.upper:g}")
            continue
        values[name] = min(max(number, one.lower), one.upper)
        if values[name] != number:
            clipped[name] = number
    ignored = tuple(_tidy(name)[:80] for name in given if name not in space.names)
    if wrong:
        more = f"; and {len(wrong) - _MANY} more" if len(wrong) > _MANY else ""
        raise ReplyError("; ".join(wrong[:_MANY]) + more)
    if not known:
        hint = unknown_name(ignored[0], space.names) if ignored else "'parameters' is empty"
        raise ReplyError(f"no parameter of the simulator has a value: {hint}")
    if all(is_same(values[name], current[name]) for name in space.names):
        raise ReplyError("no parameter changes; propose values that differ from the current ones")
    missing = tuple(name for name in space.names if name not in given)
    return Understood(values, _tidy(answer.diagnosis), _tidy(answer.reasoning), ignored, missing, clipped)


def _json_object(text: str) -> dict[str, Any]:
    """The last JSON object in a text that has parameters, or the only one there is."""
    found: list[dict[str, Any]] = []
    problem = ""
    at = text.find("{")
    for _ in range(_MOST_BRACES):
        if at < 0:
            break
        try:
            content, at = _READER.raw_decode(text, at)
            found.append(content)
        except (ValueError, RecursionError) as error:
            problem = problem or _said(error)
            at += 1
        at = text.find("{", at)
    whole = [one for one in found if "parameters" in one]
    if whole:
        return whole[-1]
    if "{" not in text:
        has = "holds no JSON object" if text.strip() else "is empty"
        raise ReplyError(f"the reply {has}; answer with one that has diagnosis, reasoning and parameters")
    raise ReplyError(f"the reply is not valid JSON: {problem}" if problem else "'parameters' is missing")


def _said(error: ValueError | RecursionError) -> str:
    if isinstance(error, json.JSONDecodeError):
        return f"{error.msg} in line {error.lineno}, column {error.colno}"
    return str(error) if isinstance(error, ValueError) else "it is nested too deep"


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    for name, value in pairs:
        if content[name] != value and not (isinstance(value, float) and math.isnan(value)):
            raise ValueError(f"'{name}' stands there twice")
    return content


_READER = json.JSONDecoder(object_pairs_hook=_without_doubles)


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _fields(error: ValidationError) -> str:
    problems: list[str] = []
    for one in error.errors()[:_MANY]:
        name = ".".join(str(place) for place in one["loc"])
        if one["type"] == "missing":
            problems.append(f"'{name}' is missing")
        else:
            wanted = "an object of names and numbers" if name == "parameters" else "text"
            problems.append(f"'{name}' is {_short(one['input'])}; it must be {wanted}")
    return "; ".join(problems)


def _short(value: Any) -> str:
    text = json.dumps(value) if isinstance(value, str | int | float | bool | None) else f"a {type(value).__name__}"
    return text if len(text) <= 40 else text[:37] + "…"


def _tidy(text: str) -> str:
    """Without what can't be written to a file, and not endless."""
    clean = text.encode("utf-8", "replace").decode("utf-8").replace("\x00", "").strip()
    return clean if len(clean) <= _LONGEST_TEXT else clean[: _LONGEST_TEXT - 1] + "…"

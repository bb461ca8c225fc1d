"""Parses what a VLM or a person answered: strict about numbers, tolerant of everything around them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, Strict, TypeAdapter, ValidationError

from swim2real.formatting import listed
from swim2real.optimizers import Proposal
from swim2real.parameters import ParameterSpace, Values
from swim2real.parameters.space import unknown_name
from swimbase.checking import explained, shown
from swimbase.errors import AdvisorError
from swimbase.parsing import named_once

SOLVED = "solved"  # what a reply may take: the last step that was solved in its turn
SAME = 1e-3  # relative: a value that is repeated as it was shown, rounded, is no change
_LONGEST_TEXT = 20_000  # characters that are kept of a diagnosis
_LONGEST_NAME = 80  # characters that are kept of an unknown name
_MOST_BRACES = 500  # at which a JSON object is looked for
_MOST_PROBLEMS = 6  # that one message lists
_MOST_TRIES = 5  # step sizes of a proposal, and alternatives


class ReplyError(AdvisorError):
    """A reply that no proposal can be made of; the message says why, to whoever wrote it."""


@dataclass(frozen=True)
class _ParsedReply:
    """Content of a usable reply.

    Attributes:
        values: Values of all parameters, within bounds.
        diagnosis: What differs.
        reasoning: Which parameters are responsible.
        ignored: Names that aren't parameters.
        missing: Parameters without a value, which keep theirs.
        clipped: Values out of bounds, as they were given.
        take: What its values begin with, in place of the current ones: `SOLVED`, or the number of a measurement.
        probe: Whether these values are only to be measured, without a line search.
        measure: Parameters that are to be measured, each alone, and the share of its range by which it is changed; None
            for a tenth toward the middle.
        keep: Whether a measured point that is better becomes the current one.
        step_sizes: Shares of the way at which it is to be tried, in order.
        alternatives: What to try where it is rejected, in order.
        predict: Whether these values are only to be predicted.
        solve: Parameters along which a step is to be solved.
        weigh: Weights of trials and parts in such a step.
        radius: By how much each of them may change, as a share of its range; None for the model's own.
        effects: Whether the effects of all parameters are asked for.
    """

    values: dict[str, float]
    diagnosis: str
    reasoning: str
    ignored: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    clipped: Mapping[str, float] = field(default_factory=dict[str, float])
    take: str = ""
    probe: bool = False
    measure: Mapping[str, float | None] = field(default_factory=dict[str, "float | None"])
    keep: bool = False
    step_sizes: tuple[float, ...] = ()
    alternatives: tuple[_ParsedReply, ...] = ()
    predict: bool = False
    solve: tuple[str, ...] = ()
    weigh: Mapping[str, float] = field(default_factory=dict[str, float])
    radius: float | None = None
    effects: bool = False

    @property
    def asks_instruments(self) -> bool:
        """True if something is asked that is answered without an evaluation, before all else."""
        return bool(self.predict or self.solve or self.effects)

    def notes(self) -> dict[str, object]:
        """Corrections made without asking again, ready for JSON."""
        notes: dict[str, object] = {"ignored": list(self.ignored), "missing": list(self.missing)}
        notes |= {"clipped": dict(self.clipped), "take": self.take}
        return {name: content for name, content in notes.items() if content}

    def proposal(self, space: ParameterSpace, incumbent: NDArray[np.float64], notes: Mapping[str, Any]) -> Proposal:
        """Proposal that a search is to try.

        Args:
            space: Parameters of the simulator.
            incumbent: Point of the incumbent. Shape (d,).
            notes: Notes of the proposal.
        """
        others = tuple(one.proposal(space, incumbent, one.notes()) for one in self.alternatives)
        point = self.point(space, incumbent)
        return Proposal(point, self.diagnosis, self.reasoning, notes, self.step_sizes, others)

    def point(self, space: ParameterSpace, incumbent: NDArray[np.float64]) -> NDArray[np.float64]:
        """In the unit cube; coordinates of parameters that keep their values are the incumbent's own. Shape (d,)."""
        current = space.to_values(incumbent)
        moved = np.array([not _is_same(self.values[name], current[name]) for name in space.names])
        return np.where(moved, space.to_cube(self.values), incumbent)


def _join_lines(value: Any) -> Any:
    """Some models answer with a list of sentences."""
    lines: Any = value
    return "\n".join(lines) if isinstance(value, list) and all(isinstance(line, str) for line in lines) else value


Text = Annotated[str, BeforeValidator(_join_lines)]
_NUMBER: TypeAdapter[float] = TypeAdapter(Annotated[float, Strict()])


StepSize = Annotated[float, Field(gt=0, le=1, strict=False)]
Weight = Annotated[float, Field(ge=0, le=1000, strict=False, allow_inf_nan=False)]


class _Try(BaseModel):
    model_config = ConfigDict(strict=True, extra="ignore")

    reasoning: Text = ""
    parameters: dict[str, object] = {}
    step_sizes: Annotated[list[StepSize], Field(max_length=_MOST_TRIES)] | None = None


class _Answer(_Try):
    diagnosis: Text = ""
    take: str | int | None = None
    probe: bool | None = False
    measure: list[str] | None = None
    keep: bool | None = False
    predict: bool | None = False
    solve: list[str] | None = None
    weigh: dict[str, Weight] | None = None
    radius: Annotated[float, Field(gt=0, le=1, strict=False)] | None = None
    effects: bool | None = False
    alternatives: Annotated[list[_Try], Field(max_length=_MOST_TRIES)] | None = None


def reply_schema(space: ParameterSpace, bounds: bool = False, several: bool = False) -> dict[str, object]:
    """JSON schema of a reply.

    Args:
        space: Parameters that are asked for.
        bounds: Whether it says what a value may be. Services refuse schemas with many bounds.
        several: Whether it has step sizes and alternatives.
    """
    numbers: dict[str, object] = {}
    for parameter in space:
        limits = {"minimum": parameter.lower, "maximum": parameter.upper} if bounds else {}
        numbers[parameter.name] = {"type": "number", "description": parameter.unit, **limits}
    texts = {"diagnosis": "what differs, seen and measured", "reasoning": "which parameters are responsible, and why"}
    steps = {"type": "array", "items": {"type": "number"}, "description": "shares of the way to try, in order"}
    properties: dict[str, object] = {name: {"type": "string", "description": text} for name, text in texts.items()}
    properties |= {
        "parameters": _object(numbers),
        "take": {
            "type": "string",
            "description": f"'{SOLVED}': the last solved step, or the number of a measurement of this round, is what "
            "parameters change; mostly empty",
        },
        "probe": {
            "type": "boolean",
            "description": "true: only measure these values, then be asked again; better ones become the current point",
        },
        "measure": {
            "type": "array",
            "items": {"type": "string"},
            "description": "parameters to measure, each changed alone from the current point, as NAME or, by a share "
            "of its range, NAME +0.05; mostly empty",
        },
        "keep": {"type": "boolean", "description": "true: a measured point that is better becomes the current one"},
        "predict": {"type": "boolean", "description": "true: only predict these values, at no cost"},
        "solve": {
            "type": "array",
            "items": {"type": "string"},
            "description": "parameters along which a step is solved, at no cost; ['all'] for all; mostly empty",
        },
        "weigh": _object({})
        | {
            "additionalProperties": {"type": "number"},
            "description": "weights of trials and parts in solve; mostly empty",
        },
        "radius": {"type": ["number", "null"], "description": "share of each range that a solved step may go at most"},
        "effects": {"type": "boolean", "description": "true: show the effects that this run has shown, at no cost"},
    }
    if several:
        properties["step_sizes"] = steps
        another = {"reasoning": properties["reasoning"], "parameters": _object(numbers), "step_sizes": steps}
        properties["alternatives"] = {"type": "array", "items": _object(another)}
    return _object(properties)


def _object(properties: Mapping[str, object]) -> dict[str, object]:
    return {"type": "object", "properties": properties, "required": list(properties), "additionalProperties": False}


def _is_same(value: float, current: float) -> bool:
    """True if a value only repeats the current one, as rounded as it was shown."""
    return abs(value - current) <= SAME * abs(current)


def parse_reply(
    text: str, space: ParameterSpace, current: Mapping[str, float], offered: Mapping[str, Values] = MappingProxyType({})
) -> _ParsedReply:  # fmt: skip
    """Makes parameter values of a reply.

    JSON may stand in a fence or among prose. Unknown names are ignored, missing ones (or null) keep their value, values
    out of bounds are clipped; each is noted.

    Args:
        text: Text of the reply.
        space: Names and bounds of the parameters.
        current: Values of the incumbent.
        offered: Values that `take` may name: those of the solved step and of this round's measurements.

    Raises:
        ReplyError: No JSON object with parameters, a value that is no finite number, no known name, or no change.
    """
    content = _json_object(text)
    try:
        answer = _Answer.model_validate(content)
    except ValidationError as error:
        raise ReplyError(_listed([explained(detail) for detail in error.errors(include_url=False)])) from None
    texts = _cleaned(answer.diagnosis), _cleaned(answer.reasoning)
    predict, effects = bool(answer.predict), bool(answer.effects)
    solve, weigh = _names(answer.solve or [], space, "solve"), dict(answer.weigh or {})
    if not predict and (solve or effects):
        return _ParsedReply(dict(current), *texts, solve=solve, weigh=weigh, radius=answer.radius, effects=effects)
    if not predict and answer.measure:
        return _ParsedReply(dict(current), *texts, measure=_changes(answer.measure, space), keep=bool(answer.keep))
    others = tuple(
        _tried(one, ("", _cleaned(one.reasoning)), space, current, current) for one in answer.alternatives or ()
    )
    take = str(answer.take or "").strip()
    if take and take not in offered:
        known = listed([f"'{name}'" for name in offered], len(offered))
        allowed = f"it may be {known}" if known else "no step was solved in this turn and nothing measured in its round"
        raise ReplyError(f"'take' is {shown(take)}; {allowed}")
    begun = offered[take] if take else current
    tried = _tried(answer, texts, space, current, begun)
    proposed = replace(tried, take=take, probe=bool(answer.probe), alternatives=others)
    return replace(proposed, predict=predict, solve=solve, weigh=weigh, radius=answer.radius, effects=effects)


def _changes(given: Sequence[str], space: ParameterSpace) -> dict[str, float | None]:
    """Parameters that are to be measured, each with the share of its range by which it is changed.

    Raises:
        ReplyError: One isn't a parameter, or a change is no share.
    """
    split = [one.split() for one in given]
    names = _names([one[0] if one else "" for one in split], space, "measure")
    if len(names) != len(split):  # all of them
        return dict.fromkeys(names)
    changes: dict[str, float | None] = {}
    for name, (_, *change) in zip(names, split, strict=True):
        number = _share(change[0]) if change else None
        if change and (number is None or not 0 < abs(number) <= 1 or len(change) > 1):
            raise ReplyError(
                f"'measure' changes '{name}' by {shown(' '.join(change))}; it must be a share of its range from -1 to "
                f"1 other than 0, such as '{name} +0.05'"
            )
        changes[name] = number
    return changes


def _share(text: str) -> float | None:
    try:
        return _number(float(text))
    except ValueError:
        return None


def _names(given: Sequence[str], space: ParameterSpace, field_name: str) -> tuple[str, ...]:
    """Parameters that a list names, each once; `all` stands for all.

    Raises:
        ReplyError: One isn't a parameter.
    """
    names = tuple(dict.fromkeys(space.names if "all" in given and "all" not in space.names else given))
    for name in names:
        if name not in space.names:
            raise ReplyError(f"'{field_name}' names no parameter of the simulator: {unknown_name(name, space.names)}")
    return names


def _tried(
    answer: _Try, texts: tuple[str, str], space: ParameterSpace, current: Mapping[str, float],
    begun: Mapping[str, float],
) -> _ParsedReply:  # fmt: skip
    """The values of one proposal, which changes those that it has begun with."""
    given = {name: value for name, value in answer.parameters.items() if value is not None}
    values, clipped, problems = dict(begun), dict[str, float](), list[str]()
    for parameter in space:
        name = parameter.name
        if name not in given:
            continue
        number = _number(given[name])
        if number is None:
            allowed = f"it must be a finite number from {parameter.lower:g} to {parameter.upper:g}"
            problems.append(f"'{name}' is {shown(given[name])}; {allowed}")
            continue
        values[name] = min(max(number, parameter.lower), parameter.upper)
        if values[name] != number:
            clipped[name] = number
    if problems:
        raise ReplyError(_listed(problems))
    ignored = tuple(_cleaned(name)[:_LONGEST_NAME] for name in given if name not in space.names)
    missing = tuple(name for name in space.names if name not in given) if begun is current else ()
    if len(missing) == len(space):
        hint = unknown_name(ignored[0], space.names) if ignored else "'parameters' is empty"
        raise ReplyError(f"no parameter of the simulator has a value: {hint}")
    if all(_is_same(values[name], current[name]) for name in space.names):
        raise ReplyError("no parameter changes; propose values that differ from the current ones")
    sizes = tuple(answer.step_sizes or ())
    return _ParsedReply(values, *texts, ignored, missing, clipped, step_sizes=sizes)


def _json_object(text: str) -> dict[str, object]:
    """The last JSON object in a text that has parameters."""
    objects: list[dict[str, object]] = []
    problem = ""
    at = text.find("{")
    for _ in range(_MOST_BRACES):
        if at < 0:
            break
        try:
            content, at = _DECODER.raw_decode(text, at)
            objects.append(content)
        except json.JSONDecodeError as error:
            problem = problem or f"{error.msg} in line {error.lineno}, column {error.colno}"
            at += 1
        except (ValueError, RecursionError) as error:
            problem = problem or (str(error) if isinstance(error, ValueError) else "it is nested too deeply")
            at += 1
        at = text.find("{", at)
    usable = [content for content in objects if content.keys() & {"parameters", "measure", "solve", "effects", "take"}]
    if usable:
        return usable[-1]
    if "{" not in text:
        state = "holds no JSON object" if text.strip() else "is empty"
        raise ReplyError(f"the reply {state}; answer with one that has diagnosis, reasoning and parameters")
    raise ReplyError(f"the reply is not valid JSON: {problem}" if problem else "'parameters' is missing")


_DECODER = json.JSONDecoder(object_pairs_hook=named_once)


def _number(value: Any) -> float | None:
    try:
        number = _NUMBER.validate_python(value)
    except (ValidationError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _listed(problems: list[str]) -> str:
    more = f"; and {len(problems) - _MOST_PROBLEMS} more" if len(problems) > _MOST_PROBLEMS else ""
    return "; ".join(problems[:_MOST_PROBLEMS]) + more


def _cleaned(text: str) -> str:
    """Text without what can't be written to a file, and of limited length."""
    clean = text.encode("utf-8", "replace").decode("utf-8").replace("\x00", "").strip()
    return clean if len(clean) <= _LONGEST_TEXT else clean[: _LONGEST_TEXT - 1] + "…"

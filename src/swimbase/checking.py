"""Checks of content from outside against a model; an error is said in one sentence.

A model is a pydantic model or a dataclass. The sentence names the key, its value, what is allowed, and what to do.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, Field, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from swimbase.errors import Swim2RealError
from swimbase.names import file_name_fault, label_fault, quoted
from swimbase.store import read_json


def _without(fault_of: Callable[[str], str | None]) -> AfterValidator:
    """Refuses texts that have a fault."""

    def checked(text: str) -> str:
        fault = fault_of(text)
        if fault is not None:
            raise ValueError(f"{quoted(text)} {fault}")
        return text

    return AfterValidator(checked)


Model = TypeVar("Model")
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number; a text or a truth value isn't one."""
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
"""A finite number above 0."""
Label = Annotated[str, _without(label_fault)]
"""A name that is only shown, or a unit: a line of characters that are seen."""
FileName = Annotated[str, _without(file_name_fault)]
"""A name that a file can have on every system."""


def _checked_path(path: str) -> str:
    longest = max((len(part.encode()) for part in path.replace("\\", "/").split("/")), default=0)
    if longest > _LONGEST_NAME or len(path) > _LONGEST_PATH:
        raise ValueError(f"it has {len(path)} characters; a path has names of at most {_LONGEST_NAME}")
    return path


PathText = Annotated[str, AfterValidator(_checked_path)]
"""A path that a system takes, whether something is there or not."""

_LONGEST = 60  # characters of a value that are shown
_LONGEST_NAME, _LONGEST_PATH = 255, 3000  # bytes of a file's name, characters of a path
_ALLOWED = {
    "missing": "it must be given",
    "int_type": "it must be a whole number",
    "int_parsing": "it must be a whole number",
    "int_from_float": "it must be a whole number",
    "float_type": "it must be a number",
    "float_parsing": "it must be a number",
    "finite_number": "it must be finite",
    "string_type": "it must be a text",
    "bool_type": "it must be true or false",
    "bool_parsing": "it must be true or false",
    "list_type": "it must be a list",
    "tuple_type": "it must be a list",
    "dict_type": "it must be a table of names and values",
    "model_type": "it must be a table of names and values",
    "dataclass_type": "it must be a table of names and values",
}


@cache
def _adapter(model: Any) -> TypeAdapter[Any]:
    return TypeAdapter(model)


def check(model: type[Model], content: Any, what: str, error: type[Swim2RealError], remedy: str = "") -> Model:
    """Content as an object of a model.

    Args:
        model: What is allowed.
        content: Plain lists, dictionaries, texts and numbers, as JSON or TOML has them.
        what: The thing that is checked, such as "camera file 'pool.json'".
        error: Type of the error that is raised.
        remedy: What to do, without a full stop; empty where the sentence says it already.

    Raises:
        Swim2RealError: Something isn't allowed; the error has the type `error` and names the first such thing.
    """
    try:
        return _adapter(model).validate_python(content)
    except ValidationError as failure:
        details, unknown = failure.errors(include_url=False), ("extra_forbidden", "unexpected_keyword_argument")
        # a key that isn't known tells more than the one that it should have been, which is missing
        detail = next((detail for detail in details if detail["type"] in unknown), details[0])
        sentence = explained(detail)
        if detail["type"] in unknown:
            sentence += did_you_mean(str(detail["loc"][-1]), _field_names(model))
        raise error(f"{what}: {sentence}" + (f"; {remedy}" if remedy else "")) from None


def read(model: type[Model], path: str | Path, what: str, error: type[Swim2RealError], remedy: str = "") -> Model:
    """A JSON file as an object of a model.

    Args:
        model: What is allowed.
        path: Path of the file.
        what: What the file is, such as "camera file"; its path is added.
        error: Type of the error that is raised.
        remedy: As for `check`.

    Raises:
        Swim2RealError: The file isn't there, isn't readable, is no JSON, or isn't as the model has it; the error has
            the type `error`.
    """
    named, end = f"{what} '{path}'", f"; {remedy}" if remedy else ""
    try:
        content = read_json(path)
    except FileNotFoundError:
        raise error(f"{named} is not there{end}") from None
    except (OSError, ValueError) as failure:
        reason = (isinstance(failure, OSError) and failure.strerror) or failure
        raise error(f"{named} can't be read as JSON: {reason}{end}") from failure
    return check(model, content, named, error, remedy)


def explained(detail: ErrorDetails) -> str:
    """One finding of pydantic in words: the key, its value, what is allowed."""
    kind, context = detail["type"], detail.get("ctx", {})
    place = _key_path(detail["loc"])
    if kind == "missing":
        return f"'{place}' is missing; it must be given"
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        return f"there is no '{place}'; remove it or correct its name"
    if kind in ("value_error", "assertion_error"):
        reason = str(context.get("error", detail["msg"]))
        return f"'{place}': {reason}" if place else reason
    value = shown(detail["input"])
    return f"'{place}' is {value}; {_allowed(kind, context, detail['msg'])}" if place else f"{value}: {detail['msg']}"


def _key_path(location: Sequence[str | int]) -> str:
    """Place in nested tables and lists, such as `markers.M0[1]`.

    Names in angle brackets are left out: tags of a union's members.
    """
    path = ""
    for key in location:
        if isinstance(key, str) and key.startswith("<"):
            continue
        name = key if isinstance(key, int) or len(key) <= _LONGEST else f"{key[: _LONGEST - 1]}…"
        path += f"[{name}]" if isinstance(name, int) else f".{name}" if path else name
    return path


def shown(value: Any) -> str:
    """A value as JSON would have it, cut off where it gets long."""
    try:
        text = json.dumps(value, ensure_ascii=False)
    except (TypeError, ValueError):
        text = repr(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def did_you_mean(name: str, known: Sequence[str]) -> str:
    """A hint at the known name that is nearest to one that isn't known; empty where none is near."""
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


def _field_names(model: Any) -> list[str]:
    """Names of the fields of a pydantic model and of the models within it; none of anything else."""
    if isinstance(model, type) and issubclass(model, BaseModel):
        within = [_field_names(field.annotation) for field in model.model_fields.values()]
        return [*model.model_fields, *chain.from_iterable(within)]
    return list(chain.from_iterable(_field_names(part) for part in get_args(model)))


def _allowed(kind: str, context: Mapping[str, Any], message: str) -> str:
    if kind in _ALLOWED:
        return _ALLOWED[kind]
    match kind:
        case "literal_error" | "enum":
            return f"it must be {context['expected']}"
        case "greater_than":
            return f"it must be above {context['gt']:g}"
        case "greater_than_equal":
            return f"it must be at least {context['ge']:g}"
        case "less_than":
            return f"it must be below {context['lt']:g}"
        case "less_than_equal":
            return f"it must be at most {context['le']:g}"
        case "too_short":
            return f"it must have at least {context['min_length']} entries"
        case "too_long":
            return f"it must have at most {context['max_length']} entries"
        case _:
            return message[:1].lower() + message[1:]

"""Who takes part in a comparison: from a name such as `line-search@google:MODEL` to the settings that it stands for."""

from __future__ import annotations

import difflib
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

from swim2real.errors import ArgumentError
from swim2real.pipeline.methods import ADVISED
from swim2real.robots.robot import Robot
from swim2real.settings import METHODS, Method, Scale, check_advisor

ABLATION = "no-line-search"
NAMES: tuple[str, ...] = (*METHODS, ABLATION)
_NOT_IN_TABLES = ("mujoco-sysid", "warm-start")
SCALES = ("auto", "log", "linear")


@dataclass(frozen=True)
class Contestant:
    """A method with its advisor and scale.

    Attributes:
        name: As on the command line, without its scale: a method, or `METHOD@ADVISOR`.
        method: Of the run's settings.
        advisor: Likewise.
        max_steps: Likewise.
        scale: Of the parameters; None takes the protocol's.
    """

    name: str
    method: Method
    advisor: str = "physics"
    max_steps: int = 3
    scale: Scale | None = None

    def as_dict(self) -> dict[str, Any]:
        return {"name": self.name, "scale": self.scale}

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Contestant:
        return replace(contestant(content["name"]), scale=content["scale"])

    def label(self, own_scale: Scale) -> str:
        """What it is called under a protocol with a scale of its own."""
        return self.name if self.scale in (None, own_scale) else f"{self.name}+{self.scale}"


def table_methods(robot: Robot) -> tuple[str, ...]:
    """Of the paper's table, and more, but for stages where nobody has planned any for the robot."""
    left_out = _NOT_IN_TABLES if robot.trials.fit_plan is not None else (*_NOT_IN_TABLES, "staged")
    return tuple(name for name in NAMES if name not in left_out)


def contestant(name: str) -> Contestant:
    """The contestant of a name: `METHOD`, `METHOD@ADVISOR`, and either with `+log` or `+linear`.

    Raises:
        ArgumentError: There is none.
    """
    whole, scale = name, None
    for one in SCALES[1:]:
        if name.endswith(f"+{one}"):
            whole, scale = name.removesuffix(f"+{one}"), one
    method, at, advisor = whole.partition("@")
    if method not in NAMES:
        near = difflib.get_close_matches(method, NAMES, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        raise ArgumentError(f"there is no method '{method}'; there are {_all()}{hint}")
    settings = "line-search" if method == ABLATION else cast("Method", method)
    if at and settings not in ADVISED:
        raise ArgumentError(f"method {method} has no advisor; write '{method}' without '@{advisor}'")
    if at:
        check_advisor(advisor)
        if advisor == "files":
            raise ArgumentError(
                "advisor 'files' waits for a person, and the runs of a comparison for nobody; "
                "use `swim2real calibrate --advisor files`, then '@replay:RUN' here"
            )
    if advisor == "physics":  # one name for one thing
        whole = method
    return Contestant(whole, settings, advisor or "physics", 1 if method == ABLATION else 3, scale)


def contestants(names: Sequence[str], scales: Sequence[str] = ("auto",)) -> tuple[Contestant, ...]:
    """Every named contestant on every scale, each once.

    Raises:
        ArgumentError: A name or scale is unknown, or there is none.
    """
    unknown = next((one for one in scales if one not in SCALES), None)
    if unknown is not None:
        raise ArgumentError(f"there is no scale '{unknown}'; there are {', '.join(SCALES)}")
    if not names or not scales:
        raise ArgumentError(f"a comparison needs a method and a scale; there are {_all()} and {', '.join(SCALES)}")
    found: dict[Contestant, None] = {}
    for name in names:
        one = contestant(name)
        for scale in scales:
            chosen = one.scale or (None if scale == "auto" else cast("Scale", scale))
            found[replace(one, scale=chosen)] = None
    return tuple(found)


def folder_name(label: str) -> str:
    """A label as the name of a folder; no two labels have the same."""
    plain = re.sub(r"[^A-Za-z0-9._@+=-]", "_", label.replace(":", "="))
    if plain == label.replace(":", "=") and len(plain) <= 80:
        return plain
    return f"{plain[:80]}-{hashlib.sha256(label.encode()).hexdigest()[:6]}"


def _all() -> str:
    advised = [name for name in NAMES if name in (*ADVISED, ABLATION)]
    return f"{', '.join(NAMES)}, and with another advisor {', '.join(f'{name}@ADVISOR' for name in advised)}"

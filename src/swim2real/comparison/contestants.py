"""Who takes part in a comparison: from a name such as `line-search@google:MODEL` to the settings that it stands for."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

from swim2real.checking import did_you_mean
from swim2real.errors import ArgumentError
from swim2real.names import quoted
from swim2real.pipeline.methods import METHODS
from swim2real.robots.robot import Robot
from swim2real.settings import Method, Scale, check_advisor

ABLATION = "no-line-search"
NAMES: tuple[str, ...] = (*METHODS, ABLATION)
SCALES = ("auto", "log", "linear")
_LONGEST = 1000  # characters of a name; an advisor may be the path of a run


@dataclass(frozen=True)
class Contestant:
    """A method with its advisor and scale.

    Attributes:
        name: Name without the scale: `METHOD`, or `METHOD@ADVISOR`.
        scale: Scale of the parameters; None takes the protocol's.
    """

    name: str
    scale: Scale | None = None

    def __post_init__(self) -> None:
        method, at, advisor = self.name.partition("@")
        if method not in NAMES or len(self.name) > _LONGEST:
            raise ArgumentError(
                f"there is no method {quoted(self.name if method in NAMES else method)}; "
                f"there are {_all_methods()}{did_you_mean(method, NAMES)}"
            )
        if at and not METHODS[self.method].advised:
            raise ArgumentError(f"method {method} has no advisor; write '{method}' without '@{advisor}'")
        if at:
            check_advisor(advisor)
        if advisor == "files":
            raise ArgumentError(
                "advisor 'files' waits for a person, and the runs of a comparison for nobody; "
                "use `swim2real calibrate --advisor files`, then '@replay:RUN' here"
            )

    @property
    def method(self) -> Method:
        """Method in the settings of a run."""
        method = self.name.partition("@")[0]
        return "line-search" if method == ABLATION else cast("Method", method)

    @property
    def advisor(self) -> str:
        """Advisor in the settings of a run."""
        return self.name.partition("@")[2] or "physics"

    @property
    def max_steps(self) -> int:
        """Steps of the line search in the settings of a run."""
        return 1 if self.name.partition("@")[0] == ABLATION else 3

    def label(self, protocol_scale: Scale) -> str:
        """What it is called in tables: its name, with the scale where that isn't the protocol's."""
        return self.name if self.scale in (None, protocol_scale) else f"{self.name}+{self.scale}"


def contestant(name: str) -> Contestant:
    """The contestant of a name: `METHOD`, `METHOD@ADVISOR`, and either with `+log` or `+linear`.

    Raises:
        ArgumentError: There is none.
    """
    scale: Scale | None = None
    if name.endswith(("+log", "+linear")):
        name, _, ending = name.rpartition("+")
        scale = cast("Scale", ending)
    named = Contestant(name, scale)
    return replace(named, name=name.removesuffix("@physics"))  # which is the advisor where none is named


def contestants(names: Sequence[str], scales: Sequence[str] = ("auto",)) -> tuple[Contestant, ...]:
    """Every named contestant on every scale, each once.

    Raises:
        ArgumentError: A name or scale is unknown, or there is none.
    """
    unknown = next((scale for scale in scales if scale not in SCALES), None)
    if unknown is not None:
        raise ArgumentError(f"there is no scale '{unknown}'; there are {', '.join(SCALES)}")
    if not names or not scales:
        raise ArgumentError(
            f"a comparison needs a method and a scale; there are {_all_methods()} and {', '.join(SCALES)}"
        )
    chosen: dict[Contestant, None] = {}
    for named in map(contestant, names):
        for scale in scales:
            own_scale = named.scale or (None if scale == "auto" else cast("Scale", scale))
            chosen[replace(named, scale=own_scale)] = None
    return tuple(chosen)


def table_methods(robot: Robot) -> tuple[str, ...]:
    """Names of the methods that are compared by default: without stages for a robot that has no plan of them."""
    left_out = {name for name, method in METHODS.items() if not method.by_default}
    if robot.trials.fit_plan is None:
        left_out.add("staged")
    return tuple(name for name in NAMES if name not in left_out)


def folder_name(label: str) -> str:
    """A label as the name of a folder; no two labels have the same."""
    plain = re.sub(r"[^A-Za-z0-9._@+=-]", "_", label.replace(":", "="))
    if plain == label.replace(":", "=") and len(plain) <= 80:
        return plain
    return f"{plain[:80]}-{hashlib.sha256(label.encode()).hexdigest()[:6]}"


def _all_methods() -> str:
    advised = [*(name for name, method in METHODS.items() if method.advised), ABLATION]
    return f"{', '.join(NAMES)}, and with another advisor {', '.join(f'{name}@ADVISOR' for name in advised)}"

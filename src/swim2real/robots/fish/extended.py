"""The fish with more physics than the paper's 16 parameters: robot `fish-extended`.

An extra parameter changes the spec of the plain fish; at its published value it changes nothing, so the published
extended fish is the published fish, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.parameters import Parameter, ParameterSpace, Values
from swim2real.robots.fish.fish import FISH
from swim2real.robots.fish.parameters import FISH_SPACE
from swim2real.robots.fish.response import fish_response
from swim2real.robots.robot import Response, Robot

Array = NDArray[np.float64]

FRICTION = "surface_friction"
DRAG = 20.0  # N s²/m², of random fish within a factor of about two (experiments/model_structure.py drag)


@dataclass(frozen=True)
class Extra:
    """A parameter beyond the 16.

    Attributes:
        parameter: Its published value is the one at which the fish is the plain one.
        write: Changes the plain fish's spec. Not called at the published value.
    """

    parameter: Parameter
    write: Callable[[mujoco.MjSpec, float], None]


@dataclass(frozen=True)
class ExtendedResponse:
    """The plain fish's response, slowed by a dry friction; of other extra parameters it expects nothing.

    Thrust and drag balance at v |v| = T / D; a friction F leaves v |v| = (T - F) / D, and no motion where T is smaller.

    Attributes:
        plain: Response to the 16.
        friction: Column of the friction among the values [N]; None where there is none.
    """

    plain: Response
    friction: int | None

    def speeds(self, points: Array, values: Array, frequencies: Array) -> Array:
        plain = self.plain.speeds(_sixteen(points), _sixteen(values), frequencies)
        left = np.maximum(plain**2 - self._loss(values), 0.0)
        return np.sign(plain) * np.sqrt(left)

    def reserve(self, values: Array) -> Array:
        return self.plain.reserve(_sixteen(values))

    def adapted(self, points: Array, values: Array, speeds: Array, frequencies: Array) -> ExtendedResponse:
        without = np.sign(speeds) * np.sqrt(speeds**2 + self._loss(values))
        return replace(self, plain=self.plain.adapted(_sixteen(points), _sixteen(values), without, frequencies))

    def beats(self, points: Array, frequencies: Array) -> Array:
        return self.plain.beats(_sixteen(points), frequencies)

    def _loss(self, values: Array) -> Array:
        """By how much friction lowers the squared speed [m²/s²]. Shape (N, 1)."""
        force = 0.0 if self.friction is None else values[:, self.friction]
        return np.broadcast_to(force / DRAG, len(values))[:, None]


def extended(name: str, extras: Sequence[Extra]) -> Robot:
    """The fish with extra parameters behind its 16.

    Args:
        name: Of the robot.
        extras: In the order of their parameters.
    """
    space = ParameterSpace((*FISH_SPACE, *(extra.parameter for extra in extras)))

    def build(values: Values) -> mujoco.MjSpec:
        checked = space.check(values)
        spec = FISH.build({parameter: checked[parameter] for parameter in FISH_SPACE.names})
        for extra in extras:
            value = checked[extra.parameter.name]
            if value != extra.parameter.published:
                extra.write(spec, value)
        return spec

    friction = space.names.index(FRICTION) if FRICTION in space.names else None
    swims = replace(FISH.swims, response=ExtendedResponse(fish_response(), friction))
    return replace(FISH, name=name, space=space, build=build, trials=swims)


def _sixteen(table: Array) -> Array:
    return table[:, : len(FISH_SPACE)]


def _write_surface_friction(spec: mujoco.MjSpec, force: float) -> None:
    for name in FISH.swims.surge_joints:
        spec.joint(name).frictionloss = force


SURFACE_FRICTION = Extra(
    Parameter(
        FRICTION, "N", 0.0, 0.05,
        "Dry friction of the floating head at the water's surface, the same force at any speed: it slows the fish at "
        "low frequencies, where thrust is weak, and hardly at high ones.",
        0.0, log_offset=0.002,
    ),
    _write_surface_friction,
)  # fmt: skip

FISH_EXTENDED = extended("fish-extended", (SURFACE_FRICTION,))

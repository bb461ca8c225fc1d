"""Candidates of what resists a motion: springs, dampers, friction and inertia of joints and tendons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from swim2real.robots.attributes import attribute
from swim2real.robots.drafting.candidate import Candidate, around, base_name, grouped, line, names, rounded

_ABSENT = "the model has none"
_LOG_SHARE = 1e-3  # of an upper bound, as the offset of a scale that begins at 0
_TURN, _SLIDE = "turn", "slide"


@dataclass(frozen=True)
class _Resistance:
    """One of the attributes.

    Attributes:
        units: Of what turns and of what slides.
        most: Upper bound where the model has none, by the inertia [kg m² or kg]: of what turns and of what slides.
        usual: Whether it is calibrated where the model has none.
        meaning: What more of it does.
    """

    units: dict[str, str]
    most: dict[str, float]
    usual: bool
    meaning: str


_JOINT = {
    # motion dies within 50 ms
    "damping": _Resistance(
        {_TURN: "N·m·s/rad", _SLIDE: "N·s/m"}, {_TURN: 20.0, _SLIDE: 20.0}, True,
        "Damping of {who}, which resists speed: more of it makes swings smaller and shorter."
    ),
    # two swings a second
    "stiffness": _Resistance(
        {_TURN: "N·m/rad", _SLIDE: "N/m"}, {_TURN: (4 * math.pi) ** 2, _SLIDE: (4 * math.pi) ** 2}, False,
        "Stiffness of {who}, which pulls back to rest: more of it bends less and swings faster."
    ),
    "frictionloss": _Resistance(
        {_TURN: "N·m", _SLIDE: "N"}, {_TURN: 20.0, _SLIDE: 2.0}, False,
        "Dry friction of {who}, the same at any speed: more of it stops small and slow motion."
    ),
    "armature": _Resistance(
        {_TURN: "kg·m²", _SLIDE: "kg"}, {_TURN: 1.0, _SLIDE: 1.0}, False,
        "Inertia of motor and gears at {who}: more of it takes longer to speed up and to stop."
    ),
}  # fmt: skip
_TENDON = {key: _JOINT[key] for key in ("stiffness", "damping", "frictionloss")}


def joints(spec: mujoco.MjSpec, model: mujoco.MjModel) -> Iterator[Candidate]:
    """Of the joints that turn or slide; a free one has no resistance of its own."""
    there = [joint for joint in spec.joints if joint.type != mujoco.mjtJoint.mjJNT_FREE and not _set_together(joint)]

    def inertia(joint: Any) -> float:
        return float(model.dof_M0[model.joint(joint.name).dofadr[0]])

    for name, about in _JOINT.items():
        for (value, turns), members in grouped(there, lambda joint, name=name: (_read(joint, name), _turns(joint))):
            way = _TURN if turns else _SLIDE
            carries = any(carrying(model, model.joint(joint.name).id) for joint in members)
            yield _candidate("joint", name, about, way, value, members, max(map(inertia, members)), not carries)


def tendons(spec: mujoco.MjSpec, model: mujoco.MjModel) -> Iterator[Candidate]:
    """Of the tendons."""

    def inertia(tendon: Any) -> float:
        inverse = float(model.tendon_invweight0[model.tendon(tendon.name).id])
        return 1.0 / inverse if inverse > 0 else 1.0

    for name, about in _TENDON.items():
        for value, members in grouped(spec.tendons, lambda tendon, name=name: _read(tendon, name)):
            yield _candidate("tendon", name, about, _SLIDE, value, members, max(map(inertia, members)), False)


def carrying(model: mujoco.MjModel, joint: int) -> bool:
    """Whether a joint stands for a robot's freedom to go anywhere: it is on a body that slides through the world."""
    body = model.jnt_bodyid[joint]
    on_body = [j for j in range(model.njnt) if model.jnt_bodyid[j] == body]
    return bool(model.body_parentid[body] == 0 and sum(_glides(model, j) for j in on_body) > 1)


def _glides(model: mujoco.MjModel, joint: int) -> bool:
    held = np.ravel(model.jnt_stiffness[joint])[0] or model.jnt_limited[joint]
    return bool(not held and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE)


def _candidate(
    kind: str, name: str, about: _Resistance, way: str, value: float, members: Sequence[Any], inertia: float,
    usual: bool,
) -> Candidate:  # fmt: skip
    who = f"{kind} {members[0].name}" if len(members) == 1 else f"{kind}s {members[0].name} to {members[-1].name}"
    aside, offset = None, 0.0
    if value > 0:
        lower, upper = around(value)
    else:
        lower, upper = 0.0, rounded(about.most[way] * inertia, digits=1)
        offset = _LOG_SHARE * upper
        aside = None if usual and about.usual else _ABSENT
    return Candidate(
        f"{base_name(kind, members)}_{name}", kind, about.units[way], lower, upper, offset,
        about.meaning.format(who=who), (line(kind, members, name),), group=names(members), aside=aside,
    )  # fmt: skip


def _read(element: Any, name: str) -> float:
    found = attribute(element, name)
    return 0.0 if found is None else found.read(0)


def _turns(joint: Any) -> bool:
    return joint.type != mujoco.mjtJoint.mjJNT_SLIDE


def _set_together(joint: Any) -> bool:
    """Whether springdamper sets what is written to stiffness and damping."""
    return bool(np.all(joint.springdamper > 0))

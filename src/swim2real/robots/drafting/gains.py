"""Candidates of actuators: gains of servos, strength of motors, time constants."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from swim2real.robots.attributes import attribute
from swim2real.robots.drafting.candidate import SPREAD, Candidate, around, base_name, grouped, line, names

_FILTERS = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
_MEANINGS = {
    "kp": "Gain of the position servo {who}: more of it follows its command more stiffly.",
    "kv": "Gain of {who} on speed: more of it follows a commanded speed more stiffly, or damps a position servo.",
    "gear": "Strength of {who}: how much force or torque its command makes, by the model's.",
    "gain": "Strength of {who}: how much force or torque its command makes, by the model's.",
    "return": "Pull of {who} against its own length or angle, by the model's.",
    "braking": "Pull of {who} against its own speed, by the model's.",
    "time_constant": "Time that {who} takes to follow its command.",
}


def actuators(spec: mujoco.MjSpec) -> Iterator[Candidate]:
    """Of the named actuators. Those of muscles and other laws of their own are left to a person."""
    slides = {joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_SLIDE}
    slides |= {tendon.name for tendon in spec.tendons}
    for own, members in grouped(spec.actuators, _law):
        unit = "N/m" if members[0].target in slides else "N·m/rad"
        for name, attr, value in own:
            yield _candidate(members, name, attr, value, unit)


def _law(actuator: Any) -> tuple[tuple[str, str, float | None], ...]:
    """What can be calibrated of an actuator: its name, where it is, and its value; None multiplies the model's own."""
    found: list[tuple[str, str, float | None]] = []
    gains = {name: attribute(actuator, name) for name in ("kp", "kv")}
    if any(gains.values()):
        values = {name: numbers.read(0) for name, numbers in gains.items() if numbers is not None}
        found += [(name, name, value) for name, value in values.items() if value > 0]
    elif actuator.gaintype in (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE):
        if not np.any(actuator.gainprm[1:3]) and actuator.gainprm[0] == 1 and np.count_nonzero(actuator.gear) == 1:
            found.append(("gear", f"gear[{int(np.flatnonzero(actuator.gear)[0])}]", None))
        else:
            found += [("gain", f"gainprm[{i}]", None) for i in range(3) if actuator.gainprm[i]]
        if actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE:
            named = ((1, "return"), (2, "braking"))
            found += [(name, f"biasprm[{i}]", None) for i, name in named if actuator.biasprm[i]]
    if actuator.dyntype in _FILTERS and actuator.dynprm[0] > 0:
        found.append(("time_constant", "dynprm[0]", float(actuator.dynprm[0])))
    return tuple(found)


def _candidate(members: tuple[Any, ...], name: str, attr: str, value: float | None, unit: str) -> Candidate:
    who = f"actuator {members[0].name}"
    if len(members) > 1:
        who = f"actuators {members[0].name} to {members[-1].name}"
    lower, upper = (1 / SPREAD, SPREAD) if value is None else around(value)
    units = {"kp": unit, "kv": unit.replace("/", "·s/"), "time_constant": "s"}
    return Candidate(
        f"{base_name('actuator', members)}_{name}", "actuator", units.get(name, "-"), lower, upper, 0.0,
        _MEANINGS[name].format(who=who), (line("actuator", members, attr),), relative=value is None,
        group=names(members),
    )  # fmt: skip

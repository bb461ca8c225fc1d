"""Candidates for the parameters of an MJCF model's first robot file: resistances, gains, fluid coefficients, masses."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from typing import Any, TypeVar

import mujoco
import numpy as np

from swim2real.robots.targets import attribute, class_name

T = TypeVar("T", bound=Hashable)

_SPREAD = 5.0  # by which bounds lie below and above a value
_TWINS = re.compile(r"\d+|left|right", re.IGNORECASE)


@dataclass(frozen=True)
class Candidate:
    """A parameter that a robot file may have.

    Attributes:
        name: Name that it gets unless another candidate has it.
        kind: Kind of element, to tell it from another candidate of this name.
        unit: SI unit.
        lower: Smallest value [unit].
        upper: Largest value [unit].
        log_offset: Offset of its logarithmic scale [unit].
        meaning: What a larger value does.
        target: Line of the places that it sets.
        relative: Whether it multiplies what the model has.
        group: Names of several elements that it sets alike; empty for a single element.
        aside: Why it is only suggested, in a comment; None where it is calibrated.
    """

    name: str
    kind: str
    unit: str
    lower: float
    upper: float
    log_offset: float
    meaning: str
    target: str
    relative: bool = False
    group: tuple[str, ...] = ()
    aside: str | None = None


def candidates(spec: mujoco.MjSpec, model: mujoco.MjModel) -> dict[str, Candidate]:
    """All candidates of a model, each under a name of its own."""
    named: dict[str, Candidate] = {}
    every = (*_joints(spec, model), *_tendons(spec, model), *_actuators(spec), *_fluid(spec), *_masses(spec))
    for candidate in every:
        own = candidate.name if candidate.name.startswith(candidate.kind) else f"{candidate.kind}_{candidate.name}"
        names = chain((candidate.name, own), (f"{own}_{i}" for i in count(2)))
        named[next(name for name in names if name not in named)] = candidate
    return named


_NO_RESISTANCE = "the model has none"
_NO_MOTOR = "no motor and no gears are there"
_LOG_SHARE = 1e-3  # of an upper bound, as the offset of a scale that begins at 0
_FAR = 4.0  # times the model's size: a slide with such a range holds nothing
_TURN, _SLIDE = "turn", "slide"


@dataclass(frozen=True)
class _Resistance:
    """One of the attributes.

    Attributes:
        units: Units for what turns and for what slides.
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


def _joints(spec: mujoco.MjSpec, model: mujoco.MjModel) -> Iterator[Candidate]:
    """Candidates of the joints that turn or slide; a free one has no resistance of its own."""
    there = [joint for joint in spec.joints if joint.type != mujoco.mjtJoint.mjJNT_FREE]

    def inertia(joint: Any) -> float:
        return float(model.dof_M0[model.joint(joint.name).dofadr[0]])

    for name, about in _JOINT.items():
        for (value, turns), members in _grouped(there, lambda joint, name=name: (_read(joint, name), _turns(joint))):
            way = _TURN if turns else _SLIDE
            numbers = [model.joint(joint.name).id for joint in members]
            carries = any(carrying(model, number) for number in numbers)
            found = _resistance("joint", name, about, way, value, members, max(map(inertia, members)), not carries)
            idle = name == "armature" and not any(_driven(model, number) for number in numbers)
            yield replace(found, aside=_NO_MOTOR) if idle else found


def _tendons(spec: mujoco.MjSpec, model: mujoco.MjModel) -> Iterator[Candidate]:
    """Candidates of the tendons."""

    def inertia(tendon: Any) -> float:
        inverse = float(model.tendon_invweight0[model.tendon(tendon.name).id])
        return 1.0 / inverse if inverse > 0 else 1.0

    for name, about in _TENDON.items():
        for value, members in _grouped(spec.tendons, lambda tendon, name=name: _read(tendon, name)):
            yield _resistance("tendon", name, about, _SLIDE, value, members, max(map(inertia, members)), False)


def carrying(model: mujoco.MjModel, joint: int) -> bool:
    """True if a joint stands for a robot's freedom to go anywhere: it is on a body that slides through the world."""
    body = model.jnt_bodyid[joint]
    on_body = [j for j in range(model.njnt) if model.jnt_bodyid[j] == body]
    return bool(model.body_parentid[body] == 0 and sum(_glides(model, j) for j in on_body) > 1)


def _driven(model: mujoco.MjModel, joint: int) -> bool:
    """True if an actuator moves a joint, or may by a tendon or a crank."""
    at_joints = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    kinds, ends = model.actuator_trntype, model.actuator_trnid[:, 0]
    return any(kind not in at_joints or end == joint for kind, end in zip(kinds, ends, strict=True))


def _glides(model: mujoco.MjModel, joint: int) -> bool:
    limited = model.jnt_limited[joint] and np.ptp(model.jnt_range[joint]) < _FAR * model.stat.extent
    held = np.ravel(model.jnt_stiffness[joint])[0] or limited
    return bool(not held and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE)


def _resistance(
    kind: str, name: str, about: _Resistance, way: str, value: float, members: Sequence[Any], inertia: float,
    usual: bool,
) -> Candidate:  # fmt: skip
    who = f"{kind} {members[0].name}" if len(members) == 1 else f"{kind}s {members[0].name} to {members[-1].name}"
    aside, offset = None, 0.0
    if value > 0:
        lower, upper = _around(value)
    else:
        lower, upper = 0.0, _rounded(about.most[way] * inertia, digits=1)
        offset = _LOG_SHARE * upper
        aside = None if usual and about.usual else _NO_RESISTANCE
    return Candidate(
        f"{_base_name(kind, members)}_{name}", kind, about.units[way], lower, upper, offset,
        about.meaning.format(who=who), _line(kind, members, name), group=_names(members), aside=aside,
    )  # fmt: skip


def _read(element: Any, name: str) -> float:
    numbers = attribute(element, name)
    return 0.0 if numbers is None else numbers.read(0)


def _turns(joint: Any) -> bool:
    return joint.type != mujoco.mjtJoint.mjJNT_SLIDE


_FILTERS = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
_GAIN_MEANINGS = {
    "kp": "Gain of the position servo {who}: more of it follows its command more stiffly.",
    "kv": "Gain of {who} on speed: more of it follows a commanded speed more stiffly, or damps a position servo.",
    "gear": "Strength of {who}: how much force or torque its command makes, by the model's.",
    "gain": "Strength of {who}: how much force or torque its command makes, by the model's.",
    "return": "Pull of {who} against its own length or angle, by the model's.",
    "braking": "Pull of {who} against its own speed, by the model's.",
    "time_constant": "Time that {who} takes to follow its command.",
}


def _actuators(spec: mujoco.MjSpec) -> Iterator[Candidate]:
    """Candidates of the named actuators. Those of muscles and other laws of their own are left to a person."""
    slides = {joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_SLIDE}
    slides |= {tendon.name for tendon in spec.tendons}
    for own, members in _grouped(spec.actuators, _gains_of):
        unit = "N/m" if members[0].target in slides else "N·m/rad"
        for name, attr, value in own:
            yield _gain(members, name, attr, value, unit)


def _gains_of(actuator: Any) -> tuple[tuple[str, str, float | None], ...]:
    """Gains of an actuator that can be calibrated: name, place, and value; None multiplies the model's own."""
    laws: list[tuple[str, str, float | None]] = []
    gains = {name: attribute(actuator, name) for name in ("kp", "kv")}
    if any(gains.values()):
        values = {name: numbers.read(0) for name, numbers in gains.items() if numbers is not None}
        laws += [(name, name, value) for name, value in values.items() if value > 0]
    elif actuator.gaintype in (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE):
        if not np.any(actuator.gainprm[1:3]) and actuator.gainprm[0] == 1 and np.count_nonzero(actuator.gear) == 1:
            laws.append(("gear", f"gear[{int(np.flatnonzero(actuator.gear)[0])}]", None))
        else:
            laws += [("gain", f"gainprm[{i}]", None) for i in range(3) if actuator.gainprm[i]]
        if actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE:
            named = ((1, "return"), (2, "braking"))
            laws += [(name, f"biasprm[{i}]", None) for i, name in named if actuator.biasprm[i]]
    if actuator.dyntype in _FILTERS and actuator.dynprm[0] > 0:
        laws.append(("time_constant", "dynprm[0]", float(actuator.dynprm[0])))
    return tuple(laws)


def _gain(members: tuple[Any, ...], name: str, attr: str, value: float | None, unit: str) -> Candidate:
    who = f"actuator {members[0].name}"
    if len(members) > 1:
        who = f"actuators {members[0].name} to {members[-1].name}"
    lower, upper = (1 / _SPREAD, _SPREAD) if value is None else _around(value)
    units = {"kp": unit, "kv": unit.replace("/", "·s/"), "time_constant": "s"}
    return Candidate(
        f"{_base_name('actuator', members)}_{name}", "actuator", units.get(name, "-"), lower, upper, 0.0,
        _GAIN_MEANINGS[name].format(who=who), _line("actuator", members, attr), relative=value is None,
        group=_names(members),
    )  # fmt: skip


_COEFFICIENTS = (
    ("blunt_drag", "Drag of every wet part against motion along its broad faces; more of it slows what is pushed."),
    ("slender_drag", "Drag along slender directions, skin-like; more of it slows what glides."),
    ("angular_drag", "Resistance to rotation in the fluid; more of it damps turning."),
    ("kutta_lift", "Lift of plates at an angle of attack; more of it pushes a beating fin harder."),
    ("magnus_lift", "Lift of parts that rotate while they translate."),
)
_FLUID_MOST, _FLUID_OFFSET = 10.0, 0.1
_DRY = "option density is 0, so there is no fluid"
_KNOWN = "it is known for most fluids: water has 1000 kg/m³ and 0.001 Pa·s, air 1.2 kg/m³ and 2e-5 Pa·s"


def _fluid(spec: mujoco.MjSpec) -> Iterator[Candidate]:
    """Candidates of a model in a fluid, or of one with ellipsoids that could be in one."""
    wet = [geom for geom in spec.geoms if geom.fluid_ellipsoid]
    if wet:
        yield from _ellipsoids(spec, wet)
    for name, unit, meaning in (
        ("density", "kg/m³", "Density of the fluid: forces that grow with the square of the speed."),
        ("viscosity", "Pa·s", "Viscosity of the fluid: forces that grow with the speed."),
    ):
        value = float(getattr(spec.option, name))
        if value > 0:
            bounds = _around(value)
            aside = _KNOWN if wet else None
            yield Candidate(f"fluid_{name}", "option", unit, *bounds, 0.0, meaning, f"option {name}", aside=aside)


def _ellipsoids(spec: mujoco.MjSpec, wet: list[Any]) -> Iterator[Candidate]:
    place = _place(wet)
    for i, (name, meaning) in enumerate(_COEFFICIENTS):
        values = {_coefficient(geom, i) for geom in wet}
        relative, absent = len(values) > 1, values == {0.0}
        lower, upper = (1 / _SPREAD, _SPREAD) if relative else (0.0, _FLUID_MOST) if absent else _around(min(values))
        aside = "the model has none" if absent else _DRY if spec.option.density == 0 else None
        yield Candidate(
            f"fluid_{name}", "geom", "-", lower, upper, _FLUID_OFFSET if absent else 0.0, meaning,
            f"{place} fluidcoef[{i}]", relative, aside=aside,
        )  # fmt: skip


def _coefficient(geom: Any, index: int) -> float:
    numbers = attribute(geom, "fluidcoef")
    return 0.0 if numbers is None else numbers.read(index)


def _place(wet: list[Any]) -> str:
    """The wet geoms by their names, or by their classes where some have none: coefficients of dry ones don't count."""
    if all(geom.name for geom in wet):
        return _line("geom", wet, "").rstrip()
    classes = dict.fromkeys(class_name(geom) for geom in wet)
    return f"geom class {', '.join(map(_quoted, classes))}"


_WEIGH = "a mass is better weighed than calibrated"
_MASS_SPREAD = 2.0


def _masses(spec: mujoco.MjSpec) -> Iterator[Candidate]:
    """Of bodies with an <inertial>, and of the geoms of others."""
    from_geoms = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    bodies = [body for body in spec.bodies if body.explicitinertial and not from_geoms]
    moving = [geom for geom in spec.geoms if geom.parent.name != "world"]
    geoms = [geom for geom in moving if not geom.parent.explicitinertial or from_geoms]
    for mass, members in _grouped(bodies, lambda body: float(body.mass)):
        yield from _mass("body", "mass", "kg", mass, members)
    for mass, members in _grouped([geom for geom in geoms if np.isfinite(geom.mass)], lambda geom: float(geom.mass)):
        yield from _mass("geom", "mass", "kg", mass, members)
    dense = [geom for geom in geoms if geom.name and not np.isfinite(geom.mass)]
    for density in dict.fromkeys(float(geom.density) for geom in dense):
        members = tuple(geom for geom in dense if geom.density == density)
        yield from _mass("geom", "density", "kg/m³", density, members, "geom")


def _mass(
    kind: str, name: str, unit: str, value: float, members: tuple[Any, ...], base: str = ""
) -> Iterator[Candidate]:
    if value > 0:
        yield Candidate(
            f"{base or _base_name(kind, members)}_{name}", kind, unit, *_around(value, _MASS_SPREAD), 0.0,
            f"{name.capitalize()} of {kind} {', '.join(member.name for member in members)}.",
            _line(kind, members, name), group=_names(members), aside=_WEIGH,
        )  # fmt: skip


def _grouped(elements: Sequence[Any], value: Callable[[Any], T]) -> list[tuple[T, tuple[Any, ...]]]:
    """Named elements whose names differ in numbers and sides only, and whose values are the same."""
    groups: dict[tuple[str, T], list[Any]] = {}
    for element in elements:
        if element.name:
            groups.setdefault((_TWINS.sub("#", element.name), value(element)), []).append(element)
    return [(own, tuple(members)) for (_, own), members in groups.items()]


def _base_name(kind: str, members: Sequence[Any]) -> str:
    """Name of one element, or of several that differ in numbers and sides."""
    name = members[0].name if len(members) == 1 else _TWINS.sub("", members[0].name)
    return re.sub(r"\W+|_+", "_", name).strip("_").lower() or kind


def _line(kind: str, members: Sequence[Any], attribute: str) -> str:
    """Line that writes to elements."""
    return f"{kind} {', '.join(_quoted(member.name) for member in members)} {attribute}"


def _names(members: Sequence[Any]) -> tuple[str, ...]:
    """Candidates of a group; none for a single element."""
    return tuple(member.name for member in members) if len(members) > 1 else ()


def _quoted(name: str) -> str:
    """A name as a line has it."""
    return f'"{name}"'


def _around(value: float, spread: float = _SPREAD) -> tuple[float, float]:
    """Bounds below and above a value above 0."""
    return _rounded(value / spread, math.floor), _rounded(value * spread, math.ceil)


def _rounded(value: float, by: Callable[[float], int] = round, digits: int = 2) -> float:
    """A number above 0 with few digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return float(f"{by(round(value / step, 6)) * step:.{digits}g}")

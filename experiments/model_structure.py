"""Model structure: which physics beyond the paper's 16 parameters explains the real swims better, on trials left out.

    python experiments/model_structure.py fit none hull-mass+slide-damping --reference tracks --start runs/words
    python experiments/model_structure.py leave-out none hull-mass --reference tracks --start runs/words
    python experiments/model_structure.py table

Every fit is CMA-ES on the whole motion from the same 16 values, with the extra parameters off their neutral ones, and
has the same budget: `none`, which the others are compared with, has the 16 alone; `a+b` has two more. `leave-out` fits
to all trials but one, for each, and judges on that one. The 16 begin at a fit to all trials there too, in every
structure alike: compare left-out errors between structures, they are no absolute measure. Every fit is a file of its
own; a fit that is there isn't done again. The same command gives the same numbers.
"""

import argparse
import json
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from floor import FIGURES, beginning, descend, table_row

from swim2real.calibration import Problem
from swim2real.parameters import Parameter, ParameterSpace, read_parameters
from swim2real.robots.fish import FISH
from swim2real.trials import load_reference

SIGMA, SEED = 0.03, 0
BUDGET = {"fit": 600, "leave-out": 200}  # evaluations


def fluid_scale(bodies, coefficients):
    """Multiplies fluid coefficients of some bodies' geoms."""

    def write(spec, factor):
        for geom in spec.geoms:
            if geom.fluid_ellipsoid and geom.parent.name in bodies:
                scaled = np.array(geom.fluid_coefs)
                scaled[list(coefficients)] *= factor
                geom.fluid_coefs = scaled

    return write


def set_joints(field, *names):
    def write(spec, value):
        for name in names:
            joint = spec.joint(name)
            if np.ndim(getattr(joint, field)):
                getattr(joint, field)[0] = value
            else:
                setattr(joint, field, value)

    return write


def set_tendons(field):
    def write(spec, value):
        for tendon in spec.tendons:
            if np.ndim(getattr(tendon, field)):
                getattr(tendon, field)[0] = value
            else:
                setattr(tendon, field, value)

    return write


def pull_only(spec, slack):
    rest = spec.compile().tendon_length0
    for tendon, length in zip(spec.tendons, rest, strict=True):
        tendon.springlength = [0.0, length + slack]


def viscosity(spec, value):
    spec.option.viscosity = value


class AddedMass:
    """A spec whose model has its added mass scaled: the engine computes it from the geoms' sizes."""

    def __init__(self, spec, factor):
        self.spec, self.factor = spec, factor

    def compile(self) -> mujoco.MjModel:
        model = self.spec.compile()
        model.geom_fluid[:, 6:12] *= self.factor
        return model


WATERS = {"water_front": 0.0, "water_rear": 0.2005}  # m, along the hull


def waves_mass(spec, mass):
    """Masses of water beside the hull's two halves, which it drags along sideways: `waves_damping` couples them."""
    hull = spec.body("fish")
    for name, x in WATERS.items():
        body = hull.add_body(name=name, pos=[x, 0, 0])
        joint = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 1, 0])
        joint.damping[0] = 10.0
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.002, 0, 0], mass=mass, contype=0, conaffinity=0)
        geom.fluid_ellipsoid, geom.fluid_coefs = 1, [0.0] * 5


def hull_mass(spec, factor):
    """Water that the hull accelerates sideways, as mass of its two plates."""
    for x, mass in ((0.0, 1.21), (0.2005, 1.34)):
        spec.body("fish").add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[0.002, 0, 0],
            pos=[x, 0, 0],
            mass=factor * mass,
            contype=0,
            conaffinity=0,
        )


@dataclass(frozen=True)
class Extra:
    """A parameter beyond the 16: at its published value it writes nothing and the fish is the plain one."""

    parameter: Parameter
    write: Callable


def extended(name, extras):
    """The fish with extra parameters behind its 16, in order."""
    space = ParameterSpace((*FISH.space, *(extra.parameter for extra in extras)), "log")

    def build(values):
        checked = space.check(values)
        spec = FISH.build({parameter: checked[parameter] for parameter in FISH.space.names})
        for extra in extras:
            value = checked[extra.parameter.name]
            if value != extra.parameter.published:
                extra.write(spec, value)
        return spec

    trials = replace(FISH.swims, response=None)
    return replace(FISH, name=name, space=space, build=build, trials=trials)


def extra(name, unit, lower, upper, neutral, write, log_offset=None):
    return Extra(Parameter(name, unit, lower, upper, "", neutral, log_offset), write)


SLIDES, TAIL = ("slide_x", "slide_y"), tuple(f"tail{i}" for i in range(5))
# pull_only is a structure whatever its slack: it has no neutral value
EXTRAS = {
    "friction": extra("surface_friction", "N", 0.0, 0.05, 0.0, set_joints("frictionloss", *SLIDES), 0.002),
    "viscosity": extra("viscosity", "Pa·s", 0.00013, 0.13, 0.0013, viscosity, 0.0),
    "slide-damping": extra("slide_damping", "N·s/m", 0.0, 8.0, 0.0, set_joints("damping", *SLIDES), 0.1),
    "tail-friction": extra("tail_friction", "N·m", 0.0, 0.1, 0.0, set_joints("frictionloss", *TAIL), 0.002),
    "pull-only": extra("tendon_slack", "m", 0.0, 0.006, -1.0, pull_only),
    "tendon-damping": extra("tendon_damping", "N·s/m", 2.0, 100.0, 10.0, set_tendons("damping"), 0.0),
    "tendon-stiffness": extra("tendon_stiffness", "N/m", 200.0, 20000.0, 20000.0, set_tendons("stiffness"), 0.0),
    "added-mass": extra("added_mass_scale", "-", 0.0, 3.0, 1.0, None),
    "sway-inertia": extra("sway_inertia", "kg", 0.0, 5.0, 0.0, set_joints("armature", "slide_y"), 0.1),
    "yaw-inertia": extra("yaw_inertia", "kg·m²", 0.0, 0.1, 0.0, set_joints("armature", "hinge_z"), 0.002),
    "hull-mass": extra("hull_mass", "-", 0.05, 8.0, 0.05, hull_mass, 0.0),
    "roll-stiffness": extra("roll_stiffness", "N·m/rad", 0.05, 10.0, 10.0, set_joints("stiffness", "hinge_x"), 0.0),
    "roll-damping": extra("roll_damping", "N·m·s/rad", 0.001, 1.0, 1.0, set_joints("damping", "hinge_x"), 0.0),
    "body-kutta": extra("body_kutta_scale", "-", 0.05, 50.0, 1.0, fluid_scale(("fish", "motor"), (3,)), 0.0),
    "body-magnus": extra("body_magnus_scale", "-", 0.02, 10.0, 1.0, fluid_scale(("fish", "motor"), (4,)), 0.0),
    "body-blunt": extra("body_blunt_scale", "-", 0.02, 20.0, 1.0, fluid_scale(("fish", "motor"), (0,)), 0.0),
    "body-slender": extra("body_slender_scale", "-", 0.05, 10.0, 1.0, fluid_scale(("fish", "motor"), (1,)), 0.0),
    "wave-mass": extra("wave_mass", "kg", 0.05, 10.0, 0.05, waves_mass, 0.0),
    "wave-damping": extra("wave_damping", "N·s/m", 0.2, 60.0, 0.2, set_joints("damping", *WATERS), 0.0),
    "body-drag": extra("body_drag_scale", "-", 0.2, 5.0, 1.0, fluid_scale(("fish", "motor"), (0, 1)), 0.0),
    "body-angular": extra("body_angular_scale", "-", 0.1, 20.0, 1.0, fluid_scale(("fish", "motor"), (2,)), 0.0),
    "body-lift": extra("body_lift_scale", "-", 0.1, 5.0, 1.0, fluid_scale(("fish", "motor"), (3, 4)), 0.0),
    "fin-lift": extra("fin_lift_scale", "-", 0.2, 5.0, 1.0, fluid_scale(("tail4",), (3,)), 0.0),
}


def robot_of(structure):
    """The fish with the extra parameters of a structure such as `friction+viscosity`."""
    if structure == "none":
        return replace(FISH, space=replace(FISH.space, scale="log"))
    names = structure.split("+")
    robot = extended(f"fish, {structure}", [EXTRAS[name] for name in names if name != "added-mass"])
    if "added-mass" not in names:
        return robot
    plain, parameter = robot, EXTRAS["added-mass"].parameter
    space = replace(plain.space, parameters=(*plain.space, parameter))
    return replace(
        plain, space=space,
        build=lambda v: AddedMass(plain.build({n: v[n] for n in plain.space.names}), v[parameter.name]),
    )  # fmt: skip


def kept(path, make):
    """The content of a JSON file, made where it isn't there."""
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(json.dumps(make(), indent=1))
        part.replace(path)
    return json.loads(path.read_text())


def one_fit(structure, left_out, a):
    """Fits a structure to all trials, or to all but one, from the start's 16 values."""
    fitted, unseen = load_reference(a.reference).split((left_out,) if left_out else ())
    robot = robot_of(structure)
    start = beginning(robot.space, read_parameters(a.start, FISH.name, FISH.space).values)
    problem = Problem(robot, fitted, threads=1)
    _, point = descend(problem, start, BUDGET[a.what], SIGMA, SEED)
    values = robot.space.to_values(point)
    judged = {"fit": problem.evaluate(values).figures()}
    if unseen is not None:
        judged["left_out"] = problem.of(unseen).evaluate(values).figures()
    return {"structure": structure, "left_out_trial": left_out, "values": values, **judged}


def done(job):
    structure, left_out, a = job
    return kept(a.out / f"{structure}-{left_out or 'all'}.json", lambda: one_fit(structure, left_out, a))


def table(a):
    print("| structure | " + " | ".join(FIGURES) + " |\n|" + "---|" * (1 + len(FIGURES)))
    fits = [json.loads(path.read_text()) for path in sorted(a.out.glob("*.json"))]
    for structure in dict.fromkeys(fit["structure"] for fit in fits):
        own = [fit for fit in fits if fit["structure"] == structure]
        for fit in own:
            if "left_out" not in fit:
                extras = {name: value for name, value in fit["values"].items() if name not in FISH.space.names}
                said = ", ".join(f"{name} {value:.3g}" for name, value in extras.items())
                print(table_row(f"{structure} {said}", fit["fit"]))
        out = [fit["left_out"] for fit in own if "left_out" in fit]
        if out:
            medians = {name: float(np.median([figures[name] for figures in out])) for name in FIGURES}
            print(table_row(f"{structure}, {len(out)} trials left out one by one, median", medians))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("fit", "leave-out", "table"))
    parser.add_argument("structures", nargs="*", default=[])
    parser.add_argument("--reference", type=Path)
    parser.add_argument("--start", type=Path, help="parameters file or run folder of the fish")
    parser.add_argument("--out", type=Path, default=Path("runs/structure"))
    parser.add_argument("--workers", type=int, default=2)
    a = parser.parse_args()
    if a.what == "table":
        return table(a)
    left_out = [None] if a.what == "fit" else [trial.name for trial in load_reference(a.reference)]
    with ProcessPoolExecutor(a.workers) as team:
        list(team.map(done, [(structure, name, a) for structure in a.structures for name in left_out]))
    return table(a)


if __name__ == "__main__":
    main()

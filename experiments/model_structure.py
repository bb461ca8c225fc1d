"""Model structure: which physics beyond the paper's 16 parameters explains the real swims better, on trials left out.

    python experiments/model_structure.py fit none friction viscosity --reference tracks --start runs/floor/best.json
    python experiments/model_structure.py leave-out none friction --reference tracks --start runs/floor/best.json
    python experiments/model_structure.py table
    python experiments/model_structure.py drag

Every fit begins where a long calibration of the 16 (experiments/floor.py) has ended, with the extra parameters at two
values off their neutral ones in turn, and has the same budget: `none`, which the others are compared with, goes on
with the 16 alone; `a+b` has two. `leave-out` fits to all trials but one, for each, and judges on that one. The 16
begin at a fit to all trials there too, in every structure alike: compare left-out errors between structures, they are
no absolute measure. `drag` measures what the response of `fish-extended` takes for drag. Every fit is a file of its
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
from scipy.optimize import lsq_linear

from swim2real.calibration import Problem
from swim2real.parameters import Parameter, ParameterSpace, read_parameters
from swim2real.robots.fish import FISH, FISH_EXTENDED
from swim2real.robots.fish.response import ExtendedResponse, fish_response
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, load_reference

SEED = 0
BUDGET = {"fit": 200, "leave-out": 150}  # evaluations
STEP, TRUST = 0.02, 0.3  # of the differences, and the most that a parameter moves in a step, in the cube
SOFT = 2e-3  # m, below which an error counts as a square
DAMPINGS = (0.1, 1.0, 10.0)  # that a round tries, times the last best one
LEAST_GAIN = 0.01  # of the loss, by a round; after less the slopes are measured again
AWAY = (0.15, 0.5), (-0.2, 0.2), (-0.15, -0.5)  # from a neutral value that is low, between or high, in the cube
FINALISTS, REPEATS, HAIR = 4, 4, 1e-6  # judged again, so often, so far apart in the cube
FRICTION_NAME = "surface_friction"
FRICTION = 0.02  # N, by which drag is measured
FIGURES = ("aligned_marker_error", "shape_error", "velocity_error")


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


@dataclass(frozen=True)
class Extra:
    """A parameter beyond the 16: at its published value it writes nothing and the fish is the plain one."""

    parameter: Parameter
    write: Callable


def extended(name, extras):
    """The fish with extra parameters behind its 16, in order."""
    space = ParameterSpace((*FISH.space, *(extra.parameter for extra in extras)))

    def build(values):
        checked = space.check(values)
        spec = FISH.build({parameter: checked[parameter] for parameter in FISH.space.names})
        for extra in extras:
            value = checked[extra.parameter.name]
            if value != extra.parameter.published:
                extra.write(spec, value)
        return spec

    friction = space.names.index(FRICTION_NAME) if FRICTION_NAME in space.names else None
    swims = replace(FISH.swims, response=ExtendedResponse(fish_response(), friction))
    return replace(FISH, name=name, space=space, build=build, trials=swims)


def extra(name, unit, lower, upper, neutral, write, log_offset=None):
    return Extra(Parameter(name, unit, lower, upper, "", neutral, log_offset), write)


SLIDES, TAIL = ("slide_x", "slide_y"), tuple(f"tail{i}" for i in range(5))
# pull_only is a structure whatever its slack: it has no neutral value
EXTRAS = {
    "friction": extra(FRICTION_NAME, "N", 0.0, 0.05, 0.0, set_joints("frictionloss", *SLIDES), 0.002),
    "viscosity": extra("viscosity", "Pa·s", 0.00013, 0.13, 0.0013, viscosity, 0.0),
    "slide-damping": extra("slide_damping", "N·s/m", 0.0, 1.0, 0.0, set_joints("damping", *SLIDES), 0.02),
    "tail-friction": extra("tail_friction", "N·m", 0.0, 0.1, 0.0, set_joints("frictionloss", *TAIL), 0.002),
    "pull-only": extra("tendon_slack", "m", 0.0, 0.006, -1.0, pull_only),
    "tendon-damping": extra("tendon_damping", "N·s/m", 2.0, 100.0, 10.0, set_tendons("damping"), 0.0),
    "tendon-stiffness": extra("tendon_stiffness", "N/m", 200.0, 20000.0, 20000.0, set_tendons("stiffness"), 0.0),
    "added-mass": extra("added_mass_scale", "-", 0.0, 3.0, 1.0, None),
    "sway-inertia": extra("sway_inertia", "kg", 0.0, 5.0, 0.0, set_joints("armature", "slide_y"), 0.1),
    "yaw-inertia": extra("yaw_inertia", "kg·m²", 0.0, 0.1, 0.0, set_joints("armature", "hinge_z"), 0.002),
    "body-drag": extra("body_drag_scale", "-", 0.2, 5.0, 1.0, fluid_scale(("fish", "motor"), (0, 1)), 0.0),
    "fin-lift": extra("fin_lift_scale", "-", 0.2, 5.0, 1.0, fluid_scale(("tail4",), (3,)), 0.0),
}


def robot_of(structure):
    """The fish with the extra parameters of a structure such as `friction+viscosity`."""
    if structure == "none":
        return FISH
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


def repeated(problem, point):
    """Figures of a point, as means over a few that lie a hair beside it, and the loss's spread among them.

    A stiff model jitters: rounding errors grow, and one evaluation tells little about the next.
    """
    space, rng = problem.robot.space, np.random.default_rng(SEED)
    points = [np.clip(point + HAIR * rng.standard_normal(len(point)), 0, 1) for _ in range(REPEATS)]
    found = problem.evaluate_many([space.to_values(p) for p in points])
    means = {name: float(np.mean([c.figure(name) for c in found])) for name in FIGURES}
    per_trial = {
        t.name: [float(np.mean([c.trials[i].figures()[name] for c in found])) for name in FIGURES]
        for i, t in enumerate(found[0].trials)
    }
    return {**means, "spread": float(np.std([c.loss for c in found])), "trials": per_trial}


def residual_and_scale(comparison):
    """The comparison's residual vector (squares add up to the mean square), and lengths of its errors [m]."""
    scale = []
    for trial in comparison.trials:
        lengths = np.linalg.norm(np.nan_to_num(trial.residual), axis=2)
        scale.append(np.repeat(np.where(trial.weights > 0, lengths, 0.0).ravel() + SOFT, 2))
    return comparison.residual_vector(), np.concatenate(scale)


class Seen:
    """Evaluations of a fit: residuals and their scales; all losses."""

    def __init__(self, problem):
        self.problem, self.losses = problem, []

    def __call__(self, points):
        found = self.problem.evaluate_many([self.problem.robot.space.to_values(p) for p in points])
        for point, comparison in zip(points, found, strict=True):
            self.losses.append((comparison.loss, len(self.losses), point))
        return [residual_and_scale(comparison) for comparison in found]

    def slopes(self, point, here):
        signs = np.where(point + STEP <= 1, STEP, -STEP)
        there = [residual for residual, _ in self(point + np.diag(signs))]
        return np.stack([(r - here) / s for r, s in zip(there, signs, strict=True)], axis=1)


def step(slopes, here, scale, point, damping):
    """Levenberg-Marquardt's step within the cube, errors weighted by one over their length. Shape (d,)."""
    size, weights = len(point), 1 / np.sqrt(scale)
    weighted = slopes * weights[:, None]
    square = weighted.T @ weighted
    root = np.linalg.cholesky(square + damping * np.trace(square) / size * np.eye(size)).T
    target = np.linalg.solve(root.T, -weighted.T @ (weights * here))
    low, high = np.maximum(-point, -TRUST), np.minimum(1 - point, TRUST)
    return lsq_linear(root, target, (low - 1e-12, high + 1e-12)).x


def soft(residual, scale):
    """The loss, but for errors below `SOFT`, which count as squares."""
    return float((residual**2 / scale).sum())


def descend(problem, start, budget):
    """Reweighted least squares by Levenberg-Marquardt, so that lengths and not squares are minimized.

    Each step corrects the slopes (Broyden); now and then they are measured. Returns all evaluations' losses and points.
    """
    seen, point, damping = Seen(problem), np.array(start), 1e-2
    ((here, scale),) = seen([point])
    slopes, fresh = seen.slopes(point, here), True
    while len(seen.losses) < budget:
        tried = [np.clip(point + step(slopes, here, scale, point, damping * d), 0, 1) for d in DAMPINGS]
        theres = seen(tried)
        losses, before = [soft(*there) for there in theres], soft(here, scale)
        for (there, _), move in zip(theres, np.array(tried) - point, strict=True):
            slopes = slopes + np.outer(there - here - slopes @ move, move) / max(move @ move, 1e-12)
        best = int(np.argmin(losses))
        damping = np.clip(damping * DAMPINGS[best], 1e-6, 10)
        if losses[best] < before:
            point, (here, scale), fresh = tried[best], theres[best], False
        elif fresh:
            damping *= DAMPINGS[-1]
        if before - losses[best] < LEAST_GAIN * before and not fresh and len(seen.losses) + len(point) < budget:
            slopes, fresh = seen.slopes(point, here), True
    return seen.losses


def fit(problem, starts, budget):
    """Best point from all starts, of those judged again, and how many evaluations there were."""
    seen = [one for start in starts for one in descend(problem, start, budget // len(starts))]
    finalists = [point for _, point in sorted(((loss, tuple(p)) for loss, _, p in seen))[:FINALISTS]]
    means = [repeated(problem, np.array(point))["aligned_marker_error"] for point in finalists]
    return np.array(finalists[int(np.argmin(means))]), len(seen)


def problem_of(structure, trials):
    robot = robot_of(structure)
    return Problem(robot, trials, threads=1)


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
    problem = problem_of(structure, fitted)
    space = problem.robot.space
    more = space.parameters[len(FISH.space) :]
    values = read_parameters(a.start, FISH.name, FISH.space).values
    begin = space.to_cube({**values, **{p.name: np.clip(p.published, p.lower, p.upper) for p in more}})
    count, starts = len(FISH.space), [begin] if structure == "none" else []
    while more and len(starts) < 2:
        away = [AWAY[int(x > 0.15) + int(x > 0.85)][len(starts)] for x in begin[count:]]
        starts.append(np.concatenate([begin[:count], begin[count:] + away]))
    point, evaluations = fit(problem, starts, BUDGET[a.what])
    judged = {"fit": repeated(problem, point)}
    if unseen is not None:
        judged["left_out"] = repeated(problem_of(structure, unseen), point)
    return {
        "structure": structure, "left_out_trial": left_out, "evaluations": evaluations, "point": point.tolist(),
        "values": space.to_values(point), **judged,
    }  # fmt: skip


def done(job):
    structure, left_out, a = job
    path = a.out / f"{structure}-{left_out or 'all'}.json"
    return structure, left_out, kept(path, lambda: one_fit(structure, left_out, a))


def drag():
    """Friction over what it takes of the squared speed, for random fish that swim [N s²/m²]."""
    space, rng = FISH_EXTENDED.space, np.random.default_rng(SEED)
    swims = [Swim(f"{f:g}", Actuation(f, 0.0, 0.1), 2.0) for f in (0.75, 1.5)]
    simulator, found = Simulator(FISH_EXTENDED, threads=1), []
    for _ in range(40):
        values = space.to_values(rng.random(len(space)))
        pair = simulator.simulate_many([{**values, "surface_friction": f} for f in (0.0, FRICTION)], swims)
        speeds = np.array([[trial.track.speed for trial in trials] for trials in pair])
        if speeds.min() > 0.03:
            found.append(FRICTION / (speeds[0] ** 2 - speeds[1] ** 2))
    logs = np.log(np.abs(found))
    print(f"{np.exp(logs.mean()):.1f} N s²/m², within a factor of {np.exp(logs.std()):.1f}; {len(found)} fish")


def said(content):
    return " ".join(f"{1e3 * content[name]:6.2f}" for name in (*FIGURES, "spread"))


def table(a):
    rows = {}
    for path in sorted(a.out.glob("*.json")):
        content = json.loads(path.read_text())
        rows.setdefault(content["structure"], []).append(content)
    print("| structure | fit | shape | velocity | left out | shape | velocity | extra values |\n|" + "---|" * 8)
    for structure, fits in rows.items():
        whole = [c for c in fits if c["left_out_trial"] is None]
        out = [c["left_out"] for c in fits if c["left_out_trial"] is not None]
        cells = [f"{1e3 * whole[0]['fit'][n]:.2f}" if whole else "" for n in FIGURES]
        cells += [f"{1e3 * np.mean([o[n] for o in out]):.2f}" if len(out) > 5 else "" for n in FIGURES]
        extras = {k: v for k, v in whole[0]["values"].items() if k not in FISH.space.names} if whole else {}
        print(f"| {structure} | {' | '.join(cells)} | {', '.join(f'{k} {v:.3g}' for k, v in extras.items())} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("fit", "leave-out", "table", "drag"))
    parser.add_argument("structures", nargs="*", default=[])
    parser.add_argument("--reference", type=Path)
    parser.add_argument("--start", type=Path, help="parameters file of the fish")
    parser.add_argument("--out", type=Path, default=Path("runs/structure"))
    parser.add_argument("--workers", type=int, default=2)
    a = parser.parse_args()
    if a.what in ("table", "drag"):
        table(a) if a.what == "table" else drag()
        return
    left_out = [None] if a.what == "fit" else [trial.name for trial in load_reference(a.reference)]
    jobs = [(structure, name, a) for structure in a.structures for name in left_out]
    with ProcessPoolExecutor(a.workers) as team:
        for structure, left_out, content in team.map(done, jobs):
            line = f"{structure:24s} without {left_out or 'none':6s} fit {said(content['fit'])}"
            print(line + (f"   left out {said(content['left_out'])}" if left_out else ""), flush=True)


if __name__ == "__main__":
    main()

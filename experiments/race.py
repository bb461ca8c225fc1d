"""A race of search methods on problems whose answer is known or bounded (race_problems.py), as data profiles.

    python experiments/race.py --problems demo hidden-0 --seeds 0 1 --seconds 100 --out runs/race
    python experiments/race.py --out runs/race --figure runs/race.png    # draws and prints what is there

Every contestant gets the same seconds of processor time, its own included, on one core, from the same random first
point on (those that begin with a population of their own excepted). A run is a line of `runs.jsonl`: its improvements
as seconds, evaluations and loss [m]. Runs that are there aren't run again. A problem counts as solved once the loss is
within a factor of its target. DFO-LS and dm_control aren't dependencies of swim2real: `pip install DFO-LS dm_control`;
who lacks a package is skipped.
"""

import argparse
import itertools
import json
import os
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from race_problems import NAMES, Missing, load
from scipy.optimize import differential_evolution, least_squares

from swim2real.advisor import make_advisor
from swim2real.objective import evidence
from swim2real.optimizers import Candidate, Evaluation, first_point
from swim2real.pipeline.methods import make_optimizer
from swim2real.settings import CalibrationSettings

STEP = 0.01  # of a parameter's range, of differences


class TimeIsUp(Exception):  # noqa: N818
    """Raised from within an evaluation, when a contestant's seconds are over."""


class Course:
    """One run: evaluates points of the unit cube, and records improvements until the seconds are over.

    Attributes:
        race: The problem, with its space.
        size: Parameters.
        history: Improvements: seconds, evaluations, loss [m].
    """

    def __init__(self, race, seconds):
        self.race, self.size, self.history, self.evaluations = race, len(race.space), [], 0
        self._seconds, self._began = seconds, time.process_time()

    def __call__(self, point, candidate=None, told=False):
        """The evaluation of a point, with residuals; with evidence where an advisor is told.

        Raises:
            TimeIsUp: The seconds are over.
        """
        point = np.clip(point, 0.0, 1.0)
        found = self.race.problem.evaluate(self.race.space.to_values(point))
        seconds = time.process_time() - self._began
        if seconds > self._seconds:
            raise TimeIsUp
        self.evaluations += 1
        if not self.history or found.loss < self.history[-1][2]:
            self.history.append((round(seconds, 3), self.evaluations, found.loss))
        failed = found.divergence is not None
        return Evaluation(
            candidate or Candidate(point), found.loss, failed, evidence(found) if told else None,
            found.residual_vector(), () if failed else found.residual_stages(),
        )  # fmt: skip

    def loss(self, point):
        """Loss [m], with a penalty outside of the cube."""
        return self(point).loss + float(np.sum((point - np.clip(point, 0, 1)) ** 2))

    def residual(self, point):
        return self(point).residual

    def starts(self, seed):
        """Random starts without end; the first is every contestant's."""
        rng = np.random.default_rng([seed, 9])
        yield first_point(self.size, seed)
        while True:
            yield rng.random(self.size)


def of_package(method, course, seed, budget=2000, starts=None):
    """A method of swim2real's own, told what the calibration loop tells it."""
    robot, space = course.race.problem.robot, course.race.space
    settings = CalibrationSettings(method=method, budget=budget, seed=seed, first="random", starts=starts)
    advised = method in ("line-search", "multi-start")  # which an advisor leads where a response is known
    optimizer = make_optimizer(settings, robot, space, make_advisor("physics", robot, space, seed))
    while True:
        candidate = optimizer.ask()
        optimizer.tell(course(candidate.point, candidate, told=advised))


def bipop(course, seed):
    """pycma with restarts of growing and of small populations."""
    cma, starts = _imported("cma"), course.starts(seed)
    options = {"bounds": [0, 1], "seed": seed + 1, "verbose": -9, "verb_log": 0}
    while True:
        cma.fmin2(course.loss, lambda: next(starts), 0.25, options, restarts=9, bipop=True)


def lq_cma(course, seed):
    """pycma with a linear-quadratic model of the loss, which ranks most of a population."""
    cma = _imported("cma")
    for start in course.starts(seed):
        cma.fmin_lq_surr2(course.loss, start, 0.25, {"seed": seed + 1, "verbose": -9, "verb_log": 0})


def dfo_ls(course, seed):
    """Gauss-Newton on interpolated residuals, with soft restarts."""
    dfols, box = _imported("dfols", "DFO-LS"), (np.zeros(course.size), np.ones(course.size))
    for start in course.starts(seed):
        inside = np.clip(start, 0.02, 0.98)
        dfols.solve(course.residual, inside, bounds=box, rhobeg=0.1, maxfun=10**5, objfun_has_noise=True)


def scipy_least_squares(course, seed):
    """A trust region on residuals by differences, from random starts."""
    for start in course.starts(seed):
        least_squares(course.residual, start, bounds=(0, 1), diff_step=STEP, ftol=1e-3, xtol=1e-4)


def evolution(course, seed):
    """Differential evolution with two candidates a parameter."""
    while True:
        differential_evolution(
            course.loss, [(0, 1)] * course.size, popsize=2, maxiter=10**5, polish=False, rng=seed, init="sobol",
            x0=first_point(course.size, seed),
        )  # fmt: skip
        seed += 1000


def composite_turbo(course, seed, features=12, memory=100, batch=3):
    """Bayesian optimization in a trust region (TuRBO-1) with a Gaussian process of the residual's main components.

    Thompson sampling: each candidate's components are drawn and their squares summed, so the model knows that the loss
    is a sum of squares.
    """
    rng, starts, size = np.random.default_rng([seed, 8]), course.starts(seed), course.size
    while True:
        told = [course(next(starts)) for _ in range(size + 2)]
        length, wins, losses, kernel, rounds = 0.8, 0, 0, None, 0
        while length > 2**-7:
            proper = sorted((one for one in told if not one.failed), key=_squares)[:memory]
            if len(proper) < 3:
                break
            best = proper[0]
            kernel, predict = _process(proper, features, kernel, tune=rounds % 5 == 0)
            moved = rng.random((1500, size)) < min(1.0, 10 / size)
            moved[np.arange(1500), rng.integers(size, size=1500)] = True
            offsets = np.where(moved, length * (rng.random((1500, size)) - 0.5), 0.0)
            points = np.clip(best.candidate.point + offsets, 0, 1)
            drawn = [predict(points, rng) for _ in range(batch)]
            fresh = [course(points[int(np.argmin(one))]) for one in drawn]
            told, rounds = told + fresh, rounds + 1
            won = min(_squares(one) for one in fresh) < (1 - 1e-3) ** 2 * _squares(best)
            wins, losses = (wins + 1, 0) if won else (0, losses + 1)
            if wins == 3 or losses == max(4, size // batch):
                length, wins, losses = min(1.6, 2 * length) if wins else length / 2, 0, 0


def _process(told, features, kernel, tune):
    """A Gaussian process of the residual's components: its kernel, and what draws sums of squares at points."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, WhiteKernel

    points = np.array([one.candidate.point for one in told])
    residuals = np.array([one.residual for one in told])
    mean = residuals.mean(0)
    _, _, axes = np.linalg.svd(residuals - mean, full_matrices=False)
    axes = axes[:features]
    components, middle = (residuals - mean) @ axes.T, axes @ mean
    spread = components.std(0).max()
    kernel = kernel or RBF(np.ones(points.shape[1]), (0.05, 20)) + WhiteKernel(1e-3, (1e-6, 0.3))
    process = GaussianProcessRegressor(kernel, optimizer="fmin_l_bfgs_b" if tune else None)
    process.fit(points, components / spread)

    def draw(at, rng):
        expected, deviation = process.predict(at, return_std=True)
        drawn = expected + rng.standard_normal(expected.shape) * deviation.reshape(expected.shape)
        return np.sum((middle + spread * drawn) ** 2, axis=1)

    return process.kernel_, draw


def _squares(evaluation):
    return float(np.sum(evaluation.residual**2))


def _imported(module, package=None):
    try:
        return __import__(module)
    except ImportError as error:
        raise Missing(f"{package or module} isn't installed") from error


CONTESTANTS = {
    "multi-start": partial(of_package, "multi-start"),
    "line-search": partial(of_package, "line-search", starts=20),
    "least-squares": partial(of_package, "least-squares"),
    "cma-es": partial(of_package, "cma-es"),
    "random": partial(of_package, "random"),
    "BIPOP-CMA-ES": bipop,
    "lq-CMA-ES": lq_cma,
    "DFO-LS": dfo_ls,
    "scipy least_squares": scipy_least_squares,
    "scipy differential_evolution": evolution,
    "TuRBO, composite": composite_turbo,
}
PACKAGES = ("swim2real", "mujoco", "numpy", "scipy", "scikit-learn", "cma", "DFO-LS")


@cache
def _loaded(name, demo):
    race = load(name, 1, demo)
    race.problem.evaluate(race.space.published)  # what is compiled at the first evaluation doesn't count
    return race


def run(name, contestant, seed, seconds, demo=None):
    """One run's line; or why there is none."""
    warnings.simplefilter("ignore")
    try:
        race = _loaded(name, demo)
        course = Course(race, seconds)
        CONTESTANTS[contestant](course, seed)
    except Missing as reason:
        return str(reason)
    except TimeIsUp:
        pass
    return {
        "problem": name, "contestant": contestant, "seed": seed, "seconds": seconds, "target": race.target,
        "evaluations": course.evaluations, "loss": course.history[-1][2], "history": course.history,
        "versions": dict(_versions()),
    }  # fmt: skip


def _versions():
    for package in PACKAGES:
        try:
            yield package, version(package)
        except ImportError:
            continue


def hold(a):
    """Runs what isn't in the file yet."""
    a.out.mkdir(parents=True, exist_ok=True)
    done = {(one["problem"], one["contestant"], one["seed"]) for one in read(a.out)}
    wanted = itertools.product(a.problems, a.seeds, a.contestants)
    jobs = [(name, who, seed) for name, seed, who in wanted if (name, who, seed) not in done]
    os.environ.update({f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")})  # of fresh processes
    team = ProcessPoolExecutor(a.workers, get_context("spawn"))
    with team, (a.out / "runs.jsonl").open("a", encoding="utf-8") as file:
        for job, made in zip(jobs, team.map(partial(_run, a.seconds, a.demo), jobs), strict=True):
            if isinstance(made, str):
                print(f"{job[0]}, {job[1]}: skipped: {made}", flush=True)
                continue
            file.write(json.dumps(made) + "\n")
            file.flush()
            counts = f"{1e3 * made['loss']:8.2f} mm, target {1e3 * made['target']:.2f} mm, {made['evaluations']}"
            print(f"{job[0]:14s} {job[1]:30s} seed {job[2]} {counts} evaluations", flush=True)


def _run(seconds, demo, job):
    return run(*job, seconds, demo)


def read(folder):
    """All finished runs."""
    path = folder / "runs.jsonl"
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def solved_at(one, factor):
    """Seconds after which a run had solved its problem; infinite where it hasn't."""
    return next((seconds for seconds, _, loss in one["history"] if loss <= factor * one["target"]), np.inf)


def draw(runs, factors, path):
    """Share of the problems that are solved over the seconds: a line each contestant, a panel each factor."""
    import matplotlib.pyplot as plt

    size = (2 + 4 * len(factors), 3.6)
    figure, panels = plt.subplots(1, len(factors), figsize=size, sharey=True, layout="constrained")
    last = max(one["seconds"] for one in runs)
    for panel, factor in zip(np.atleast_1d(panels), factors, strict=True):
        for number, name in enumerate(CONTESTANTS):
            times = np.sort([solved_at(one, factor) for one in runs if one["contestant"] == name])
            solved = times[np.isfinite(times)]
            if times.size:
                share = 100 * np.arange(len(solved) + 1) / len(times)
                at, style = [0.01, *solved, last], ("-", "--", ":")[number % 3]
                color = f"C{number}" if number < 10 else "black"
                panel.step(at, [*share, share[-1]], style, where="post", label=name, color=color)
        panel.set(xscale="log", xlim=(1, last), ylim=(-1, 101), title=f"loss ≤ {factor:g} × target")
        panel.set_xlabel("processor time [s]")
    np.atleast_1d(panels)[0].set_ylabel("problems solved [%]")
    figure.legend(*panel.get_legend_handles_labels(), loc="outside right center", fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80)


def table(runs):
    """Median loss over seeds [mm] and evaluations, a row each contestant, in Markdown."""
    names = [name for name in NAMES if any(one["problem"] == name for one in runs)]
    targets = [next(1e3 * one["target"] for one in runs if one["problem"] == name) for name in names]
    rows = [["", *names], ["---", *["---:"] * len(names)], ["target", *(f"{target:.1f}" for target in targets)]]
    for who in CONTESTANTS:
        cells = []
        for name in names:
            those = [one for one in runs if (one["contestant"], one["problem"]) == (who, name)]
            loss, count = (np.median([one[key] for one in those] or [np.nan]) for key in ("loss", "evaluations"))
            cells.append(f"{1e3 * loss:.1f} ({count:.0f})" if those else "–")
        if any(cell != "–" for cell in cells):
            rows.append([who, *cells])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", nargs="*", choices=NAMES, default=[], metavar="NAME")
    parser.add_argument("--contestants", nargs="+", choices=list(CONTESTANTS), default=list(CONTESTANTS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--seconds", type=float, default=100.0, help="of processor time, a run")
    parser.add_argument("--workers", type=int, default=1, help="processes, a core each")
    parser.add_argument("--demo", type=Path, help="folder `reference` of a demo, in place of simulated markers")
    parser.add_argument("--out", type=Path, default=Path("runs/race"))
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--factors", nargs="+", type=float, default=[1.25, 1.5], help="of the target, a panel each")
    a = parser.parse_args()
    hold(a)
    runs = read(a.out)
    if runs:
        print(table(runs))
        if a.figure:
            draw(runs, a.factors, a.figure)


if __name__ == "__main__":
    main()

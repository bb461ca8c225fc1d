"""Measures the fast step against the engine's own on several models. Prints the table of src/fluidstep/README.md.

Both make the same steps from the same state under the same swinging controls, by turns in one process on one thread,
whose processor time is taken: one simulation, and 64 by `mujoco.rollout` and by `Batch`. Each model is given the
integrators that the fast step does; the engine's steps with the one that it comes with are in the last column.

Run with the package installed, and beside it `pip install dm_control "gymnasium[mujoco]"`: `python
benchmarks/fast_step.py`. Models of a package that isn't there are left out.
"""

from __future__ import annotations

import argparse
import copy
import importlib.util
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import numba
import numpy as np
from mujoco import rollout

from fluidstep import Batch, FastStep, UnsupportedModelError, disagreement
from swim2real.robots.fish import FISH

COUNT = 64
PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS
INTEGRATOR = mujoco.mjtIntegrator


def models() -> Iterator[tuple[str, mujoco.MjModel]]:
    yield "swim2real fish", FISH.build(FISH.space.published).compile()
    if importlib.util.find_spec("dm_control"):
        from dm_control.suite import fish, swimmer

        for name, (xml, assets) in (
            ("dm_control swimmer6", swimmer.get_model_and_assets(6)),
            ("dm_control swimmer15", swimmer.get_model_and_assets(15)),
            ("dm_control fish", fish.get_model_and_assets()),
        ):
            yield name, mujoco.MjModel.from_xml_string(xml.decode(), assets)
    found = importlib.util.find_spec("gymnasium")
    if found and found.origin:
        assets = Path(found.origin).parent / "envs/mujoco/assets"
        yield "Gymnasium Swimmer-v5", mujoco.MjModel.from_xml_path(str(assets / "swimmer.xml"))


def named(integrator: int) -> str:
    return INTEGRATOR(integrator).name.removeprefix("mjINT_").replace("IMPLICIT", "implicit").replace("FAST", "fast")


def engine_steps(model: mujoco.MjModel, controls: np.ndarray) -> Callable[[], np.ndarray]:
    """Rolls simulations out from the model's start, and returns the last positions of the first."""
    data = mujoco.MjData(model)
    start = np.empty(mujoco.mj_stateSize(model, PHYSICS))
    mujoco.mj_getState(model, data, start, PHYSICS)
    starts = np.tile(start, (len(controls), 1))

    def run() -> np.ndarray:
        states, _ = rollout.rollout(model, data, starts, controls)
        return states[0, -1, 1 : 1 + model.nq]

    return run


def fast_steps(model: mujoco.MjModel, controls: np.ndarray) -> Callable[[], np.ndarray]:
    fast, data = FastStep(model), mujoco.MjData(model)

    def run() -> np.ndarray:
        mujoco.mj_resetData(model, data)
        assert not fast.run(data, controls, len(controls)).failed
        return data.qpos

    return run


def batch_steps(model: mujoco.MjModel, controls: np.ndarray) -> Callable[[], np.ndarray]:
    batch = Batch([model], len(controls))

    def run() -> np.ndarray:
        for i in range(len(controls)):
            batch.start(i)
        batch.step(controls, controls.shape[1])
        assert not batch.failed.any()
        return batch.qpos[0]

    return run


def seconds(action: Callable[[], object]) -> float:
    """Time of the processor, so that others who use the machine hardly count."""
    began = time.thread_time()
    action()
    return time.thread_time() - began


def compare(name: str, model: mujoco.MjModel, turns: int, steps: int) -> None:
    """Prints a row of the table for each integrator that the fast step does."""
    phases = np.random.default_rng(0).uniform(0, 2 * np.pi, (COUNT, 1, model.nu))
    controls = np.sin(2 * np.pi * model.opt.timestep * np.arange(steps)[:, None] + phases)  # 1 Hz
    many = controls[:, : steps // 10]
    for integrator in (INTEGRATOR.mjINT_IMPLICIT, INTEGRATOR.mjINT_IMPLICITFAST):
        chosen = copy.copy(model)
        chosen.opt.integrator = integrator
        try:
            gap = disagreement(FastStep(chosen), states=100)
        except UnsupportedModelError:
            continue
        actions = {
            "as it comes": engine_steps(model, controls[:1]),
            "engine": engine_steps(chosen, controls[:1]),
            "fast": fast_steps(chosen, controls[0]),
            "engine, 64": engine_steps(chosen, many),
            "fast, 64": batch_steps(chosen, many),
        }
        for action in actions.values():
            action()
        spent = {what: [] for what in actions}
        for _ in range(turns):
            for what, action in actions.items():
                spent[what].append(seconds(action))
        rates = {what: f"{steps / statistics.median(spent[what]):,.0f}" for what in ("as it comes", "engine", "fast")}
        one, batch = (
            statistics.median(a / b for a, b in zip(spent[f"engine{what}"], spent[f"fast{what}"], strict=True))
            for what in ("", ", 64")
        )
        print(
            f"| {name} | {named(integrator)} | {rates['engine']} | {rates['fast']} | {one:.1f} | {batch:.1f} "
            f"| {gap:.0e} | {named(model.opt.integrator)}: {rates['as it comes']} |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=int, default=15, help="turns of each comparison (%(default)s)")
    parser.add_argument(
        "--steps",
        type=int,
        default=1000,
        help="steps of one simulation in a turn, a tenth for each of 64 (%(default)s)",
    )
    arguments = parser.parse_args()
    print(
        f"{os.cpu_count()} cores {platform.machine()}, {platform.system()}; Python {platform.python_version()}, "
        f"MuJoCo {mujoco.__version__}, numba {numba.__version__}, NumPy {np.__version__}\n"
    )
    print(
        "| model | integrator | engine, steps/s | fast, steps/s | ratio | ratio of 64 | difference | as it comes |\n"
        "|---|---|---|---|---|---|---|---|"
    )
    for name, model in models():
        compare(name, model, arguments.turns, arguments.steps)


if __name__ == "__main__":
    main()

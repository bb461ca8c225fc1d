"""A study that takes seconds: one parameter that counts, two that make up for one another, one without effect.

The trial starts from rest and protocol 'paper' compares it, since no steady cycle has to be found then.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import small_run

from swim2real.calibration import Problem, RunFolder, calibrate, reference_fingerprint
from swim2real.optimizers import RandomSearch, streams
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, MarkerTrack, Trial, TrialSet

HIDDEN = {"lift": 5.0, "arm_a": 0.02, "arm_b": 0.016, "nothing": 0.3}
START = {"lift": 4.0, "arm_a": 0.0172, "arm_b": 0.0172, "nothing": 0.5}
FREQUENCY, SECONDS = 1.7, 1.2  # Hz, s


def build(values):
    found = {**FISH.space.published, **small_run.HIDDEN, "fluid_kutta_lift": values["lift"]}
    return FISH.build({**found, "motor_arm_length": values["arm_a"] + values["arm_b"]})


SPACE = ParameterSpace(
    (
        Parameter("lift", "-", 2.0, 8.0, "Lift of the fin.", 5.0),
        Parameter("arm_a", "m", 0.01, 0.026, "One half of the arm.", 0.018),
        Parameter("arm_b", "m", 0.01, 0.026, "The other half.", 0.018),
        Parameter("nothing", "-", 0.0, 1.0, "Does nothing.", 0.5),
    )
)
ROBOT = replace(FISH, name="toy", space=SPACE, build=build)


def make_reference(noise: float = 1e-3) -> TrialSet:
    """The hidden fish's swim with noise on its markers [m]."""
    simulator = Simulator(ROBOT, threads=2, sample_interval=1 / 60)
    trial = simulator.simulate(HIDDEN, [Swim("f1_70", Actuation(FREQUENCY), SECONDS)]).trials[0]
    positions = trial.track.positions + np.random.default_rng(0).normal(0, noise, trial.track.positions.shape)
    return TrialSet((Trial("f1_70", MarkerTrack(trial.track.times, positions), FREQUENCY),), ROBOT.marker_names)


def make_run(reference: TrialSet, out: Path, budget: int = 3, seed: int = 0) -> RunFolder:
    """A short run that begins near the hidden values."""
    problem = Problem(ROBOT, reference, "paper", threads=2)
    folder = RunFolder(out)
    with folder.locked():
        folder.begin(
            {
                "robot": ROBOT.name, "scale": SPACE.scale, "protocol": "paper", "horizon": 4.0, "hold_out": [],
                "reference_fingerprint": reference_fingerprint(reference), "reference": "the toy's reference",
                "engine": problem.simulator.engine.as_dict(), "budget": budget, "seed": seed,
            }
        )  # fmt: skip
        optimizer = RandomSearch(len(SPACE), streams(seed)[1], SPACE.to_cube(START))
        calibrate(problem, SPACE, optimizer, budget, folder)
    return folder

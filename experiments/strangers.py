"""Recovers hidden parameters of two models that nobody here wrote, from several seeds.

    python experiments/strangers.py swimmer MODEL.xml    # gymnasium/envs/mujoco/assets/swimmer.xml
    python experiments/strangers.py fish MODEL.xml       # dm_control/suite/fish.xml

The files come with the packages gymnasium and dm_control. Each model gets markers (sites) and four parameters with wide
bounds, whose hidden values are off the model's by factors of 0.65 to 5, and is recorded from rest under two sinusoidal
commands, with noise. Prints the loss of the hidden values and of the model's own, then a row per seed: the lowest loss
after the budget, and how far each parameter is from its hidden value.
"""

import argparse
import json
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from markertrack.track import MarkerTrack
from swim2real.calibration import Problem
from swim2real.pipeline import calibrate
from swim2real.robots import load_robot
from swim2real.settings import CalibrationSettings
from swim2real.simulation import PlaybackSimulator
from swim2real.simulation.playback import Rollout
from swim2real.trials import Trial, TrialSet
from swim2real.trials.signals import Signals


@dataclass(frozen=True)
class Case:
    """A model with what is hidden.

    Attributes:
        sites: Body and place [m] of each marker.
        lines: Line of the model, bounds and hidden value of each parameter.
        commands: Amplitude and phase [rad] of each actuator by its index, and the frequency [Hz], for each trial.
        fps: Frames a second.
        noise: Of the markers [m].
    """

    sites: dict[str, tuple[str, list[float]]]
    lines: dict[str, tuple[str, float, float, float]]
    commands: tuple[tuple[dict[int, tuple[float, float]], float], ...]
    fps: float
    noise: float


SECONDS = 4.0
CASES = {
    "swimmer": Case(
        {
            "nose": ("torso", [1.5, 0, 0]), "neck": ("torso", [0.6, 0, 0]), "middle": ("mid", [-0.5, 0, 0]),
            "back": ("back", [-0.2, 0, 0]), "tail": ("back", [-1, 0, 0]),
        },
        {
            "density": ("option density", 500.0, 20000.0, 2600.0),
            "viscosity": ("option viscosity", 0.01, 5.0, 0.5),
            "gear": ('actuator "*" gear[0]', 30.0, 600.0, 110.0),
            "armature": ('joint "motor*" armature', 0.02, 2.0, 0.3),
        },
        (({0: (0.4, 0.0), 1: (0.4, -1.5)}, 0.5), ({0: (0.7, 0.0), 1: (0.5, -2.0)}, 1.0)),
        30.0, 2e-3,
    ),
    "fish": Case(
        {
            "nose": ("torso", [0, 0.07, 0.04]), "back": ("torso", [0, -0.06, 0.04]), "stem": ("tail1", [0, 0, 0.016]),
            "tip": ("tail2", [0, -0.018, 0.035]),
        },
        {
            "density": ("option density", 500.0, 20000.0, 3200.0),
            "tail_stiffness": ('joint "tail2" stiffness', 1e-5, 2e-3, 2e-4),
            "damping": ('joint "tail*" damping', 1e-6, 1e-3, 6e-5),
            "tail_servo": ('actuator "tail" kp', 5e-5, 5e-3, 1.1e-3),
        },
        (({0: (0.8, 0.0)}, 1.0), ({0: (0.6, 0.0)}, 2.2)),
        60.0, 2e-4,
    ),
}  # fmt: skip


def robot_of(name, case, path, folder):
    """The robot file of a model with markers, written beside a copy of it."""
    spec = mujoco.MjSpec.from_file(str(path))
    for site, (body, place) in case.sites.items():
        spec.body(body).add_site(name=site, pos=place)
    for number, actuator in enumerate(spec.actuators):
        actuator.name = actuator.name or f"motor{number + 1}"
    actuators = [actuator.name for actuator in spec.actuators]
    spec.compile()
    (folder / f"{name}.xml").write_text(spec.to_xml())
    driven = [actuators[i] for i in case.commands[0][0]]
    text = f"format = 1\nname = 'strange-{name}'\ndescription = 'A model from another package.'\nmodel = '{name}.xml'\n"
    text += f"camera = 'above'\nmarkers = {list(case.sites)}\n[recordings]\nstart = 'rest'\n"
    text += f"frame = {list(case.sites)[:2]}\n[recordings.controls]\n"
    text += "".join(f"{actuator} = 'table'\n" for actuator in driven)
    for key, (line, lower, upper, _) in case.lines.items():
        text += f"[[parameters]]\nname = '{key}'\nlower = {lower}\nupper = {upper}\nscale = 'log'\nmeaning = '{key}'\n"
        text += f"targets = '{line}'\n"
    (folder / f"{name}.toml").write_text(text)
    return load_robot(folder / f"{name}.toml"), driven


def recorded(case, robot, driven):
    """What a camera sees of the hidden robot."""
    hidden, rng = {key: line[3] for key, line in case.lines.items()}, np.random.default_rng(0)
    times, ticks, trials = np.arange(0, SECONDS, 1 / case.fps), np.arange(0, SECONDS, 0.02), []
    for number, (waves, frequency) in enumerate(case.commands):
        angle = 2 * np.pi * frequency * ticks
        commands = np.column_stack([amplitude * np.sin(angle + phase) for amplitude, phase in waves.values()])
        nothing = np.full((len(times), len(case.sites), 2), np.nan)
        trial = Trial(f"{number}", MarkerTrack(times, nothing), controls=Signals(ticks, driven, commands))
        (made,) = PlaybackSimulator(robot).simulate(hidden, [Rollout(trial)])
        seen = made.track.positions + rng.normal(0, case.noise, made.track.positions.shape)
        trials.append(replace(trial, track=MarkerTrack(times, seen)))
    return hidden, TrialSet(tuple(trials), robot.marker_names)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=list(CASES))
    parser.add_argument("model", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/strangers"))
    parser.add_argument("--budget", type=int, default=60)
    parser.add_argument("--method", default="line-search")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2, 3, 4])
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        robot, driven = robot_of(a.name, CASES[a.name], a.model, Path(folder))
        hidden, reference = recorded(CASES[a.name], robot, driven)
        problem = Problem.with_settings(robot, reference, CalibrationSettings(horizon=SECONDS))
        losses = [1e3 * problem.evaluate(values).loss for values in (hidden, robot.space.published)]
        print(f"{a.name}: {losses[0]:.3f} mm at the hidden values, {losses[1]:.1f} mm at the model's own")
        for seed in a.seeds:
            out = a.out / f"{a.name}-{a.method}-{seed}-{a.budget}"
            settings = CalibrationSettings(method=a.method, budget=a.budget, seed=seed, horizon=SECONDS, threads=1)
            outcome = calibrate(reference, robot, settings, out, resume=out.exists())
            found = json.loads((out / "best.json").read_text())["parameters"]
            off = ", ".join(f"{key} {100 * (found[key] / value - 1):+.0f} %" for key, value in hidden.items())
            print(f"seed {seed}: {1e3 * outcome.fit.loss:.3f} mm; {off}", flush=True)


if __name__ == "__main__":
    main()

"""Which method calibrates recordings best: five robots with hidden parameters, from the model's own values and others.

    python experiments/recordings.py --out runs/recordings --budget 60

Robots: finger, snake and arm of the examples, a double pendulum that swings down, and a frame of two floors that rings
down at 6 Hz, filmed at 20 frames per second (both with noise of 0.3 mm). Each hidden set is off the model's by what
drawings are off. Prints a row per run: the loss, the parameter that is farthest off, and how far those that the trials
don't tell have gone from the model's values.
"""

import argparse
import importlib.util
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from markertrack.track import MarkerTrack
from swim2real.pipeline import calibrate
from swim2real.robots import load_robot
from swim2real.settings import CalibrationSettings
from swim2real.simulation import PlaybackSimulator
from swim2real.simulation.playback import Rollout
from swim2real.trials import Trial, TrialSet

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
UNTOLD = {"finger": {"air_density"}, "snake": {"joint_damping", "servo_damping"}}
NOISE = 3e-4  # m
PENDULUM = """<mujoco model="pendulum"><option timestep="0.002" integrator="implicitfast"/><worldbody>
<site name="pivot" pos="0 0 0.5"/><body name="upper" pos="0 0 0.5"><joint name="shoulder" axis="0 1 0" damping="0.001"/>
<geom name="upper" type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01" mass="0.1"/><site name="middle" pos="0 0 -0.2"/>
<body name="lower" pos="0 0 -0.2"><joint name="elbow" axis="0 1 0" damping="0.0005"/>
<geom name="lower" type="capsule" fromto="0 0 0 0 0 -0.15" size="0.01" mass="0.08"/><site name="end" pos="0 0 -0.15"/>
</body></body></worldbody></mujoco>"""
FRAME = """<mujoco model="frame"><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body name="low" pos="0 0 0.2"><joint name="lower" type="slide" axis="1 0 0" stiffness="1500" damping="1"/>
<geom name="low" type="box" size="0.1 0.02 0.005" mass="0.5"/><site name="left" pos="-0.05 0 0"/>
<body name="high" pos="0 0 0.2"><joint name="upper" type="slide" axis="1 0 0" stiffness="1500" damping="1"/>
<geom name="high" type="box" size="0.1 0.02 0.005" mass="0.5"/><site name="top" pos="0.05 0 0"/>
</body></body></worldbody></mujoco>"""
LINES = {
    "pendulum": {
        "shoulder_damping": ('joint "shoulder" damping', 1e-4, 1e-2),
        "elbow_damping": ('joint "elbow" damping', 1e-4, 1e-2),
        "lower_mass": ('geom "lower" mass', 0.02, 0.3),
        "upper_mass": ('geom "upper" mass', 0.02, 0.5),
    },
    "frame": {
        "lower_stiffness": ('joint "lower" stiffness', 200.0, 8000.0),
        "upper_stiffness": ('joint "upper" stiffness', 200.0, 8000.0),
        "lower_damping": ('joint "lower" damping', 0.05, 10.0),
        "upper_damping": ('joint "upper" damping', 0.05, 10.0),
    },
}
HIDDEN = {
    "pendulum": {"shoulder_damping": 0.002, "elbow_damping": 0.0003, "lower_mass": 0.06, "upper_mass": 0.115},
    "frame": {"lower_stiffness": 1860.0, "upper_stiffness": 2000.0, "lower_damping": 0.6, "upper_damping": 0.4},
}
STARTS = {
    "pendulum": [{"shoulder": 1.2, "elbow": 0.4}, {"shoulder": -0.7, "elbow": 1.0}],
    "frame": [{"lower": 0.02, "upper": 0.012}, {"lower": 0.015, "upper": -0.01}],
}
SECONDS = {"finger": 1.5, "snake": 1.5, "arm": 1.5, "pendulum": 3.0, "frame": 3.0}


def small(name, folder):
    """The pendulum or the frame: robot, hidden values, recordings cut out of longer ones."""
    (folder / f"{name}.xml").write_text(PENDULUM if name == "pendulum" else FRAME)
    sites = ["pivot", "middle", "end"] if name == "pendulum" else ["left", "top"]
    text = f"format = 1\nname = '{name}'\ndescription = 'Rings down.'\nmodel = '{name}.xml'\ncamera = 'side'\n"
    text += f"markers = {sites}\n[recordings]\nstart = 'fitted'\n"
    for key, (line, lower, upper) in LINES[name].items():
        text += f"[[parameters]]\nname = '{key}'\nlower = {lower}\nupper = {upper}\nscale = 'log'\nmeaning = 'm'\n"
        text += f"targets = '{line}'\n"
    (folder / f"{name}.toml").write_text(text)
    robot = load_robot(folder / f"{name}.toml")
    fps, rng, trials = (20 if name == "frame" else 60), np.random.default_rng(0), []
    times = np.arange(0, SECONDS[name], 1 / fps) + 0.0567
    for number, start in enumerate(STARTS[name]):
        nowhere = np.full((len(times) + 1, len(sites), 2), np.nan)
        blank = Trial(f"{number}", MarkerTrack(np.concatenate([[0.0], times]), nowhere), start=start)
        resting = replace(robot, trials=replace(robot.recordings, start="rest"))
        (made,) = PlaybackSimulator(resting).simulate(HIDDEN[name], [Rollout(blank)])
        seen = made.track.positions[1:] + rng.normal(0, NOISE, made.track.positions[1:].shape)
        trials.append(Trial(f"{number}", MarkerTrack(times - times[0], seen)))
    return robot, HIDDEN[name], TrialSet(tuple(trials), robot.marker_names)


def example(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / name / "make_data.py")
    code = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(code)
    made = code.record() if hasattr(code, "record") else code.LAB.record(code.takes())
    return code.ROBOT, code.HIDDEN, made


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/recordings"))
    parser.add_argument("--budget", type=int, default=60)
    parser.add_argument("--robots", nargs="+", default=list(SECONDS))
    parser.add_argument("--methods", nargs="+", default=["line-search", "least-squares", "mujoco-sysid", "bayesopt"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1])
    parser.add_argument("--pieces", type=float, nargs="+", default=[])
    a = parser.parse_args()
    for name in a.robots:
        with tempfile.TemporaryDirectory() as folder:
            robot, hidden, recordings = example(name) if (EXAMPLES / name).is_dir() else small(name, Path(folder))
            for pieces in [None, *a.pieces]:
                for method in a.methods:
                    for seed in a.seeds:
                        out = a.out / f"{name}-{method}-{pieces}-{seed}-{a.budget}"
                        settings = CalibrationSettings(
                            method=method, budget=a.budget, seed=seed, horizon=SECONDS[name], pieces=pieces, threads=1
                        )
                        outcome = calibrate(recordings, robot, settings, out, resume=out.exists())
                        found = json.loads((out / "best.json").read_text())["parameters"]
                        off = {key: np.log(found[key] / value) for key, value in hidden.items()}
                        told = {key: one for key, one in off.items() if key not in UNTOLD.get(name, ())}
                        worst = max(told, key=lambda key: abs(told[key]))
                        gone = [abs(np.log(found[key] / robot.space.published[key])) for key in UNTOLD.get(name, ())]
                        wandered = f", untold {np.exp(max(gone)):.2g} times the model's" if gone else ""
                        print(
                            f"{name:9s} {method:14s} seed {seed} pieces {pieces}: {1e3 * outcome.fit.loss:.3f} mm, "
                            f"median {100 * np.median([abs(np.expm1(x)) for x in told.values()]):.1f} % off, worst "
                            f"{worst} {100 * np.expm1(told[worst]):+.0f} %{wandered}",
                            flush=True,
                        )


if __name__ == "__main__":
    main()

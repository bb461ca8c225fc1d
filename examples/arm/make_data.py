"""Records an arm whose parameters are hidden, in place of your own robot: commands and encoders, no camera.

python examples/arm/make_data.py [FOLDER]
"""

import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from swim2real.robots import load_robot
from swim2real.robots.compiled import set_linear
from swim2real.trials import Signals, save_reference

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from lab import Lab, Take

ROBOT = load_robot(Path(__file__).with_name("arm.toml"))
HIDDEN = {
    "shoulder_damping": 0.09, "elbow_damping": 0.035, "shoulder_friction": 0.08, "elbow_friction": 0.03,
    "servo_stiffness": 15.0, "tool_mass": 0.16, "delay": 0.022,
}  # fmt: skip
COUNT = 2 * np.pi / 4096  # rad, of the encoders
SECONDS = 4.0


def differs(spec: mujoco.MjSpec) -> None:
    """What the real arm has, and its model hasn't."""
    spec.option.timestep, spec.option.integrator = 2.5e-4, mujoco.mjtIntegrator.mjINT_EULER
    set_linear(spec.joint("shoulder"), "stiffness", 0.03)  # N·m/rad of the cables to the elbow
    spec.geom("tool").pos[0] += 2e-3  # m, by which the tool isn't quite in line


def takes() -> list[Take]:
    """Steps, a chirp from 0.2 to 3 Hz and a slow way there and back to fit; a pick and place to hold out."""
    times = np.arange(0.0, SECONDS, 0.01)
    steps = np.array([0.3, -0.5, 0.8, 0.1, -0.7, 0.4])[np.minimum(times // 0.7, 5).astype(int)]
    chirp = 0.4 * np.sin(2 * np.pi * (0.2 + (3.0 - 0.2) / (2 * SECONDS) * times) * times)
    ramp = 0.9 * (1 - np.abs(1 - 2 * times / SECONDS))
    way = np.interp(times, [0, 0.5, 1.2, 1.8, 2.5, 3.2, 4.0], [0, 0, 0.9, 0.9, -0.6, -0.6, 0])
    commands = {
        "steps": (steps, np.roll(steps, 35) * 1.2), "chirp": (chirp, 0.8 * np.roll(chirp, 20)),
        "ramp": (ramp, 0.9 - 1.5 * ramp), "place": (way, 0.7 * np.sin(2 * np.pi * 0.6 * times) - 0.5 * way),
    }  # fmt: skip
    names = ["shoulder_servo", "elbow_servo"]
    return [
        Take(name, SECONDS, controls=Signals(times, names, np.stack(both, axis=1))) for name, both in commands.items()
    ]


LAB = Lab(ROBOT, HIDDEN, differs, lag=0.001, seed=3)


def record():
    """The recordings, read by encoders that count."""
    made = LAB.record(takes(), 100.0)

    def counted(sensors: Signals) -> Signals:
        return Signals(sensors.times, sensors.names, COUNT * np.round(sensors.values / COUNT))

    return replace(made, trials=tuple(replace(trial, sensors=counted(trial.sensors)) for trial in made))


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "arm-recordings")
    save_reference(record(), folder)
    print(folder)

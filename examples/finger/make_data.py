"""Films a finger whose parameters are hidden, in place of your own robot, camera and load cell.

python examples/finger/make_data.py [FOLDER]
"""

import sys
from pathlib import Path

import mujoco
import numpy as np

from swim2real.robots import load_robot
from swim2real.robots.compiled import set_linear
from swim2real.trials import Signals

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from lab import Lab, Take
from pool import PoolCamera

ROBOT = load_robot(Path(__file__).with_name("finger.toml"))
HIDDEN = {
    "knuckle_stiffness": 0.27, "middle_stiffness": 0.14, "joint_damping": 0.018, "joint_friction": 0.02,
    "cable_stiffness": 1500.0, "distal_mass": 0.065, "air_density": 1.2,
}  # fmt: skip
CAMERA = PoolCamera(
    width=800, height=640, view=0.32, camera_height=1.5, center=(0.035, -0.05), marker_radius=0.004,
    body_color=(40, 44, 50), water_color=(150, 158, 150), caustics=0.0,
)  # fmt: skip
LINK_HALF_WIDTH = 0.008  # m
SECONDS = 4.0


def differs(spec: mujoco.MjSpec) -> None:
    """What the real finger has, and its model hasn't."""
    spec.option.timestep, spec.option.integrator = 2.5e-4, mujoco.mjtIntegrator.mjINT_EULER
    set_linear(spec.tendon("cable"), "damping", 0.5)  # N·s/m in the cable itself
    spec.site("dist1").pos[0] += 7e-4  # glued beside its place


def takes() -> list[Take]:
    """Steps, a chirp from 0.3 to 4 Hz and a slow way there and back."""
    times = np.arange(0.0, SECONDS, 0.01)
    steps = np.array([8, 22, 13, 27, 17, 30, 10]) * 1e-3
    chirp = 0.018 + 0.007 * np.sin(2 * np.pi * (0.3 + (4.0 - 0.3) / (2 * SECONDS) * times) * times)
    ramp = 0.006 + 0.024 * (1 - np.abs(1 - 2 * times / SECONDS))
    commands = {"steps": steps[np.minimum(times // 0.6, 6).astype(int)], "chirp": chirp, "ramp": ramp}
    return [
        Take(name, SECONDS, controls=Signals(times, ["winch"], command[:, None])) for name, command in commands.items()
    ]


LAB = Lab(ROBOT, HIDDEN, differs, lag=0.001, sensor_noise={"pull": 0.2}, seed=1)

if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "finger-films")
    for film in LAB.film(takes(), CAMERA, LINK_HALF_WIDTH, folder):
        print(film)

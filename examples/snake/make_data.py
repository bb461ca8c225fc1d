"""Films a swimming snake whose parameters are hidden, in place of your own robot and camera.

python examples/snake/make_data.py [FOLDER]
"""

import sys
from pathlib import Path

import mujoco

from swim2real.robots import load_robot

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from lab import Lab, Take
from pool import PoolCamera

ROBOT = load_robot(Path(__file__).with_name("snake.toml"))
HIDDEN = {
    "blunt_drag": 0.7, "kutta_lift": 0.8, "joint_stiffness": 0.04, "servo_stiffness": 0.4, "joint_damping": 0.005,
    "servo_damping": 0.005,
}  # fmt: skip
CAMERA = PoolCamera(width=1280, height=720, view=1.4, center=(0.05, 0.1), caustics=0.3)
LINK_HALF_WIDTH = 0.016  # m
SECONDS = 4.0


def differs(spec: mujoco.MjSpec) -> None:
    """What the real snake has, and its model hasn't."""
    spec.option.timestep, spec.option.integrator = 5e-4, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint in spec.joints:
        if joint.name.startswith("bend"):
            joint.frictionloss = 1e-3  # N·m of dry friction
    spec.site("back2").pos[1] += 1e-3  # glued beside its place


def takes() -> list[Take]:
    """Swims at three frequencies, which the names of the films say."""
    return [Take(f"f{f:.2f}".replace(".", "_"), SECONDS, frequency=f) for f in (0.5, 1.1, 1.7)]


LAB = Lab(ROBOT, HIDDEN, differs, lag=0.001, heading=0.4, seed=2)

if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "snake-films")
    for film in LAB.film(takes(), CAMERA, LINK_HALF_WIDTH, folder):
        print(film)

"""Makes trajectories.npz: short swims of our own fish, to notice when the model changes by accident.

Run it on an engine before MuJoCo 3.14, and only when the model is meant to change:

    python tests/robots/make_trajectories.py
"""

from pathlib import Path

import mujoco
import numpy as np

from swim2real.robots.fish import FISH
from swim2real.simulation.stepper import Stepper

PLACE = Path(__file__).with_name("trajectories.npz")
FREQUENCIES = (0.8, 1.7)  # Hz
DURATION, INTERVAL = 0.8, 40  # s, steps between samples
SOFT = {name: (0.12 if "stiffness" in name else value) for name, value in FISH.space.published.items()}
SETS = (
    {**SOFT, "fluid_magnus_lift": 2.0, "motor_arm_length": 0.05, "hinge_damping_4": 0.003},
    {**FISH.space.published, "fluid_blunt_drag": 2.0, "fluid_kutta_lift": 1.0, "hinge_stiffness_2": 2.5},
    {**FISH.space.published, "fluid_slender_drag": 1.0, "fluid_angular_drag": 0.3, "hinge_damping_0": 0.05},
)


def swim(values: dict[str, float], frequency: float, duration: float, interval: int) -> np.ndarray:
    """Markers from rest, the motor joint at the commanded speed [m]. Shape (T, M, 2)."""
    stepper = Stepper(FISH.build(values).compile(), FISH, 0.0, 2 * np.pi * frequency, 0.0)
    chunk = stepper.run(round(duration / stepper.timestep) + 1)
    assert chunk.failed_at is None
    return chunk.markers[::interval]


if __name__ == "__main__":
    np.savez_compressed(
        PLACE,
        parameters=np.array([[values[name] for name in FISH.space.names] for values in SETS]),
        frequencies=np.array(FREQUENCIES),
        markers=np.array([[swim(v, f, DURATION, INTERVAL) for f in FREQUENCIES] for v in SETS], dtype=np.float32),
        engine=np.array(mujoco.__version__),
    )

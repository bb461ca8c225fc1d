"""Calibrates a simulated fish against the swims of another one, whose parameters are hidden.

python examples/calibrate.py [RUN_FOLDER [BUDGET]]
"""

import sys
from pathlib import Path

from swim2real.demo import Camera, synthetic_reference
from swim2real.pipeline import run
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings

out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/example")
budget = int(sys.argv[2]) if len(sys.argv) > 2 else 10

# For real tracks: from swim2real.trials import load_reference; reference = load_reference("tracks")
hidden = {**FISH.space.published, "fluid_kutta_lift": 2.5, "motor_arm_length": 0.035}
camera = Camera(noise=5e-4, placement=3e-3)
reference = synthetic_reference(FISH, hidden, frequencies=(0.8, 1.2, 1.6), seconds=4.0, camera=camera, seed=1)

outcome = run(reference, FISH, CalibrationSettings(budget=budget, seed=0), out, resume=(out / "settings.json").exists())

figures = outcome["fit"]
print(f"aligned marker error {1e3 * figures['aligned_marker_error']:.1f} mm")
print(f"velocity error {1e3 * figures['velocity_error']:.1f} mm/s")
print(f"parameters in {out / 'best.json'}")

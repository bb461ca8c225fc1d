"""Calibrates a simulated fish against the swims of another one, whose parameters are hidden.

python examples/calibrate.py [RUN_FOLDER [BUDGET]]
"""

import sys
from pathlib import Path

import swim2real

out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/example")
budget = int(sys.argv[2]) if len(sys.argv) > 2 else 10
fish = swim2real.load_robot("fish")

# For real tracks: reference = swim2real.load_reference("tracks")
hidden = {**fish.space.published, "fluid_kutta_lift": 2.5, "motor_arm_length": 0.035}
camera = swim2real.SyntheticCamera(noise=5e-4, placement=3e-3)
reference = swim2real.synthetic_reference(fish, hidden, (0.8, 1.2, 1.6), seconds=4.0, camera=camera, seed=1)

settings = swim2real.CalibrationSettings(budget=budget, seed=0)
outcome = swim2real.calibrate(reference, fish, settings, out, resume=(out / "settings.json").exists())

print(f"aligned marker error {1e3 * outcome.fit.aligned_marker_error:.1f} mm")
print(f"velocity error {1e3 * outcome.fit.velocity_error:.1f} mm/s")
print(f"parameters in {out / 'best.json'}")

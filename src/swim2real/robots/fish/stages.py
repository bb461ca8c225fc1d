"""The fish fitted by hand, stage by stage, as the prior work [michelis2026simple] did.

It fits nine numbers: a stiffness by the spectrum of the tail's sideways motion, the motor's geometry on a grid, five
fluid coefficients by Bayesian optimization of the marker error. Of our sixteen parameters these are eight: its fish has
one stiffness for all five hinges, and what turns the motor is identified from the tracks, not fitted. Its hinges have
no damping, which no stage fits; so it is held at zero here. Each stage's share is the count of its numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.robots.robot import FitPlan, FitStage


def beat_distance(evidence: Mapping[str, Any]) -> float:
    """Mean distance of the simulated from the real sideways fundamentals in the body frame [m].

    Over trials and markers, those that aren't known left out; NaN without any. One common phase a trial is free, since
    under the paper's protocol the simulated motor starts at another angle.
    """
    distances: list[float] = []
    for trial in evidence["trials"].values():
        simulated, real = (_complex(trial[f"beat_{side}"]) for side in ("simulated", "real"))
        known = np.isfinite(simulated) & np.isfinite(real)
        if known.any():
            turn = np.exp(1j * np.angle(np.vdot(simulated[known], real[known])))
            distances.append(float(np.abs(turn * simulated[known] - real[known]).mean()))
    return float(np.mean(distances)) if distances else float("nan")


def _complex(beat: Mapping[str, Any]) -> NDArray[np.complex128]:
    amplitude, phase = (np.array(beat[key], dtype=float) for key in ("amplitude", "phase"))
    return amplitude * np.exp(1j * phase)


def fish_plan() -> FitPlan:
    """Stiffness, motor arm, fluid."""
    joints = range(5)
    fluid = ("blunt_drag", "slender_drag", "angular_drag", "kutta_lift", "magnus_lift")
    return FitPlan(
        (
            FitStage(
                "stiffness", tuple(f"hinge_stiffness_{i}" for i in joints), 1.0, together=True, score=beat_distance
            ),
            FitStage("motor arm", ("motor_arm_length",), 1.0, together=True, score=beat_distance),
            FitStage("fluid", tuple(f"fluid_{name}" for name in fluid), 5.0),
        ),
        {f"hinge_damping_{i}": 0.0 for i in joints},
    )

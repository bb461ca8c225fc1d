"""Which way parameters swim from rest, where a policy and the robot begin.

The aligned protocol compares steady swims that begin at the real speed. Many parameters have two steady swims at the
same frequency, one head first and one tail first: a fit may meet the real swims and still set off backward.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from markertrack.track import MarkerTrack
from swim2real.objective.figures import Fact
from swim2real.parameters import Values
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation, Trial
from swimbase.checking import Number

_SETTLING = 3.0  # s at least until the direction is settled, and as long again to measure the speed


@dataclass(frozen=True)
class FromRest:
    """A swim from rest, once it has settled.

    Attributes:
        frequency: Frequency of the motor [Hz].
        speed: Forward [m/s], negative is tail first; None when it diverged.
        divergence: Why and when the simulation failed; None when it didn't.
        first_beats: Forward speed over the first two beats [m/s]: as the parameters change it passes smoothly through
            about 0 where the settled swim jumps from head first to tail first.
    """

    frequency: Number
    speed: Fact
    divergence: str | None
    first_beats: Fact = None


def from_rest(simulator: Simulator, values: Values, frequencies: Mapping[str, float]) -> dict[str, FromRest]:
    """Swims from rest, the motor turning from angle 0, in one batch.

    Each lasts an even number of periods, 6 s at least; the second half tells the speed.

    Args:
        simulator: Simulator of the robot.
        values: Values of its parameters, by name.
        frequencies: Frequencies of the motor, by name of the swim [Hz].
    """
    trials = simulator.simulate(values, swims_from_rest(frequencies))
    return {trial.name: settled(trial, frequencies[trial.name]) for trial in trials}


def swims_from_rest(frequencies: Mapping[str, float]) -> list[Swim]:
    """Swims that `from_rest` requests of a simulator."""
    return [Swim(name, Actuation(f), 2 * math.ceil(_SETTLING * f) / f) for name, f in frequencies.items()]


def backward_from_rest(found: Mapping[str, FromRest]) -> str | None:
    """A warning that names the frequencies at which a fit swims tail first or diverges from rest; None without any.

    Args:
        found: Swims from rest, by trial.
    """
    faults = {
        "swims tail first": [one.frequency for one in found.values() if (one.speed or 0.0) < 0],
        "diverges": [one.frequency for one in found.values() if one.divergence],
    }
    said = [f"{fault} at {', '.join(f'{f:.2f}' for f in sorted(at))} Hz" for fault, at in faults.items() if at]
    if not said:
        return None
    return (
        f"unusable: from rest, where a policy and the robot begin, this fit {' and '.join(said)}; "
        f"train no policy in it, calibrate with --protocol motion or another seed"
    )


def settled(trial: Trial, frequency: float) -> FromRest:
    """Result of one of those swims.

    Args:
        trial: The simulated swim.
        frequency: Frequency of its motor [Hz].
    """
    if trial.divergence:
        return FromRest(frequency, None, trial.divergence)
    times, positions = trial.track.times, trial.track.positions
    early, late = times <= 2 / frequency, times >= times[-1] / 2
    first, last = (MarkerTrack(times[part], positions[part]).speed for part in (early, late))
    return FromRest(frequency, last, None, first)


def backward_at_first(trial: Trial, frequency: float) -> float:
    """Distance that a swim from rest goes backward in its second beat [m]; 0 where it doesn't, or diverged.

    As the parameters change this changes smoothly, where the settled speed jumps. By a threshold of this way alone 98 %
    of 250 swims near a fit of the fish that rolls settle head first or tail first.

    Args:
        trial: The simulated swim.
        frequency: Frequency of its motor [Hz].
    """
    if trial.divergence:
        return 0.0
    middles = trial.track.positions[:, :, 0].mean(axis=1)  # a robot moves toward -x of its frame
    first, second = np.interp([1 / frequency, 2 / frequency], trial.track.times, middles)
    return max(float(second - first), 0.0)

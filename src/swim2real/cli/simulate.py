"""`simulate`."""

from __future__ import annotations

import numpy as np

from swim2real.cli import tables
from swim2real.cli.arguments import Simulate
from swim2real.cli.calibrate import threads
from swim2real.cli.subject import robot_for, values_of
from swim2real.errors import ArgumentError, EngineError
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation

_START_SPEED = 0.1  # m/s, a first guess from which the steady cycle is found


def simulate(a: Simulate) -> int:
    """Writes the markers of simulated swims."""
    for name, value in (("--seconds", a.seconds), ("--rate", a.rate)):
        if not (np.isfinite(value) and value > 0):
            raise ArgumentError(f"{name} is {value}; it must be above 0")
    if not a.frequency:
        raise ArgumentError("give at least one --frequency in Hz")
    for frequency in a.frequency:
        if not (np.isfinite(frequency) and frequency > 0):
            raise ArgumentError(f"--frequency is {frequency:g}; it must be finite and above 0")
    robot = robot_for(a.parameters)
    simulator = Simulator(robot, threads(a.threads), sample_interval=1 / a.rate)
    values = values_of(a.parameters, simulator)
    start = None if a.from_rest else _START_SPEED
    # a whole number of intervals, so that samples are exactly 1 / rate apart
    count = max(1, round(a.seconds * a.rate))
    swims = [Swim(f"{f:g} Hz", Actuation(f, 0.0, start), count / a.rate) for f in a.frequency]
    trials = simulator.simulate(values, swims)
    for trial in trials:
        if trial.divergence:
            raise EngineError(f"{trial.name}: {trial.divergence}; nothing was written")
    try:
        with a.out.open("wb") as file:
            np.savez_compressed(
                file,
                times=trials.trials[0].track.times,
                frequencies=np.array(a.frequency),
                markers=np.stack([trial.track.positions for trial in trials]),
                marker_names=np.array(robot.marker_names),
            )
    except OSError as error:
        raise ArgumentError(f"--out '{a.out}' can't be written: {error.strerror or error}") from error
    tables.table("Simulated", ("swim", "speed mm/s"), [(t.name, tables.millimeters(t.track.speed)) for t in trials])
    tables.console.print(f"{a.out}: {len(trials)} swims of {count + 1} samples", soft_wrap=True)
    return 0

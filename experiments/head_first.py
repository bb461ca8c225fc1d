"""Do all sets that fit nearly as well swim head first from rest, at frequencies that weren't fitted as well?

    swim2real ensemble runs/* --reference tracks --out sets.json --count 100 --within 1.2
    python experiments/head_first.py sets.json

Prints, per frequency, how many sets do, and the spread of their speeds from rest over the last three of twelve beats.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from markertrack.track import MarkerTrack
from swim2real.robots import load_robot
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation

FREQUENCIES, BEATS = np.linspace(0.35, 1.7, 10), 12


def late(track):
    """Times and positions over the last three beats."""
    kept = track.times >= track.duration * (BEATS - 3) / BEATS
    return track.times[kept], track.positions[kept]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("ensemble", type=Path)
    content = json.loads(parser.parse_args().ensemble.read_text())
    simulator = Simulator(load_robot(content["robot"]))
    swims = [Swim(f"{f:.2f}", Actuation(float(f)), BEATS / float(f)) for f in FREQUENCIES]
    speeds = []
    for member in content["members"]:
        trials = simulator.simulate(member["parameters"], swims)
        swims_late = (MarkerTrack(*late(t.track)) for t in trials)
        speeds.append([track.speed for track in swims_late])
    for f, column in zip(FREQUENCIES, 1e3 * np.array(speeds).T, strict=True):
        low, middle, high = np.quantile(column, (0, 0.5, 1))
        print(f"{f:.2f} Hz  {np.sum(column > 0):3d} of {len(column)} head first, {low:.0f} to {high:.0f}, "
              f"median {middle:.0f} mm/s")  # fmt: skip


if __name__ == "__main__":
    main()

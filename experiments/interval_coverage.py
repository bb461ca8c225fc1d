"""How often the intervals that `identify` gives hold the truth, on problems whose hidden values are known.

    python experiments/interval_coverage.py --problems demo hidden-0 hidden-1 finger snake --evaluations 500

Searches each problem of `race_problems.py` with multi-start, begun at random, then draws the sets that fit as
`swim2real identify` does. Prints, by problem and in all, how many hidden values lie within the 50 and the 95 %
intervals, the widths of these, and the seconds of processor time for the search and for the sets. `--seeds` repeats
both with other random choices.
"""

import argparse
import time

import numpy as np
from race_problems import NAMES, Missing, load

from swim2real.identification.evaluated import evaluated, independent_numbers
from swim2real.identification.identifiability import interval
from swim2real.identification.posterior import draw, first_points
from swim2real.optimizers import Evaluation
from swim2real.pipeline.methods import make_optimizer
from swim2real.settings import CalibrationSettings, IdentifiabilitySettings


def searched(race, seed, count):
    """Points that a search evaluates, with their losses."""
    settings = CalibrationSettings(seed=seed, first="random")
    optimizer, record = make_optimizer(settings, race.problem.robot, race.space), []
    while len(record) < count and not optimizer.done:
        candidate = optimizer.ask()
        found = race.problem.evaluate(race.space.to_values(candidate.point))
        failed = found.divergence is not None
        stages = () if failed else found.residual_stages()
        optimizer.tell(Evaluation(candidate, found.loss, failed, stages=stages))
        record.append((candidate.point, found.loss))
    return record


def covered(race, record, seed):
    """Whether each hidden value is in its 50 and 95 % interval, and the widths. Shapes (d,)."""
    blocks = race.problem.blocks()
    posterior = draw(
        lambda points: evaluated(race.problem, race.space, points),
        first_points(record),
        lambda residual: independent_numbers(residual, blocks),
        IdentifiabilitySettings().rounds,
        seed,
    )
    truth = race.space.to_cube(race.truth)
    (first, third), (low, high) = (interval(posterior.draws, share) for share in ("50", "95"))
    return (first <= truth) & (truth <= third), (low <= truth) & (truth <= high), high - low


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", nargs="+", default=[name for name in NAMES if not name.startswith("fish")])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--evaluations", type=int, default=500)
    parser.add_argument("--demo", help="folder `reference` of a demo that was filmed and tracked")
    a = parser.parse_args()
    inside, within = [], []
    for name in a.problems:
        try:
            race = load(name, threads=1, demo=a.demo)
        except Missing as why:
            print(f"{name}: left out, {why}", flush=True)
            continue
        for seed in a.seeds:
            begun = time.process_time()
            record = searched(race, seed, a.evaluations)
            middle = time.process_time()
            half, most, widths = covered(race, record, seed)
            inside.extend(half)
            within.extend(most)
            print(
                f"{name}, seed {seed}: {half.sum()} and {most.sum()} of {len(most)}; median width "
                f"{100 * np.median(widths):.0f} %; search {1e3 * min(loss for _, loss in record):.2f} mm (hidden "
                f"{1e3 * race.target:.2f}), {middle - begun:.0f} s, sets {time.process_time() - middle:.0f} s",
                flush=True,
            )
    print(f"in all {100 * np.mean(inside):.0f} % in the 50 % intervals, {100 * np.mean(within):.0f} % in the 95 % ones")


if __name__ == "__main__":
    main()

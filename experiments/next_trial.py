"""Whether the trial that `next` proposes narrows the sets more than others do, on problems with hidden values.

    python experiments/next_trial.py --problems hidden-1 finger --evaluations 400

Searches each problem of `race_problems.py` and draws the sets that fit, as in `interval_coverage.py`. Then adds a
trial, made of the hidden values as the others were (camera, noise, and what the model lacks), and draws again: the
proposed one, some at random among the other new ones, and a repetition. Prints for each the volume of the sets, the
product of their standard deviations along their principal axes, relative to that before: as expected, and as drawn.
Also, how far the hidden values are from the sets' middle, as the root mean square over parameters, in shares of the
ranges. A trial's weight follows from what fits leave, so it changes with a new trial that the model
explains worse, and the volume with it; the third number is without that.
"""

import argparse
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
from interval_coverage import searched
from race_problems import CAMERA, EXAMPLES, SECONDS, _code, load

from swim2real.demo import synthetic_reference
from swim2real.identification.evaluated import evaluated, independent_numbers
from swim2real.identification.next_trial import FittingSets, judged_trials
from swim2real.identification.possible_trials import possible_trials
from swim2real.identification.posterior import draw, first_points
from swim2real.robots.fish import FISH
from swim2real.trials import TrialSet

KEPT, AGAIN = 200, 48  # draws, as a study keeps them; those with which the sets are drawn again


def drawn(problem, space, first, rounds, seed):
    """Sets that fit."""
    blocks = problem.blocks()
    independent = partial(independent_numbers, blocks=blocks)
    return draw(lambda points: evaluated(problem, space, points), first, independent, rounds, seed)


def volume(draws):
    """Logarithm of the product of standard deviations along the principal axes."""
    return 0.5 * np.linalg.slogdet(np.cov(draws.T))[1]


def enlarged(race, possible, seed):
    """The problem with one trial more, of the same robot before the same camera."""
    problem, trial = race.problem, possible.trial
    if race.name.startswith("hidden"):
        frequency = possible.request.actuation.frequency
        film = synthetic_reference(FISH, race.truth, [frequency], SECONDS, CAMERA, seed).trials[0]
    else:
        code = _code(EXAMPLES / race.name / "make_data.py")
        take = code.Take("next", trial.track.duration, trial.nominal_frequency, trial.controls)
        film = replace(code.LAB, seed=seed).record([take]).trials[0]
    return problem.of(TrialSet((*problem.trials, replace(film, name="next")), problem.robot.marker_names))


def report(race, a):
    """A line for each added trial."""
    problem, space, rng = race.problem, race.space, np.random.default_rng(a.seed)
    first = first_points(searched(race, a.seed, a.evaluations))
    before = drawn(problem, space, first, a.rounds, a.seed)
    sets = FittingSets(
        before.draws[:: len(before.draws) // KEPT], before.lowest.point, before.weight / len(problem.trials)
    )
    possible = possible_trials(problem, space.to_values(sets.lowest))
    run = SimpleNamespace(problem=problem, space=space)
    judged = [one for one in judged_trials(run, sets, possible, a.seed) if not one.reason]
    ranked = sorted(judged, key=lambda one: one.volume)
    new, repeats = (
        [one for one in ranked[1:] if one.possible.label.startswith("repeat") is old] for old in (False, True)
    )
    chosen = [("proposed", ranked[0]), *(("random", new[i]) for i in rng.permutation(len(new))[: a.random])]
    chosen += [("repetition", repeats[rng.integers(len(repeats))])]
    print("; ".join(f"{one.possible.label}: {one.volume:.3g}" for one in ranked), flush=True)
    truth = space.to_cube(race.truth)
    print(f"{race.name}: {before.determined:.1f} of {len(space)} determined; off by {off(before.draws, truth):.3f}")
    for kind, one in chosen:
        more = enlarged(race, one.possible, 1000 + a.seed)
        again = [before.lowest.point, *before.draws[rng.choice(len(before.draws), AGAIN, replace=False)]]
        after = drawn(more, space, [*again, *first_points([(before.lowest.point, 1.0)])[1:]], a.again, a.seed)
        sharper = after.weight / len(more.trials) / sets.weight
        got = np.exp(volume(after.draws) - volume(before.draws))
        same = got * sharper ** (after.determined / 2)
        print(f"{race.name}: {kind}, {one.possible.label}: expected {one.volume:.3g}, drawn {got:.3g}, with the weight")
        print(
            f"    as before {same:.3g}; weight {sharper:.2f} of before, off by {off(after.draws, truth):.3f}",
            flush=True,
        )


def off(draws, truth):
    """Root mean square distance of the middle of sets from the hidden values."""
    return float(np.sqrt(np.mean((np.median(draws, axis=0) - truth) ** 2)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", nargs="+", default=["hidden-1", "finger"])
    parser.add_argument("--evaluations", type=int, default=400, help="of the search")
    parser.add_argument("--rounds", type=int, default=6, help="of the sets before")
    parser.add_argument("--again", type=int, default=4, help="rounds of the sets with a trial more")
    parser.add_argument("--random", type=int, default=2, help="trials at random")
    parser.add_argument("--seed", type=int, default=0)
    a = parser.parse_args()
    for name in a.problems:
        report(load(name, threads=1), a)


if __name__ == "__main__":
    main()

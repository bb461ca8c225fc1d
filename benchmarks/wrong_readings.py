"""Trials that are read wrongly, drawn at random: which does `check` name, and which right ones does it doubt?

    python benchmarks/wrong_readings.py --wrong 20 --right 50 [--robots finger snake arm ROBOT.toml]

Each case records a robot whose parameters are drawn about the model's own (up to a third of their ranges beside them)
in three trials with random commands and noise. A wrong case then gets one mistake: of a kind, in a stream, in a file or
in all. Prints a line per case, and how many of them were named and doubted.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from markertrack.track import MarkerTrack
from swim2real.checks.mistakes import judged
from swim2real.checks.probing import swing
from swim2real.checks.resting import started
from swim2real.robots import load_robot
from swim2real.simulation import PlaybackSimulator
from swim2real.simulation.playback import Rollout
from swim2real.trials import Signals, Trial, TrialSet

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
TRIALS, SECONDS, FPS, RATE = 3, 3.0, 60.0, 100.0
NOISE, READ_NOISE = 3e-4, 0.02  # m, and of a reading's spread
BESIDE, BESIDE_WRONG = 0.35, 0.25  # of the parameters' ranges, of right cases and of wrong ones


def commanded(robot, rng):
    """A trial without markers: sines within the actuators' ranges, some of them in steps."""
    times, ticks, frequency = np.arange(0, SECONDS, 1 / FPS), np.arange(0, SECONDS, 1 / RATE), rng.uniform(0.4, 2.0)
    names, columns = [name for name, drive in robot.trials.controls.items() if drive.table], []
    for number, name in enumerate(names):
        column = swing(robot.model.actuator(name), ticks, number, rng.uniform(0.5, 1.0), frequency)
        if rng.random() < 0.4:
            held = rng.uniform(0.3, 0.8)
            column = column[(np.floor(ticks / held) * held * RATE).astype(int)]
        columns.append(column)
    controls = Signals(ticks, names, np.stack(columns, axis=1)) if names else None
    nowhere = np.full((len(times), len(robot.marker_names), 2), np.nan)
    return MarkerTrack(times, nowhere), frequency, controls


def recorded(robot, rng, beside):
    """What a robot with hidden parameters does."""
    resting = PlaybackSimulator(replace(robot, trials=replace(robot.trials, start="rest")))
    middle = robot.space.to_cube(robot.space.published)
    while True:
        hidden = robot.space.to_values(np.clip(middle + rng.uniform(-beside, beside, len(middle)), 0.05, 0.95))
        asked = [commanded(robot, rng) for _ in range(TRIALS)]
        blanks = [Trial(f"t{k}", track, f, controls=table) for k, (track, f, table) in enumerate(asked)]
        made = resting.simulate(hidden, [Rollout(blank) for blank in blanks])
        if not any(one.divergence for one in made):
            break
    trials = []
    for blank, one in zip(blanks, made, strict=True):
        seen = one.track.positions + NOISE * rng.standard_normal(one.track.positions.shape)
        sensors = one.sensors
        if sensors is not None:
            noise = READ_NOISE * sensors.values.std(axis=0) * rng.standard_normal(sensors.values.shape)
            sensors = replace(sensors, values=sensors.values + noise)
        trials.append(replace(blank, track=MarkerTrack(one.track.times, seen), sensors=sensors))
    return TrialSet(tuple(trials), robot.marker_names)


def kinds(robot, trials, rng):
    """Mistakes that these trials can have, with the words by which they must be named, and what makes them."""

    def table(kind, change):
        def made(trial):
            signals, values = getattr(trial, kind), getattr(trial, kind).values.copy()
            return replace(trial, **{kind: replace(signals, values=change(values))})

        return made

    def late(kind, seconds):
        return lambda one: replace(one, **{kind: replace(getattr(one, kind), times=getattr(one, kind).times + seconds)})

    def placed(change):
        return lambda one: replace(one, track=MarkerTrack(one.track.times, change(one.track.positions)))

    def swapped(kind, i, j):
        def change(values):
            values[:, [i, j]] = values[:, [j, i]]
            return values

        return table(kind, change)

    def negated(kind, i):
        return table(kind, lambda values: values * np.where(np.arange(values.shape[1]) == i, -1, 1))

    ratio, shift = rng.choice([1.2, 2.0, 2.4, 4.0, 0.5]), rng.choice([-0.3, 0.25, 0.4])
    for kind, said in (("controls", "commands"), ("sensors", "readings")):
        signals = getattr(trials[0], kind)
        if signals is None:
            continue
        i, *others = rng.permutation(len(signals.names))
        name = signals.names[i]
        yield f"{said}: sign of {name}", ("other sign", "mirror"), negated(kind, i)
        yield f"{said}: degrees", ("degrees", "57.3"), table(kind, np.rad2deg)
        yield f"{said}: {shift} s late", ("late", "early"), late(kind, shift)
        if others:
            yield f"{said}: {name} swapped", ("swapped",), swapped(kind, i, others[0])
        tables = {"t0": getattr(trials[1], kind), "t1": signals}
        exchanged = lambda one, kind=kind, of=tables: replace(one, **{kind: of.get(one.name, getattr(one, kind))})  # noqa: E731
        yield f"{said}: files exchanged", ("exchanged",), exchanged
    if robot.marker_names:
        yield "markers: mm", ("mm", "millimeters"), placed(lambda places: 1e3 * places)
        slow = lambda one: replace(one, track=MarkerTrack(ratio * one.track.times, one.track.positions))  # noqa: E731
        yield f"film: {ratio} times slower", ("times as long",), slow
        if robot.trials.frame is None:
            yield "markers: y down", ("upside down", "mirror", "180 degrees"), placed(lambda places: places * [1, -1])
            yield "markers: pixels", ("pixels", "times as far apart"), placed(lambda p: p * [2e3, -2e3] + [640, 360])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="+", default=["finger", "snake", "arm"])
    parser.add_argument("--wrong", type=int, default=20)
    parser.add_argument("--right", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    a = parser.parse_args()
    robots = [load_robot(EXAMPLES / name / f"{name}.toml" if name.isalpha() else name) for name in a.robots]
    named = doubted = 0
    for case in range(a.wrong + a.right):
        robot, rng, wrong = robots[case % len(robots)], np.random.default_rng([a.seed, case]), case < a.wrong
        trials, what, words = recorded(robot, rng, BESIDE_WRONG if wrong else BESIDE), "right", ()
        if wrong:
            every = list(kinds(robot, trials.trials, rng))
            what, words, change = every[rng.integers(len(every))]
            only = int(rng.integers(TRIALS)) if rng.random() < 0.3 and "exchanged" not in what else None
            made = [change(one) if only in (None, k) else one for k, one in enumerate(trials)]
            trials, what = replace(trials, trials=tuple(made)), what if only is None else f"{what}, in t{only} only"
        begun = time.process_time()
        verdict = judged(started(robot, trials), trials)
        found = any(word in doubt for doubt in verdict.doubts for word in words)
        named, doubted = named + found, doubted + (not wrong and bool(verdict.doubts))
        said = " | ".join(verdict.doubts) or verdict.summary(trials.names)
        mark = "ok" if found or not (wrong or verdict.doubts) else "MISSED" if wrong else "DOUBTED"
        print(f"{mark:8}{robot.name}: {what} [{time.process_time() - begun:.0f} s]: {said}", flush=True)
    print(f"{named} of {a.wrong} wrong cases named, {doubted} of {a.right} right cases doubted")


if __name__ == "__main__":
    main()

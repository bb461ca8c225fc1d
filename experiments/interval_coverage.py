"""How often the intervals that `identify` gives hold the truth, with each kind of start.

    python experiments/interval_coverage.py --sets 10

Robots: the double pendulum of recordings.py with three parameters, that swings from rest or is filmed in motion, with
hidden values drawn within a factor of two of the model's and noise of 0.3 mm. Starts: given (the pose at rest is on
record), markers (the pose of the first frames), fitted. Prints, for each start, how many of the parameters lie within
one and two standard errors, and within the profile's interval.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from recordings import LINES, NOISE, PENDULUM, STARTS

from swim2real.identification.finished_run import reopen
from swim2real.identification.identifiability import identify
from swim2real.pipeline import calibrate
from swim2real.robots import load_robot
from swim2real.settings import CalibrationSettings
from swim2real.simulation import PlaybackSimulator
from swim2real.simulation.playback import Rollout
from swim2real.trials import MarkerTrack, Trial, TrialSet

SITES = ("pivot", "middle", "end")
PARAMETERS = ("shoulder_damping", "elbow_damping", "lower_mass")  # the upper mass is weighed
SECONDS, FPS = 2.0, 60.0


def robot_with(start, folder):
    (folder / "pendulum.xml").write_text(PENDULUM)
    text = "format = 1\nname = 'pendulum'\ndescription = 'Swings down.'\nmodel = 'pendulum.xml'\ncamera = 'side'\n"
    text += f"markers = {list(SITES)}\n[recordings]\nstart = '{start}'\n"
    for key in PARAMETERS:
        line, lower, upper = LINES["pendulum"][key]
        text += f"[[parameters]]\nname = '{key}'\nlower = {lower}\nupper = {upper}\nscale = 'log'\nmeaning = '{key}'\n"
        text += f"targets = '{line}'\n"
    (folder / f"{start}.toml").write_text(text)
    return load_robot(folder / f"{start}.toml")


def filmed(robot, hidden, rng, moving):
    """Trials of the hidden pendulum; moving ones begin a little after it was let go."""
    resting = replace(robot, trials=replace(robot.recordings, start="rest"))
    times, trials = np.arange(0, SECONDS, 1 / FPS), []
    for number, start in enumerate(STARTS["pendulum"]):
        seen_at = times + (0.2567 if moving else 0.0)
        stamps = seen_at if seen_at[0] == 0 else np.concatenate([[0.0], seen_at])
        nowhere = np.full((len(stamps), len(SITES), 2), np.nan)
        (made,) = PlaybackSimulator(resting).simulate(
            hidden, [Rollout(Trial(f"{number}", MarkerTrack(stamps, nowhere), start=start))]
        )
        seen = made.track.positions[-len(times) :]
        seen = seen + rng.normal(0, NOISE, seen.shape)
        trials.append(Trial(f"{number}", MarkerTrack(times, seen), start={} if moving else start))
    return TrialSet(tuple(trials), robot.marker_names)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=10)
    parser.add_argument("--starts", nargs="+", default=["rest", "markers", "fitted"])
    a = parser.parse_args()
    for start in a.starts:
        within = np.zeros(3, dtype=int)
        wrong = []
        for number in range(a.sets):
            with tempfile.TemporaryDirectory() as name:
                folder, rng = Path(name), np.random.default_rng(number)
                robot = robot_with(start, folder)
                model = robot.space.published
                hidden = {key: float(model[key] * 2 ** rng.uniform(-1, 1)) for key in PARAMETERS}
                reference = filmed(robot, hidden, rng, moving=start != "rest")
                settings = CalibrationSettings(budget=40, horizon=SECONDS, threads=1)
                calibrate(reference, robot, settings, folder / "run")
                study = identify(reopen(folder / "run", reference, robot, threads=1))
                truth, fit = robot.space.to_cube(hidden), np.array(study["fit"]["point"])
                for i, key in enumerate(PARAMETERS):
                    error = study["local"]["standard_errors"][key]["cube"] or np.inf
                    off = abs(fit[i] - truth[i])
                    low, high = study["profiles"][key]["interval"]
                    held = (off <= error, off <= 2 * error, low <= truth[i] <= high)
                    within += held
                    if not held[1]:
                        wrong.append(
                            f"{key} {100 * np.expm1(np.log(robot.space.to_values(fit)[key] / hidden[key])):+.1f} %"
                        )
        share = [f"{100 * count / (len(PARAMETERS) * a.sets):.0f} %" for count in within]
        print(f"{start}: {share[0]} within one standard error, {share[1]} within two, {share[2]} in the interval")
        print(f"  beyond two: {', '.join(wrong) or 'none'}", flush=True)


if __name__ == "__main__":
    main()

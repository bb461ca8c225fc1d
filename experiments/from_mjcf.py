"""From a stranger's MJCF to values, without an edit: `init`, `check`, `calibrate` on trials of hidden values.

    python experiments/from_mjcf.py FOLDER --names swimmer fish

FOLDER holds swimmer.xml (gymnasium/envs/mujoco/assets), fish.xml, dm_swimmer.xml and finger.xml (dm_control/suite;
the swimmer as its swimmer.py makes it) and car.xml (MuJoCo's model/car). Each gets markers (sites), or encoders in
their place, and hidden changes; four trials from rest are recorded with noise, the last of which is held out. Commands
are run as by a person; what they print is in log.txt of each folder of --out. Prints the losses [mm] of the
hidden values, of the model's own and of what was found, and the intervals beside what was hidden.
"""

import argparse
import json
import re
import subprocess
import sys
import time
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from markertrack.track import MarkerTrack
from swim2real.calibration import Problem
from swim2real.robots import load_robot
from swim2real.settings import CalibrationSettings
from swim2real.simulation import PlaybackSimulator
from swim2real.simulation.playback import Rollout
from swim2real.trials import Trial, TrialSet, load_reference, save_reference
from swim2real.trials.signals import Signals

SECONDS, FPS, NOISE, READING_NOISE = 4.0, 60.0, 5e-4, 2e-3


@dataclass(frozen=True)
class Case:
    """A model.

    Attributes:
        sites: Body and place [m] of each marker.
        encoded: Joints with encoders.
        hidden: Kind, name, attribute and factor, or value where the model has 0.
        swings: For each trial the amplitude, as a share of the range, and frequency [Hz] of the commands.
    """

    sites: dict
    encoded: tuple
    hidden: tuple
    swings: tuple = ((0.8, 0.5), (0.5, 1.0), (0.9, 1.6), (0.7, 0.8))


CASES = {
    "swimmer": Case(
        {"nose": ("torso", [1.5, 0, 0]), "neck": ("torso", [0.6, 0, 0]), "middle": ("mid", [-0.5, 0, 0]),
         "back": ("back", [-0.2, 0, 0]), "tail": ("back", [-1, 0, 0])},
        ("motor1_rot", "motor2_rot"),
        (("option", "", "density", 0.65), ("option", "", "viscosity", 5.0), ("actuator", "*", "gear", 0.73),
         ("joint", "motor", "armature", 3.0)),
    ),
    "fish": Case(
        {"nose": ("torso", [0, 0.07, 0.04]), "hump": ("torso", [0, -0.06, 0.04]), "stem": ("tail1", [0, 0, 0.016]),
         "tip": ("tail2", [0, -0.018, 0.035])},
        ("tail1", "tail_twist", "tail2", "finright_roll", "finleft_roll"),
        (("option", "", "density", 0.64), ("joint", "tail", "damping", 3.0), ("joint", "tail2", "stiffness", 2.5),
         ("actuator", "tail", "kp", 2.2)),
    ),
    "dm_swimmer": Case(
        {"front": ("head", [0, -0.05, 0]), "rear": ("head", [0, 0.04, 0]), "first": ("segment_1", [0, 0, 0]),
         "last": ("segment_3", [0, 0.05, 0])},
        ("joint_0", "joint_1", "joint_2", "joint_3"),
        (("option", "", "density", 0.6), ("actuator", "*", "gear", 1.7), ("joint", "joint_", "armature", 4.0)),
    ),
    "finger": Case(
        {"knuckle": ("proximal", [0, -0.03, -0.09]), "joint": ("distal", [0, -0.03, 0]),
         "nail": ("distal", [0, -0.03, -0.16]),
         "rim": ("spinner", [0.06, -0.05, 0])},
        ("proximal", "distal", "hinge"),
        (("joint", "proximal", "damping", 0.5), ("joint", "distal", "damping", 0.6), ("joint", "hinge", "damping", 2.0),
         ("actuator", "proximal", "gear", 1.5), ("actuator", "distal", "gear", 0.7)),
    ),
    "car": Case(
        {"left": ("car", [0, 0.05, 0.02]), "right": ("car", [0, -0.05, 0.02]), "bow": ("car", [0.08, 0, 0.02])},
        ("left", "right"),
        (("joint", "", "damping", 0.5), ("actuator", "*", "gear", 1.4)),
    ),
}  # fmt: skip


def scaled(spec, kind, name, attribute, factor):
    """Applies a hidden change."""
    if kind == "option":
        setattr(spec.option, attribute, factor * getattr(spec.option, attribute))
    elif kind == "joint":
        for joint in spec.joints:
            if joint.name.startswith(name) and joint.type != mujoco.mjtJoint.mjJNT_FREE:
                value = getattr(joint, attribute)
                if np.ndim(value):
                    value[0] = factor * value[0]
                else:
                    setattr(joint, attribute, factor * value)
    else:
        for actuator in spec.actuators:
            if name not in ("*", actuator.name):
                continue
            if attribute == "gear":
                actuator.gear[0] *= factor
            else:
                actuator.gainprm[0] *= factor
                actuator.biasprm[1] *= factor


def models(path, name, case, folder, encoders):
    """Writes the model with markers or encoders, and the same with the hidden changes."""
    spec = mujoco.MjSpec.from_file(str(path))
    for one in [*spec.sensors, *spec.sites]:  # of a task that nobody films
        spec.delete(one)
    if encoders:
        for joint in case.encoded:
            spec.add_sensor(
                name=f"e_{joint}", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT,
                objname=joint,
            )  # fmt: skip
    for site, (body, place) in {} if encoders else case.sites.items():
        spec.body(body).add_site(name=site, pos=place)
    spec.compile()
    (folder / f"{name}.xml").write_text(spec.to_xml())
    made = mujoco.MjSpec.from_file(str(folder / f"{name}.xml"))
    for change in case.hidden:
        scaled(made, *change)
    made.compile()
    (folder / "hidden.xml").write_text(made.to_xml())


def run(folder, *arguments):
    """Runs a command; what it printed and how long it took [s]. Ends the program where it fails."""
    words, began = list(map(str, arguments)), time.monotonic()
    done = subprocess.run([sys.executable, "-m", "swim2real", *words], capture_output=True, text=True, cwd=folder)
    seconds = time.monotonic() - began
    with (folder / "log.txt").open("a") as log:
        log.write(f"\n$ swim2real {' '.join(words)}   # {seconds:.0f} s\n{done.stdout}{done.stderr}")
    if done.returncode and words[0] != "check":
        sys.exit(f"{folder}: {words[0]} failed: {done.stderr[-500:]}")
    return done.stdout, seconds


def recorded(robot, swings):
    """What a camera or encoders see of the hidden robot."""
    model, rng = robot.model, np.random.default_rng(0)
    times, ticks, trials = np.arange(0, SECONDS, 1 / FPS), np.arange(0, SECONDS, 0.02), []
    driven = [name for name, drive in robot.trials.controls.items() if drive.table]
    still = replace(robot, trials=replace(robot.trials, start="rest"))
    for number, (share, frequency) in enumerate(swings):
        columns = []
        for i, name in enumerate(driven):
            actuator = model.actuator(name)
            low, high = actuator.ctrlrange if actuator.ctrllimited[0] else (-1.0, 1.0)
            wave = np.sin(2 * np.pi * frequency * ticks - 1.3 * i * (1 + 0.3 * number))
            columns.append((low + high) / 2 + share * (high - low) / 2 * wave)
        nothing = np.full((len(times), len(robot.marker_names), 2), np.nan)
        commands = Signals(ticks, driven, np.stack(columns, axis=1))
        trial = Trial(f"trial{number}", MarkerTrack(times, nothing), controls=commands)
        (made,) = PlaybackSimulator(still).simulate(robot.space.published, [Rollout(trial)])
        seen = made.track.positions + rng.normal(0, NOISE, made.track.positions.shape)
        sensors = made.sensors
        if sensors is not None:
            noise = rng.normal(0, READING_NOISE, sensors.values.shape)
            sensors = replace(sensors, values=sensors.values + noise)
        trials.append(replace(trial, track=MarkerTrack(times, seen), sensors=sensors))
    return TrialSet(tuple(trials), robot.marker_names)


def truths(robot, folder, case):
    """What each parameter of the drafted file is in the hidden robot; of relative ones the factor."""
    tables = tomllib.loads((folder / "hidden.toml").read_text())["parameters"]
    values = dict(robot.space.published)
    for table in tables:
        if isinstance(table["targets"], dict):
            line = table["targets"]["to"]
            factors = [f for kind, name, attribute, f in case.hidden
                       if line.startswith(kind) and attribute in line and name.strip("*") in line]  # fmt: skip
            values[table["name"]] = factors[0] if factors else 1.0
    return values


def studied(path, name, case, folder, encoders, minutes):
    """One model from its MJCF to the intervals of its parameters."""
    folder.mkdir(parents=True, exist_ok=True)
    models(path, name, case, folder, encoders)
    run(folder, "init", f"{name}.xml", "--force")
    text = (folder / f"{name}.toml").read_text()
    (folder / "hidden.toml").write_text(text.replace(f'"{name}.xml"', '"hidden.xml"'))
    truth, robot = (load_robot(folder / f"{one}.toml") for one in ("hidden", name))
    save_reference(recorded(truth, case.swings), folder / "reference")
    fitted, unseen = load_reference(folder / "reference").split(("trial3",))
    said, seconds = run(folder, "check", f"{name}.toml", "--reference", "reference")
    doubts = [line for line in said.splitlines() if line.startswith("Probably wrong")]
    advised = re.search(r"try --horizon\s+([0-9.]+)", said)
    horizon = float(advised[1].rstrip(".")) if advised else 4.0
    print(f"{folder.name}: check, {seconds:.0f} s: {doubts or 'fits'}, --horizon {horizon:g}", flush=True)
    losses = []
    for one in (truth, robot):
        problem = Problem.with_settings(one, fitted, CalibrationSettings(horizon=horizon))
        losses.append([1e3 * each.evaluate(one.space.published).loss for each in (problem, problem.of(unseen))])
    print(f"  {len(robot.space)} parameters; hidden {losses[0]}, the model's own {losses[1]}", flush=True)
    options = ("--out", "run", "--hold-out", "trial3", "--minutes", minutes, "--horizon", horizon)
    _, seconds = run(folder, "calibrate", "reference", "--robot", f"{name}.toml", *options)
    outcome = json.loads((folder / "run" / "outcome.json").read_text())
    shares = [1e3 * outcome[key]["loss"] / loss for key, loss in zip(("fit", "held_out"), losses[0], strict=True)]
    print(f"  calibrate, {seconds:.0f} s, {outcome['evaluations']} evaluations: {shares} times the hidden values' loss")
    _, seconds = run(folder, "identify", "run", "--reference", "reference")
    study = json.loads((folder / "run" / "identifiability.json").read_text())
    print(f"  identify, {seconds:.0f} s. {study['doubt']}")
    for key, value in truths(truth, folder, case).items():
        one = study["intervals"][key]
        low, high = one["interval_95"]
        missed = "" if low <= value <= high else ", missed"
        print(f"    {key}: {one['verdict']}, {low:.3g} to {high:.3g}, hidden {value:.3g}{missed}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", type=Path)
    parser.add_argument("--names", nargs="+", default=list(CASES))
    parser.add_argument("--out", type=Path, default=Path("runs/from-mjcf"))
    parser.add_argument("--minutes", default=5)
    parser.add_argument("--encoders", nargs="+", type=int, default=[0, 1])
    a = parser.parse_args()
    for name in a.names:
        for encoders in a.encoders:
            folder = (a.out / f"{name}{'-encoders' if encoders else ''}").resolve()
            studied(a.models / f"{name}.xml", name, CASES[name], folder, encoders, a.minutes)


if __name__ == "__main__":
    main()

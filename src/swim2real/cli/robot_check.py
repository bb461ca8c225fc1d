"""Output of `check` for a robot: tables, sentences and a picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from markertrack.drawing import to_pillow
from swim2real.calibration import Problem
from swim2real.checks.delays import delays
from swim2real.checks.effects import why_no_effect
from swim2real.checks.floating import afloat
from swim2real.checks.mistakes import judged
from swim2real.checks.probing import FAINT, SECONDS, TRIALS, Probe, Shift, growing, made_up_motion, probe
from swim2real.checks.reference import misfits, starts
from swim2real.checks.resting import better_starts, other_start, started
from swim2real.cli.tables import millimeters, table
from swim2real.cli.terminal import say
from swim2real.rendering.marker_map import marker_map
from swim2real.robots import ROBOTS, load_robot, robot_file
from swim2real.robots.drives import Drive
from swim2real.robots.file import PLANES, RobotFile, open_robot_file
from swim2real.robots.robot import Robot
from swim2real.settings import HORIZON
from swim2real.simulation.pose import MarkerView
from swim2real.simulation.start import STRETCH
from swim2real.trials import TrialSet, load_reference
from swimbase.errors import ArgumentError, EngineError, TrialError
from swimbase.store import writing


def check_robot(name: str, reference_folder: Path | None, out: Path | None, threads: int | None) -> bool:
    """Prints what a robot's parameters do, where its markers are and what drives it, and draws the markers.

    Args:
        name: Name of the robot, or its file.
        reference_folder: Real trials, None for none.
        out: Picture to write, None for one beside the robot file.
        threads: Simulations at a time, None for all cores.

    Returns:
        Whether nothing is wrong.
    """
    if Path(name).suffix == ".toml":
        open_robot_file(name, alone=True)  # before this process compiles it
    robot = load_robot(name)
    file = open_robot_file(robot_file(name))
    reference = None if reference_folder is None else load_reference(reference_folder)
    wrong = [] if reference is None else misfits(robot, reference)
    fits = not wrong
    try:
        probes = probe(robot, reference if fits else None, threads)
    except EngineError:  # it may be the trials' fault
        doubts = judged(robot, reference).doubts if reference is not None and fits else ()
        if not doubts:
            raise
        for sentence in doubts:
            say(f"Probably wrong: {sentence}.")
        return False
    _parameters(file, probes, bool(robot.marker_names))
    by = made_up_motion(robot)
    if fits and reference is not None:
        by = f"as in the trials of the reference ({', '.join(reference.names[:TRIALS])})"
    say(f"Moved for {SECONDS:g} s {by}.")
    if robot.marker_names:
        _markers(robot)
    _trials(robot)
    wrong += [*(sentence for result in probes for sentence in _wrong(file, robot, result)), *afloat(robot)]
    for sentence in (*wrong, *_notes(probes, bool(robot.marker_names))):
        say(sentence)
    if reference is not None and fits:
        begun = started(robot, reference)
        _starts(begun, reference)
        verdict = judged(begun, reference)
        doubts = list(verdict.doubts) or _doubts(robot, reference)
        for sentence in doubts:
            say(f"Probably wrong: {sentence}.")
        if not doubts:
            say(verdict.summary(reference.names))
            for sentence in delays(begun, reference, begun.space.published):
                say(f"{sentence[0].upper()}{sentence[1:]}.")
        wrong += doubts
    if robot.marker_names:
        _draw(robot, out or (Path(f"{name}.png") if name in ROBOTS else Path(name).with_suffix(".png")))
    return not wrong


def _parameters(file: RobotFile, probes: list[Probe], markers: bool) -> None:
    rows: list[tuple[str, ...]] = []
    for one, calibrated in zip(probes, file.calibrated, strict=True):
        p = one.parameter
        name = "\n  ".join([p.name, *map(str, (*calibrated.targets, *calibrated.delays))])
        rows.append((name, p.unit, f"{p.lower:g} to {p.upper:g}", f"{p.published:.4g}",
                     _cell(one.lower), _cell(one.upper)))  # fmt: skip
    columns = ("parameter, what it writes", "unit", "bounds", "value", "lower mm", "upper mm")
    moved = "moves the markers" if markers else "changes the sensors, in their meters_per_unit,"
    table(f"Parameters, and how far each bound {moved} on average", columns, rows)


def _cell(shift: Shift) -> str:
    return "–" if shift.failure else f"{1e3 * shift.distance:.3g}"


def _markers(robot: Robot) -> None:
    """Prints the markers' places in the world, from its origin; else from the first one."""
    right, up = ("xyz"[axis] for axis in robot.plane)
    places, origin = robot.rest_markers, f"marker {robot.marker_names[0]}"
    if robot.trials.frame is None:
        model = robot.model
        places = MarkerView(model, len(robot.marker_names), robot.plane).at(model.qpos0).markers
        origin = "the model's origin, which must be the camera file's"
    rows = [
        (name, f"{1e3 * x:.1f}", f"{1e3 * y:.1f}", millimeters(float(height)))
        for name, (x, y), height in zip(robot.marker_names, places, robot.marker_heights, strict=True)
    ]
    table(
        f"Markers at rest, seen from {_side(robot)}, from {origin} [mm]",
        ("marker", f"{right} to the right", f"{up} up", "height"),
        rows,
    )


def _starts(robot: Robot, reference: TrialSet) -> None:
    """Prints how each recording starts, and possible errors of the start."""
    rows: list[tuple[str, ...]] = []
    better = better_starts(robot, reference)
    for name, off in starts(robot, reference).items():
        ways, start = np.linalg.norm(off, axis=2), better.get(name)
        both = ("–",) * 3 if start is None else (f"{1e3 * start.rest:.2g}", f"{1e3 * start.fitted:.2g}", start.start)
        stretch = f"{1e3 * np.nanmean(ways):.2g}" if np.isfinite(ways).any() else "–"
        if not np.isfinite(ways[0]).any():
            rows.append((name, "–", "–", "no marker is seen", stretch, *both))
            continue
        worst = int(np.nanargmax(ways[0]))
        largest, mean = f"{1e3 * ways[0, worst]:.2g}", f"{1e3 * np.nanmean(ways[0]):.2g}"
        rows.append((name, mean, largest, robot.marker_names[worst], stretch, *both))
    if rows:
        columns = ("trial", "mean", "largest", "of marker", f"mean of the first {STRETCH:g} s", "from rest",
                   "from a fitted start", "better")  # fmt: skip
        table("Simulated markers, values of the file, from the real ones of the first frame [mm]", columns, rows)
    for line in growing(robot, reference, HORIZON):
        say(f"Warning: {line}.")
    proposal = other_start(robot, reference)
    if proposal is not None:
        say(f"{proposal}.")


def _doubts(robot: Robot, reference: TrialSet) -> list[str]:
    """Doubts about trials, and refusals that a calibration would give."""
    try:
        found = Problem(robot, reference).examinations()
    except TrialError as error:
        return [str(error)]
    return [f"trial '{name}': {doubt}" for name, one in found.items() for doubt in one["doubts"]]


def _side(robot: Robot) -> str:
    name = next(name for name, plane in PLANES.items() if plane == robot.plane)
    return "above" if name == "above" else f"the {name}"


def _trials(robot: Robot) -> None:
    trials = robot.trials
    model = robot.model
    actuators = [model.actuator(i).name for i in range(model.nu)]
    if actuators:
        rows = [(name or "(no name)", _driven_by(trials.controls.get(name))) for name in actuators]
        table("What drives a trial", ("actuator", "driven by"), rows)
    if trials.sensors:
        rows = [(sensor.name, sensor.unit, f"{1e3 * sensor.meters_per_unit:g}") for sensor in trials.sensors]
        table("Sensors", ("sensor", "unit", "one unit counts as mm"), rows)
    say(trials.summary(robot.marker_names))


def _driven_by(drive: Drive | None) -> str:
    if drive is None:
        return "nothing, so 0"
    if drive.table:
        return "its column of the trial's controls" + ", interpolated" * drive.interpolated
    if drive.speed:
        return "2π times the trial's frequency"
    if not drive.amplitude:
        return f"{drive.offset:g} in every trial"
    return f"{drive.amplitude:g} sin(2π f t{_signed(drive.phase)}){_signed(drive.offset)}, f of the trial"


def _signed(number: float) -> str:
    return "" if number == 0 else f" {'-' if number < 0 else '+'} {abs(number):g}"


def _wrong(file: RobotFile, robot: Robot, one: Probe) -> Iterator[str]:
    """Errors of a parameter."""
    refused = [why for why in (one.effect.lower, one.effect.upper, one.effect.undone) if why is not None]
    yield from refused
    if not refused and one.idle:
        shown = "moves no marker" if robot.marker_names else "changes no sensor"
        what = shown if one.parameter.name in robot.delays or one.effect.changes else "changes nothing of the model"
        why = why_no_effect(file, robot, one.parameter.name)
        yield f"{one.parameter.name} {what}{f': {why}' if why else ''}"


def _notes(probes: list[Probe], markers: bool) -> Iterator[str]:
    """Notes on the other parameters."""
    for one in probes:
        p = one.parameter
        for bound, refused, shift in ((p.lower, one.effect.lower, one.lower), (p.upper, one.effect.upper, one.upper)):
            if refused is None and shift.failure is not None:
                yield f"{p.name} = {bound:g}: {shift.failure}"
        if not one.idle and one.distance < FAINT:
            moved = "moves the markers" if markers else "changes the sensors"
            yield f"{p.name} hardly shows: it {moved} by less than {1e3 * FAINT:g} mm on average"


def _draw(robot: Robot, out: Path) -> None:
    """Writes the map of the markers."""
    right, up = ("xyz"[axis] for axis in robot.plane)
    title = f"{robot.name}: markers at rest, from {_side(robot)}"
    picture = to_pillow(marker_map(robot.rest_markers, robot.marker_names, robot.links, (right, up), title))
    with writing(out, ArgumentError, what="--out"):
        picture.save(out, "PNG", optimize=True)
    say(str(out))

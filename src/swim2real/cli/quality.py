"""`quality`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from swim2real.calibration import Problem
from swim2real.cli import tables
from swim2real.cli.arguments import Quality
from swim2real.errors import ArgumentError, TrialError
from swim2real.pipeline import check_lost
from swim2real.robots import robot_named
from swim2real.robots.robot import Robot
from swim2real.trials import TrialSet, load_reference

Content = dict[str, dict[str, Any]]


def quality(a: Quality) -> int:
    """Checks tracks, says what drove each trial, and refuses trials that shouldn't be used as they are."""
    allowed = float(a.allow_lost)
    if not 0 <= allowed <= 1:
        raise ArgumentError(f"--allow-lost is {allowed:g}; it is a share of frames within 0 and 1, such as 0.05")
    robot, reference = robot_named(a.robot), load_reference(a.reference)
    content, blank = _examined(reference, robot)
    lost = {name: _lost(found, robot, allowed) for name, found in content.items()}
    refused = {name: shares for name, shares in lost.items() if shares}
    for name in content:
        content[name]["usable"] = name not in refused
    if a.json:
        print(
            json.dumps({**content, **{name: {"error": why, "usable": False} for name, why in blank.items()}}, indent=2)
        )
    else:
        _print(content, robot)
        for why in blank.values():
            tables.console.print(why, soft_wrap=True, markup=False)
        if refused:
            tables.console.print(_refusal(refused, allowed))
    if a.plot is not None:
        from swim2real.report import write_quality_page

        checked = [(trial, check_lost(trial.track, robot)) for trial in reference if trial.name in content]
        try:
            write_quality_page(checked, robot.marker_names, a.plot)
        except OSError as error:
            raise ArgumentError(f"--plot '{a.plot}' can't be written: {error.strerror or error}") from error
    return 1 if refused or blank else 0


def _examined(reference: TrialSet, robot: Robot) -> tuple[Content, dict[str, str]]:
    """What was found in each trial, and why nothing was found in others.

    Raises:
        TrialError: Nothing was found in any.
    """
    found: Content = {}
    blank: dict[str, str] = {}
    problem: Problem | None = None
    for trial in reference:
        alone = TrialSet((trial,), reference.marker_names)
        try:
            problem = Problem(robot, alone, horizon=None) if problem is None else problem.of(alone)
            found |= problem.examinations()
        except TrialError as error:
            blank[trial.name] = str(error)
    if not found:
        raise TrialError(next(iter(blank.values())))
    return found, blank


def _lost(found: Mapping[str, Any], robot: Robot, allowed: float) -> dict[str, float]:
    """Markers of a trial that are lost for more than the allowed share of frames, with that share."""
    shares = zip(robot.marker_names, found["lost_share"], strict=True)
    return {name: share for name, share in shares if share > allowed}


def _print(content: Content, robot: Robot) -> None:
    swims = bool(robot.trials.tail_markers)
    if swims:
        tables.table(
            "What drove each trial",
            ("trial", "nominal Hz", "beat Hz", "±", "ratio", "phase rad", "speed mm/s", "±", "tail mm"),
            [
                (
                    name, "–" if t["nominal_frequency"] is None else f"{t['nominal_frequency']:.2f}",
                    f"{t['frequency']:.4f}", f"{t['frequency_std']:.4f}",
                    "–" if t["nominal_frequency"] is None else f"{t['frequency'] / t['nominal_frequency']:.3f}",
                    f"{t['phase']:.2f}", tables.millimeters(t["start_speed"]),
                    tables.millimeters(t["start_speed_std"]), tables.millimeters(t["amplitude"]),
                )
                for name, t in content.items()
            ],
        )  # fmt: skip
    else:
        tables.table(
            "What was recorded", ("trial", "s", "frames", "nominal Hz", "controls", "sensors"),
            [
                (
                    name, f"{t['duration']:.2f}", str(t["frames"]),
                    "–" if t["nominal_frequency"] is None else f"{t['nominal_frequency']:.2f}",
                    ", ".join(t["controls"]) or "–", ", ".join(t["sensors"]) or "–",
                )
                for name, t in content.items()
            ],
        )  # fmt: skip
    lengths = {"head_spread": "head ±%", "body_spread": "body ±%"} if swims else {}
    tables.table(
        "Frames for which each marker is lost [%]",
        ("trial", *robot.marker_names, *lengths.values(), "usable as it is"),
        [
            (
                name, *("–" if share == 0 else f"{100 * share:.0f}" for share in t["lost_share"]),
                *(f"{100 * t[key]:.1f}" for key in lengths), "yes" if t["usable"] else "no",
            )
            for name, t in content.items()
        ],
    )  # fmt: skip
    for name, t in content.items():
        for line in t["findings"]:
            tables.console.print(f"{name}: {line}")


def _refusal(refused: Mapping[str, Mapping[str, float]], allowed: float) -> str:
    """Which trials and markers, and what to do."""
    listed = [
        f"{trial} ({', '.join(f'{name} {100 * share:.0f} %' for name, share in shares.items())})"
        for trial, shares in refused.items()
    ]
    enough = math.ceil(100 * max(max(shares.values()) for shares in refused.values())) / 100
    return (
        f"Not to be used as they are, markers lost in more than {100 * allowed:g} % of frames: {'; '.join(listed)}. "
        f"Track these videos again, leave the trials out (--hold-out of calibrate), or accept them with "
        f"--allow-lost {enough:g}: calibration leaves lost marker-frames out by itself."
    )

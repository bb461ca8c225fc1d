"""`quality`."""

from __future__ import annotations

import json
import math

from swim2real.calibration import RealTrial, examine, examined
from swim2real.cli import tables
from swim2real.cli.arguments import Quality
from swim2real.errors import ArgumentError, TrialError
from swim2real.robots.fish import FISH
from swim2real.trials import TrialSet, load_reference


def quality(a: Quality) -> int:
    """Checks tracks, says what drove each trial, and refuses trials that shouldn't be used as they are."""
    allowed = float(a.allow_lost)
    if not 0 <= allowed <= 1:
        raise ArgumentError(f"--allow-lost is {allowed:g}; it is a share of frames within 0 and 1, such as 0.05")
    real, blank = _examined(load_reference(a.reference))
    refused = [one for one in real if one.quality.lost_markers(allowed)]
    content = {one.trial.name: examined(one, FISH.marker_names) for one in real}
    for one in real:
        content[one.trial.name]["usable"] = not one.quality.lost_markers(allowed)
    if a.json:
        print(
            json.dumps({**content, **{name: {"error": why, "usable": False} for name, why in blank.items()}}, indent=2)
        )
    else:
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
        tables.table(
            "Frames for which each marker is lost [%]",
            ("trial", *FISH.marker_names, "head ±%", "body ±%", "usable as it is"),
            [
                (
                    name, *("–" if share == 0 else f"{100 * share:.0f}" for share in t["lost_share"]),
                    f"{100 * t['head_spread']:.1f}", f"{100 * t['body_spread']:.1f}", "yes" if t["usable"] else "no",
                )
                for name, t in content.items()
            ],
        )  # fmt: skip
        for name, t in content.items():
            for line in t["findings"]:
                tables.console.print(f"{name}: {line}")
        for why in blank.values():
            tables.console.print(why, soft_wrap=True, markup=False)
        if refused:
            tables.console.print(_refusal(refused, allowed))
    if a.plot is not None:
        from swim2real.report import write_quality_page

        try:
            write_quality_page(real, FISH.marker_names, a.plot)
        except OSError as error:
            raise ArgumentError(f"--plot '{a.plot}' can't be written: {error.strerror or error}") from error
    return 1 if refused or blank else 0


def _examined(reference: TrialSet) -> tuple[list[RealTrial], dict[str, str]]:
    """What was found in each trial, and why nothing was found in others.

    Raises:
        TrialError: Nothing was found in any.
    """
    found: list[RealTrial] = []
    blank: dict[str, str] = {}
    for trial in reference:
        try:
            found += examine(TrialSet((trial,), reference.marker_names), FISH)
        except TrialError as error:
            blank[trial.name] = str(error)
    if not found:
        raise TrialError(next(iter(blank.values())))
    return found, blank


def _refusal(refused: list[RealTrial], allowed: float) -> str:
    """Which trials and markers, and what to do."""
    listed: list[str] = []
    worst = 0.0
    for one in refused:
        shares = {FISH.marker_names[m]: float(one.quality.lost_share[m]) for m in one.quality.lost_markers(allowed)}
        listed.append(
            f"{one.trial.name} ({', '.join(f'{name} {100 * share:.0f} %' for name, share in shares.items())})"
        )
        worst = max(worst, *shares.values())
    enough = math.ceil(100 * worst) / 100
    return (
        f"Not to be used as they are, markers lost in more than {100 * allowed:g} % of frames: {'; '.join(listed)}. "
        f"Track these videos again, leave the trials out (--hold-out of calibrate), or accept them with "
        f"--allow-lost {enough:g}: calibration leaves lost marker-frames out by itself."
    )

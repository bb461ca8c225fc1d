"""From a reference to a calibrated run with its report: composes the rooms, for the command line and for scripts."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from swim2real.advisor import AdvisorContext, AdvisorEvent, ProbingAdvisor, asks_a_vlm, make_advisor, replayed_run
from swim2real.calibration import (
    Outcome,
    Problem,
    Progress,
    RecordMismatchError,
    RunFolder,
    commit,
    conclude,
    minimize,
    reference_fingerprint,
    sensitivities,
    versions,
)
from swim2real.calibration.run_folder import ADDED
from swim2real.errors import ArgumentError, RunError
from swim2real.optimizers import Advice, recorded_advice
from swim2real.pipeline.methods import default_starts, make_optimizer
from swim2real.robots.fingerprint import fingerprint
from swim2real.robots.robot import Robot
from swim2real.settings import ADVISED, PHYSICS, CalibrationSettings, First, VlmAccess
from swim2real.store import path_from, source_from
from swim2real.trials import TrialSet

_log = logging.getLogger(__name__)


def calibrate(
    reference: TrialSet, robot: Robot, settings: CalibrationSettings, out: str | Path, *, source: str = "",
    resume: bool = False, accept_edited: bool = False, sensitivity: bool = False, access: VlmAccess | None = None,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    on_advisor: Callable[[AdvisorEvent], None] = lambda event: None,
) -> Outcome:  # fmt: skip
    """Calibrates a robot's simulator against a reference, into a run folder.

    Args:
        reference: Real trials.
        robot: What is calibrated.
        settings: Settings of the run.
        out: Run folder.
        source: Where the reference came from, for the record.
        resume: Go on with the run that is there.
        accept_edited: Whether a record that was edited or cut is taken as it is. What doesn't fit the rest any more is
            evaluated anew; the record as it was is kept beside it.
        sensitivity: Also measure each parameter's effect on the loss, outside the budget.
        access: How a VLM is reached and what it may take.
        on_progress: Called after every evaluation.
        on_advisor: Called as a VLM is asked and answers.

    Returns:
        The outcome, as `conclude` describes it. On KeyboardInterrupt the folder holds a usable, resumable run.

    Raises:
        Swim2RealError: Something is wrong, which its sentence names.
    """
    space = replace(robot.space, scale=settings.resolved_scale)
    folder = RunFolder(out)
    if resume:
        folder.settings()  # so that nothing is made of a folder without a run
    fitted, unseen = reference.split(settings.hold_out)
    problem = Problem.with_settings(robot, fitted, settings)
    held_out = None if unseen is None else problem.of(unseen)
    for name, found in problem.examinations().items():
        for doubt in found["doubts"]:
            _log.warning("trial '%s': %s", name, doubt)
    begun = folder.settings() if resume else None
    starts = _starts(settings, problem.protocol.name, len(space), begun)
    first = _first(settings, problem.protocol.name, starts, begun)
    resolved = {
        "robot": robot.name,
        **({} if robot.source is None else {"robot_fingerprint": fingerprint(robot.source)}),
        **asdict(settings),
        "protocol": problem.protocol.name,
        "start": problem.protocol.start,
        "scale": settings.resolved_scale,
        "first": first,
        "starts": starts,
        "briefing": asdict(settings.briefing) if asks_a_vlm(settings.advisor) else None,
        "hold_out": sorted(out.name for out in unseen or ()),
        "reference_fingerprint": reference_fingerprint(reference),
        "engine": problem.engine.as_dict(),
    }
    about = {
        **({} if robot.source is None else {"robot_file": path_from(folder.path, robot.source)}),
        "reference": source_from(folder.path, source), "versions": versions(), "commit": commit(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }  # fmt: skip
    _check_replay(settings.advisor, resolved)
    # an advisor is shown films on the clock of their trials
    videos = {trial.name: trial.video for trial in fitted if trial.video is not None and not trial.video_begin}
    context = AdvisorContext(
        folder.path, problem.evaluate, problem.speeds_from_rest, videos, settings.briefing, access or VlmAccess(),
        on_advisor,
    )  # fmt: skip
    advisor = None
    if settings.method in ADVISED:
        advisor = make_advisor(settings.advisor, robot, space, settings.seed, context)
        advisor = ProbingAdvisor(advisor, space, settings.probes) if settings.probes else advisor
    with folder.locked():
        if resume:
            if settings.method == "staged" and folder.settings().get("budget") != settings.budget:
                raise ArgumentError(
                    f"budget was {folder.settings().get('budget')} and is now {settings.budget}; stages are planned by "
                    f"the budget, so a run with another one must be begun anew"
                )
            folder.resume(resolved)
            if accept_edited:
                folder.accept_edited()
        else:
            folder.begin({**resolved, **about})
        prior = space.to_cube(space.published) if first == "model" else None

        def run() -> dict[str, Any]:
            optimizer = make_optimizer(
                settings.method, robot, space, settings.seed, settings.budget, advisor, _recorded_advice(folder),
                from_model=first == "model", starts=starts, max_steps=settings.max_steps,
                early_stop=settings.early_stop, give_up=settings.give_up,
            )  # fmt: skip
            return minimize(problem, space, optimizer, settings.budget, folder, on_progress, prior)

        try:
            best = run()
        except RecordMismatchError as mismatch:
            if not accept_edited:
                raise
            folder.keep_first(mismatch.index)
            best = run()
        effects = sensitivities(problem, space, best["values"]) if sensitivity else None
        return conclude(folder, problem, held_out, best["values"], effects)


def _starts(settings: CalibrationSettings, protocol: str, dimension: int, begun: Mapping[str, Any] | None) -> int:
    """How many starts a run has; one that goes on, as many as it had, unless another number is asked for."""
    if settings.starts is not None:
        return settings.starts
    if begun is not None:
        return begun.get("starts", ADDED["starts"])
    unknown = protocol == "playback" and settings.method == "line-search" and settings.advisor == PHYSICS
    return default_starts(dimension, settings.budget) if unknown else 1


def _first(settings: CalibrationSettings, protocol: str, starts: int, begun: Mapping[str, Any] | None) -> First:
    """Where a run begins; one that goes on, where it began, unless another first point is asked for."""
    if settings.first != "auto":
        return settings.first
    if begun is not None:
        return begun.get("first", ADDED["first"])
    return "model" if protocol == "playback" and (settings.seed == 0 or starts > 1) else "random"


def _recorded_advice(folder: RunFolder) -> list[Advice]:
    try:
        return recorded_advice(folder.record())
    except (KeyError, TypeError) as error:
        raise RunError(f"the record of '{folder.path}' is damaged: {error!r}; begin a new run") from error


_TAKEN = (
    "method",
    "protocol",
    "start",
    "seed",
    "first",
    "starts",
    "budget",
    "scale",
    "max_steps",
    "early_stop",
    "give_up",
    "probes",
    "horizon",
    "pieces",
    "hold_out",
)
_REPLAYED = (
    *(name for name in _TAKEN if name != "budget"), "robot", "robot_fingerprint", "reference_fingerprint", "engine",
)  # fmt: skip


def as_replayed(settings: CalibrationSettings) -> CalibrationSettings:
    """Settings that replay a run as it was: what has its default is as that run had it, what was chosen stays.

    Raises:
        RunError: There is no such run.
        ArgumentError: Its settings can't be used.
    """
    source = replayed_run(settings.advisor)
    if source is None:
        return settings
    there, default = RunFolder(source).settings(), CalibrationSettings()
    there: dict[str, Any] = {"first": ADDED["first"], "starts": ADDED["starts"], **there}
    taken = {
        name: there[name] for name in _TAKEN if name in there and getattr(settings, name) == getattr(default, name)
    }
    if "hold_out" in taken:
        taken["hold_out"] = tuple(taken["hold_out"])
    return replace(settings, **taken)


def _check_replay(advisor: str, resolved: Mapping[str, Any]) -> None:
    """A replay takes another way where anything else differs; better said at the start."""
    source = replayed_run(advisor)
    if source is None:
        return
    there = {**ADDED, **RunFolder(source).settings()}
    here = json.loads(json.dumps(dict(resolved)))
    for key in _REPLAYED:
        if there.get(key) != here.get(key):
            raise ArgumentError(
                f"a replay needs what '{source}' was run with: {key} was {there.get(key)!r} and is now "
                f"{here.get(key)!r}"
            )

"""From a reference to a calibrated run with its report: composes the rooms, for the command line and for scripts."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

from swim2real import calibration
from swim2real.advisor import AdvisorContext, AdvisorEvent, ProbingAdvisor, make_advisor
from swim2real.checks.delays import delays
from swim2real.checks.mistakes import judged
from swim2real.checks.probing import growing
from swim2real.checks.resting import other_start, started
from swim2real.methods import ADVISED, METHODS
from swim2real.optimizers import ScriptedAdvisor, recorded_advice
from swim2real.parameters import read_parameters
from swim2real.pipeline.methods import default_starts, make_optimizer
from swim2real.robots.fingerprint import fingerprint
from swim2real.robots.read_back import check_targets
from swim2real.robots.robot import Robot
from swim2real.settings import (
    FIRST,
    FROM_FILE,
    PAPER_BUDGET,
    PHYSICS,
    CalibrationSettings,
    VlmAccess,
    replayed_run,
)
from swim2real.trials import TrialSet
from swimbase.errors import ArgumentError
from swimbase.store import path_from, source_from

_log = logging.getLogger(__name__)


def calibrate(
    reference: TrialSet, robot: Robot, settings: CalibrationSettings, out: str | Path, *, source: str = "",
    resume: bool = False, sensitivity: bool = False, access: VlmAccess | None = None,
    on_progress: Callable[[calibration.Progress], None] = lambda progress: None,
    on_advisor: Callable[[AdvisorEvent], None] = lambda event: None,
    on_warning: Callable[[str], None] | None = _log.warning,
) -> calibration.Outcome:  # fmt: skip
    """Calibrates a robot's simulator against a reference, into a run folder.

    Args:
        reference: Real trials.
        robot: What is calibrated.
        settings: Settings of the run.
        out: Run folder.
        source: Where the reference came from, for the record.
        resume: Go on with the run that is there.
        sensitivity: Also measure each parameter's effect on the loss, outside the budget.
        access: How a VLM is reached and what it may take.
        on_progress: Called after every evaluation; `progress.stop()` in it ends the search, which is concluded.
        on_advisor: Called as a VLM is asked and answers.
        on_warning: Called with a sentence for all that is probably wrong with the trials; None doesn't look.

    Returns:
        The outcome, as `conclude` describes it.

    Raises:
        KeyboardInterrupt: A callback raised it. The folder holds a resumable run whose outcome says so.
        Swim2RealError: Something is wrong, which its sentence names.
    """
    robot.check_trials(reference)
    fitted, unseen = reference.split(settings.hold_out)
    folder = calibration.RunFolder(out)
    begun = folder.settings() if resume else None
    if begun is not None and begun.budget is not None and (settings.budget is None or begun.finish):
        finish = begun.finish or begun.method != "multi-start"  # which goes on by itself
        settings = replace(settings, method=begun.method, budget=begun.budget if finish else None, finish=finish)
    if on_warning is not None:
        check_targets(robot)
        begins = started(robot, reference)
        lines = list(judged(begins, reference).doubts)
        if settings.pieces is None:
            lines += [*growing(begins, reference, settings.horizon), *filter(None, [other_start(robot, reference)])]
        for line in lines:
            on_warning(line)
    problem = calibration.Problem.with_settings(robot, fitted, settings)
    held_out = None if unseen is None else problem.of(unseen)
    for name, found in problem.examinations().items():
        for doubt in found["doubts"]:
            _log.warning("trial '%s': %s", name, doubt)
    resolved = _resolved(settings, problem, reference, folder.path, source, begun)
    _check_replay(resolved)
    space = replace(robot.space, scale=resolved.resolved_scale)
    # an advisor is shown films on the clock of their trials
    shown = [trial for trial in fitted if not trial.video_begin]
    videos = {trial.name: (trial.video, trial.film_rate) for trial in shown if trial.video is not None}
    context = AdvisorContext(
        folder.path, problem.evaluate, problem.speeds_from_rest, videos, settings.briefing, access or VlmAccess(),
        on_advisor, resolved.budget, resolved.method == "proposal-search",
    )  # fmt: skip
    advisor = None
    if resolved.method in ADVISED:
        advisor = make_advisor(resolved.advisor, robot, space, resolved.seed, context)
        advisor = ProbingAdvisor(advisor, space, resolved.probes) if resolved.probes else advisor
    with folder.locked():
        if resume:
            folder.resume(resolved)
        else:
            folder.begin(resolved)
        if advisor is not None:  # advice on record isn't asked for again
            notes = (entry.model_dump(include={"point", "note"}, exclude_unset=True) for entry in folder.record())
            advisor = ScriptedAdvisor(recorded_advice(notes), then=advisor)
        optimizer = make_optimizer(
            resolved, robot, space, advisor, resolved.first_values, sizes=calibration.sizes_of(problem),
            led=resolved.search > 1,
        )  # fmt: skip
        first = space.published if resolved.first == "model" else resolved.first_values
        slopes = calibration.Slopes(space)
        best, search = calibration.minimize(
            problem, space, optimizer, None if resolved.finish else resolved.budget, folder, on_progress,
            None if first is None else space.to_cube(first), settings.minutes, slopes,
        )  # fmt: skip
        interrupted = search.ending == "interrupted"  # whoever did it doesn't want to wait
        effects = calibration.sensitivities(problem, space, best.values) if sensitivity and not interrupted else None
        late = [] if on_warning is None or interrupted else delays(started(robot, fitted), fitted, best.values)
        outcome = calibration.conclude(folder, problem, held_out, best.values, effects, search, slopes, late)
        if interrupted:
            raise KeyboardInterrupt
        return outcome


def _resolved(
    settings: CalibrationSettings, problem: calibration.Problem, reference: TrialSet, folder: Path, source: str,
    begun: calibration.RunSettings | None,
) -> calibration.RunSettings:  # fmt: skip
    """Settings with every choice made; a run that goes on has the choices that it had, where nothing else is asked."""
    robot, protocol = problem.robot, problem.protocol.name
    unknown = protocol == "playback" and settings.method in ADVISED and settings.advisor == PHYSICS
    starts, first = settings.starts, settings.first
    if starts is None and begun is not None:
        starts = begun.starts
    if starts is None:
        starts = default_starts(len(robot.space), settings.budget or PAPER_BUDGET) if unknown else 1
    if first == "auto" and begun is not None:
        first = begun.first
    if first == "auto":
        first = "model" if protocol == "playback" and (settings.seed == 0 or starts > 1) else "random"
    first_values, source_run = None, replayed_run(settings.advisor)
    earlier = begun or (None if source_run is None else calibration.RunFolder(source_run).settings())
    if first == FROM_FILE:
        first_values = None if earlier is None else earlier.first_values
    elif first not in FIRST:
        first, first_values = FROM_FILE, read_parameters(first, robot.name, robot.space).values
    if begun is not None and METHODS[settings.chosen_method].planned_by_budget and begun.budget != settings.budget:
        raise ArgumentError(
            f"budget was {begun.budget} and is now {settings.budget}; method {settings.method} plans by the budget, so "
            f"a run with another one must be begun anew"
        )
    chosen = replace(
        settings, protocol=protocol, start=problem.protocol.start, scale=settings.resolved_scale, first=first,
        starts=starts, hold_out=tuple(sorted(settings.hold_out)),
    )  # fmt: skip
    return calibration.RunSettings(
        **vars(chosen),
        first_values=first_values,
        search=calibration.SEARCH if earlier is None else earlier.search,
        robot=robot.name,
        robot_fingerprint=None if robot.source is None else fingerprint(robot.source),
        robot_file=None if robot.source is None else path_from(folder, robot.source),
        reference_fingerprint=calibration.reference_fingerprint(reference),
        reference=source_from(folder, source),
        engine=problem.engine,
        **calibration.made_by(),
    )


def as_replayed(settings: CalibrationSettings) -> CalibrationSettings:
    """Settings that replay a run as it was: what has its default is as that run had it, what was chosen stays.

    Raises:
        RunError: There is no such run.
    """
    source = replayed_run(settings.advisor)
    if source is None:
        return settings
    there, default = calibration.RunFolder(source).settings(), CalibrationSettings(advisor=settings.advisor)
    names = [field.name for field in fields(default) if field.name not in ("advisor", "threads", "briefing")]
    taken = {name: getattr(there, name) for name in names if getattr(settings, name) == getattr(default, name)}
    return replace(settings, **taken)


def _check_replay(settings: calibration.RunSettings) -> None:
    """A replay takes another way where anything else differs; better said at the start."""
    source = replayed_run(settings.advisor)
    if source is None:
        return
    differing = settings.difference(replace(calibration.RunFolder(source).settings(), advisor=settings.advisor))
    if differing is not None:
        name, now, before = differing
        raise ArgumentError(f"a replay needs what '{source}' was run with: {name} was {before!r} and is now {now!r}")

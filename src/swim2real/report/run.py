"""A run folder, read for its page: what is on record, and the trials at the best parameters where it has ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from swim2real.advisor.vlm.transcript import CALLS, Call, Transcript
from swim2real.calibration import Outcome, RunFolder, RunSettings, SavedTrial, load_trials
from swim2real.calibration.convergence import ends_of, incumbent, never_beaten, standing, still_falling
from swim2real.calibration.file_models import RecordedEvaluation, TrialSummary, Verdict
from swim2real.calibration.loop import Search
from swim2real.calibration.run_folder import TRIALS
from swim2real.calibration.verdict import judge
from swim2real.formatting import listed
from swim2real.identification.identifiability import Study, study_of
from swim2real.objective.figures import FitFigures, TrialFigures
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot
from swim2real.settings import replayed_run
from swimbase.errors import AdvisorError, RunError

_SAME_LOSS = 1e-5  # m, by which a loss may differ when the same parameters are simulated again


@dataclass(frozen=True)
class ReportedTrial:
    """A trial at some parameters.

    Attributes:
        name: Name of the trial.
        held_out: Whether it was left out of the fit.
        figures: As on record.
        checked: What was found in the real track.
    """

    name: str
    held_out: bool
    figures: TrialFigures
    checked: TrialSummary

    @property
    def diverged(self) -> bool:
        """True if there are no figures of the simulation."""
        return bool(self.figures.divergence)


@dataclass(frozen=True)
class RecordedCalls:
    """The transcript of a run whose advisor was asked over a wire or by files.

    Attributes:
        folder: Folder of the run.
        calls: In order; empty where the transcript is missing or damaged.
        problem: What is wrong with the transcript, in a sentence; empty where it is whole.
    """

    folder: Path
    calls: tuple[Call, ...] = ()
    problem: str = ""


@dataclass(frozen=True)
class ReportedRun:
    """A run as it is reported.

    Attributes:
        name: Name of the folder.
        robot: The robot that was calibrated.
        settings: Settings as recorded.
        space: On the run's scale.
        entries: The record, one entry an evaluation, at least one.
        outcome: What was found at its end; None before it.
        is_current: Whether that is of the best parameters on record.
        saved: Trials at the best parameters by frequency and name; empty before a run ends.
        calls: Calls of the advisor; None for a run that made none.
        unfinished: What is missing and why, in sentences; empty for a run that ended.
        study: What `identify` found of it; None where it wasn't studied.
        study_problem: Why a study that is there isn't shown, as a sentence.
    """

    name: str
    robot: Robot
    settings: RunSettings
    space: ParameterSpace
    entries: tuple[RecordedEvaluation, ...]
    outcome: Outcome | None
    is_current: bool
    saved: tuple[SavedTrial, ...]
    calls: RecordedCalls | None
    unfinished: str
    study: Study | None = None
    study_problem: str = ""

    @cached_property
    def best(self) -> RecordedEvaluation:
        """The incumbent; the first evaluation where all failed."""
        return incumbent(self.entries) or self.entries[0]

    @property
    def of_best(self) -> Outcome:
        """Findings about the best parameters."""
        if self.outcome is not None and self.is_current:
            return self.outcome
        return Outcome(fit=self.best.evidence)

    @property
    def marker_names(self) -> tuple[str, ...]:
        """M names."""
        return tuple((self.outcome and self.outcome.marker_names) or self.robot.marker_names)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to read before the best parameters are used."""
        found = (
            () if self.standing else tuple(told(self.entries, self.settings) for told in (still_falling, never_beaten))
        )
        return tuple(warning for warning in (*found, *self.of_best.late) if warning)

    @property
    def verdict(self) -> Verdict:
        """Verdict on the best parameters; on those of a run of before there were any, by what it has on record."""
        recorded = self.of_best.verdict
        if recorded is not None:
            return recorded
        known = "interrupted"
        if self.outcome is not None and self.is_current:
            known = "done" if self.outcome.ending == "done" else "budget"
        search = Search(known, "", len(self.entries), ends_of(self.entries, self.outcome))
        fitted = [one.compared for one in self.saved if not one.held_out]
        return judge(fitted, self.robot, search, self.of_best.noise, self.of_best.from_rest)

    @property
    def studied(self) -> Study | None:
        """The study, if it is complete and of these parameters."""
        study = self.study
        return study if study is not None and study.complete and set(study.intervals) == set(self.space.names) else None

    @property
    def budget(self) -> int | None:
        """Evaluations that end it; None for a search that ends when it is done."""
        return None if self.settings.finish else self.settings.budget

    @property
    def standing(self) -> tuple[str, ...]:
        """State of a search without a budget, in sentences."""
        return standing(self.entries, self.settings, self.outcome, self.space)

    @property
    def loss(self) -> str:
        """Quantity that is minimized, in words."""
        if self.robot.trials.sensors:
            return "playback error"
        if not self.registered:
            return "marker error"
        names = {"motion": "motion error", "paper": "marker error"}
        return names.get(self.settings.protocol, "aligned marker error")

    @cached_property
    def trials(self) -> tuple[ReportedTrial, ...]:
        """Fitted and held-out trials by frequency, where they have one, and name."""
        checked = {} if self.outcome is None else self.outcome.trials
        trials = [
            ReportedTrial(name, held_out, figures, checked.get(name, TrialSummary()))
            for held_out, fit in ((False, self.of_best.fit), (True, self.of_best.held_out or FitFigures()))
            for name, figures in fit.trials.items()
        ]
        return tuple(sorted(trials, key=lambda trial: (trial.figures.frequency or 0.0, trial.name)))

    @property
    def registered(self) -> bool:
        """True if a constant shift of each marker is taken out before trials are compared."""
        return self.has("static_offset")

    @property
    def has_beat(self) -> bool:
        """True if trials have the frequency of a beat."""
        return self.has("frequency")

    @property
    def has_progress(self) -> bool:
        """True if trials are scored by how far the robot has come."""
        return self.robot.trials.score_progress

    def has(self, figure: str) -> bool:
        """True if a trial has a figure."""
        return any(getattr(trial.figures, figure) not in (None, []) for trial in self.trials)


def read_run(path: str | Path, robot: Robot) -> ReportedRun:
    """Gathers a run.

    Args:
        path: The run folder.
        robot: The robot that was calibrated.

    Raises:
        RunError: No run there, nothing evaluated yet, or a file is damaged.
        ParameterError: The run is of another robot.
    """
    folder = RunFolder(path)
    settings = folder.settings()
    entries = folder.record()
    if not entries:
        raise RunError(
            f"run '{path}' has no evaluation on record yet, so there is nothing to report; go on with --resume"
        )
    best, outcome = incumbent(entries) or entries[0], folder.outcome()
    study, study_problem = _read_study(folder, best)
    robot.space.check(best.values, where=f"run '{path}'")
    is_current = outcome is not None and (
        outcome.evaluations == len(entries) or abs((outcome.fit.loss or 0.0) - best.loss) <= _SAME_LOSS
    )
    has_trials = (folder.path / TRIALS).is_file()
    saved = load_trials(folder) if is_current and has_trials else ()
    of_all = f" of {settings.budget}" if settings.budget and not settings.finish else ""
    on_record = f"{len(entries)}{of_all} evaluations are on record"
    unfinished = ""
    if outcome is None:
        unfinished = (
            f"This run has not ended: {on_record}. The page shows what is on record. Charts of each trial, "
            f"held-out trials, track quality and the effect of each parameter are written when the run ends; go on "
            f"with --resume and make the report again."
        )
    elif not is_current:
        unfinished = (
            f"This run went on after it had ended once, and has found better parameters since: {on_record}. Charts of "
            f"each trial, held-out trials and the effect of each parameter belong to the earlier ones and are left "
            f"out; finish the run with --resume and make the report again."
        )
    elif not has_trials:
        unfinished = f"The run folder has no {TRIALS}, so charts of each trial are left out; --resume writes it again."
    return ReportedRun(
        name=folder.path.resolve().name,
        robot=robot,
        settings=settings,
        space=replace(robot.space, scale=settings.resolved_scale),
        entries=entries,
        outcome=outcome,
        is_current=is_current,
        saved=tuple(sorted(saved, key=lambda trial: (trial.compared.frequency or 0.0, trial.compared.name))),
        calls=_read_calls(folder.path, settings, entries),
        unfinished=unfinished,
        study=study,
        study_problem=study_problem,
    )


def calls_of(entry: RecordedEvaluation) -> list[int]:
    """Numbers of the calls that a proposal came of."""
    numbers = entry.note.proposal.notes.get("calls") if entry.note.proposal else None
    return [number for number in numbers if isinstance(number, int)] if isinstance(numbers, list) else []


def _read_study(folder: RunFolder, best: RecordedEvaluation) -> tuple[Study | None, str]:
    """The study of a run, or why it can't be shown."""
    begin = f"begin anew with swim2real identify {folder.path} --again"
    try:
        study = study_of(folder)
    except RunError as error:
        return None, f"The study of what the trials determine isn't shown: {error} ({begin})."
    if study is not None and study.difference({"start": {"point": list(best.point), "loss": best.loss}}):
        return None, f"The study of what the trials determine is from before the run had its best values; {begin}."
    return study, ""


def _read_calls(folder: Path, settings: RunSettings, entries: Sequence[RecordedEvaluation]) -> RecordedCalls | None:
    """The calls of a run. A transcript that can't be read is a sentence, not an error.

    None for a run that made no calls: its advisor is built in, repeats another run's calls, or hasn't been asked.
    """
    has_files = any((folder / CALLS).glob("call_*.json"))
    named = {number for entry in entries for number in calls_of(entry)}
    if not has_files and (not named or replayed_run(settings.advisor) is not None):
        return None
    if not has_files:
        return RecordedCalls(
            folder,
            problem=f"The advisor's calls are on record, but their transcript, the folder '{CALLS}' of the run, is "
            f"missing, so cost and media are unknown. Put the folder back and make the report again.",
        )
    try:
        calls = Transcript(folder).calls
    except AdvisorError as error:
        what = str(error).replace(f"{folder}/", "")
        return RecordedCalls(folder, problem=f"The transcript of the advisor's calls can't be read: {what}.")
    there = {call.number for call in calls}
    lost, problem = sorted((named | set(range(1, max(there) + 1))) - there), ""
    if lost:
        one = len(lost) == 1
        problem = (
            f"Call{'' if one else 's'} {listed(lost)} {'is' if one else 'are'} missing in the transcript, the folder "
            f"'{CALLS}' of the run; the sums below are without {'it' if one else 'them'}."
        )
    return RecordedCalls(folder, calls, problem)

"""A fit by hand: trials simulated with any values at once and laid over the real ones; searches from there."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from markertrack.camera import fixed_camera
from markertrack.camera_file import read_camera
from swim2real.advisor.choice import AdvisorContext, make_advisor
from swim2real.advisor.vlm.advisor import AdvisorEvent
from swim2real.calibration import Problem, Progress, RunFolder
from swim2real.calibration.loop import write_fit
from swim2real.identification.identifiability import Interval, study_of
from swim2real.objective import ComparedTrial, evidence
from swim2real.objective.comparison import rounded
from swim2real.optimizers import Candidate, Evaluation, Measurement, Situation
from swim2real.parameters import Parameter, Values, read_parameters
from swim2real.pipeline import calibrate
from swim2real.pipeline.overlays import in_world, off_its_film
from swim2real.rendering.trial_view import view_of
from swim2real.report import write_report
from swim2real.robots.robot import Robot
from swim2real.settings import CalibrationSettings, VlmAccess, asks_a_vlm
from swim2real.trials import TrialSet, load_reference
from swim2real.ui.films import FilmCache, packed
from swim2real.ui.jobs import Job
from swimbase.arrays import Array
from swimbase.checking import PathText, read
from swimbase.errors import AdvisorError, ArgumentError, ParameterError, RunError

CAMERA = "camera.json"
_GROUND, _SMALL = (1280, 720), (128, 56)  # px of the ground of a trial without a film, and of the small pictures
_MARGIN, _INSTANTS = 0.1, 4  # share that is left around a trial on the ground; poses in a small picture
_MOST_ASKED = 60  # measurements that an advisor may want before it proposes


class Left(BaseModel):
    """What a file of values says besides: the robot, and the trials, run and held-out trials that were chosen then."""

    robot: str
    robot_file: PathText | None = None
    reference: PathText | None = None
    run: PathText | None = None
    held: tuple[str, ...] = ()


@dataclass(frozen=True)
class About:
    """Sliders, with what `identify` found of some, names of the trials and of those held out, values to begin with."""

    parameters: list[Parameter]
    intervals: dict[str, Interval]
    trials: list[str]
    held: list[str]
    values: dict[str, float]


@dataclass(frozen=True)
class Scene:
    """Picture that a trial is drawn on.

    Attributes:
        trial: Name of the trial.
        film: Path of its film from the folder; None for the ground.
        first: Number of its first frame in the film.
        note: Finding that a person should know.
        size: Width and height [px].
        seconds: Duration [s].
        markers: Number of markers.
        real: Real places, `packed` [px]. Shape (T, M, 2).
    """

    trial: str
    film: str | None
    first: int
    note: str
    size: tuple[int, int]
    seconds: float
    markers: int
    real: str


@dataclass(frozen=True)
class Simulated:
    """Trials simulated with the sliders' values.

    Attributes:
        errors: Error of each [m].
        diverged: Reason by name, of those that diverged.
        small: Paths of the small picture of each, real and simulated; empty for one trial alone.
        simulated: Places of the one trial, as those of its scene.
    """

    errors: dict[str, float | None]
    diverged: dict[str, str]
    small: dict[str, tuple[str, str]]
    simulated: str = ""


@dataclass
class Fit:
    """Trials and a robot, posed as a problem once.

    Attributes:
        folder: Reference folder.
        robot: The robot.
        run: Run whose settings and study are taken; None for the default ones.
        root: Folder outside of which no film is looked for.
        films: Films that are open.
    """

    folder: Path
    robot: Robot
    run: Path | None
    root: Path
    films: FilmCache

    def __post_init__(self) -> None:
        reference = load_reference(self.folder)
        self.robot.check_trials(reference)
        self.robot.check_markers("draw")
        self.reference = reference
        self._lock = threading.Lock()
        self._scenes: dict[int, tuple[Callable[[Array], Array], Scene]] = {}
        self.settings = CalibrationSettings()
        if self.run is not None:
            made = RunFolder(self.run).settings()
            names = ("protocol", "start", "horizon", "pieces", "hold_out")
            self.settings = replace(self.settings, **{name: getattr(made, name) for name in names})
        self.problem = Problem.with_settings(self.robot, reference, self.settings)

    def about(self, begin: Path | None) -> About:
        """Parameters with bounds and what is known of them, trials, and the values to begin with.

        Args:
            begin: Run or file with these values; None for the model's own.
        """
        space, values, held = self.robot.space, self.robot.space.published, self.settings.hold_out
        study = None
        if self.run is not None:
            with suppress(RunError):  # one of an earlier version
                study = study_of(RunFolder(self.run))
        if begin is not None:
            values = read_parameters(begin, self.robot.name, space).values
            held = held if begin.is_dir() else read(Left, begin, "values", ParameterError).held
        intervals = study.intervals if study is not None and study.complete else {}
        return About(list(space), dict(intervals), list(self.reference.names), list(held), dict(values))

    def scene(self, trial: str) -> Scene:
        """What a trial is drawn on."""
        return self._scene(self.reference.names.index(self.reference[trial].name))[1]

    def simulated(self, values: Values, trial: str | None) -> Simulated:
        """Trials simulated with values: the errors of all of them, or of one with what is drawn of it.

        Args:
            values: Values of the parameters, checked here.
            trial: Name of the one trial; None for all.
        """
        checked, names = self.robot.space.check(values), self.reference.names
        chosen = range(len(names)) if trial is None else [names.index(self.reference[trial].name)]
        with self._lock:  # one simulation at a time; it uses all cores
            prepared = [self.problem.prepared[i] for i in chosen]
            trials = self.problem.simulator.simulate(checked, [one.request for one in prepared])
        compared = [self.problem.protocol.compare(p.target, t) for p, t in zip(prepared, trials, strict=True)]
        errors = {one.name: rounded(view_of(one, self.robot).error) for one in compared}
        lost = {one.name: one.divergence for one in compared if one.divergence is not None}
        if trial is None:
            small = {one.name: self._small(i, one) for i, one in enumerate(compared)}
            return Simulated(errors, lost, small)
        placed = _placed(compared[0], self._real(chosen[0]))
        return Simulated(errors, lost, {}, packed(self._scene(chosen[0])[0](placed)))

    def _real(self, index: int) -> Array:
        """Real positions of a trial as far as it is compared [m]. Shape (T, M, 2)."""
        return self.reference.trials[index].track.positions[: len(self.problem.prepared[index].target.weights)]

    def _small(self, index: int, compared: ComparedTrial) -> tuple[str, str]:
        """Some instants of a trial, real and simulated, as the paths of a small picture."""
        real = self._real(index)
        instants = np.linspace(0, len(real) - 1, _INSTANTS).round().astype(int)
        to_pixels = _ground(real, _SMALL)
        return _path(to_pixels(real[instants])), _path(to_pixels(_placed(compared, real)[instants]))

    def _scene(self, index: int) -> tuple[Callable[[Array], Array], Scene]:
        """Meters to pixels of the picture that a trial is drawn on, and what of it doesn't depend on a simulation."""
        if index in self._scenes:
            return self._scenes[index]
        trial, real = self.reference.trials[index], self._real(index)
        film = None if trial.video is None else trial.video.resolve()
        times = trial.track.times[: len(real)] - trial.track.times[0]
        size, to_pixels, name, first, note = _GROUND, _ground(real, _GROUND), None, 0, ""
        if film is not None and film.is_relative_to(self.root) and film.is_file():
            about, file, name = (
                self.films.opened(film),
                camera_of(film, self.root),
                film.relative_to(self.root).as_posix(),
            )
            size, known = (about.width, about.height), None if file is None else read_camera(file)
            to_pixels = fixed_camera(known, trial.meters_per_pixel, self.robot.marker_heights, size).to_pixels
            first = round((trial.video_begin + float(trial.track.times[0])) * (trial.film_rate or about.fps))
            note = " ".join(off_its_film(trial, to_pixels(real), self.folder))
        scene = Scene(trial.name, name, first, note, size, float(times[-1]), real.shape[1], packed(to_pixels(real)))
        self._scenes[index] = to_pixels, scene
        return to_pixels, scene

    def search(self, values: Values, held: tuple[str, ...], out: Path, job: Job) -> str:
        """Calibrates from values on, without trials held out, into a run folder; a person's stop concludes it."""
        first = out / "first.json"
        out.mkdir()
        write_fit(first, self.problem, self.robot.space.check(values))
        settings = replace(self.settings, first=str(first), hold_out=held)
        return searched(self.folder, self.reference, self.robot, settings, out, job)

    def ask(self, values: Values, name: str, access: VlmAccess, out: Path, job: Job) -> str:
        """Has an advisor say what differs, and propose values.

        Args:
            values: Values that it is shown.
            name: Name of the advisor.
            access: How a VLM is reached.
            out: Folder for what a VLM was asked and answered.
            job: Where it says how far it is.
        """

        def noted(event: AdvisorEvent) -> None:
            job.note(warning=event.text)
            job.heed()

        space, problem = self.robot.space, self.problem
        context = AdvisorContext(out, problem.evaluate, problem.speeds_from_rest, access=access, on_event=noted)
        advisor = make_advisor(name, self.robot, space, 0, context)
        here = self._evaluated(Candidate(space.to_cube(values)))
        measured: list[Evaluation] = []
        while isinstance(advice := advisor.propose(Situation(here, (), here, tuple(measured))), Measurement):
            job.heed()
            measured.append(self._evaluated(advice.candidate))
            job.note(done=len(measured))
            if len(measured) > _MOST_ASKED:
                raise AdvisorError(
                    f"the advisor still has no proposal after {_MOST_ASKED} measurements; search instead"
                )
        job.note(values=dict(space.to_values(advice.point)))
        return " ".join(filter(None, (advice.diagnosis, advice.reasoning)))

    def _evaluated(self, candidate: Candidate) -> Evaluation:
        comparison = self.problem.evaluate(self.robot.space.to_values(candidate.point))
        failed = comparison.divergence is not None
        return Evaluation(candidate, comparison.loss, failed, evidence(comparison), comparison.residual_vector())


def resumed(folder: Path, robot: Robot, run: Path, job: Job) -> str:
    """Goes on with a run until it is done, as `calibrate --resume` does without a budget."""
    made = RunFolder(run).settings()
    if asks_a_vlm(made.advisor):
        raise ArgumentError(f"run '{run.name}' asks '{made.advisor}'; go on with: swim2real calibrate … --resume")
    free = ("method", "budget", "minutes", "finish", "starts", "probes")
    kept = {one.name: getattr(made, one.name) for one in fields(CalibrationSettings) if one.name not in free}
    return searched(folder, load_reference(folder), robot, CalibrationSettings(**kept), run, job, resume=True)


def searched(
    folder: Path, reference: TrialSet, robot: Robot, settings: CalibrationSettings, out: Path, job: Job,
    resume: bool = False,
) -> str:  # fmt: skip
    """Calibrates into a run folder; a person's stop concludes it.

    Args:
        folder: Reference folder.
        reference: Its trials.
        robot: The robot.
        settings: Settings of the run.
        out: Run folder.
        job: Where it says how far it is.
        resume: Whether it goes on with the run that is there.
    """

    def noted(progress: Progress) -> None:
        job.note(done=progress.done, run=out.name)
        if progress.improved:
            job.improved(1e3 * progress.best, progress.values)
        if job.now.stopping:
            progress.stop()

    outcome = calibrate(
        reference, robot, settings, out, source=str(folder), resume=resume, on_progress=noted,
        on_warning=lambda line: job.note(warning=line),
    )  # fmt: skip
    if not job.now.stopping:
        write_report(out, robot)
    verdict = outcome.verdict
    return f"run {out.name}: " + (f"{verdict.title}: {verdict.sentence}" if verdict else "done")


def camera_of(film: Path, root: Path) -> Path | None:
    """The camera file of a film: beside it, or in the folder."""
    return next((one for one in (film.parent / CAMERA, root / CAMERA) if one.is_file() and not one.is_symlink()), None)


def _placed(compared: ComparedTrial, real: Array) -> Array:
    """Simulated positions laid over the real ones [m]; NaN where it diverged. Shape (T, M, 2)."""
    return in_world(compared, real) if compared.divergence is None else np.full_like(real, np.nan)


def _ground(real: Array, size: tuple[int, int]) -> Callable[[Array], Array]:
    """Meters to pixels of a plain picture that holds a trial."""
    low, high = np.nanmin(real, axis=(0, 1)), np.nanmax(real, axis=(0, 1))
    scale = (1 - 2 * _MARGIN) * float((np.array(size) / np.maximum(high - low, 1e-6)).min())
    return lambda positions: (positions - (low + high) / 2) * scale * [1, -1] + np.array(size) / 2


def _path(poses: Array) -> str:
    """Poses as the path of a picture. Shape (T, M, 2)."""
    known = [pose[np.isfinite(pose[:, 0])].round(1).tolist() for pose in poses]
    return "".join("M" + "L".join(f"{x} {y}" for x, y in pose) for pose in known if pose)

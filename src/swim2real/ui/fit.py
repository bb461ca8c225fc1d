"""A fit by hand: trials simulated with any values at once and laid over the real ones; searches from there."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from markertrack.camera import fixed_camera
from markertrack.camera_file import read_camera
from swim2real.advisor.choice import make_advisor
from swim2real.calibration import Problem, Progress, RunFolder
from swim2real.calibration.loop import write_fit
from swim2real.identification.identifiability import study_of
from swim2real.objective import ComparedTrial, evidence
from swim2real.objective.comparison import rounded
from swim2real.optimizers import Candidate, Evaluation, Measurement, Situation
from swim2real.parameters import Values, read_parameters
from swim2real.pipeline import calibrate
from swim2real.pipeline.overlays import in_world, off_its_film
from swim2real.rendering.trial_view import view_of
from swim2real.report import write_report
from swim2real.robots.robot import Robot
from swim2real.settings import PHYSICS, CalibrationSettings
from swim2real.trials import load_reference
from swim2real.ui.films import FilmCache
from swim2real.ui.jobs import Job
from swimbase.arrays import Array
from swimbase.errors import AdvisorError, RunError

CAMERA = "camera.json"
_GROUND, _MARGIN = (1280, 720), 0.1  # px of the ground that a trial without a film is drawn on, and share left around
_MOST_ASKED = 60  # measurements that an advisor may want before it proposes


@dataclass
class Fit:
    """Trials and a robot, posed as a problem once.

    Attributes:
        folder: Reference folder.
        robot: The robot.
        run: Run whose values, settings and study are taken; None for the robot's own.
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
        self._scenes: dict[int, tuple[Callable[[Array], Array], dict[str, Any]]] = {}
        self.settings = CalibrationSettings()
        if self.run is not None:
            made = RunFolder(self.run).settings()
            names = ("protocol", "start", "horizon", "pieces", "hold_out")
            self.settings = replace(self.settings, **{name: getattr(made, name) for name in names})
        self.problem = Problem.with_settings(self.robot, reference, self.settings)

    def about(self) -> dict[str, Any]:
        """Parameters with bounds and what is known of them, trials with their films, and the values to begin with."""
        space, values = self.robot.space, self.robot.space.published
        study = None
        if self.run is not None:
            values = read_parameters(self.run, self.robot.name, space).values
            with suppress(RunError):  # one of an earlier version
                study = study_of(RunFolder(self.run))
        intervals = study.intervals if study is not None and study.complete else {}
        parameters = [
            {
                "name": one.name, "unit": one.unit, "low": one.lower, "high": one.upper, "offset": one.log_offset,
                "meaning": one.meaning, "model": one.published,
                **({"known": known.known, "interval": known.interval_95} if (known := intervals.get(one.name)) else {}),
            }
            for one in space
        ]  # fmt: skip
        trials = [{"name": trial.name, "held": trial.name in self.settings.hold_out} for trial in self.reference]
        return {"parameters": parameters, "trials": trials, "values": values, "links": self.robot.links}

    def simulated(self, values: Values, trial: str | None) -> dict[str, Any]:
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
        answer: dict[str, Any] = {"errors": errors, "diverged": lost}
        if trial is not None:
            answer |= self._drawn(chosen[0], compared[0])
        return answer

    def _drawn(self, index: int, compared: ComparedTrial) -> dict[str, Any]:
        """Places of the markers on the trial's film, or on the ground where there is none [px]."""
        real = self.reference.trials[index].track.positions[: len(compared.times)]
        if index not in self._scenes:
            self._scenes[index] = self._scene(index, real)
        to_pixels, scene = self._scenes[index]
        placed = in_world(compared, real) if compared.divergence is None else np.full_like(real, np.nan)
        times = rounded(compared.times - compared.times[0])
        return {**scene, "times": times, "simulated": places(to_pixels(placed))}

    def _scene(self, index: int, real: Array) -> tuple[Callable[[Array], Array], dict[str, Any]]:
        """Meters to pixels of the picture that a trial is drawn on, and what of it doesn't depend on a simulation."""
        trial = self.reference.trials[index]
        film = None if trial.video is None else trial.video.resolve()
        if film is not None and film.is_relative_to(self.root) and film.is_file():
            about, file = self.films.opened(film), camera_of(film, self.root)
            size, known = (about["width"], about["height"]), None if file is None else read_camera(file)
            to_pixels = fixed_camera(known, trial.meters_per_pixel, self.robot.marker_heights, size).to_pixels
            first = round((trial.video_begin + float(trial.track.times[0])) * (trial.film_rate or about["fps"]))
            note = " ".join(off_its_film(trial, to_pixels(real), self.folder))
            drawn = {"film": film.relative_to(self.root).as_posix(), "first": first, "note": note, "size": size}
        else:
            low, high = np.nanmin(real, axis=(0, 1)), np.nanmax(real, axis=(0, 1))
            scale = (1 - 2 * _MARGIN) * float((np.array(_GROUND) / np.maximum(high - low, 1e-6)).min())

            def to_pixels(positions: Array) -> Array:
                return (positions - (low + high) / 2) * scale * [1, -1] + np.array(_GROUND) / 2

            drawn = {"film": None, "first": 0, "note": "", "size": _GROUND}
        return to_pixels, {"trial": trial.name, "real": places(to_pixels(real)), **drawn}

    def search(self, values: Values, out: Path, job: Job) -> str:
        """Calibrates from values on, into a run folder; a person's stop concludes the run."""
        first = out / "first.json"
        out.mkdir()
        write_fit(first, self.problem, self.robot.space.check(values))

        def noted(progress: Progress) -> None:
            news = {} if not progress.improved else {"values": dict(progress.values), "best": 1e3 * progress.best}
            job.note(done=progress.done, run=out.name, **news)
            if job.stopping:
                progress.stop()

        settings = replace(self.settings, first=str(first))
        outcome = calibrate(
            self.reference, self.robot, settings, out, source=str(self.folder), on_progress=noted,
            on_warning=lambda line: job.note(warning=line),
        )  # fmt: skip
        if not job.stopping:
            write_report(out, self.robot)
        return f"run {out.name}: {outcome.verdict.sentence if outcome.verdict else 'done'}"

    def ask(self, values: Values, job: Job) -> str:
        """Has the built-in advisor say what differs, and propose values."""
        space = self.robot.space
        advisor = make_advisor(PHYSICS, self.robot, space, 0)
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
        job.note(proposed=space.to_values(advice.point))
        return " ".join(filter(None, (advice.diagnosis, advice.reasoning)))

    def _evaluated(self, candidate: Candidate) -> Evaluation:
        comparison = self.problem.evaluate(self.robot.space.to_values(candidate.point))
        failed = comparison.divergence is not None
        return Evaluation(candidate, comparison.loss, failed, evidence(comparison), comparison.residual_vector())


def camera_of(film: Path, root: Path) -> Path | None:
    """The camera file of a film: beside it, or in the folder."""
    return next((one for one in (film.parent / CAMERA, root / CAMERA) if one.is_file() and not one.is_symlink()), None)


def places(positions: Array) -> list[Any]:
    """Places for JSON, None where unknown [px]. Shape (T, M, 2)."""
    rows = np.round(positions, 1).tolist()
    return [[place if place[0] == place[0] and place[1] == place[1] else None for place in row] for row in rows]

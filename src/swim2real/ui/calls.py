"""Calls of the page: what each takes, and what it does."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, Field

from swim2real import api
from swim2real.calibration.loop import write_fit
from swim2real.identification.identifiability import StudyProgress
from swim2real.parameters import read_parameters
from swim2real.report import write_report
from swim2real.report.pages import inline_svg
from swim2real.report.run import read_run
from swim2real.report.run_charts import speeds
from swim2real.robots import ROBOTS
from swim2real.trials import load_reference
from swim2real.ui.fit import Fit, camera_of, resumed
from swim2real.ui.jobs import Job, JobNow
from swim2real.ui.marking import about_film, clicked, mark, track
from swim2real.ui.project import KEPT, LEFT, Project
from swimbase.checking import Number, PathText
from swimbase.errors import ArgumentError

Call = Callable[[Project, Any], object]
_MOST_FITS, _OPENING = 3, threading.Lock()  # fits that are open, of several pages


@dataclass(frozen=True)
class Picture:
    """A frame as JPEG, and its number."""

    content: bytes
    number: int


class _Nothing(BaseModel, extra="forbid"):
    """A call without arguments."""


class _OfFilm(BaseModel, extra="forbid"):
    """A film, from the folder."""

    film: PathText


class _OfRobot(_OfFilm):
    """A film and the robot in it, the trial that was tracked in it, and whether its midline is followed."""

    robot: PathText
    reference: PathText | None = None
    trial: str | None = None
    midline: bool = False


class _OfMarks(_OfFilm):
    """What was clicked in a film with a robot."""

    robot: PathText
    kind: Literal["points", "corrections"]


class _Marked(_OfMarks):
    """Places that were clicked in a frame, by name, and those that were taken away."""

    frame: int = Field(ge=0)
    put: dict[str, list[Number] | None]
    drop: tuple[str, ...] = ()


class _OfFrame(_OfFilm):
    """A frame of a film."""

    number: int = Field(ge=0)
    early: bool = False


class _OfFit(BaseModel, extra="forbid"):
    """Trials and a robot; with a run, its settings."""

    reference: PathText
    robot: PathText
    run: PathText | None = None


class _Begun(_OfFit):
    """A fit, and the run or file whose values it begins with."""

    begin: PathText | None = None


class _OfTrial(_OfFit):
    """A trial of a fit."""

    trial: str


class _OfValues(_OfFit):
    """Values of parameters, and the trial that is looked at."""

    values: dict[str, Number]
    trial: str | None = None


class _OfRun(BaseModel, extra="forbid"):
    """A run."""

    run: PathText


class _Work(_OfRun):
    """What is done with a run."""

    kind: Literal["resume", "identify", "report", "export"]


class _Held(_OfValues):
    """Values, and the trials that a search from them doesn't see."""

    held: tuple[str, ...] = ()


class _Kept(_Held):
    """Values that are to be found again: under a new name, or as the hand left them."""

    left: bool = False


def _frame(project: Project, asked: _OfFrame) -> Picture:
    film = project.place(asked.film)
    if asked.early:
        return Picture(*project.films.early(film, asked.number))
    return Picture(project.films.picture(film, asked.number), asked.number)


def _fit(project: Project, asked: _OfFit) -> Fit:
    folder, run = project.place(asked.reference), None if asked.run is None else project.place(asked.run)
    files = [*folder.glob("*.*"), *([] if asked.robot in ROBOTS else [project.place(asked.robot)])]
    stamp = max((file.stat().st_mtime_ns for file in files if file.is_file()), default=0)
    key = (folder, asked.robot, run, stamp)
    with _OPENING:
        if key not in project.fits:
            for one in filter(None, (asked.reference, asked.run)):
                project.folder(one)
            project.fits[key] = Fit(folder, project.robot(asked.robot), run, project.root, project.films)
            while len(project.fits) > _MOST_FITS:
                project.fits.popitem(last=False)
        project.fits.move_to_end(key)
        return project.fits[key]


def _scene(project: Project, asked: _OfTrial) -> dict[str, object]:
    scene = _fit(project, asked).scene(asked.trial)
    return vars(scene) if scene.film is None else {**vars(scene), **project.shown(scene.film)}


def _search(project: Project, asked: _Held) -> JobNow:
    fit, out = _fit(project, asked), _new(project, "fit-{}")
    title = f"search from here, into {out.name}"
    return project.jobs.start("search", title, lambda job: fit.search(asked.values, asked.held, out, job))


def _keep(project: Project, asked: _Kept) -> dict[str, str]:
    fit = _fit(project, asked)
    with project.lock:  # of two pages each has a name of its own
        path = project.root / LEFT if asked.left else _new(project, KEPT)
        chosen = {"reference": asked.reference, "run": asked.run, "held": asked.held}
        write_fit(path, fit.problem, fit.robot.space.check(asked.values), **chosen)
        project.saves += 1
    return {"said": f"{path.name} is written: this page, evaluate, view and --first take it"}


def _mark(project: Project, asked: _Marked) -> None:
    film, robot = project.place(asked.film), project.robot(asked.robot)
    about = project.films.opened(film)
    with project.lock:  # two pages may change the same file
        mark(film, (about.width, about.height), robot, asked.kind, asked.frame, asked.put, asked.drop)
        project.saves += 1


def _track(project: Project, asked: _OfRobot) -> JobNow:
    film, folder = project.place(asked.film), project.place(asked.reference or "reference")
    robot, title = project.robot(asked.robot), f"tracking {film.name}"
    work = partial(track, film, robot, folder, camera_of(film, project.root), asked.midline, project.films)
    return project.jobs.start("track", title, work, film=asked.film)


def _work(project: Project, asked: _Work) -> JobNow:
    folder = project.folder(asked.run)
    run = project.run(folder)
    if run.robot is None or run.reference is None:
        raise ArgumentError(f"'{asked.run}' is no run whose robot and trials are in this folder")
    robot, trials = project.robot(run.robot), project.folder(run.reference)

    def identified(job: Job) -> str:
        def noted(progress: StudyProgress) -> None:
            job.note(done=progress.evaluations, total=progress.most)
            job.heed()

        study = api.identify(folder, load_reference(trials), robot=robot, on_progress=noted)
        write_report(folder, robot)
        return f"the trials determine {study.determined:.1f} directions of {len(study.parameters)}"

    def exported(job: Job) -> str:
        api.export_model(read_parameters(folder, robot.name, robot.space).values, robot, folder / "model.xml")
        return f"{asked.run}/model.xml is written"

    def reported(job: Job) -> str:
        return f"{asked.run}/{write_report(folder, robot).name} is written: open it in a browser"

    works = {"identify": identified, "export": exported, "report": reported}
    works["resume"] = partial(resumed, trials, robot, folder)
    return project.jobs.start(asked.kind, f"{asked.kind} {asked.run}", works[asked.kind])


def _new(project: Project, name: str) -> Path:
    """The first place of a numbered name where nothing is."""
    return next(path for k in count(1) if not os.path.lexists(path := project.root / name.format(k)))


def _ask(project: Project, asked: _OfValues) -> JobNow:
    fit, name, out = _fit(project, asked), project.advisor, _new(project, "asked-{}")
    return project.jobs.start("ask", f"asking {name}", partial(fit.ask, asked.values, name, project.access, out))


def _speeds(project: Project, asked: _OfRun) -> dict[str, str]:
    folder = project.folder(asked.run)
    run = read_run(folder, project.robot(project.run(folder).robot or ""))
    return {"svg": inline_svg(partial(speeds, run), "speeds") if run.has_beat else ""}


CALLS: dict[str, tuple[type[BaseModel], Call]] = {
    "GET project": (_Nothing, lambda project, asked: {**vars(project.content()), "job": project.jobs.now()}),
    "GET job": (_Nothing, lambda project, asked: {**vars(project.jobs.now()), "saves": project.saves}),
    "POST stop": (_Nothing, lambda project, asked: project.jobs.stop()),
    "GET film": (_OfRobot, lambda project, asked: about_film(project, **vars(asked))),
    "GET marks": (_OfMarks, lambda project, asked: list(
        clicked(project.place(asked.film), project.robot(asked.robot), asked.kind).items())),
    "POST mark": (_Marked, _mark),
    "POST track": (_OfRobot, _track), "POST work": (_Work, _work), "GET frame": (_OfFrame, _frame),
    "POST fit": (_Begun, lambda project, asked: _fit(project, asked).about(
        None if asked.begin is None else project.place(asked.begin))), "POST scene": (_OfTrial, _scene),
    "POST simulate": (_OfValues, lambda project, asked: _fit(project, asked).simulated(asked.values, asked.trial)),
    "POST search": (_Held, _search), "POST keep": (_Kept, _keep), "POST ask": (_OfValues, _ask),
    "GET speeds": (_OfRun, _speeds),
}  # fmt: skip

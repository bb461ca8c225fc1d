"""Calls of the page: what each takes, and what it does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, Field

from swim2real import api
from swim2real.calibration.loop import write_fit
from swim2real.identification.identifiability import StudyProgress
from swim2real.parameters import read_parameters
from swim2real.report import write_report
from swim2real.trials import load_reference
from swim2real.ui.fit import Fit
from swim2real.ui.jobs import Job
from swim2real.ui.marking import about_film, save, track
from swim2real.ui.project import Project
from swimbase.checking import FileName, Number, PathText
from swimbase.errors import ArgumentError

Call = Callable[[Project, Any], dict[str, Any] | bytes]


class _Nothing(BaseModel, extra="forbid"):
    """A call without arguments."""


class _OfFilm(BaseModel, extra="forbid"):
    """A film, from the folder."""

    film: PathText


class _OfRobot(_OfFilm):
    """A film and the robot in it."""

    robot: PathText


class _Clicked(_OfFilm):
    """What was clicked in a film."""

    kind: Literal["points", "corrections"]
    content: dict[str, Any]


class _OfFrame(_OfFilm):
    """A frame of a film."""

    number: int = Field(ge=0)


class _OfFit(BaseModel, extra="forbid"):
    """Trials and a robot; with a run, its values and its settings."""

    reference: PathText
    robot: PathText
    run: PathText | None = None


class _OfValues(_OfFit):
    """Values of parameters, and the trial that is looked at."""

    values: dict[str, Number]
    trial: str | None = None


class _Work(BaseModel, extra="forbid"):
    """What is done with a run."""

    kind: Literal["identify", "report", "export"]
    run: PathText


class _OfName(_OfValues):
    """Values that are kept under a name."""

    name: FileName


def _fit(project: Project, asked: _OfFit) -> Fit:
    run = None if asked.run is None else project.folder(asked.run)
    folder = project.folder(asked.reference)
    stamp = max((file.stat().st_mtime_ns for file in folder.glob("*.*")), default=0)
    key = (folder, asked.robot, run, stamp)
    if project.fits.get("key") != key:
        fit = Fit(folder, project.robot(asked.robot), run, project.root, project.films)
        project.fits = {"key": key, "fit": fit}
    return project.fits["fit"]


def _search(project: Project, asked: _OfName) -> dict[str, Any]:
    fit, out = _fit(project, asked), _new(project, asked.name)
    title = f"search from here, into {out.name}"
    return project.jobs.start("search", title, lambda job: fit.search(asked.values, out, job)).as_dict()


def _keep(project: Project, asked: _OfName) -> dict[str, Any]:
    fit, path = _fit(project, asked), _new(project, f"{asked.name}.json")
    write_fit(path, fit.problem, fit.robot.space.check(asked.values))
    return {"said": f"{path.name} is written: evaluate, view and --first take it"}


def _track(project: Project, asked: _OfRobot) -> dict[str, Any]:
    film = project.place(asked.film)
    title = f"tracking {film.name}"
    return project.jobs.start("track", title, lambda job: track(project, film, asked.robot, job)).as_dict()


def _work(project: Project, asked: _Work) -> dict[str, Any]:
    run = next((one for one in project.content()["runs"] if one["path"] == asked.run), {})
    if not run.get("robot") or not run.get("reference"):
        raise ArgumentError(f"'{asked.run}' is no run whose robot and trials are in this folder")
    folder, robot = project.folder(asked.run), project.robot(run["robot"])
    reference = load_reference(project.folder(run["reference"]))

    def identified(job: Job) -> str:
        def noted(progress: StudyProgress) -> None:
            job.note(done=progress.evaluations, total=progress.most)
            job.heed()

        study = api.identify(folder, reference, robot=robot, on_progress=noted)
        write_report(folder, robot)
        return f"the trials determine {study.determined:.1f} directions of {len(study.parameters)}"

    def exported(job: Job) -> str:
        api.export_model(read_parameters(folder, robot.name, robot.space).values, robot, folder / "model.xml")
        return f"{asked.run}/model.xml is written"

    def reported(job: Job) -> str:
        return f"{asked.run}/{write_report(folder, robot).name} is written: open it in a browser"

    works = {"identify": identified, "export": exported, "report": reported}
    return project.jobs.start(asked.kind, f"{asked.kind} {asked.run}", works[asked.kind]).as_dict()


def _new(project: Project, name: str) -> Path:
    path = project.place(name)
    if path.exists():
        raise ArgumentError(f"'{name}' is there; choose another name")
    return path


def _ask(project: Project, asked: _OfValues) -> dict[str, Any]:
    fit = _fit(project, asked)
    return project.jobs.start("ask", "what the advisor says", lambda job: fit.ask(asked.values, job)).as_dict()


CALLS: dict[str, tuple[type[BaseModel], Call]] = {
    "GET project": (_Nothing, lambda project, asked: {**project.content(), "job": project.jobs.as_dict()}),
    "GET job": (_Nothing, lambda project, asked: project.jobs.as_dict()),
    "POST stop": (_Nothing, lambda project, asked: project.jobs.stop()),
    "GET film": (_OfRobot, lambda project, asked: about_film(project, project.place(asked.film), asked.robot)),
    "POST mark": (_Clicked, lambda project, asked: save(project.place(asked.film), asked.kind, asked.content)),
    "POST track": (_OfRobot, _track), "POST work": (_Work, _work),
    "GET frame": (_OfFrame, lambda project, asked: project.films.picture(project.place(asked.film), asked.number)),
    "POST fit": (_OfFit, lambda project, asked: _fit(project, asked).about()),
    "POST simulate": (_OfValues, lambda project, asked: _fit(project, asked).simulated(asked.values, asked.trial)),
    "POST search": (_OfName, _search), "POST keep": (_OfName, _keep), "POST ask": (_OfValues, _ask),
}  # fmt: skip

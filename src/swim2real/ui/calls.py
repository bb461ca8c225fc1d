"""Calls of the page: what each takes, and what it does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pydantic import BaseModel, Field

from swim2real.ui.project import Project
from swimbase.checking import PathText

Call = Callable[[Project, Any], dict[str, Any] | bytes]


class _Nothing(BaseModel, extra="forbid"):
    """A call without arguments."""


class _OfFilm(BaseModel, extra="forbid"):
    """A film, from the folder."""

    film: PathText


class _OfFrame(_OfFilm):
    """A frame of a film."""

    number: int = Field(ge=0)


def _project(project: Project, asked: _Nothing) -> dict[str, Any]:
    return {**project.content(), "job": project.jobs.as_dict()}


def _job(project: Project, asked: _Nothing) -> dict[str, Any]:
    return project.jobs.as_dict()


def _stop(project: Project, asked: _Nothing) -> dict[str, Any]:
    project.jobs.stop()
    return project.jobs.as_dict()


def _film(project: Project, asked: _OfFilm) -> dict[str, Any]:
    return project.films.opened(project.place(asked.film))


def _frame(project: Project, asked: _OfFrame) -> bytes:
    return project.films.picture(project.place(asked.film), asked.number)


CALLS: dict[str, tuple[type[BaseModel], Call]] = {
    "GET project": (_Nothing, _project), "GET job": (_Nothing, _job), "POST stop": (_Nothing, _stop),
    "GET film": (_OfFilm, _film), "GET frame": (_OfFrame, _frame),
}  # fmt: skip

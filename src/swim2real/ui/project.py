"""The folder that the page shows: films, references, robots and runs, as the commands leave them."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swim2real.calibration import RunFolder
from swim2real.calibration.run_folder import SETTINGS
from swim2real.parameters.file import BEST
from swim2real.robots import ROBOTS, load_robot
from swim2real.robots.robot import Robot
from swim2real.trials.reference import FILMS, INDEX, Index
from swim2real.ui.films import FilmCache
from swim2real.ui.jobs import Jobs
from swimbase.checking import read
from swimbase.errors import ArgumentError, Swim2RealError, TrialError

_DEEPEST, _MOST = 4, 5000  # folders into which is looked, and files
_LARGEST_ROBOT = 4 << 20  # bytes of a robot file


@dataclass
class Project:
    """A folder with what is open of it.

    Attributes:
        root: The folder, resolved.
        jobs: What is under way.
        films: Films that are open.
        fits: The fit that is open, and what it is of.
    """

    root: Path
    jobs: Jobs = field(default_factory=Jobs)
    films: FilmCache = field(default_factory=FilmCache)
    fits: dict[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        if not self.root.is_dir():
            raise ArgumentError(f"'{self.root}' is no folder; give the one with your films, or where `demo` wrote")
        self.root = self.root.resolve()

    def place(self, name: str) -> Path:
        """The path of something in the folder, also of what isn't there yet.

        Raises:
            ArgumentError: It lies outside, as it is written or by a link.
        """
        try:
            path = (self.root / name).resolve()
        except (OSError, ValueError, RuntimeError):
            path = Path("/")
        if not path.is_relative_to(self.root) or "\0" in name:
            raise ArgumentError(f"'{name[:200]}' isn't in the folder '{self.root}'; nothing outside of it is read")
        return path

    def folder(self, name: str) -> Path:
        """The path of a folder of which no link leads outside."""
        path = self.place(name)
        for link in filter(Path.is_symlink, path.rglob("*")):
            self.place(str(link))
        return path

    def robot(self, name: str) -> Robot:
        """A robot by its name, or by its file in the folder."""
        return load_robot(name if name in ROBOTS else self.place(name))

    def name(self, path: Path) -> str:
        """The path of something from the folder."""
        return path.resolve().relative_to(self.root).as_posix()

    def content(self) -> dict[str, Any]:
        """What is there: paths from the folder, with what the page shows of each.

        Films are listed with the files of their points and corrections and the trial that was tracked in them.
        """
        films: dict[str, dict[str, Any]] = {}
        references: list[dict[str, Any]] = []
        runs: list[dict[str, Any]] = []
        robots = list[str]()
        for path in self._files():
            folder = path.parent
            if path.name == INDEX:
                references.append({"path": self.name(folder), "trials": self._trials(folder)})
            elif path.name == SETTINGS and (folder / "record.jsonl").is_file():
                runs.append({"path": self.name(folder), **_run(folder, self)})
            elif path.suffix.lower() in FILMS and not (folder.parent / INDEX).is_file():
                films[self.name(path)] = {"points": path.with_suffix(".points.json").is_file()}
            elif path.suffix == ".toml" and _is_robot(path):
                robots.append(self.name(path))
        for reference in references:
            for trial in reference["trials"]:
                if trial["film"] in films:
                    films[trial["film"]] |= {"reference": reference["path"], "trial": trial["name"]}
        return {
            "folder": self.root.name, "films": [{"path": path, **film} for path, film in films.items()],
            "references": references, "runs": runs, "robots": [*robots, *ROBOTS],
            "taken": sorted({path.stem for path in self.root.iterdir()}),
        }  # fmt: skip

    def film(self, path: Path) -> dict[str, Any]:
        """What the list has of a film; nothing of one that isn't in it."""
        return next((one for one in self.content()["films"] if one["path"] == self.name(path)), {})

    def _files(self) -> Iterator[Path]:
        """Files in the folder, in order, without hidden ones and links to folders."""
        count = 0
        for folder, folders, names in os.walk(self.root):
            deep = len(Path(folder).relative_to(self.root).parts) >= _DEEPEST
            folders[:] = [] if deep else sorted(name for name in folders if name[0] != ".")
            for name in sorted(names):
                path, count = Path(folder, name), count + 1
                if count > _MOST:
                    return
                if name[0] != "." and path.resolve().is_relative_to(self.root):
                    yield path

    def _trials(self, folder: Path) -> list[dict[str, Any]]:
        try:
            index = read(Index, folder / INDEX, "reference", TrialError)
        except Swim2RealError:  # it is reported when it is opened
            return []
        films = [None if trial.video is None else (folder / trial.video).resolve() for trial in index.trials]
        return [
            {"name": trial.name, "film": self.name(film) if film and film.is_relative_to(self.root) else None}
            for trial, film in zip(index.trials, films, strict=True)
        ]


def _run(folder: Path, project: Project) -> dict[str, Any]:
    """A run in the list: robot, reference, and how it ended."""
    try:
        run = RunFolder(project.folder(str(folder)))
        settings, outcome = run.settings(), run.outcome()
    except Swim2RealError as error:
        return {"fault": str(error)}
    file = None if settings.robot_file is None else (folder / settings.robot_file).resolve()
    reference = (folder / settings.reference).resolve()
    inside = [path for path in (file, reference) if path is not None and path.is_relative_to(project.root)]
    fit, verdict = (None, None) if outcome is None else (outcome.fit, outcome.verdict)
    return {
        "robot": settings.robot if file is None else project.name(file) if file in inside else None,
        "reference": project.name(reference) if reference in inside else None,
        "usable": (folder / BEST).is_file(), "error": None if fit is None else fit.error,
        "verdict": None if verdict is None else verdict.kind,
    }  # fmt: skip


def _is_robot(path: Path) -> bool:
    try:
        return path.stat().st_size < _LARGEST_ROBOT and "model" in tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return False

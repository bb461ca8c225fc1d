"""The folder that the page shows: films, references, robots and runs, as the commands leave them."""

from __future__ import annotations

import hmac
import os
import secrets
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from urllib.parse import quote

from swim2real.calibration import RunFolder
from swim2real.calibration.run_folder import SETTINGS
from swim2real.parameters.file import BEST
from swim2real.robots import ROBOTS, load_robot
from swim2real.robots.robot import Robot
from swim2real.settings import FILES, PHYSICS, VlmAccess, check_advisor, replayed_run
from swim2real.trials.reference import FILMS, INDEX, Index
from swim2real.ui.films import FilmCache
from swim2real.ui.fit import Fit
from swim2real.ui.jobs import Jobs
from swimbase.checking import read
from swimbase.errors import ArgumentError, Swim2RealError, TrialError

_DEEPEST, _MOST = 4, 5000  # folders into which is looked, and files
_LARGEST_ROBOT = 4 << 20  # bytes of a robot file


@dataclass(frozen=True)
class ListedFilm:
    """A film in the list: whether it has points, and the trial that was tracked in it."""

    path: str
    points: bool
    reference: str | None = None
    trial: str | None = None


@dataclass(frozen=True)
class ListedReference:
    """A reference in the list, and the films of its trials by name."""

    path: str
    trials: dict[str, str | None]


@dataclass(frozen=True)
class ListedRun:
    """A run in the list; without robot, reference and values where it can't be read."""

    path: str
    robot: str | None = None
    reference: str | None = None
    usable: bool = False
    error: float | None = None
    verdict: str | None = None
    sentence: str = ""


@dataclass(frozen=True)
class Content:
    """What is in a folder."""

    folder: str
    films: list[ListedFilm]
    references: list[ListedReference]
    runs: list[ListedRun]
    robots: list[str]


@dataclass
class Project:
    """A folder with what is open of it.

    Attributes:
        root: The folder, resolved.
        jobs: What is under way.
        films: Films that are open.
        secret: By it the addresses of films are sealed.
        fit: The fit that is open, after what it is of.
        advisor: Who is asked about a fit.
        access: How it is reached, if it is a VLM.
    """

    root: Path
    jobs: Jobs = field(default_factory=Jobs)
    films: FilmCache = field(default_factory=FilmCache)
    secret: bytes = field(default_factory=lambda: secrets.token_bytes(24), repr=False)
    fit: tuple[object, Fit] | None = None
    advisor: str = PHYSICS
    access: VlmAccess = field(default_factory=VlmAccess)

    def __post_init__(self) -> None:
        check_advisor(self.advisor)
        if self.advisor == FILES or replayed_run(self.advisor) is not None:
            raise ArgumentError(
                f"advisor is '{self.advisor}'; on the page it must be {PHYSICS} or PROVIDER:MODEL: you have the sliders"
            )
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

    def shown(self, film: str) -> dict[str, object]:
        """A film as the page shows it: size, rate and times of its frames, and the address for the browser's player."""
        about = self.films.opened(self.place(film))
        return {**vars(about), "address": f"/film/{self.seal(film)}/{quote(film)}"}

    def seal(self, name: str) -> str:
        """What the address of a film has beside its path, so that nobody else knows it."""
        return hmac.new(self.secret, name.encode(), "sha256").hexdigest()

    def content(self) -> Content:
        """What is there: paths from the folder, with what the page shows of each."""
        films: dict[str, ListedFilm] = {}
        references: list[ListedReference] = []
        runs: list[ListedRun] = []
        robots = list[str]()
        paths = list(islice(self._files(), _MOST + 1))
        shown = self.root.name + (f" (its first {_MOST} files)" if len(paths) > _MOST else "")
        for path in paths[:_MOST]:
            folder = path.parent
            if path.name == INDEX:
                references.append(ListedReference(self.name(folder), self._trials(folder)))
            elif path.name == SETTINGS and (folder / "record.jsonl").is_file():
                runs.append(self.run(folder))
            elif path.suffix.lower() in FILMS and not (folder.parent / INDEX).is_file():
                films[self.name(path)] = ListedFilm(self.name(path), path.with_suffix(".points.json").is_file())
            elif path.suffix == ".toml" and _is_robot(path):
                robots.append(self.name(path))
        for reference in references:
            for trial, film in reference.trials.items():
                if film in films:
                    films[film] = replace(films[film], reference=reference.path, trial=trial)
        return Content(shown, list(films.values()), references, runs, [*robots, *ROBOTS])

    def run(self, folder: Path) -> ListedRun:
        """A run in the list: robot, reference, and how it ended."""
        try:
            run = RunFolder(self.folder(str(folder)))
            settings, outcome = run.settings(), run.outcome()
        except Swim2RealError:
            return ListedRun(self.name(folder))
        file = None if settings.robot_file is None else (folder / settings.robot_file).resolve()
        robot = settings.robot if file is None else self.name(file) if file.is_relative_to(self.root) else None
        reference = (folder / settings.reference).resolve()
        fit, verdict = (None, None) if outcome is None else (outcome.fit, outcome.verdict)
        ended = () if verdict is None else (verdict.title, verdict.sentence)
        return ListedRun(
            self.name(folder), robot, self.name(reference) if reference.is_relative_to(self.root) else None,
            (folder / BEST).is_file(), None if fit is None else fit.error, *ended,
        )  # fmt: skip

    def _files(self) -> Iterator[Path]:
        """Files in the folder, in order, without hidden ones and links to folders."""
        for folder, folders, names in os.walk(self.root):
            deep = len(Path(folder).relative_to(self.root).parts) >= _DEEPEST
            folders[:] = [] if deep else sorted(name for name in folders if name[0] != ".")
            for name in sorted(names):
                path = Path(folder, name)
                if name[0] != "." and path.resolve().is_relative_to(self.root):
                    yield path

    def _trials(self, folder: Path) -> dict[str, str | None]:
        try:
            index = read(Index, folder / INDEX, "reference", TrialError)
        except Swim2RealError:  # it is reported when it is opened
            return {}
        films = [None if trial.video is None else (folder / trial.video).resolve() for trial in index.trials]
        return {
            trial.name: self.name(film) if film and film.is_relative_to(self.root) else None
            for trial, film in zip(index.trials, films, strict=True)
        }


def _is_robot(path: Path) -> bool:
    try:
        return path.stat().st_size < _LARGEST_ROBOT and "model" in tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return False

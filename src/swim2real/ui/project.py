"""The folder that the page shows: films, references, robots and runs, as the commands leave them."""

from __future__ import annotations

import hmac
import os
import secrets
import threading
import tomllib
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import suppress
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
from swim2real.ui.fit import Fit, Left
from swim2real.ui.jobs import Jobs
from swimbase.checking import read
from swimbase.errors import ArgumentError, ParameterError, Swim2RealError, TrialError

_DEEPEST, _MOST = 4, 5000  # folders into which is looked, and files
_LARGEST_ROBOT = 4 << 20  # bytes of a robot file
LEFT, KEPT = "sliders.json", "values-{}.json"  # values as the hand left them, and under a new name


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
    """A run in the list, or a file of values with the run of their settings; without a robot it can't be read."""

    path: str
    robot: str | None = None
    reference: str | None = None
    run: str | None = None
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
        fits: Fits that are open, by what they are of.
        lock: Held while files are written for a page.
        saves: How often a page has written something, by which others know that there is news.
        advisor: Who is asked about a fit.
        access: How it is reached, if it is a VLM.
    """

    root: Path
    jobs: Jobs = field(default_factory=Jobs)
    films: FilmCache = field(default_factory=FilmCache)
    secret: bytes = field(default_factory=lambda: secrets.token_bytes(24), repr=False)
    fits: OrderedDict[object, Fit] = field(default_factory=OrderedDict[object, Fit])
    lock: threading.Lock = field(default_factory=threading.Lock)
    saves: int = 0
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
            elif path.name == LEFT or path.match(KEPT.format("*")):
                runs.append(self._values(path))
            elif path.suffix == ".toml" and _is_robot(path):
                robots.append(self.name(path))
        for reference in references:
            for trial, film in reference.trials.items():
                if film in films:
                    films[film] = replace(films[film], reference=reference.path, trial=trial)
        runs.sort(key=lambda run: _changed(self.root / run.path))
        return Content(shown, list(films.values()), references, runs, [*robots, *ROBOTS])

    def run(self, folder: Path) -> ListedRun:
        """A run in the list: robot, reference, and how it ended."""
        try:
            run = RunFolder(self.folder(str(folder)))
            settings, outcome = run.settings(), run.outcome()
        except Swim2RealError:
            return ListedRun(self.name(folder))
        robot = settings.robot if settings.robot_file is None else self._inside(folder / settings.robot_file)
        fit, verdict = (None, None) if outcome is None else (outcome.fit, outcome.verdict)
        ended = () if verdict is None else (verdict.title, verdict.sentence)
        path, reference = self.name(folder), self._inside(folder / settings.reference)
        error = None if fit is None else fit.error
        return ListedRun(path, robot, reference, path, (folder / BEST).is_file(), error, *ended)

    def _values(self, path: Path) -> ListedRun:
        try:
            left = read(Left, path, "values", ParameterError)
        except Swim2RealError:
            return ListedRun(self.name(path))
        robot = left.robot if left.robot_file is None else self._inside(path.parent / left.robot_file)
        return ListedRun(self.name(path), robot, left.reference, left.run, usable=True)

    def _inside(self, path: Path) -> str | None:
        """The path of something from the folder; None outside of it."""
        return self.name(path) if path.resolve().is_relative_to(self.root) else None

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
        films = ((trial.name, trial.video) for trial in index.trials)
        return {name: None if film is None else self._inside(folder / film) for name, film in films}


def _changed(path: Path) -> float:
    """When the values of a run, or in a file, were written; 0 where there are none."""
    with suppress(OSError):
        return (path / BEST if path.is_dir() else path).stat().st_mtime
    return 0.0


def _is_robot(path: Path) -> bool:
    try:
        return path.stat().st_size < _LARGEST_ROBOT and "model" in tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return False

"""What the briefing asks of a kind of trial: its facts, its words and its pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from swim2real.objective import Comparison
from swim2real.rendering.drawing import Bytes
from swim2real.robots.robot import Robot

Facts = Mapping[str, Any]


class Scene(Protocol):
    """A compared trial, ready to be drawn.

    Attributes:
        name: Of the trial.
        title: Of it, in a few words.
        loss: What it adds to the loss [m].
        pace: Of its fastest motion, which a film must not miss [Hz].
        start: Of what is compared, since the first frame of its real film [s].
        duration: Of what is compared [s].
        clip_note: What is where in its film.
        film_note: Which moments of its real film are shown.
    """

    name: str
    title: str
    loss: float
    pace: float
    start: float
    duration: float
    clip_note: str
    film_note: str

    def write_clip(self, path: str | Path, fps: float, width: int) -> None:
        """Writes a film of the simulated trial over the real one.

        Raises:
            ArgumentError: A number is not allowed.
            MissingExtraError: Pillow or PyAV isn't installed.
        """
        ...

    def sheet(self, moments: int, columns: int, width: int) -> Bytes:
        """Several moments in one picture. Raises as `write_clip`."""
        ...

    def sheet_note(self, moments: int) -> str:
        """What is where in that picture."""
        ...

    def film_times(self, moments: int) -> list[float]:
        """As many moments of the real film [s]."""
        ...


class Album(Protocol):
    """All trials of a comparison, drawn in one scale."""

    @property
    def scenes(self) -> Sequence[Scene]:
        """In the order in which they are shown."""
        ...

    def overview(self, moments: int, width: int) -> Bytes:
        """All trials in one picture. Raises as `Scene.write_clip`."""
        ...


class Telling(Protocol):
    """How trials of one kind are told and shown.

    Attributes:
        kind: In a word, as the facts have it.
        motion: What a trial shows, as a noun.
        names: What is to be said of trials' names; empty for nothing.
        look_for: Discrepancies that an advisor is asked to name.
        alike: Effects that look alike, and what tells them apart.
    """

    kind: str
    motion: str
    names: str
    look_for: str
    alike: str

    def compared(self, detail: Facts, robot: Robot) -> dict[str, Any]:
        """How trials are compared: `protocol`, `horizon`, `loss` in words, and what else the words need."""
        ...

    def trials(self, detail: Facts, robot: Robot) -> list[dict[str, Any]]:
        """Every trial that was simulated, with `name`, `diverged`, `error` and more, in the order of the tables."""
        ...

    def differences(self, trials: Sequence[Facts]) -> dict[str, Any]:
        """What differs over all trials, with `worst_trial` and more."""
        ...

    def outcome(self, trials: Sequence[Facts]) -> dict[str, Any]:
        """What a step did, beside its loss; of no trials, that nothing is known."""
        ...

    def markers(self, facts: Facts) -> str:
        """A sentence on the markers."""
        ...

    def called(self, trial: Facts) -> str:
        """A trial by its name, and what tells it apart."""
        ...

    def details(self, facts: Facts) -> list[str]:
        """Paragraphs and tables on the differences."""
        ...

    def steps(self, facts: Facts) -> str:
        """A sentence on what each step tells."""
        ...

    def step(self, outcome: Facts) -> str:
        """An outcome in few words after its loss; empty where nothing is known."""
        ...

    def album(self, comparison: Comparison, robot: Robot) -> Album:
        """The trials of a comparison, ready to be drawn.

        Raises:
            TrialError: They are of another kind.
        """
        ...

"""The folder of a run: settings, an append-only record, the best parameters. Survives being killed at any moment."""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, cast

from swim2real import store
from swim2real.checking import shown
from swim2real.errors import RunError
from swim2real.parameters.file import BEST

FORMAT = 1
SETTINGS, RECORD, OUTCOME, TRIALS = "settings.json", "record.jsonl", "outcome.json", "trials.npz"

# settings that may differ when a run goes on
_FREE = ("budget", "threads")
ADDED = {
    "start": "speed",
    "probes": 0,
    "give_up": None,
    "pieces": None,
    "first": "random",
}  # settings that earlier versions didn't write
_FALLING = 0.05  # of the loss, by which the last quarter of the budget may lower it in a run that has converged


class RunFolder:
    """Reads and writes one run folder."""

    RESTORE = "restore it or begin a new run"

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    @property
    def settings_path(self) -> Path:
        """Where the settings are."""
        return self.path / SETTINGS

    @property
    def best_path(self) -> Path:
        """Where the best parameters are."""
        return self.path / BEST

    @property
    def exists(self) -> bool:
        """Whether a run was begun here."""
        return self.settings_path.is_file()

    @contextmanager
    def locked(self) -> Generator[None]:
        """Keeps other processes out while a run writes here.

        Raises:
            RunError: Another process has the run, or the folder can't be made.
        """
        with ExitStack() as stack:
            with self._disk():
                try:
                    stack.enter_context(store.locked(self.path))
                except BlockingIOError:
                    raise RunError(
                        f"another process is working on run folder '{self.path}'; wait for it or use another"
                    ) from None
            yield

    def begin(self, settings: Mapping[str, Any]) -> None:
        """Writes the settings of a new run.

        Raises:
            RunError: The folder holds a run already, or can't be written.
        """
        if self.exists:
            raise RunError(f"'{self.path}' holds a run already; go on with --resume or choose another folder")
        self.write_json(SETTINGS, {"format": FORMAT, **settings})

    def resume(self, settings: Mapping[str, Any]) -> None:
        """Checks that a run can go on with these settings, and takes over the new budget.

        Raises:
            RunError: A setting that decides the result differs.
        """
        recorded = self.settings()
        wanted = json.loads(json.dumps(dict(settings)))
        for key, value in wanted.items():
            before = recorded.get(key, ADDED.get(key))
            if key not in _FREE and before != value:
                raise RunError(
                    f"run '{self.path}' can't go on: {key} was {shown(before)} and is now {shown(value)}; "
                    f"use the same settings and reference, or begin a new run"
                )
        if wanted["budget"] > recorded.get("budget", 0):
            self.write_json(SETTINGS, {**recorded, "budget": wanted["budget"]})

    def settings(self) -> dict[str, Any]:
        """The recorded settings.

        Raises:
            RunError: No run here, or of another format.
        """
        content = self._read_json(SETTINGS, "is no run folder: it has no settings.json")
        if content.get("format") != FORMAT:
            raise RunError(
                f"run '{self.path}' has format {content.get('format')!r}; this version of swim2real reads {FORMAT}"
            )
        return content

    def outcome(self) -> dict[str, Any] | None:
        """What was found at the end of the run, None before it."""
        if not (self.path / OUTCOME).is_file():
            return None
        content = self._read_json(OUTCOME, "")
        return {
            **content,
            "fit": upgraded_evidence(content.get("fit")),
            "held_out": upgraded_evidence(content.get("held_out")),
        }

    def record(self) -> list[dict[str, Any]]:
        """All recorded evaluations. A last line that was cut off by a crash doesn't count.

        Raises:
            RunError: Another line can't be read.
        """
        path = self.path / RECORD
        with self._disk():
            lines = store.read_lines(path)
        entries: list[dict[str, Any]] = []
        for number, line in enumerate(lines, start=1):
            try:
                entry = json.loads(line)
            except ValueError as error:
                raise RunError(f"{path}, line {number} is damaged ({error}); {self.RESTORE}") from error
            if not isinstance(entry, dict):
                raise RunError(f"{path}, line {number} is damaged (no evaluation); {self.RESTORE}")
            if "evidence" in entry:
                entry["evidence"] = upgraded_evidence(entry["evidence"])
            entries.append(cast("dict[str, Any]", entry))
        return entries

    def drop_cut_line(self) -> None:
        """Removes what a crash left of a last line, so that appending is safe."""
        with self._disk():
            store.drop_cut_line(self.path / RECORD)

    def append(self, entry: Mapping[str, Any]) -> None:
        """Adds an evaluation to the record; it is on the disk when this returns."""
        with self._disk():
            store.append_line(self.path / RECORD, entry)

    def write_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Writes a file of the folder, whole or not at all."""
        with self._disk():
            store.write_json(self.path / name, content)

    def write_arrays(self, name: str, arrays: Mapping[str, Any]) -> None:
        """Writes an .npz file of the folder, whole or not at all."""
        with self._disk():
            store.write_arrays(self.path / name, arrays)

    def read_arrays(self, name: str) -> dict[str, Any]:
        """The content of an .npz file that was written when the run ended.

        Raises:
            RunError: It isn't there, or damaged.
        """
        path = self.path / name
        try:
            return store.read_arrays(path)
        except FileNotFoundError:
            raise RunError(f"run '{self.path}' has no {name} yet; it is written when a run ends") from None
        except (OSError, ValueError) as error:
            raise RunError(f"{path} can't be read: {error}") from error

    def _read_json(self, name: str, missing: str) -> dict[str, Any]:
        path = self.path / name
        try:
            content = store.read_json(path)
        except FileNotFoundError:
            raise RunError(f"'{self.path}' {missing}") from None
        except (OSError, ValueError) as error:
            raise RunError(f"{path} can't be read: {error}") from error
        if not isinstance(content, dict):
            raise RunError(f"{path} must hold a JSON object")
        return cast("dict[str, Any]", content)

    @contextmanager
    def _disk(self) -> Generator[None]:
        """Turns what the system says of the disk into a sentence."""
        try:
            yield
        except OSError as error:
            raise RunError(
                f"can't write run folder '{self.path}': {error.strerror or error}; what was recorded so far is kept, "
                f"--resume goes on from there"
            ) from error


def best_losses(entries: Sequence[Mapping[str, Any]]) -> list[float]:
    """Loss of the incumbent after each evaluation [m]; that of a failure as long as all failed."""
    losses: list[float] = []
    best: float | None = None
    for entry in entries:
        if not entry["failed"]:
            best = entry["loss"] if best is None else min(best, entry["loss"])
        losses.append(entry["loss"] if best is None else best)
    return losses


def still_falling(entries: Sequence[Mapping[str, Any]], settings: Mapping[str, Any]) -> str | None:
    """A warning that a run hadn't converged: its last quarter lowered the loss by more than 5 %.

    Args:
        entries: Evaluations on record.
        settings: Settings of the run; `budget` and `method` are read.

    Returns:
        None for a run that converged, hasn't spent its budget, or is shorter than four evaluations.
    """
    budget = settings.get("budget", 0)
    if budget < 4 or len(entries) < budget:
        return None
    losses = best_losses(entries)
    before, end = losses[len(losses) - len(losses) // 4 - 1], losses[-1]
    if end >= (1 - _FALLING) * before:
        return None
    more = "begin a new run with a higher --budget"  # its stages are planned by the budget
    if settings.get("method") != "staged":
        more = "raise --budget and add --resume"
    return (
        f"the loss was still falling: {100 * (1 - end / before):.0f} % lower in the last quarter of the budget; {more}"
    )


def upgraded_evidence(evidence: Any) -> Any:
    """Evidence as this version has it: of recordings 0.1 called the aligned error `marker_error`."""
    if not isinstance(evidence, dict) or cast("Any", evidence).get("protocol") != "playback":
        return cast("Any", evidence)
    content = cast("dict[str, Any]", evidence)
    trials = {name: _renamed(trial) for name, trial in cast("dict[str, Any]", content.get("trials", {})).items()}
    return {**_renamed(content), "trials": trials}


def _renamed(figures: Mapping[str, Any]) -> dict[str, Any]:
    names = {"marker_error": "aligned_marker_error", "marker_errors": "aligned_marker_errors"}
    return {names.get(key, key): value for key, value in figures.items()}

"""The folder of a run: settings, an append-only record, the best parameters. Survives being killed at any moment."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, cast

from numpy.typing import NDArray

from swim2real.calibration.file_models import Outcome, RecordedEvaluation
from swim2real.calibration.run_settings import FORMAT, RunSettings
from swim2real.parameters.file import BEST
from swimbase import store
from swimbase.checking import check, shown
from swimbase.errors import ArgumentError, RunError
from swimbase.parsing import from_json

SETTINGS, RECORD, OUTCOME, TRIALS = "settings.json", "record.jsonl", "outcome.json", "trials.npz"
# what is written only by the process that has the run
_WRITTEN = (
    SETTINGS, RECORD, BEST, OUTCOME, TRIALS, "identif*.json", "advisor/*.json", "advisor/media/*", "advisor/round_*/*",
)  # fmt: skip


class RunFolder:
    """Reads and writes one run folder."""

    RESTORE = "restore it or begin a new run"

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    @property
    def settings_path(self) -> Path:
        """Path of the settings."""
        return self.path / SETTINGS

    @property
    def best_path(self) -> Path:
        """Path of the best parameters."""
        return self.path / BEST

    @property
    def exists(self) -> bool:
        """True if a run was begun here."""
        return self.settings_path.is_file()

    @contextmanager
    def locked(self) -> Generator[None]:
        """Keeps other processes out while a run writes here.

        Raises:
            RunError: Another process has the run, or the folder can't be made.
        """
        with ExitStack() as stack:
            with self._disk(busy=f"another process is working on run folder '{self.path}'; wait for it or use another"):
                stack.enter_context(store.locked(self.path))
                store.remove_leftovers(self.path, _WRITTEN)
            yield

    def begin(self, settings: RunSettings) -> None:
        """Writes the settings of a new run.

        Raises:
            RunError: The folder holds a run already, or can't be written.
        """
        if self.exists:
            raise RunError(f"'{self.path}' holds a run already; go on with --resume or choose another folder")
        self._write_settings(settings)

    def resume(self, settings: RunSettings) -> None:
        """Checks that a run can go on with these settings; takes over a higher budget, or that it is to be finished.

        Raises:
            RunError: A setting that decides the result differs.
        """
        recorded = self.settings()
        if (differing := recorded.difference(settings)) is not None:
            name, before, now = differing
            if name == "robot_fingerprint":
                raise RunError(
                    f"run '{self.path}' can't go on: its robot file or model has changed since; begin a new run "
                    f"from its values: --first {self.path}, and another --out"
                )
            if name == "reference_fingerprint":
                raise RunError(
                    f"run '{self.path}' can't go on: it was made with other trials than the ones given, or they have "
                    f"changed since; give the ones that it was made with ({recorded.reference}), or begin a new run"
                )
            raise RunError(
                f"run '{self.path}' can't go on: {name} was {shown(before)} and is now {shown(now)}; "
                f"use the same settings and reference, or begin a new run"
            )
        goes_on = settings.method == "multi-start" and not settings.finish
        budget = max(settings.budget, recorded.budget) if settings.budget and recorded.budget else recorded.budget
        budget = budget if (settings.budget and recorded.budget) or not goes_on else settings.budget
        if (budget, settings.finish) != (recorded.budget, recorded.finish):
            self._write_settings(replace(recorded, budget=budget, finish=settings.finish))

    def settings(self) -> RunSettings:
        """The recorded settings.

        Raises:
            RunError: No run here, or of another format.
        """
        content = self._read_json(SETTINGS, "is no run folder: it has no settings.json")
        if content.get("kind") == "training":
            raise RunError(f"'{self.path}' is a training run, not a calibration; `swim2real rollout` writes its page")
        if content.pop("format", None) != FORMAT:
            raise RunError(f"{self.settings_path} is of another format than {FORMAT}; {self.RESTORE}")
        try:
            return check(RunSettings, content, str(self.settings_path), RunError, self.RESTORE)
        except ArgumentError as error:  # settings that can't be
            raise RunError(f"{self.settings_path}: {error}; {self.RESTORE}") from error

    def outcome(self) -> Outcome | None:
        """Findings at the end of the run, None before it."""
        if not (self.path / OUTCOME).is_file():
            return None
        content = self._read_json(OUTCOME, "")
        return check(Outcome, content, str(self.path / OUTCOME), RunError, self.RESTORE)

    def record(self) -> tuple[RecordedEvaluation, ...]:
        """All recorded evaluations. A last line that was cut off by a crash doesn't count.

        Raises:
            RunError: Another line is no evaluation, or not the next one; the error names it.
        """
        path = self.path / RECORD
        with self._disk():
            try:
                lines = store.read_lines(path)
            except ValueError as error:
                raise RunError(f"{path} isn't read: {error}; {self.RESTORE}") from error
        entries: list[RecordedEvaluation] = []
        for number, line in enumerate(lines, start=1):
            where = f"{path}, line {number}"
            try:
                content = from_json(line)
            except ValueError as error:
                raise RunError(f"{where} is damaged ({error}); {self.RESTORE}") from error
            entry = check(RecordedEvaluation, content, where, RunError, self.RESTORE)
            if entry.index != number - 1:
                raise RunError(f"{where} has index {entry.index}; expected {number - 1}; {self.RESTORE}")
            entries.append(entry)
        return tuple(entries)

    def drop_cut_line(self) -> None:
        """Removes what a crash left of a last line, so that appending is safe."""
        with self._disk():
            store.drop_cut_line(self.path / RECORD)

    def append(self, entry: Mapping[str, Any]) -> None:
        """Adds an evaluation to the record; it is on the disk when this returns."""
        with self._disk():
            store.append_lines(self.path / RECORD, [entry])

    def write_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Writes a file of the folder, whole or not at all."""
        with self._disk():
            store.write_json(self.path / name, content)

    def write_arrays(self, name: str, arrays: Mapping[str, Any]) -> None:
        """Writes an .npz file of the folder, whole or not at all."""
        with self._disk():
            store.write_arrays(self.path / name, arrays)

    def read_arrays(self, name: str) -> dict[str, NDArray[Any]]:
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

    def _write_settings(self, settings: RunSettings) -> None:
        self.write_json(SETTINGS, {"format": FORMAT, **asdict(settings)})

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

    def _disk(self, busy: str = "") -> AbstractContextManager[None]:
        """Turns what the system says of the disk into a sentence."""
        kept = "what was recorded so far is kept, --resume goes on from there" if self.path.is_dir() else ""
        return store.writing(self.path, RunError, kept, what="run folder", busy=busy)

"""The folder of a run: settings, an append-only record, the best parameters. Survives being killed at any moment."""

from __future__ import annotations

import json
import os
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from filelock import FileLock, Timeout

from swim2real.errors import RunError
from swim2real.parameters.file import BEST

FORMAT = 1
SETTINGS, RECORD, LOCK = "settings.json", "record.jsonl", ".lock"
OUTCOME = "outcome.json"

# settings that may differ when a run goes on
_FREE = ("budget", "threads")
_ADDED = {"start": "speed"}  # settings that earlier versions didn't write


class RunFolder:
    """Reads and writes one run folder."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    @property
    def settings_path(self) -> Path:
        return self.path / SETTINGS

    @property
    def best_path(self) -> Path:
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
        with _disk(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self.path / LOCK, timeout=0)
        try:
            with _disk(self.path):
                lock.acquire()
        except Timeout:
            raise RunError(
                f"another process is working on run folder '{self.path}'; wait for it or use another"
            ) from None
        try:
            yield
        finally:
            lock.release()

    def begin(self, settings: Mapping[str, Any]) -> None:
        """Writes the settings of a new run.

        Raises:
            RunError: The folder holds a run already, or can't be written.
        """
        if self.exists:
            raise RunError(f"'{self.path}' holds a run already; go on with --resume or choose another folder")
        self.write_json(self.settings_path, {"format": FORMAT, **settings})

    def resume(self, settings: Mapping[str, Any]) -> None:
        """Checks that a run can go on with these settings, and takes over the new budget.

        Raises:
            RunError: A setting that decides the result differs.
        """
        recorded = self.settings()
        wanted = json.loads(json.dumps(dict(settings)))
        for key, value in wanted.items():
            if key not in _FREE and recorded.get(key, _ADDED.get(key)) != value:
                raise RunError(
                    f"run '{self.path}' can't go on: {key} was {_short(recorded.get(key))} and is now {_short(value)}; "
                    f"use the same settings and reference, or begin a new run"
                )
        if wanted["budget"] > recorded.get("budget", 0):
            self.write_json(self.settings_path, {**recorded, "budget": wanted["budget"]})

    def settings(self) -> dict[str, Any]:
        """The recorded settings.

        Raises:
            RunError: No run here, or of another format.
        """
        content = self._read_json(self.settings_path, "is no run folder: it has no settings.json")
        if content.get("format") != FORMAT:
            raise RunError(
                f"run '{self.path}' has format {content.get('format')!r}; this version of swim2real reads {FORMAT}"
            )
        return content

    def outcome(self) -> dict[str, Any] | None:
        """What was found at the end of the run, None before it."""
        path = self.path / OUTCOME
        return self._read_json(path, "") if path.is_file() else None

    def record(self) -> list[dict[str, Any]]:
        """All recorded evaluations. A last line that was cut off by a crash doesn't count.

        Raises:
            RunError: Another line can't be read.
        """
        path = self.path / RECORD
        if not path.is_file():
            return []
        with _disk(self.path):
            whole = path.read_bytes()
        lines = whole.split(b"\n")[:-1]  # what follows the last newline was cut off
        entries: list[dict[str, Any]] = []
        for number, line in enumerate(lines, start=1):
            try:
                entry = json.loads(line)
            except ValueError as error:
                raise RunError(f"{path}, line {number} is damaged ({error}); restore it or begin a new run") from error
            if not isinstance(entry, dict):
                raise RunError(f"{path}, line {number} is damaged (no evaluation); restore it or begin a new run")
            entries.append(entry)  # pyright: ignore[reportUnknownArgumentType]
        return entries

    def drop_cut_line(self) -> None:
        """Removes what a crash left of a last line, so that appending is safe."""
        path = self.path / RECORD
        if not path.is_file():
            return
        with _disk(self.path), path.open("r+b") as file:
            whole = file.read()
            end = whole.rfind(b"\n") + 1
            if end < len(whole):
                file.truncate(end)

    def append(self, entry: Mapping[str, Any]) -> None:
        """Adds an evaluation to the record; it is on the disk when this returns."""
        line = json.dumps(entry, allow_nan=False) + "\n"
        with _disk(self.path), (self.path / RECORD).open("ab") as file:
            file.write(line.encode())
            file.flush()
            os.fsync(file.fileno())

    def write_json(self, path: Path, content: Mapping[str, Any]) -> None:
        """Writes a file whole or not at all."""
        part = path.with_name(path.name + ".part")
        with _disk(self.path):
            part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
            os.replace(part, path)

    def write_arrays(self, name: str, arrays: Mapping[str, Any]) -> None:
        """Writes an .npz file whole or not at all."""
        path = self.path / name
        part = path.with_name(name + ".part")
        try:
            with part.open("wb") as file:
                np.savez_compressed(file, **arrays)
            part.replace(path)
        except OSError as error:
            raise RunError(f"can't write '{path}': {error.strerror or error}") from error

    def read_arrays(self, name: str) -> dict[str, Any]:
        """The content of an .npz file that was written when the run ended.

        Raises:
            RunError: It isn't there, or damaged.
        """
        path = self.path / name
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                return dict(stored)
        except FileNotFoundError:
            raise RunError(f"run '{self.path}' has no {name} yet; it is written when a run ends") from None
        except (OSError, EOFError, ValueError, KeyError, BadZipFile) as error:
            raise RunError(f"{path} can't be read: {error}") from error

    def _read_json(self, path: Path, missing: str) -> dict[str, Any]:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise RunError(f"'{self.path}' {missing}") from None
        except (OSError, ValueError) as error:
            raise RunError(f"{path} can't be read: {error}") from error
        if not isinstance(content, dict):
            raise RunError(f"{path} must hold a JSON object")
        return content


@contextmanager
def _disk(folder: Path) -> Generator[None]:
    try:
        yield
    except OSError as error:
        if isinstance(error, Timeout):
            raise
        raise RunError(
            f"can't write run folder '{folder}': {error.strerror or error}; what was recorded so far is kept, "
            f"--resume goes on from there"
        ) from error


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) < 60 else text[:57] + "…"

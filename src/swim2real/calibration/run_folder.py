"""The folder of a run: settings, an append-only record, the best parameters. Survives being killed at any moment."""

from __future__ import annotations

import json
import shutil
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, cast

from swim2real import store
from swim2real.calibration.chain import CHAIN, broken_links, chained, last_hash, next_hash
from swim2real.calibration.file_models import Outcome, RecordedEvaluation, RunSettings
from swim2real.checking import check, shown
from swim2real.errors import RunError
from swim2real.parameters.file import BEST

FORMAT = 1
SETTINGS, RECORD, OUTCOME, TRIALS = "settings.json", "record.jsonl", "outcome.json", "trials.npz"
# what is written only by the process that has the run
_WRITTEN = (SETTINGS, RECORD, BEST, OUTCOME, TRIALS, "identif*.json", "advisor/*.json", "advisor/media/*")

# settings that may differ when a run goes on
_FREE = ("budget", "threads")
ADDED = {
    "start": "speed",
    "probes": 0,
    "give_up": None,
    "pieces": None,
    "first": "random",
    "starts": 1,
}  # settings that earlier versions didn't write


class RunFolder:
    """Reads and writes one run folder."""

    RESTORE = "restore it or begin a new run"
    ACCEPT = (
        "restore it, begin a new run, or go on with it as it is: calibrate --resume and compare take --accept-edited"
    )

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._last_hash: str | None = None  # of the record, once it is read by the process that writes it

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
            store.remove_leftovers(self.path, _WRITTEN)
            yield

    def begin(self, settings: Mapping[str, Any]) -> None:
        """Writes the settings of a new run.

        Raises:
            RunError: The folder holds a run already, or can't be written.
        """
        if self.exists:
            raise RunError(f"'{self.path}' holds a run already; go on with --resume or choose another folder")
        self.write_json(SETTINGS, {"format": FORMAT, "chained": True, **settings})

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
                f"run '{self.path}' has format {shown(content.get('format'))}; this version of swim2real reads {FORMAT}"
            )
        check(RunSettings, content, str(self.settings_path), RunError, self.RESTORE)
        return content

    def outcome(self) -> Outcome | None:
        """What was found at the end of the run, None before it."""
        if not (self.path / OUTCOME).is_file():
            return None
        content = self._read_json(OUTCOME, "")
        return check(Outcome, content, str(self.path / OUTCOME), RunError, self.RESTORE)

    def record(self) -> list[dict[str, Any]]:
        """All recorded evaluations. A last line that was cut off by a crash doesn't count.

        Raises:
            RunError: Another line can't be read, or the record was edited or cut; the error names the line.
        """
        path = self.path / RECORD
        lines = self._lines()
        entries = _readable(lines)
        if len(entries) < len(lines):
            raise RunError(
                f"{path}, line {len(entries) + 1} is damaged ({_damage(lines[len(entries)])}); {self.ACCEPT}"
            )
        if broken := broken_links(entries, self._all_chained()):
            raise RunError(
                f"{path}, line {broken[0] + 1} isn't as it was written, or a line above it is gone; {self.ACCEPT}"
            )
        known, name = self._known_evaluations()
        if len(entries) < known:
            raise RunError(
                f"{path} was cut after line {len(entries)}: {name} tells of evaluation {known}; {self.ACCEPT}"
            )
        self._last_hash = last_hash(entries)
        for number, entry in enumerate(entries, start=1):
            check(RecordedEvaluation, entry, f"{path}, line {number}", RunError, self.RESTORE)
            entry.pop(CHAIN, None)
        return entries

    def drop_cut_line(self) -> None:
        """Removes what a crash left of a last line, so that appending is safe."""
        self._last_hash = None
        with self._disk():
            store.drop_cut_line(self.path / RECORD)

    def append(self, entry: Mapping[str, Any]) -> None:
        """Adds an evaluation to the record; it is on the disk when this returns."""
        if self._last_hash is None:
            self._last_hash = last_hash(_readable(self._lines()))
        fitting = next_hash(self._last_hash, entry)
        with self._disk():
            store.append_line(self.path / RECORD, {**entry, CHAIN: fitting})
        self._last_hash = fitting

    def accept_edited(self) -> None:
        """Makes a record that was edited or cut one that goes on: lines whose hash doesn't fit are noted as edited.

        From the first line on that is no evaluation, or not the next one, nothing is kept. The record as it was stays
        as `record-edited-N.jsonl`.
        """
        self.drop_cut_line()
        lines = self._lines()
        entries = _readable(lines)
        broken = broken_links(entries, self._all_chained())
        kept = next((i for i, entry in enumerate(entries) if entry.get("index") != i), len(entries))
        if broken or kept < max(len(lines), self._known_evaluations()[0]):
            self._rewrite(chained(entries[:kept], broken))

    def keep_first(self, count: int) -> None:
        """Keeps the first evaluations of the record, of a copy of which `accept_edited` tells."""
        self._rewrite(chained(_readable(self._lines())[:count], ()))

    def _rewrite(self, entries: Sequence[Mapping[str, Any]]) -> None:
        """Replaces the record, keeps a copy, and removes what tells of evaluations that are no longer in it."""
        path = self.path / RECORD
        number = 1 + len(list(self.path.glob("record-edited-*.jsonl")))
        with self._disk():
            if path.is_file():
                shutil.copyfile(path, path.with_name(f"record-edited-{number}.jsonl"))
            store.write_text(path, "".join(json.dumps(entry) + "\n" for entry in entries))
            if self._known_evaluations()[0] > len(entries):
                self.best_path.unlink(missing_ok=True)
                (self.path / OUTCOME).unlink(missing_ok=True)
        self._last_hash = None

    def _lines(self) -> list[bytes]:
        with self._disk():
            return store.read_lines(self.path / RECORD)

    def _all_chained(self) -> bool:
        """Whether every line has a hash; versions before them wrote none."""
        return self.exists and self.settings().get("chained") is True

    def _known_evaluations(self) -> tuple[int, str]:
        """The number of evaluations that must be on record, and the name of the file that tells so."""
        known = (0, "")
        for name, key, more in ((BEST, "evaluation", 1), (OUTCOME, "evaluations", 0)):
            content: Any = None
            with suppress(OSError, ValueError):  # what is wrong with them is said where they are read
                content = store.read_json(self.path / name)
            number = cast("dict[str, Any]", content).get(key) if isinstance(content, dict) else None
            if isinstance(number, int):
                known = max(known, (number + more, name))
        return known

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
                f"can't write run folder '{self.path}': {store.reason(error, self.path)}; what was recorded so far is "
                f"kept, --resume goes on from there"
            ) from error


def _readable(lines: Sequence[bytes]) -> list[dict[str, Any]]:
    """The evaluations of a record's lines, up to the first that is none."""
    entries: list[dict[str, Any]] = []
    for line in lines:
        if _damage(line):
            break
        entries.append(store.from_json(line))
    return entries


def _damage(line: bytes) -> str:
    """Why a line is no evaluation; empty where it is one."""
    try:
        return "" if isinstance(store.from_json(line), dict) else "no evaluation"
    except ValueError as error:
        return str(error)

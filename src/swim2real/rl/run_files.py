"""Files of a training run beside its checkpoints: settings, a line an episode, a line an evaluation, the outcome."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from swim2real.errors import RunError

SETTINGS, OUTCOME = "settings.json", "outcome.json"
EPISODES, EVALUATIONS, PROGRESS = "episodes.jsonl", "evaluations.jsonl", "progress.jsonl"
POLICY, BEST = "policy.zip", "best.zip"


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Writes a file at once, so that a reader never sees half of it."""
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        os.replace(part, path)
    except OSError as error:
        raise RunError(f"'{path}' can't be written: {error.strerror or error}; make room or choose another") from error


def read_json(path: Path) -> dict[str, Any]:
    """Reads a file that `write_json` wrote.

    Raises:
        RunError: It isn't there, or isn't JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise RunError(
            f"'{path.parent}' is no training run: it has no {path.name}; `swim2real train` makes one"
        ) from None
    except (OSError, ValueError) as error:
        raise RunError(f"'{path}' can't be read as JSON: {error}") from error


def append(path: Path, lines: list[dict[str, Any]]) -> None:
    """Adds lines to a record."""
    if lines:
        with path.open("a", encoding="utf-8") as file:
            file.write("".join(json.dumps(line) + "\n" for line in lines))


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Lines of a record; one that a crash cut off is dropped, and a file that isn't there has none."""
    if not path.is_file():
        return []
    lines: list[dict[str, Any]] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            lines.append(json.loads(line))
        except ValueError:
            break
    return lines


def cut(path: Path, step: int) -> None:
    """Drops the lines of a record that were written after an environment step."""
    lines = [line for line in read_lines(path) if line["step"] <= step]
    part = path.with_name(path.name + ".part")
    part.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    os.replace(part, path)

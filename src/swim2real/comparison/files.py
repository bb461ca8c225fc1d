"""Files of a comparison, written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swim2real.errors import RunError


def write_text(path: Path, text: str) -> None:
    """Writes a file, making its folder.

    Raises:
        RunError: The disk failed.
    """
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(text, encoding="utf-8", newline="\n")
        os.replace(part, path)
    except OSError as error:
        raise RunError(
            f"can't write '{path}': {error.strerror or error}; what was run so far is kept, the same command goes on"
        ) from error


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Writes a JSON file."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")

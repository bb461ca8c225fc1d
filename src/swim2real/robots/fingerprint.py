"""A fingerprint of a robot file and of all that its model is made of, so that a change of either is seen."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from swim2real.robots.compiled import numbers
from swim2real.robots.file import open_robot_file
from swim2real.robots.mjcf_files import first_found, model_files
from swim2real.robots.schema import hook_file, read_content


def fingerprint(path: str | Path) -> str:
    """The fingerprint of a robot file and all that it names.

    That are the files that it extends, its model with included files, meshes and the like, and hooks in files. Comments
    and spaces don't count. A model made by a Python function counts by its numbers, which another version of MuJoCo may
    compile otherwise.

    Raises:
        RobotError: One can't be read.
    """
    place = Path(path)
    content = read_content(place)
    content.pop("policy", None)
    mark = hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode())
    for name, data in _parts(place, content):
        mark.update(f"\0{name}\0".encode() + data)
    return mark.hexdigest()[:16]


def _parts(place: Path, content: Mapping[str, Any]) -> Iterator[tuple[str, bytes]]:
    """Parts of a robot beside its own file: names and contents."""
    folder, model = place.parent, str(content["model"])
    hooks = [content.get("swims", {}).get(key) for key in ("response", "fit_plan")]
    for text in (model, *hooks):
        file = hook_file(text)
        if file is not None:
            yield file, (folder / file).read_bytes()
    if model.startswith("python:"):
        for name, array in numbers(open_robot_file(place).spec.compile()):
            yield name, np.asarray(array).tobytes()
    else:
        yield from _mjcf(folder / model)


def _mjcf(path: Path) -> Iterator[tuple[str, bytes]]:
    """An MJCF file and all that it names, each once."""
    files = model_files(path)
    for file in files.texts:
        try:
            yield file.name, ElementTree.canonicalize(from_file=file, strip_text=True).encode()
        except ElementTree.ParseError:  # MuJoCo reads more than XML allows
            yield file.name, file.read_bytes()
    for name in files.names:
        for file in first_found(name, files.folders):
            yield name, file.read_bytes()

"""The files that an MJCF model is made of, found without MuJoCo, and whether they lie in the model's folder.

The text is taken apart as MuJoCo's own parser does it, which accepts more than XML allows.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swim2real.consent import OUTSIDE, Request
from swimbase.errors import RobotError

_FOLDERS = ("meshdir", "texturedir", "assetdir")  # of an MJCF compiler
_SIDES = ("fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")  # of a cube's texture
_PASSED_OVER = ((b"<!--", b"-->"), (b"<![CDATA[", b"]]>"), (b"<?", b"?>"), (b"<!", b">"))
_TAG = re.compile(rb"\s*/?\s*([^\s/>=\"']+)")  # an end tag may have attributes: `</mesh file="…"/>` is an element
_ATTRIBUTE = re.compile(rb"\s*([^\s/>=\"']+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_ENTITY = re.compile(r"&(?:#(\d{1,7})|#x([0-9A-Fa-f]{1,6})|(lt|gt|amp|quot|apos));")
_ENTITIES = {"lt": "<", "gt": ">", "amp": "&", "quot": '"', "apos": "'"}
_ARCHIVE = b"PK\x03\x04"
_LARGEST = 200_000_000  # bytes of a text
_MOST_TEXTS = 1000
_MOST_PLACES = 1_000_000
_MOST_TOLD = 3  # places in a sentence


@dataclass(frozen=True)
class _ModelFiles:
    """The files of a model.

    Attributes:
        texts: The model and the MJCF files that it includes or attaches, in the order in which they are met.
        folders: Folders in which files are looked up.
        names: Other files as the texts name them: meshes, textures, height fields, skins.
        others: All further names of files: those of `texts`, and of the sides of cubes.
    """

    texts: tuple[Path, ...]
    folders: tuple[Path, ...]
    names: tuple[str, ...]
    others: tuple[str, ...]


def model_files(path: Path, *, every: bool = False) -> _ModelFiles:
    """The files of a model.

    Args:
        path: The model.
        every: Follow every file that a name of an included file could mean, not only the first.

    Raises:
        RobotError: One of its texts is an archive or too large, or there are too many.
        OSError: One can't be read.
    """
    waiting, done, folders = [path], dict[Path, None](), [path.parent]
    names, others = dict[str, None](), dict[str, None]()
    while waiting:
        file = waiting.pop()
        if file in done:
            continue
        done[file] = None
        if len(done) > _MOST_TEXTS:
            raise RobotError(f"it is made of more than {_MOST_TEXTS:,} MJCF files; put some of them together")
        folders.append(file.parent)
        for tag, attributes in _elements(_text(file)):
            name = attributes.get("file") or attributes.get("filename")
            if tag == "compiler":
                given = [attributes[key] for key in _FOLDERS if key in attributes]
                folders += [path.parent / (_plain(folder) if every else folder) for folder in given]
            elif tag in ("include", "model") and name:
                near = (path.parent, file.parent)
                waiting += _all_found(name, near) if every else first_found(name, near)
                others[name] = None
            elif name:
                names[name] = None
            others.update({attributes[side]: None for side in _SIDES if side in attributes})
    return _ModelFiles(tuple(done), tuple(dict.fromkeys(folders)), tuple(names), tuple(others))


def root_tag(path: Path) -> str:
    """Tag of a model's outermost element: `mujoco` of MJCF, `robot` of URDF; empty without any.

    Raises:
        RobotError: It is an archive or too large.
        OSError: It can't be read.
    """
    return next((tag for tag, _ in _elements(_text(path))), "")


def first_found(name: str, folders: Sequence[Path]) -> list[Path]:
    """The first file of a name that is there, in no list or a list of one."""
    places: list[Any] = [folder / name for folder in folders] + [folder / Path(name).name for folder in folders]
    return next(([place] for place in places if place.is_file()), [])


def outside(path: Path, where: str = "") -> Request | None:
    """Request for a model that is made of files outside of its folder; None if all lie in it or below it.

    Args:
        path: The model.
        where: What a message begins with.

    Raises:
        RobotError: A file can't be read, or is none that could be, such as a pipe, or there are too many.
    """
    try:
        model = path.resolve()
        files = model_files(model, every=True)
        count = len(files.folders) * len((*files.names, *files.others))
        if count > _MOST_PLACES:
            raise RobotError(
                f"its files could lie in {count:,} places, more than the {_MOST_PLACES:,} that are looked at; name "
                f"fewer files, or put them into fewer folders"
            )
        places = _outside(model.parent, files)
    except RobotError as error:
        raise RobotError(f"{where}model '{path}' isn't read: {error}") from error
    except OSError as error:
        raise RobotError(f"{where}model '{path}' can't be read: {error.strerror or error}") from error
    if not places:
        return None
    told = ", ".join(f"'{place}'" for place in places[:_MOST_TOLD])
    more = f" and {len(places) - _MOST_TOLD} more" if len(places) > _MOST_TOLD else ""
    mark = hashlib.sha256("\0".join(["outside", *places]).encode("utf-8", "surrogateescape"))
    return Request(
        OUTSIDE, mark.hexdigest(),
        f"{where}model '{path}' reads files outside of its folder: {told}{more}; move them into it",
    )  # fmt: skip


def _outside(root: Path, files: _ModelFiles) -> list[str]:
    """Places outside of a model's folder from which it would read."""
    places = set[str]()
    for name in dict.fromkeys((*files.names, *files.others)):
        for place in _places(name, files.folders):
            if place.startswith(("//", "\\\\")):  # another machine's: not even looked at
                places.add(place)
            elif os.path.lexists(place):
                real = os.path.realpath(place)
                if not Path(real).is_relative_to(root):
                    places.add(real)
                elif not os.path.isfile(real) and not os.path.isdir(real):
                    raise RobotError(f"'{place}' is no plain file; take it away")
    return sorted(places)


def _plain(name: str) -> str:
    """A path as MuJoCo reads it, on every system."""
    return name.replace("\\", "/")


def _places(name: str, folders: Sequence[Path]) -> list[str]:
    """Everywhere a name could lead to; a model can have MuJoCo look for its last part only."""
    return [
        os.path.normpath(folder / part)
        for folder in folders for part in dict.fromkeys((_plain(name), _plain(name).rpartition("/")[2]))
    ]  # fmt: skip


def _all_found(name: str, folders: Sequence[Path]) -> list[Path]:
    """All files that a name could mean."""
    places = [Path(place) for place in _places(name, folders) if not place.startswith(("//", "\\\\"))]
    return [place for place in places if place.is_file()]


def _text(file: Path) -> bytes:
    """The text of an MJCF file."""
    with file.open("rb") as stream:
        text = stream.read(_LARGEST + 1)
    if len(text) > _LARGEST:
        raise RobotError(f"'{file}' has more than {_LARGEST / 1e6:.0f} MB of text; put its meshes into files")
    if text.startswith(_ARCHIVE):
        raise RobotError(f"'{file}' is an archive; unpack it and name the MJCF file that was in it")
    return text


def _elements(text: bytes) -> Iterator[tuple[str, dict[str, str]]]:
    """Tag and attributes of every element, as MuJoCo's parser finds them, whatever is wrong beside them."""
    end = 0
    while (start := text.find(b"<", end)) >= 0:
        opening, closing = next((pair for pair in _PASSED_OVER if text.startswith(pair[0], start)), (b"", b""))
        if opening:
            end = text.find(closing, start + len(opening))
            if end < 0:
                return
            end += len(closing)
            continue
        tag = _TAG.match(text, start + 1)
        if tag is None:
            end = start + 1
            continue
        attributes, end = dict[str, str](), tag.end()
        while (attribute := _ATTRIBUTE.match(text, end)) is not None:
            key, double, single = attribute.groups()
            attributes.setdefault(_decoded(key), _decoded(single if double is None else double))
            end = attribute.end()
        yield _decoded(tag[1]), attributes


def _decoded(raw: bytes) -> str:
    return _ENTITY.sub(_character, raw.decode("utf-8", "surrogateescape"))


def _character(entity: re.Match[str]) -> str:
    decimal, hexadecimal, name = entity.groups()
    if name:
        return _ENTITIES[name]
    code = int(decimal) if decimal else int(hexadecimal, 16)
    return chr(code) if code <= sys.maxunicode else entity[0]

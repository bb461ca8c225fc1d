"""A URDF as MuJoCo takes it without loss: it keeps every link and mesh, and names meshes by where they are."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from swimbase.errors import RobotError

_NAME = re.compile(r"(?:package|model)://([^/]+)/(.+)|file://(.+)")
_KEEPS = ("fusestatic", "discardvisual")  # what MuJoCo leaves out of a URDF unless set otherwise
_ABOVE = 3  # folders above the file in which packages are looked for


def plain_urdf(path: Path, packages: Mapping[str, Path]) -> bytes:
    """The text of a URDF to which MuJoCo's defaults do no harm.

    Args:
        path: Path of the file.
        packages: Folders of packages that it names.

    Raises:
        RobotError: It isn't XML, or a mesh isn't found.
        OSError: It can't be read.
    """
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except ElementTree.ParseError as error:
        raise RobotError(f"model '{path}' can't be read: {error}") from error
    extension = root.find("mujoco")
    extension = ElementTree.SubElement(root, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
    compiler.attrib |= dict.fromkeys(_KEEPS, "false") | compiler.attrib
    for mesh in root.iter("mesh"):
        if (named := _NAME.fullmatch(mesh.get("filename", ""))) and compiler.get("strippath") != "true":
            place = Path(named[3]) if named[3] else _found(path, named[1], named[2], packages)
            mesh.set("filename", Path(os.path.relpath(place, path.parent / compiler.get("meshdir", ""))).as_posix())
    return ElementTree.tostring(root)


def _found(path: Path, package: str, rest: str, packages: Mapping[str, Path]) -> Path:
    """A file of a package: in its folder, else beside the URDF or above it, by the longest end of its name."""
    parts = (package, *rest.split("/"))
    tails = [Path(*parts[i:]) for i in range(len(parts))]
    folders = [path.parent, *path.absolute().parent.parents[:_ABOVE]]
    places = [folder / tail for tail in tails for folder in folders if len(tail.parts) > 1 or folder is folders[0]]
    if package in packages:
        places = [packages[package] / rest]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        where = f"in '{packages[package]}'" if package in packages else "beside it or above"
        raise RobotError(
            f"model '{path}' names the mesh 'package://{package}/{rest}', which isn't {where}; put it beside the file, "
            f"or say where the package is: --package {package}=FOLDER"
        )
    return found

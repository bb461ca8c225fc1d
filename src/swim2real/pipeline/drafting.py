"""A first robot file: read from an MJCF model, tried out, and written with what shows in the markers."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from swim2real.checks.probing import FAINT, Probe, made_up_for, moved, probe
from swim2real.robots import ROBOTS
from swim2real.robots.candidates import candidates, carrying
from swim2real.robots.compiled import compiled
from swim2real.robots.draft import Draft
from swim2real.robots.file import PLANES, read_mjcf, robot_from_file
from swim2real.robots.mjcf_files import root_tag
from swim2real.robots.robot import Robot
from swim2real.robots.targets import class_name
from swimbase.errors import RobotError, Swim2RealError
from swimbase.names import label_fault, quoted
from swimbase.store import reason, writing

_NAME = re.compile(r"(?:package|model)://([^/]+)/(.+)|file://(.+)")
_KEEPS = ("fusestatic", "discardvisual")  # what MuJoCo leaves out of a URDF unless set otherwise
_ABOVE = 3  # folders above the file in which packages are looked for
_UPRIGHT = 0.99  # the vertical part of a hinge's axis about which nothing tilts
_REST_SHARE = 0.1  # by which the place of markers counts for the camera, beside their motion


def draft_robot(path: Path, threads: int | None = None) -> Draft:
    """A robot file for a model: its sites are markers, tables drive it, and what shows in the markers is calibrated.

    Args:
        path: Path of the MJCF file.
        threads: Simulations at a time; by default the number of cores.

    Raises:
        RobotError: The model can't be read, has no named site, or nothing of it could be calibrated.
        EngineError: It can't be simulated.
    """
    if not path.is_file():
        raise RobotError(f"model '{path}' is not there; give an MJCF file")
    spec = read_mjcf(path, alone=True)
    _check_names(spec, path)
    model = compiled(spec.copy(), f"model '{path}'")
    draft = _first(path, spec, model)
    if draft.markers:
        camera = _camera(_loaded(draft, path), threads)
        draft = replace(draft, camera=camera, heights=_heights(model, draft.markers) if camera == "above" else {})
    probes, markers = probe(_loaded(draft, path), threads=threads), bool(draft.markers)
    wrong = {one.parameter.name: why for one in probes if (why := _unfit(one, markers))}
    if len(wrong) < len(draft.calibrated):  # else a person must see to it; `check` says what is wrong
        draft = replace(draft, aside={**draft.aside, **wrong})
        draft = replace(draft, aside={**draft.aside, **made_up_for(_loaded(draft, path), threads)})
    return draft


@dataclass(frozen=True)
class Converted:
    """A URDF as MJCF.

    Attributes:
        text: The MJCF.
        bodies: Names of its bodies, the base first.
        joints: Names of its joints.
    """

    text: str
    bodies: tuple[str, ...]
    joints: tuple[str, ...]


def from_urdf(path: Path, packages: Mapping[str, Path]) -> Converted | None:
    """A model in MuJoCo's format, of a URDF; None of any other file, or where there is none.

    Args:
        path: Path of the file.
        packages: Folders of packages that it names.

    Raises:
        RobotError: It can't be read or compiled, or a mesh isn't found.
        ConsentError: It names files outside of its folder, which wasn't allowed.
    """
    try:
        if not path.is_file() or root_tag(path) != "robot":
            return None
    except OSError:
        return None  # of which the reader of MJCF tells
    beside = path.with_name(f".{path.stem}.part.urdf")  # where its meshes are found
    try:
        beside.unlink(missing_ok=True)  # a link that came with a folder would be followed
        beside.write_bytes(_plain_urdf(path, packages))
        spec = read_mjcf(beside, alone=True)
        compiled(spec, f"model '{path}'")
    except OSError as error:
        raise RobotError(f"model '{path}' can't be read, or nothing be written beside it: {reason(error)}") from error
    except Swim2RealError as error:
        raise type(error)(str(error).replace(str(beside), str(path))) from error
    finally:
        beside.unlink(missing_ok=True)
    bodies = tuple(body.name for body in spec.bodies if body.name not in ("", "world"))
    return Converted(spec.to_xml(), bodies, tuple(joint.name for joint in spec.joints if joint.name))


def write_draft(draft: Draft, model: Path, out: Path) -> None:
    """Writes the robot file.

    Raises:
        RobotError: It can't be written.
    """
    with writing(out, RobotError, what="robot file"):
        out.write_text(draft.text(_way(model, out.parent)), encoding="utf-8")


def _check_names(spec: mujoco.MjSpec, path: Path) -> None:
    """Refuses names that a robot file can't hold, in its comments neither."""
    elements = (
        *spec.bodies, *spec.joints, *spec.geoms, *spec.sites, *spec.tendons, *spec.actuators, *spec.sensors, *spec.keys,
    )  # fmt: skip
    classes = (class_name(element) for element in (*spec.joints, *spec.geoms))
    for name in filter(None, (path.name, spec.modelname, *(element.name for element in elements), *classes)):
        if fault := label_fault(name):
            raise RobotError(f"model '{path}': the name {quoted(name)} {fault}; give it another")


def _first(path: Path, spec: mujoco.MjSpec, model: mujoco.MjModel) -> Draft:
    """Draft from the model alone."""
    sites = [site.name for site in spec.sites if site.name]
    if not sites and not spec.sensors:
        bodies = ", ".join(body.name for body in spec.bodies if body.name not in ("", "world")) or "none with a name"
        raise RobotError(
            f"model '{path}' has no named site, so it has no markers, and no sensor; add a site for each marker to the "
            f'body that carries it, such as <site name="M0" pos="0 0 0"/>, or the sensors that are recorded, such as '
            f'<jointpos joint="…"/>; the bodies are: {bodies}'
        )
    wraps = zip(model.wrap_type, model.wrap_objid, strict=True)
    routed = {model.site(int(i)).name for kind, i in wraps if kind == mujoco.mjtWrap.mjWRAP_SITE}
    shown = mujoco.MjvOption().sitegroup  # as MuJoCo's viewer begins
    seen = {name for name in sites if model.site(name).rgba[3] > 0 and shown[model.site(name).group[0]]}
    free = tuple(name for name in sites if name not in routed)
    markers = tuple(name for name in free if name in seen) or free or tuple(sites)
    found = candidates(spec, model)
    if not found:
        raise RobotError(
            f"model '{path}' has nothing that could be calibrated: no joint, tendon or actuator with a name, and no "
            f"fluid; name its elements"
        )
    aside = {name: one.aside for name, one in found.items() if one.aside is not None}
    name = path.stem if spec.modelname in ("", "MuJoCo Model") else spec.modelname
    return Draft(
        f"my-{name}" if name in ROBOTS else name,
        path.name,
        spec,
        markers,
        {
            why: left
            for why, left in (
                ("tendons run through these sites", tuple(name for name in sites if name not in (*markers, *free))),
                ("these sites are invisible", tuple(name for name in free if name not in markers)),
            )
            if left
        },
        _frame(model, markers),
        found,
        aside=aside if len(aside) < len(found) else {},
    )


def _frame(model: mujoco.MjModel, markers: tuple[str, ...]) -> tuple[str, str] | None:
    """The first two markers on one body, of a robot that can go anywhere."""
    free = mujoco.mjtJoint.mjJNT_FREE
    if not any(model.jnt_type[j] == free or carrying(model, j) for j in range(model.njnt)):
        return None
    bodies = [int(model.body_weldid[model.site(name).bodyid[0]]) for name in markers]
    pairs = [(i, j) for j in range(len(markers)) for i in range(j) if bodies[i] == bodies[j] != 0]
    return (markers[pairs[0][0]], markers[pairs[0][1]]) if pairs else None


def _loaded(draft: Draft, path: Path) -> Robot:
    """The robot as the draft has it, in a file that is thrown away."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "robot.toml"
        place.write_text(draft.text(path.resolve().as_posix()), encoding="utf-8")
        return robot_from_file(place)


def _camera(robot: Robot, threads: int | None) -> str:
    """The side from which markers move most, and where that is the same, lie farthest apart."""
    spread = np.zeros(3)
    for plane in PLANES.values():
        seen = replace(robot, plane=plane)
        positions = np.concatenate([trial.track.positions for trial in moved(seen, threads)])
        spread[list(plane)] = positions.std(axis=0).mean(axis=0) + _REST_SHARE * positions[0].std(axis=0)
    return max(PLANES, key=lambda name: round(float(np.sum(spread[list(PLANES[name])])), 9))


def _heights(model: mujoco.MjModel, markers: tuple[str, ...]) -> dict[str, float]:
    """Heights above the origin at rest of those markers that a roll or pitch moves sideways, by name [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    flat = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    slides = int(mujoco.mjtJoint.mjJNT_SLIDE)
    tilting = {
        int(model.jnt_bodyid[j]) for j in range(model.njnt)
        if model.jnt_type[j] not in flat or (model.jnt_type[j] != slides and abs(data.xaxis[j, 2]) < _UPRIGHT)
    }  # fmt: skip
    heights: dict[str, float] = {}
    for name in markers:
        body = int(model.site(name).bodyid[0])
        while body and body not in tilting:
            body = int(model.body_parentid[body])
        if body:
            heights[name] = float(data.site(name).xpos[2])
    return heights


def _unfit(one: Probe, markers: bool) -> str | None:
    """Why a parameter is only suggested; None where it shows."""
    if one.effect.undone is not None:
        return one.effect.undone
    failure = one.refused or one.lower.failure or one.upper.failure
    if failure is not None:
        return f"at a bound the model can't be simulated; choose other bounds ({failure})"
    if one.distance < FAINT:
        return f"it moves the markers by less than {1e3 * FAINT:g} mm" if markers else "it hardly changes the sensors"
    return None


def _way(model: Path, folder: Path) -> str:
    """To the model from the robot file's folder; the whole path where there is none."""
    try:
        return Path(os.path.relpath(model.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return model.resolve().as_posix()


def _plain_urdf(path: Path, packages: Mapping[str, Path]) -> bytes:
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
            place = Path(named[3]) if named[3] else _mesh_of(path, named[1], named[2], packages)
            mesh.set("filename", Path(os.path.relpath(place, path.parent / compiler.get("meshdir", ""))).as_posix())
    return ElementTree.tostring(root)


def _mesh_of(path: Path, package: str, rest: str, packages: Mapping[str, Path]) -> Path:
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

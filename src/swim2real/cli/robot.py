"""`init`, `check` and `export-model`: robot files and the models that come of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional

from swim2real.cli import options as opt
from swim2real.cli.options import PUBLISHED, word
from swim2real.cli.terminal import say
from swim2real.settings import all_cores
from swimbase.errors import ArgumentError, RobotError

Folders = Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=FOLDER ...")]

if TYPE_CHECKING:
    from swim2real.pipeline.drafting import Converted


def init(
    model: Positional[Path], *, out: Path | None = None, force: bool = False, package: Folders = ()
) -> int:  # fmt: skip
    """Write a robot file for an MJCF model: markers, what drives a trial, and candidates to calibrate.

    Simulates 2 s with each candidate at both bounds. Candidates that no camera would see, or that should rather be
    weighed or looked up, are written as comments. Then edit the file, and run: swim2real check ROBOT.toml. From a URDF,
    which has no markers, it writes the MJCF file to add them to.

    Args:
        model: MJCF file, or a URDF.
        out: Robot file to write; by default beside the model.
        force: Overwrite an existing file.
        package: Folders of packages whose meshes a URDF names (package://NAME/…); by default they are looked for beside
            the file and above it.
    """
    file = out or model.with_suffix(".toml")
    if file.suffix != ".toml":
        raise ArgumentError(f"--out is '{file}'; a robot file ends in .toml")
    if file.exists() and not force:
        raise ArgumentError(f"'{file}' is there; give another --out, or --force to write over it")
    from swim2real.pipeline.drafting import draft_robot, from_urdf, write_draft

    if wrong := next((pair for pair in package if "=" not in pair), None):
        raise ArgumentError(f"--package is '{wrong}'; it must be NAME=FOLDER")
    converted = from_urdf(model, {name: Path(folder) for name, _, folder in (pair.partition("=") for pair in package)})
    if converted is not None:
        return _write_model(converted, model, force)
    draft = draft_robot(model)
    write_draft(draft, model, file)
    if draft.markers:
        say(f'camera = "{draft.camera}" is a guess, by where markers move most; change it if it stands elsewhere.')
    calibrated = draft.calibrated
    say(
        f"{file}: {len(draft.markers)} markers, {len(calibrated)} parameters ({', '.join(calibrated)}), and "
        f"{len(draft.candidates) - len(calibrated)} more as comments. Edit it, then: swim2real check {word(file)}"
    )
    if draft.heights:
        say(f"How high do {', '.join(draft.heights)} stand? A camera above sees a roll by that; see the file.")
    return 0


def _write_model(converted: Converted, urdf: Path, force: bool) -> int:
    """Writes the MJCF file of a URDF beside it, and tells what it lacks."""
    from swimbase.store import write_text, writing

    out = urdf.with_suffix(".xml")
    if out.exists() and not force:
        raise ArgumentError(f"'{out}' is there; --force writes the MJCF of '{urdf}' over it")
    with writing(out, RobotError, what="model"):
        write_text(out, converted.text)
    base = f"'{converted.bodies[0]}'" if converted.bodies else "that moves"
    joint = converted.joints[0] if converted.joints else "JOINT"
    say(
        f"{out}: '{urdf}' in MuJoCo's format, with the bodies {', '.join(converted.bodies) or 'none'} and the joints "
        f"{', '.join(converted.joints) or 'none'}. A URDF has neither markers nor motors: write a site for each marker "
        f'into the body that carries it, as in <site name="M0" pos="0 0 0"/>, and what drives the joints, as in '
        f'<actuator><position name="{joint}" joint="{joint}" kp="1"/></actuator>; a base that isn\'t fixed also needs '
        f"<freejoint/> in the body {base}. Then: swim2real init {word(out)}"
    )
    return 0


def check(
    robot: Positional[str], *, reference: Path | None = None, out: Path | None = None, threads: opt.Threads = 0
) -> int:
    """Check a robot: what each parameter sets and moves, its markers, and what drives a trial.

    Simulates 2 s with each parameter at both bounds, and draws a map of the markers. Exits with 1 if a parameter
    changes nothing, a setting of the model undoes it or the model doesn't compile at a bound, or if the trials of
    --reference don't fit or are probably of another unit, order, axes, clock or sign. Takes some seconds.

    Args:
        robot: Robot file, or the name of a robot: fish, fish-extended, fish-rolling.
        reference: Folder with real trials, whose controls are used; by default the robot is moved by invented ones.
        out: Picture of the markers to write (PNG); by default beside the robot file.
    """
    threads_or_all = all_cores(threads)
    from swim2real.cli.robot_check import check_robot

    return 0 if check_robot(robot, reference, out, threads_or_all) else 1


def export_model(
    parameters: Positional[opt.ValuesPath], *, out: Path, robot: opt.RobotOfValues = None, anyway: opt.Anyway = False
) -> int:
    """Write the calibrated simulator as one MJCF file, for any program that loads MuJoCo models.

    Reads a run folder or parameters file. The model contains the markers' sensors, and cameras, a light and the water's
    surface, which don't affect the physics; meshes and textures stay where they are. Numbers are as exact as MuJoCo
    writes them; the difference is reported.

    Args:
        out: MJCF file to write (.xml).
    """
    from swim2real import api
    from swim2real.cli.subject import heed, robot_for
    from swim2real.parameters import read_parameters

    body = robot_for(parameters, robot)
    heed(parameters, anyway, "export it")
    published = str(parameters) == PUBLISHED
    values = body.space.published if published else read_parameters(parameters, body.name, body.space).values
    name, gap = api.export_model(values, body, out)
    exact = "all numbers read back the same" if not gap else f"numbers read back within {gap:.1g}, relative ({name})"
    late = [f"{name} = {values[name]:g} s" for name in body.delays]
    told = f"; delays are no part of a model, so these aren't in it: {', '.join(late)}" if late else ""
    say(f"{out}: robot '{body.name}', {exact}{told}")
    return 0

"""A robot file in the making, and its text."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from textwrap import fill

import mujoco

from swim2real.robots.candidates import Candidate
from swim2real.robots.targets import class_name

_WIDTH = 110
_UNITS = {
    "TOUCH": "N", "ACCELEROMETER": "m/s²", "VELOCIMETER": "m/s", "GYRO": "rad/s", "FORCE": "N", "TORQUE": "N·m",
    "MAGNETOMETER": "T", "RANGEFINDER": "m", "TENDONPOS": "m", "TENDONVEL": "m/s", "TENDONACTFRC": "N",
    "FRAMELINVEL": "m/s", "FRAMEANGVEL": "rad/s", "FRAMELINACC": "m/s²", "FRAMEANGACC": "rad/s²",
}  # fmt: skip
_OF_JOINTS = {"JOINTPOS": "rad", "JOINTVEL": "rad/s", "JOINTACTFRC": "N·m", "JOINTLIMITFRC": "N·m"}
_METERS_PER_UNIT = 0.01  # m


@dataclass(frozen=True)
class Draft:
    """What a new robot file says.

    Attributes:
        name: Name of the robot.
        title: Name of the model's file.
        spec: The model.
        markers: Sites, in the order of the model.
        routing: Sites that are none, since tendons run through them.
        frame: Two markers on one body of a robot that travels; None for one that doesn't.
        candidates: Candidates by name.
        camera: The side from which it moves most.
        aside: Why candidates are only suggested, by name.
    """

    name: str
    title: str
    spec: mujoco.MjSpec
    markers: tuple[str, ...]
    routing: tuple[str, ...]
    frame: tuple[str, str] | None
    candidates: Mapping[str, Candidate]
    camera: str = "above"
    aside: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def calibrated(self) -> list[str]:
        """Names of the candidates that the file calibrates."""
        return [name for name in self.candidates if name not in self.aside]

    def text(self, model: str) -> str:
        """The file.

        Args:
            model: Path to the model, from the file.
        """
        parts = [self._head(model), self._trials(), "\n".join(self._parameters())]
        return "\n".join(parts).rstrip() + "\n"

    def _head(self, model: str) -> str:
        lines = [
            f"# A robot file, begun from {self.title}. What it suggests but doesn't use is behind #.",
            "# `swim2real check` says what each parameter moves, and draws the markers.",
            "format = 1",
            f"name = {_text(self.name)}",
            "# say in two to five sentences what it is, where its markers are, what drives it and which way it moves",
            f'description = """\n{_folded(self._description())}"""',
            f"model = {_text(model)}",
            f"camera = {_text(self.camera)}  # above (x right, y up), side (x right, z up) or front (y right, z up)",
            "",
            "# sites that carry a marker, in the order in which they are tracked",
        ]
        if not self.markers:
            return "\n".join(
                [
                    *lines[:-1],
                    "# the model has no named sites: nothing is filmed, sensors are compared",
                    "markers = []",
                    "",
                ]
            )
        if self.routing:
            lines.append(f"# tendons run through these sites, so they are left out: {', '.join(self.routing)}")
        lines += [f"markers = {_list(self.markers)}", "# lines of pictures; left out: from each marker to the next"]
        return "\n".join([*lines, f"# links = [{_list(self.markers[:2])}]", ""])

    def _description(self) -> str:
        bodies = [body.name for body in self.spec.bodies if body.name not in ("", "world")]
        driven = [actuator.name for actuator in self.spec.actuators if actuator.name]
        joints = [joint.name for joint in self.spec.joints if joint.name]
        parts = [f"A robot of {len(self.spec.bodies) - 1} bodies" + _named(bodies)]
        parts.append(f"{len(self.spec.joints)} joints" + _named(joints))
        parts.append(f"{len(driven)} actuators" + _named(driven) if driven else "no actuator")
        shown = f"Its markers are {_spoken(self.markers)}." if self.markers else "Its sensors are recorded, no camera."
        return f"{parts[0]}, {parts[1]} and {parts[2]}. {shown}"

    def _trials(self) -> str:
        keys = [key.name for key in self.spec.keys if key.name]
        starts = (
            "fitted (pose and speed that fit the first stretch best), markers (a line through the first frames), rest"
        )
        starts += f" or a keyframe: {', '.join(keys)}" if keys else ""
        lines = ["[recordings]", f"# {starts}", 'start = "fitted"']
        if self.frame is None and self.markers:
            lines += ["# compare in the frame of two markers; left out: in the world", f"# {self._frame(self.markers)}"]
        elif self.frame is not None:
            lines += [
                "# compare in the frame of two markers; it travels from the second toward the first, or swap them"
            ]
            lines += [self._frame(self.frame), "score_progress = true  # whether how far it comes is compared, too"]
        driven = [actuator.name for actuator in self.spec.actuators if actuator.name]
        unnamed = len(self.spec.actuators) - len(driven)
        if unnamed:
            lines.append(f"# actuators without a name: {unnamed}; they get 0, unless they are named in {self.title}")
        if driven:
            lines += [
                "", "[recordings.controls]",
                '# "table" (its column of a trial\'s controls), "frequency" (2 pi times its frequency), a number, or',
                "# {amplitude = 1.0, phase = 0.0, offset = 0.0} (a sine at the trial's frequency)",
                *(f'{_key(name)} = "table"' for name in driven),
            ]  # fmt: skip
            lines.append("# a delay of commands can be calibrated, in s: targets = 'control \"*\" delay'")
        sensors = list(_sensor_lines(self.spec))
        if sensors:
            beside, mark = (" beside the markers", "# ") if self.markers else ("", "")
            lines += ["", f"# what is compared{beside}: an error of one unit counts as `meters_per_unit`"]
            lines += [f"{mark}[recordings.sensors]", *(f"{mark}{line}" for line in sensors)]
        return "\n".join([*lines, ""])

    def _frame(self, markers: tuple[str, ...]) -> str:
        return f"frame = {_list(markers[:2])}"

    def _parameters(self) -> Iterator[str]:
        for kind, elements in (("joints", self.spec.joints), ("geoms", self.spec.geoms)):
            unnamed = sum(not element.name for element in elements)
            if unnamed:
                classes = ", ".join(sorted({class_name(element) for element in elements}))
                yield f"# {kind} without a name: {unnamed}; parameters write to names or classes ({classes})\n"
        for name in sorted(self.candidates, key=lambda name: name in self.aside):
            yield from self._parameter(name, self.candidates[name])
            yield ""

    def _parameter(self, name: str, candidate: Candidate) -> Iterator[str]:
        aside = self.aside.get(name)
        if aside is not None:
            yield f"# left out: {aside}"
        if candidate.group:
            yield f"# one value for {', '.join(candidate.group)}; for more, copy this table and name some in each"
        lines = [
            "[[parameters]]",
            f"name = {_text(name)}",
            f"unit = {_text(candidate.unit)}",
            f"lower = {candidate.lower!r}",
        ]
        lines += [f"upper = {candidate.upper!r}", 'scale = "log"']
        if candidate.log_offset:
            lines.append(f"log_offset = {candidate.log_offset:.3g}")
        lines.append(f"meaning = {_text(candidate.meaning)}")
        targets = [
            f"{{to = {_text(line)}, relative = true}}" if candidate.relative else _text(line)
            for line in candidate.targets
        ]
        lines.append(f"targets = {targets[0] if len(targets) == 1 else '[' + ', '.join(targets) + ']'}")
        yield from lines if aside is None else (f"# {line}" for line in lines)


def _sensor_lines(spec: mujoco.MjSpec) -> Iterator[str]:
    """A line of [recordings.sensors] for each number of the named sensors; positions of frames are markers."""
    model = spec.copy().compile()
    slides = {joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_SLIDE}
    for sensor in spec.sensors:
        kind = mujoco.mjtSensor(sensor.type).name.removeprefix("mjSENS_")
        if not sensor.name or kind == "FRAMEPOS":
            continue
        unit = _OF_JOINTS.get(kind, _UNITS.get(kind, "-"))
        if kind in _OF_JOINTS and sensor.objname in slides:
            unit = unit.replace("rad", "m").replace("N·m", "N")
        size = int(model.sensor(sensor.name).dim[0])
        for key in [sensor.name] if size == 1 else [f"{sensor.name}[{i}]" for i in range(size)]:
            bare = key.isascii() and key.replace("_", "").isalnum()
            yield f'{key if bare else json.dumps(key)} = {{unit = "{unit}", meters_per_unit = {_METERS_PER_UNIT}}}'


def _named(names: list[str]) -> str:
    return f" ({', '.join(names)})" if names else ""


def _spoken(names: tuple[str, ...]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _folded(text: str) -> str:
    return fill(text.replace("\\", "/").replace('"', "'"), _WIDTH, break_long_words=False, break_on_hyphens=False)


def _list(names: tuple[str, ...]) -> str:
    return f"[{', '.join(map(_text, names))}]"


def _text(text: str) -> str:
    """A TOML string."""
    return f"'{text}'" if '"' in text and "'" not in text else json.dumps(text, ensure_ascii=False)


def _key(name: str) -> str:
    """A TOML key."""
    return name if name.isascii() and name.replace("_", "").replace("-", "").isalnum() else _text(name)

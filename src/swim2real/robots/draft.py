"""A robot file in the making: its text, filled into `draft.toml.j2`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from textwrap import fill

import mujoco
from jinja2 import Environment, StrictUndefined

from swim2real.robots.candidates import Candidate
from swim2real.robots.compiled import sensor_units
from swim2real.robots.targets import class_name

_WIDTH = 110


@dataclass(frozen=True)
class Draft:
    """Draft of a new robot file.

    Attributes:
        name: Name of the robot.
        title: Name of the model's file.
        spec: The model.
        markers: Sites, in the order of the model.
        left_out: Sites that are none, by the reason.
        frame: Two markers on one body of a robot that travels; None for one that doesn't.
        candidates: Candidates by name.
        camera: The side from which it moves most.
        aside: Why candidates are only suggested, by name.
        heights: Of the markers on bodies that can roll under a camera above [m], which sees a roll by them.
    """

    name: str
    title: str
    spec: mujoco.MjSpec
    markers: tuple[str, ...]
    left_out: Mapping[str, tuple[str, ...]]
    frame: tuple[str, str] | None
    candidates: Mapping[str, Candidate]
    camera: str = "above"
    aside: Mapping[str, str] = field(default_factory=dict[str, str])
    heights: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def calibrated(self) -> list[str]:
        """Names of the candidates that the file calibrates."""
        return [name for name in self.candidates if name not in self.aside]

    def text(self, model: str) -> str:
        """The file.

        Args:
            model: Path to the model, from the file.
        """
        environment = Environment(
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
            autoescape=False,  # no page, but TOML
        )
        environment.filters |= {"toml": _toml, "key": _key}
        template = resources.files("swim2real.robots").joinpath("draft.toml.j2").read_text(encoding="utf-8")
        driven = [actuator.name for actuator in self.spec.actuators if actuator.name]
        unnamed = {
            kind: [class_name(element) for element in elements if not element.name]
            for kind, elements in (("joints", self.spec.joints), ("geoms", self.spec.geoms))
        }
        classes = {kind: sorted({class_name(element) for element in getattr(self.spec, kind)}) for kind in unnamed}
        compiled = self.spec.copy().compile()
        text = environment.from_string(template).render(
            draft=self, model=model, description=self._description(driven), driven=driven,
            sensors=_sensors(self.spec, compiled), limits=_limits(compiled),
            keys=[key.name for key in self.spec.keys if key.name],
            unnamed=[(kind, len(names), classes[kind]) for kind, names in unnamed.items() if names],
            candidates=sorted(self.candidates.items(), key=lambda item: item[0] in self.aside),
        )  # fmt: skip
        return text.rstrip() + "\n"

    def _description(self, driven: Sequence[str]) -> str:
        bodies = [body.name for body in self.spec.bodies if body.name not in ("", "world")]
        joints = [joint.name for joint in self.spec.joints if joint.name]
        markers = f"{', '.join(self.markers[:-1])} and {self.markers[-1]}".removeprefix(" and ") if self.markers else ""
        text = (
            f"A robot of {len(self.spec.bodies) - 1} bodies{_listed(bodies)}, {len(self.spec.joints)} "
            f"joints{_listed(joints)} and {f'{len(driven)} actuators{_listed(driven)}' if driven else 'no actuator'}. "
            f"{f'Its markers are {markers}.' if markers else 'Its sensors are recorded, no camera.'}"
        )
        return fill(text.replace("\\", "/").replace('"', "'"), _WIDTH, break_long_words=False, break_on_hyphens=False)


def _limits(model: mujoco.MjModel) -> dict[str, tuple[float, float]]:
    """Limits of the commands of the named actuators that have some about 0."""
    limited = [one for one in map(model.actuator, range(model.nu)) if one.name and one.ctrllimited[0]]
    ranges = {str(one.name): one.ctrlrange for one in limited}
    return {name: (float(low), float(high)) for name, (low, high) in ranges.items() if low <= 0 <= high}


def _sensors(spec: mujoco.MjSpec, model: mujoco.MjModel) -> dict[str, str]:
    """Units of the numbers of the named sensors, by their names in [recordings.sensors]; positions are markers."""
    units, known = dict[str, str](), sensor_units(model)
    for sensor in spec.sensors:
        if sensor.name and sensor.type != mujoco.mjtSensor.mjSENS_FRAMEPOS:
            size = int(model.sensor(sensor.name).dim[0])
            names = [sensor.name] if size == 1 else [f"{sensor.name}[{i}]" for i in range(size)]
            units |= dict.fromkeys(names, known[sensor.name])
    return units


def _listed(names: Sequence[str]) -> str:
    return f" ({', '.join(names)})" if names else ""


def _toml(value: str | Sequence[str]) -> str:
    """A text or a list of texts as TOML has them."""
    if not isinstance(value, str):
        return f"[{', '.join(map(_toml, value))}]"
    return f"'{value}'" if '"' in value and "'" not in value else json.dumps(value, ensure_ascii=False)


def _key(name: str) -> str:
    return name if name.isascii() and name.replace("_", "").replace("-", "").isalnum() else _toml(name)

"""Suggestions of sensors to compare."""

from __future__ import annotations

import json
from collections.abc import Iterator

import mujoco

_UNITS = {
    "TOUCH": "N", "ACCELEROMETER": "m/s²", "VELOCIMETER": "m/s", "GYRO": "rad/s", "FORCE": "N", "TORQUE": "N·m",
    "MAGNETOMETER": "T", "RANGEFINDER": "m", "TENDONPOS": "m", "TENDONVEL": "m/s", "TENDONACTFRC": "N",
    "FRAMELINVEL": "m/s", "FRAMEANGVEL": "rad/s", "FRAMELINACC": "m/s²", "FRAMEANGACC": "rad/s²",
}  # fmt: skip
_OF_JOINTS = {"JOINTPOS": "rad", "JOINTVEL": "rad/s", "JOINTACTFRC": "N·m", "JOINTLIMITFRC": "N·m"}
_WORTH = 0.01  # m


def sensor_lines(spec: mujoco.MjSpec) -> Iterator[str]:
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
            yield f'{key if bare else json.dumps(key)} = {{unit = "{unit}", worth = {_WORTH}}}'

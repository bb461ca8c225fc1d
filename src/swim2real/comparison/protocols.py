"""How tables and charts describe each protocol: the loss, the figures that a fit has, the errors that a marker has."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

MarkerKind = Literal["motion", "marker", "aligned", "shape"]

SENSORS = "sensor_errors"


@dataclass(frozen=True)
class FitFigure:
    """One figure of a fit.

    Attributes:
        name: Key in the evidence of a fit; `sensor_errors.NAME` is the error of a sensor.
        heading: Heading of its column, with the unit.
        factor: Factor from SI to that unit.
        digits: Digits after the point; None for three significant ones, where the size isn't known beforehand.
    """

    name: str
    heading: str
    factor: float = 1e3
    digits: int | None = 1

    def value(self, fit: Mapping[str, Any]) -> float | None:
        """Its value in the evidence of a fit [SI]; None where the fit hasn't it."""
        group, _, sensor = self.name.partition(".")
        return (fit.get(group) or {}).get(sensor) if sensor else fit.get(group)


@dataclass(frozen=True)
class ProtocolDescription:
    """How one protocol is described.

    Attributes:
        loss: Name of the loss.
        trial_loss: Key of the loss in the evidence of a trial.
        figures: Figures that a fit may have, without those of its sensors.
        markers: Kinds of errors that a marker has, each with its description.
        markers_title: Title of tables and charts of these errors.
        markers_order: Label of the axis of the markers.
        markers_note: How to read these errors.
        has_frequencies: Whether its trials have a frequency, so that there is a speed against it.
    """

    loss: str
    trial_loss: str
    figures: tuple[FitFigure, ...]
    markers: tuple[tuple[MarkerKind, str], ...]
    markers_title: str
    markers_order: str
    markers_note: str
    has_frequencies: bool


_SWIM_FIGURES = (
    FitFigure("marker_error", "Marker error, Eq. 1 (mm)"),
    FitFigure("aligned_marker_error", "Aligned marker error (mm)"),
    FitFigure("shape_error", "Shape error (mm)"),
    FitFigure("velocity_error", "Velocity error (mm/s)"),
    FitFigure("static_offset", "Static offset (mm)"),
)
_MOTION_FIGURES = (
    FitFigure("motion_error", "Motion error (mm)"),
    FitFigure("recoil_error", "Recoil error (mm)"),
    FitFigure("yaw_error", "Yaw error (°)", 180 / math.pi),
    FitFigure("sway_error", "Sway error (mm)"),
    *_SWIM_FIGURES[1:],
)
_PLAYBACK_FIGURES = (
    FitFigure("aligned_marker_error", "Marker error (mm)"),
    FitFigure("shape_error", "Shape error (mm)"),
    FitFigure("velocity_error", "Velocity error (mm/s)"),
    FitFigure("heading_error", "Heading error (°)", 180 / math.pi),
)
_HEAD_TO_TAIL = ("Error from head to tail", "marker, head to tail")

PROTOCOLS: Mapping[str, ProtocolDescription] = {
    "motion": ProtocolDescription(
        "motion error", "motion_error", _MOTION_FIGURES,
        (("motion", "in the frame of the path"), ("aligned", "in the body frame"), ("shape", "shape alone")),
        *_HEAD_TO_TAIL, "Registration takes a static offset of each marker and trial out.", True,
    ),
    "aligned": ProtocolDescription(
        "aligned marker error", "aligned_marker_error", _SWIM_FIGURES,
        (("marker", "not registered (Eq. 1)"), ("aligned", "registered"), ("shape", "registered, shape alone")),
        *_HEAD_TO_TAIL, "Registration takes a static offset of each marker and trial out.", True,
    ),
    "paper": ProtocolDescription(
        "marker error (Eq. 1)", "marker_error", _SWIM_FIGURES, (("marker", "Eq. 1"), ("shape", "shape alone")),
        *_HEAD_TO_TAIL, "Under the paper's protocol nothing is registered.", True,
    ),
    "playback": ProtocolDescription(
        "playback error", "loss", _PLAYBACK_FIGURES, (("aligned", "at the same times"),),
        "Error of each marker", "marker", "Real and simulated markers are compared at the same times.", False,
    ),
}  # fmt: skip


def figures_of(protocol: str, sensors: Mapping[str, str]) -> tuple[FitFigure, ...]:
    """All figures that a fit may have.

    Args:
        protocol: Name of the protocol.
        sensors: Units of the sensors that are compared, by name.
    """
    sensor_figures = [FitFigure(f"{SENSORS}.{name}", f"{name} ({unit})", 1.0, None) for name, unit in sensors.items()]
    return (*PROTOCOLS[protocol].figures, *sensor_figures)

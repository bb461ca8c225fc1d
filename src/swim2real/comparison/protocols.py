"""What tables and figures say of each protocol: what is minimized, which figures a fit has, which errors a marker."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

MarkerKind = Literal["marker", "aligned", "shape"]

SENSORS = "sensor_errors"


@dataclass(frozen=True)
class FitFigure:
    """One figure of a fit.

    Attributes:
        name: In evidence; `sensor_errors.NAME` is that of a sensor.
        heading: What it is, with unit.
        factor: From SI to that unit.
        digits: After the point; None for three in all, where nobody knows the size before.
    """

    name: str
    heading: str
    factor: float = 1e3
    digits: int | None = 1

    def of(self, fit: Mapping[str, Any]) -> float | None:
        """Its value in evidence [SI]; None where it isn't known, or there is no such figure."""
        group, _, sensor = self.name.partition(".")
        return (fit.get(group) or {}).get(sensor) if sensor else fit.get(group)


@dataclass(frozen=True)
class ProtocolWords:
    """What is said of one protocol.

    Attributes:
        loss: What is minimized.
        trial_loss: Its name in the evidence of a trial.
        figures: That a fit may have, but for its sensors.
        markers: Kinds of errors by marker, with their words.
        markers_title: Of what shows them.
        markers_order: What the axis of the markers is.
        markers_note: How to read them.
        frequencies: Whether its trials have one, so that there is a speed against it.
    """

    loss: str
    trial_loss: str
    figures: tuple[FitFigure, ...]
    markers: tuple[tuple[MarkerKind, str], ...]
    markers_title: str
    markers_order: str
    markers_note: str
    frequencies: bool


_SWIM_FIGURES = (
    FitFigure("marker_error", "Marker error, Eq. 1 (mm)"),
    FitFigure("aligned_marker_error", "Aligned marker error (mm)"),
    FitFigure("shape_error", "Shape error (mm)"),
    FitFigure("velocity_error", "Velocity error (mm/s)"),
    FitFigure("static_offset", "Static offset (mm)"),
)
_PLAYBACK_FIGURES = (
    FitFigure("aligned_marker_error", "Marker error (mm)"),
    FitFigure("shape_error", "Shape error (mm)"),
    FitFigure("velocity_error", "Velocity error (mm/s)"),
    FitFigure("heading_error", "Heading error (°)", 180 / math.pi),
)
_HEAD_TO_TAIL = ("Error from head to tail", "marker, head to tail")

PROTOCOLS: Mapping[str, ProtocolWords] = {
    "aligned": ProtocolWords(
        "aligned marker error", "aligned_marker_error", _SWIM_FIGURES,
        (("marker", "not registered (Eq. 1)"), ("aligned", "registered"), ("shape", "registered, shape alone")),
        *_HEAD_TO_TAIL, "Registration takes a static offset of each marker and trial out.", True,
    ),
    "paper": ProtocolWords(
        "marker error (Eq. 1)", "marker_error", _SWIM_FIGURES, (("marker", "Eq. 1"), ("shape", "shape alone")),
        *_HEAD_TO_TAIL, "Under the paper's protocol nothing is registered.", True,
    ),
    "playback": ProtocolWords(
        "playback error", "loss", _PLAYBACK_FIGURES, (("marker", "at the same times"),),
        "Error of each marker", "marker", "Real and simulated markers are compared at the same times.", False,
    ),
}  # fmt: skip


def figures_of(protocol: str, sensors: Mapping[str, str]) -> tuple[FitFigure, ...]:
    """The figures that a fit may have.

    Args:
        protocol: Under which.
        sensors: Units of the sensors that are compared, by name.
    """
    readings = [FitFigure(f"{SENSORS}.{name}", f"{name} ({unit})", 1.0, None) for name, unit in sensors.items()]
    return (*PROTOCOLS[protocol].figures, *readings)

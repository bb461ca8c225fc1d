"""How tables and charts describe each protocol: the loss, the figures of a fit, the errors that a marker has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from swim2real.objective.figures import AVERAGED, SENSORS, Figure, figures_for, sensor_figure

MarkerKind = Literal["motion", "marker", "aligned", "shape"]


@dataclass(frozen=True)
class ProtocolDescription:
    """How one protocol is described.

    Attributes:
        loss: Name of the loss.
        trial_loss: Key of the loss in the evidence of a trial.
        markers: Kinds of errors that a marker has, each with its description.
        markers_title: Title of tables and charts of these errors.
        markers_order: Label of the axis of the markers.
        markers_note: How to read these errors.
        has_frequencies: Whether its trials have a frequency, so that there is a speed against it.
    """

    loss: str
    trial_loss: str
    markers: tuple[tuple[MarkerKind, str], ...]
    markers_title: str
    markers_order: str
    markers_note: str
    has_frequencies: bool


_HEAD_TO_TAIL = ("Error from head to tail", "marker, head to tail")

PROTOCOLS: Mapping[str, ProtocolDescription] = {
    "motion": ProtocolDescription(
        "motion error", "motion_error",
        (("motion", "in the frame of the path"), ("aligned", "in the body frame"), ("shape", "shape alone")),
        *_HEAD_TO_TAIL, "Registration takes a static offset of each marker and trial out.", True,
    ),
    "aligned": ProtocolDescription(
        "aligned marker error", "aligned_marker_error",
        (("marker", "not registered (Eq. 1)"), ("aligned", "registered"), ("shape", "registered, shape alone")),
        *_HEAD_TO_TAIL, "Registration takes a static offset of each marker and trial out.", True,
    ),
    "paper": ProtocolDescription(
        "marker error (Eq. 1)", "marker_error", (("marker", "Eq. 1"), ("shape", "shape alone")),
        *_HEAD_TO_TAIL, "Under the paper's protocol nothing is registered.", True,
    ),
    "playback": ProtocolDescription(
        "playback error", "loss", (("aligned", "at the same times"),),
        "Error of each marker", "marker", "Real and simulated markers are compared at the same times.", False,
    ),
}  # fmt: skip


def figures_of(protocol: str, sensors: Mapping[str, str]) -> dict[str, Figure]:
    """All figures that a fit may have, by name.

    Args:
        protocol: Name of the protocol.
        sensors: Units of the sensors that are compared, by name.
    """
    figures = figures_for(registered=protocol != "playback")
    shown = {name: figures[name] for name in AVERAGED if name != SENSORS and figures[name].of != "tracks"}
    return shown | {f"{SENSORS}.{name}": sensor_figure(name, unit) for name, unit in sensors.items()}

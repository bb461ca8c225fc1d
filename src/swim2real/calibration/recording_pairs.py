"""The recordings of a run and their playbacks, as they are kept with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from swim2real.calibration.run_folder import RunFolder
from swim2real.errors import RunError
from swim2real.objective import Comparison, PlaybackComparison, SensorComparison, playbacks_of

RECORDINGS = "recordings.npz"
_MARKERS = ("weights", "world_real", "world_simulated")
_READINGS = ("real", "simulated")


@dataclass(frozen=True)
class RecordingPair:
    """One recording and its playback.

    Attributes:
        held_out: Whether the trial was left out of the fit.
        compared: Both, at the same time stamps.
    """

    held_out: bool
    compared: PlaybackComparison


def save_recordings(folder: RunFolder, fit: Comparison, unseen: Comparison | None) -> None:
    """Writes the recordings of a run's best parameters and their playbacks, the held-out ones last.

    Raises:
        RunError: The folder can't be written.
    """
    pairs = [(False, t) for t in playbacks_of(fit)] + [(True, t) for t in (playbacks_of(unseen) if unseen else ())]
    first = pairs[0][1]
    arrays: dict[str, Any] = {
        "names": np.array([t.name for _, t in pairs]),
        "held_out": np.array([out for out, _ in pairs]),
        "divergences": np.array([t.divergence or "" for _, t in pairs]),
        "frame": np.array(first.frame or (), dtype=int),
        "travels": np.array(first.travels),
        "sensors": np.array([sensor.name for sensor in first.sensors]),
        "worths": np.array([sensor.worth for sensor in first.sensors]),
    }
    for i, (_, trial) in enumerate(pairs):
        arrays[f"times_{i}"] = trial.times
        arrays.update({f"{name}_{i}": np.asarray(getattr(trial, name), dtype=np.float32) for name in _MARKERS})
        for j, sensor in enumerate(trial.sensors):
            arrays[f"sensor_times_{i}_{j}"] = sensor.times
            arrays.update({f"sensor_{k}_{i}_{j}": np.asarray(getattr(sensor, k), np.float32) for k in _READINGS})
    folder.write_arrays(RECORDINGS, arrays)


def load_recordings(folder: RunFolder) -> list[RecordingPair]:
    """The recordings of a concluded run and their playbacks.

    Raises:
        RunError: The run wasn't concluded, or the file is damaged.
    """
    content = folder.read_arrays(RECORDINGS)
    try:
        return [
            RecordingPair(bool(content["held_out"][i]), _compared(content, i, str(name)))
            for i, name in enumerate(content["names"])
        ]
    except (KeyError, ValueError) as error:
        raise RunError(f"{folder.path / RECORDINGS} can't be read: {error}") from error


def _compared(content: Mapping[str, Any], trial: int, name: str) -> PlaybackComparison:
    weights, real, simulated = (np.asarray(content[f"{array}_{trial}"], dtype=float) for array in _MARKERS)
    sensors = tuple(
        SensorComparison(
            str(sensor), float(content["worths"][j]), content[f"sensor_times_{trial}_{j}"],
            *(np.asarray(content[f"sensor_{kind}_{trial}_{j}"], dtype=float) for kind in _READINGS),
        )
        for j, sensor in enumerate(content["sensors"])
    )  # fmt: skip
    frame = (int(content["frame"][0]), int(content["frame"][1])) if len(content["frame"]) else None
    return PlaybackComparison(
        name, content[f"times_{trial}"], weights, real, simulated, frame, bool(content["travels"]), sensors,
        str(content["divergences"][trial]) or None,
    )  # fmt: skip

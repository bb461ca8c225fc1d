"""The trials of a run's best parameters, real and simulated, as they are kept with the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from swim2real.calibration.run_folder import TRIALS, RunFolder
from swim2real.errors import RunError
from swim2real.objective import ComparedSensor, ComparedTrial, Comparison
from swim2real.objective.head import HeadMotion, Oscillation

_EARLIER = ("swims.npz", "recordings.npz")  # what version 0.1 wrote
_TIMES = ("times",)  # arrays that are kept with all their digits; the others as 32-bit floats


@dataclass(frozen=True)
class SavedTrial:
    """One compared trial of a run.

    Attributes:
        held_out: Whether the trial was left out of the fit.
        compared: The real and the simulated trial.
    """

    held_out: bool
    compared: ComparedTrial


def save_trials(folder: RunFolder, fit: Comparison, held_out: Comparison | None) -> None:
    """Writes the trials of a run's best parameters, the held-out ones last.

    Raises:
        RunError: The folder can't be written.
    """
    pairs = [(False, trial) for trial in fit.trials]
    pairs += [(True, trial) for trial in held_out.trials] if held_out is not None else []
    arrays: dict[str, Any] = {"held_out": np.array([held for held, _ in pairs])}
    for i, (_, trial) in enumerate(pairs):
        for field in fields(ComparedTrial):
            value = getattr(trial, field.name)
            if isinstance(value, HeadMotion):
                arrays |= {f"{i}/{field.name}/{name}": part for name, part in _head_arrays(value).items()}
            elif field.name != "sensors" and value is not None:
                arrays[f"{i}/{field.name}"] = _stored(field.name, value)
        for j, sensor in enumerate(trial.sensors):
            for field in fields(ComparedSensor):
                arrays[f"{i}/sensors/{j}/{field.name}"] = _stored(field.name, getattr(sensor, field.name))
    folder.write_arrays(TRIALS, arrays)


def load_trials(folder: RunFolder) -> tuple[SavedTrial, ...]:
    """The trials of a run that has ended.

    Raises:
        RunError: The run hasn't ended, was made by version 0.1, or the file is damaged.
    """
    if not (folder.path / TRIALS).is_file():
        earlier = next((name for name in _EARLIER if (folder.path / name).is_file()), None)
        if earlier is not None:
            raise RunError(
                f"run '{folder.path}' was made by version 0.1, whose {earlier} this version doesn't read; run its "
                f"calibrate command again with --resume, which takes the record as it is and writes {TRIALS}"
            )
    content = folder.read_arrays(TRIALS)
    try:
        return tuple(SavedTrial(bool(held), _trial(content, i)) for i, held in enumerate(content["held_out"]))
    except (KeyError, ValueError, TypeError) as error:
        raise RunError(f"{folder.path / TRIALS} can't be read: {error!r}; {folder.RESTORE}") from error


def _stored(name: str, value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.dtype == np.float64 and name not in _TIMES:
        return value.astype(np.float32)
    return np.array(value)


def _head_arrays(head: HeadMotion) -> dict[str, Any]:
    return {field.name: _stored(field.name, getattr(head, field.name)) for field in fields(HeadMotion)}


def _head(of_trial: Mapping[str, Any], name: str) -> HeadMotion | None:
    if f"{name}/progress" not in of_trial:
        return None
    parts: dict[str, Any] = {field.name: _read(of_trial[f"{name}/{field.name}"]) for field in fields(HeadMotion)}
    parts |= {beat: Oscillation(*map(float, parts[beat])) for beat in ("sway_beat", "yaw_beat")}
    return HeadMotion(**parts)


def _trial(content: Mapping[str, Any], index: int) -> ComparedTrial:
    prefix = f"{index}/"
    of_trial = {key.removeprefix(prefix): array for key, array in content.items() if key.startswith(prefix)}
    count = len({key.split("/")[1] for key in of_trial if key.startswith("sensors/")})
    sensors = tuple(
        ComparedSensor(**{field.name: _read(of_trial[f"sensors/{j}/{field.name}"]) for field in fields(ComparedSensor)})
        for j in range(count)
    )
    values: dict[str, Any] = {
        field.name: _read(of_trial[field.name]) for field in fields(ComparedTrial) if field.name in of_trial
    }
    if values.get("frame") is not None:
        values["frame"] = (int(values["frame"][0]), int(values["frame"][1]))
    values |= {name: _head(of_trial, name) for name in ("head_real", "head_simulated")}
    return ComparedTrial(**values, sensors=sensors)


def _read(array: Any) -> Any:
    """A text, a number, or an array of 64-bit floats."""
    if array.ndim == 0:
        return array.item()
    return array.astype(float)

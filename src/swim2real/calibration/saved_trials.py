"""The trials of a run's best parameters, real and simulated, as they are kept with the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, get_args

import numpy as np

from swim2real.calibration.run_folder import TRIALS, RunFolder
from swim2real.errors import RunError
from swim2real.objective import ComparedSensor, ComparedTrial, Comparison
from swim2real.objective.head import HeadMotion, Oscillation
from swim2real.objective.trial import LossFigure

_EARLIER = ("swims.npz", "recordings.npz")  # what version 0.1 wrote
_LARGEST = 1e15  # of a number, in whatever unit
_SHAPES = {
    "times": "T", "weights": "TM", "real": "TM2", "simulated": "TM2", "registration": "M2", "path_real": "TM2",
    "path_simulated": "TM2", "progress_real": "T", "progress_simulated": "T", "swim_residual": "TM2",
}  # fmt: skip
_HEAD_SHAPES = {"progress": "T", "sway": "T", "yaw": "T"}
_SENSOR_SHAPES = {"times": "R", "real": "R", "simulated": "R"}
_TEXTS = ("name", "loss_figure", "divergence")
_NUMBERS = (
    "velocity_real", "velocity_simulated", "frequency", "beat_frequency", "phase", "static_offset", "turn_rate",
    "wander",
    "meters_per_unit",
)  # fmt: skip
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
        held_out = np.atleast_1d(content["held_out"])
        return tuple(SavedTrial(bool(held), _trial(content, i)) for i, held in enumerate(held_out))
    except (AttributeError, IndexError, KeyError, ValueError, TypeError) as error:
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
    trial = ComparedTrial(**values, sensors=sensors)
    _check_shapes(trial)
    return trial


def _check_shapes(trial: ComparedTrial) -> None:
    """Checks what constructors take as it is, since every other trial comes from our own code.

    Raises:
        ValueError: An array has another shape, or a number or a text is none.
    """
    sizes: dict[str, Any] = {
        "T": len(trial.times),
        "M": np.shape(trial.weights)[-1] if np.ndim(trial.weights) else -1,
        "2": 2,
    }
    heads = [head for head in (trial.head_real, trial.head_simulated) if head is not None]
    parts: list[tuple[Any, Mapping[str, str], Mapping[str, Any]]] = [
        (trial, _SHAPES, sizes), *((head, _HEAD_SHAPES, sizes) for head in heads),
        *((sensor, _SENSOR_SHAPES, {"R": len(sensor.times)}) for sensor in trial.sensors),
    ]  # fmt: skip
    for part, shapes, known in parts:
        for field in fields(part):
            value = getattr(part, field.name)
            if field.name in shapes and value is not None:
                wanted = tuple(known[letter] for letter in shapes[field.name])
                if np.shape(value) != wanted:
                    raise ValueError(f"{field.name} has shape {np.shape(value)}; expected {wanted}")
            elif field.name in _TEXTS and not isinstance(value, str | None):
                raise ValueError(f"{field.name} is no text")
            elif field.name in _NUMBERS and not isinstance(value, float | int | None):
                raise ValueError(f"{field.name} is no number")
    if trial.loss_figure not in get_args(LossFigure):
        raise ValueError(f"loss_figure is {trial.loss_figure!r}; it must be one of {', '.join(get_args(LossFigure))}")
    marker_count = sizes["M"]
    if trial.frame is not None and not all(0 <= marker < marker_count for marker in trial.frame):
        raise ValueError(f"frame is {trial.frame}; it must be two of {marker_count} markers")
    if not (np.isfinite(trial.times).all() and (np.diff(trial.times) > 0).all() and len(trial.times) > 1):
        raise ValueError("times must be finite and rise")


def _read(array: Any) -> Any:
    """A text, a number, or an array of 64-bit floats."""
    if array.ndim == 0:
        return array.item()
    numbers = array.astype(float)
    if numbers.size and np.nanmax(np.abs(numbers), initial=0.0) > _LARGEST:
        raise ValueError(f"a number is beyond ±{_LARGEST:g}")
    return numbers

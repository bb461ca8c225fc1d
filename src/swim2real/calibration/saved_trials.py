"""Findings of a run, kept with it so that a report needs nothing else: figures, and the trials, real and simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from swim2real.calibration.convergence import noise_of
from swim2real.calibration.file_models import Outcome
from swim2real.calibration.loop import Search
from swim2real.calibration.problem import Problem
from swim2real.calibration.run_folder import OUTCOME, TRIALS, RunFolder
from swim2real.calibration.sensitivity import Sensitivity, Slopes
from swim2real.calibration.verdict import judge
from swim2real.objective import (
    ComparedBeat,
    ComparedHead,
    ComparedProgress,
    ComparedSensor,
    ComparedTrial,
    Comparison,
    evidence,
)
from swim2real.objective.comparison import rounded
from swim2real.objective.head import HeadMotion, Oscillation
from swim2real.objective.trial import LossFigure
from swim2real.parameters import Values
from swimbase.errors import RunError

_LARGEST = 1e15  # of a number, in whatever unit
_SHAPES: Mapping[Any, Mapping[str, str]] = {
    ComparedTrial: {
        "times": "T", "weights": "TM", "real": "TM2", "simulated": "TM2", "registration": "M2", "path_real": "TM2",
        "path_simulated": "TM2",
    },
    ComparedBeat: {"swim_residual": "TM2"},
    ComparedProgress: {"real": "T", "simulated": "T"},
    ComparedHead: {},
    HeadMotion: {"progress": "T", "sway": "T", "yaw": "T"},
    ComparedSensor: {"times": "R", "real": "R", "simulated": "R"},
}  # fmt: skip


@dataclass(frozen=True)
class SavedTrial:
    """One compared trial of a run.

    Attributes:
        held_out: Whether the trial was left out of the fit.
        compared: The real and the simulated trial.
    """

    held_out: bool
    compared: ComparedTrial


def conclude(
    folder: RunFolder, problem: Problem, held_out: Problem | None, values: Values,
    sensitivity: Sequence[Sensitivity] | None = None, search: Search | None = None, slopes: Slopes | None = None,
    late: Sequence[str] = (),
) -> Outcome:  # fmt: skip
    """Simulates the best parameters once more, on held-out trials too, and writes figures and trials.

    Args:
        folder: Folder of the run.
        problem: The fitted trials.
        held_out: The held-out trials; None without any.
        values: The best parameters.
        sensitivity: Effect of each parameter on the loss, where it was measured.
        search: How the search ended; None for one of which nothing is known.
        slopes: How the residual changes about the best parameters, where the search knows it.
        late: A sentence for each stream that seems late.

    Raises:
        RunError: The folder can't be written.
    """
    fit = problem.evaluate(values)
    on_held_out = None if held_out is None else held_out.evaluate(values)
    swims, made = problem.check_fit(values), len(folder.record())
    search = search or Search(made=made)
    noise = noise_of(problem.trials, problem.robot.trials.sensors)
    verdict = judge(fit.trials, problem.robot, search, noise, swims)
    content: dict[str, object] = {
        "verdict": rounded(verdict.model_dump()),
        "values": dict(values),
        "fit": evidence(fit),
        "held_out": None if on_held_out is None else evidence(on_held_out),
        **({"from_rest": rounded({name: asdict(swim) for name, swim in swims.items()})} if swims else {}),
        "trials": {**problem.examinations(), **({} if held_out is None else held_out.examinations())},
        "sensitivity": None if sensitivity is None else rounded([asdict(s) for s in sensitivity]),
        "engine": problem.engine.as_dict(),
        "marker_names": list(problem.robot.marker_names),
        "evaluations": made,
        "ending": search.ending,
        "conclusion": search.conclusion,
        "noise": rounded(noise),
        "ranges": {} if slopes is None else {name: list(ends) for name, ends in slopes.ranges().items()},
        "late": list(late),
    }
    save_trials(folder, fit, on_held_out)
    folder.write_json(OUTCOME, content)
    return Outcome.model_validate(content)


def save_trials(folder: RunFolder, fit: Comparison, held_out: Comparison | None) -> None:
    """Writes the trials of a run's best parameters, the held-out ones last.

    Raises:
        RunError: The folder can't be written.
    """
    pairs = [(False, trial) for trial in fit.trials]
    pairs += [(True, trial) for trial in held_out.trials] if held_out is not None else []
    arrays: dict[str, NDArray[Any]] = {"held_out": np.array([held for held, _ in pairs])}
    for i, (_, trial) in enumerate(pairs):
        arrays |= _flat(str(i), trial)
    folder.write_arrays(TRIALS, arrays)


def load_trials(folder: RunFolder) -> tuple[SavedTrial, ...]:
    """The trials of a run that has ended.

    Raises:
        RunError: The run hasn't ended, or the file is damaged.
    """
    content = folder.read_arrays(TRIALS)
    try:
        held_out = np.atleast_1d(content["held_out"])
        return tuple(SavedTrial(bool(held), _trial(content, str(i))) for i, held in enumerate(held_out))
    except (AttributeError, IndexError, KeyError, ValueError, TypeError) as error:
        raise RunError(f"{folder.path / TRIALS} can't be read: {error!r}; {folder.RESTORE}") from error


def _flat(path: str, value: Any) -> dict[str, NDArray[Any]]:
    """A value, or those of all its parts, by their paths; times keep all their digits, other numbers 32 bits."""
    if is_dataclass(value):
        parts = {field.name: getattr(value, field.name) for field in fields(value)}
        return {key: array for name, part in parts.items() for key, array in _flat(f"{path}/{name}", part).items()}
    if path.endswith("/sensors"):
        return {key: array for j, sensor in enumerate(value) for key, array in _flat(f"{path}/{j}", sensor).items()}
    if value is None:
        return {}
    if isinstance(value, np.ndarray) and value.dtype == np.float64 and not path.endswith("/times"):
        return {path: value.astype(np.float32)}
    return {path: np.array(value)}


def _trial(content: Mapping[str, Any], path: str) -> ComparedTrial:
    """A trial from its arrays. What constructors take as it is is checked, since other trials come from our own code.

    Raises:
        ValueError: An array has another shape, or a number or a text is none.
    """
    weights = content[f"{path}/weights"]
    sizes = {"T": len(content[f"{path}/times"]), "M": weights.shape[-1] if weights.ndim else -1, "2": 2}
    trial: ComparedTrial = _part(ComparedTrial, content, path, sizes)
    if trial.loss_figure not in get_args(LossFigure):
        raise ValueError(f"loss_figure is {trial.loss_figure!r}; it must be one of {', '.join(get_args(LossFigure))}")
    if trial.frame is not None and not all(0 <= marker < sizes["M"] for marker in trial.frame):
        raise ValueError(f"frame is {trial.frame}; it must be two of {sizes['M']} markers")
    if not (np.isfinite(trial.times).all() and (np.diff(trial.times) > 0).all() and len(trial.times) > 1):
        raise ValueError("times must be finite and rise")
    return trial


def _part(kind: Any, content: Mapping[str, Any], path: str, sizes: Mapping[str, int]) -> Any:
    """An object of a dataclass from the arrays below a path."""
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(kind).items():
        place, parts = f"{path}/{name}", [part for part in (hint, *get_args(hint)) if part in _SHAPES]
        if name == "sensors":
            count = len({key.split("/")[2] for key in content if key.startswith(f"{place}/")})
            paths = [f"{place}/{j}" for j in range(count)]
            values[name] = tuple(_part(ComparedSensor, content, p, {"R": len(content[f"{p}/times"])}) for p in paths)
        elif parts and any(key.startswith(f"{place}/") for key in content):
            values[name] = _part(parts[0], content, place, sizes)
        elif place in content:
            shape = _SHAPES[kind].get(name)
            wanted = None if shape is None else tuple(sizes[letter] for letter in shape)
            values[name] = _checked(name, hint, content[place], wanted)
    return kind(**values)


def _checked(name: str, hint: Any, array: Any, shape: tuple[int, ...] | None) -> Any:
    """A text, a number, or an array of 64-bit floats, as the type and the shape want it."""
    if array.ndim == 0:
        value, number = array.item(), hint in (float, float | None)
        if shape is not None or not isinstance(value, float | int if number else str):
            raise ValueError(f"{name} is {value!r}, which is no {'number' if number else 'text or array'}")
        return value
    numbers = array.astype(float)
    if numbers.size and np.nanmax(np.abs(numbers), initial=0.0) > _LARGEST:
        raise ValueError(f"a number is beyond ±{_LARGEST:g}")
    if hint is Oscillation:
        return Oscillation(*map(float, numbers))
    if name == "frame":
        return int(numbers[0]), int(numbers[1])
    if numbers.shape != shape:
        raise ValueError(f"{name} has shape {numbers.shape}; expected {shape}")
    return numbers

"""What a run found, kept with it so that a report needs nothing else: figures, and the swims themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from swim2real.calibration.from_rest import from_rest
from swim2real.calibration.problem import Problem, RealTrial
from swim2real.calibration.run_folder import OUTCOME, RunFolder
from swim2real.calibration.sensitivity import Sensitivity
from swim2real.errors import RunError
from swim2real.objective import Comparison, evidence
from swim2real.objective.evidence import rounded
from swim2real.parameters import Values

SWIMS = "swims.npz"
_ARRAYS = ("times", "weights", "real", "simulated", "registration", "progress_real", "progress_simulated")


@dataclass(frozen=True)
class SwimPair:
    """One real and simulated swim at the same time stamps, as compared.

    Attributes:
        name: Of the trial.
        held_out: Whether the trial was left out of the fit.
        frequency: Of the beat [Hz].
        times: [s]. Shape (T,).
        weights: 0 where a marker was lost. Shape (T, M).
        real: Body frame [m]. Shape (T, M, 2).
        simulated: Body frame, phase aligned, not registered [m]. Shape (T, M, 2).
        registration: Real minus simulated, static [m]. Shape (M, 2).
        progress_real: [m]. Shape (T,).
        progress_simulated: [m]. Shape (T,).
    """

    name: str
    held_out: bool
    frequency: float
    times: NDArray[np.float64]
    weights: NDArray[np.float64]
    real: NDArray[np.float64]
    simulated: NDArray[np.float64]
    registration: NDArray[np.float64]
    progress_real: NDArray[np.float64]
    progress_simulated: NDArray[np.float64]


def conclude(
    folder: RunFolder, problem: Problem, held_out: Problem | None, values: Values,
    sensitivity: Sequence[Sensitivity] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Simulates the best parameters once more, on held-out trials and from rest too, and writes figures and swims.

    Returns:
        The outcome as written: `fit` and `held_out` (figures with per-marker evidence), `from_rest` (how each fitted
        trial's beat swims from rest), `trials` (quality and beat of each), `sensitivity`, `engine`.
    """
    fit = problem.evaluate(values)
    unseen = None if held_out is None else held_out.evaluate(values)
    begun = from_rest(problem.simulator, values, {swim.name: swim.actuation.frequency for swim in problem.swims})
    outcome: dict[str, Any] = {
        "fit": evidence(fit),
        "held_out": None if unseen is None else evidence(unseen),
        "from_rest": rounded({name: swim.as_dict() for name, swim in begun.items()}),
        "trials": {one.trial.name: examined(one, problem.robot.marker_names) for one in problem.real},
        "sensitivity": None if sensitivity is None else rounded([s.as_dict() for s in sensitivity]),
        "engine": problem.simulator.engine.as_dict(),
        "marker_names": list(problem.robot.marker_names),
    }
    if held_out is not None:
        outcome["trials"].update({o.trial.name: examined(o, problem.robot.marker_names) for o in held_out.real})
    _save_swims(folder.path / SWIMS, fit, unseen)
    folder.write_json(folder.path / OUTCOME, outcome)
    return outcome


def examined(one: RealTrial, names: tuple[str, ...]) -> dict[str, Any]:
    """Quality and beat of a real trial, ready for JSON."""
    beat = one.beat
    return rounded(
        {
            "nominal_frequency": one.trial.nominal_frequency,
            "meters_per_pixel": one.trial.meters_per_pixel,
            "duration": one.trial.track.duration,
            "frames": one.trial.track.frame_count,
            "frequency": beat.frequency,
            "frequency_std": beat.frequency_std,
            "phase": beat.phase,
            "phase_std": beat.phase_std,
            "start_speed": beat.start_speed,
            "start_speed_std": beat.start_speed_std,
            "amplitude": beat.amplitude,
            "explained": beat.explained,
            "lost_share": one.quality.lost_share,
            "left_out_share": one.quality.left_out_share,
            "head_spread": one.quality.head_spread,
            "body_spread": one.quality.body_spread,
            "usable": one.quality.usable,
            "findings": one.quality.findings(names),
        }
    )


def _save_swims(path: Path, fit: Comparison, unseen: Comparison | None) -> None:
    pairs = [(False, t) for t in fit.trials] + [(True, t) for t in (unseen.trials if unseen else ())]
    arrays: dict[str, Any] = {
        "names": np.array([t.name for _, t in pairs]),
        "held_out": np.array([out for out, _ in pairs]),
        "frequencies": np.array([t.frequency for _, t in pairs]),
    }
    for i, (_, trial) in enumerate(pairs):
        arrays.update({f"{name}_{i}": np.asarray(getattr(trial, name), dtype=np.float32) for name in _ARRAYS})
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            np.savez_compressed(file, **arrays)
        part.replace(path)
    except OSError as error:
        raise RunError(f"can't write '{path}': {error.strerror or error}") from error


def load_swims(folder: RunFolder) -> list[SwimPair]:
    """The swims of a concluded run.

    Raises:
        RunError: The run wasn't concluded, or the file is damaged.
    """
    path = folder.path / SWIMS
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            content: Mapping[str, Any] = dict(stored)
        return [
            SwimPair(
                str(name), bool(content["held_out"][i]), float(content["frequencies"][i]),
                *(np.asarray(content[f"{array}_{i}"], dtype=float) for array in _ARRAYS),
            )
            for i, name in enumerate(content["names"])
        ]  # fmt: skip
    except FileNotFoundError:
        raise RunError(f"run '{folder.path}' has no {SWIMS} yet; it is written when a run ends") from None
    except (OSError, EOFError, ValueError, KeyError, BadZipFile) as error:
        raise RunError(f"{path} can't be read: {error}") from error

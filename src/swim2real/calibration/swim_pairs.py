"""The swims of a run, real and simulated, as they are kept with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.calibration.run_folder import RunFolder
from swim2real.errors import RunError
from swim2real.objective import Comparison, swims_of

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


def save_swims(folder: RunFolder, fit: Comparison, unseen: Comparison | None) -> None:
    """Writes the swims of a run's best parameters, those on held-out trials last.

    Raises:
        RunError: The folder can't be written.
    """
    pairs = [(False, t) for t in swims_of(fit)] + [(True, t) for t in (swims_of(unseen) if unseen else ())]
    arrays: dict[str, Any] = {
        "names": np.array([t.name for _, t in pairs]),
        "held_out": np.array([out for out, _ in pairs]),
        "frequencies": np.array([t.frequency for _, t in pairs]),
    }
    for i, (_, trial) in enumerate(pairs):
        arrays.update({f"{name}_{i}": np.asarray(getattr(trial, name), dtype=np.float32) for name in _ARRAYS})
    folder.write_arrays(SWIMS, arrays)


def load_swims(folder: RunFolder) -> list[SwimPair]:
    """The swims of a concluded run.

    Raises:
        RunError: The run wasn't concluded, or the file is damaged.
    """
    content = folder.read_arrays(SWIMS)
    try:
        return [
            SwimPair(
                str(name), bool(content["held_out"][i]), float(content["frequencies"][i]),
                *(np.asarray(content[f"{array}_{i}"], dtype=float) for array in _ARRAYS),
            )
            for i, name in enumerate(content["names"])
        ]  # fmt: skip
    except (KeyError, ValueError) as error:
        raise RunError(f"{folder.path / SWIMS} can't be read: {error}") from error

"""What a robot tells the rest of swim2real about itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.parameters import ParameterSpace, Values


class Response(Protocol):
    """How a robot's swimming responds to its parameters, roughly, as measured over its whole box."""

    def speeds(
        self, points: NDArray[np.float64], values: NDArray[np.float64], frequencies: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Forward speeds [m/s], from the logarithmic cube and from values. Shapes (N, d), (N, d), (F,) to (N, F)."""
        ...

    def reserve(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share of the thrust that is left after what works against it. Shape (N, d) to (N,)."""
        ...

    def adapted(
        self, points: NDArray[np.float64], values: NDArray[np.float64], speeds: NDArray[np.float64],
        frequencies: NDArray[np.float64],
    ) -> Response:  # fmt: skip
        """The response bent to simulated speeds (N, F) [m/s] that a run has seen."""
        ...

    def beats(self, points: NDArray[np.float64], frequencies: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sideways fundamentals of the markers, real then imaginary parts [m]. Shapes (N, d), (F,) to (N, F, 2 M)."""
        ...


Score = Callable[[Mapping[str, Any]], float]


@dataclass(frozen=True)
class FitStage:
    """Some parameters that a person would fit on their own.

    Attributes:
        name: In a word.
        parameters: Their names.
        share: Of the evaluations, relative to the other stages.
        together: Whether all have one place in their ranges and a scan along it, or each its own and a search.
        score: From the evidence of an evaluation to what is minimized, NaN where it can't be told; None is the loss.
    """

    name: str
    parameters: tuple[str, ...]
    share: float
    together: bool = False
    score: Score | None = None


@dataclass(frozen=True)
class FitPlan:
    """How a person would fit a robot step by step, for the method of stages.

    Attributes:
        stages: In order.
        held: Values of parameters that are set once and never fitted [unit].
    """

    stages: tuple[FitStage, ...]
    held: Values


@dataclass(frozen=True)
class Robot:
    """A robot that can be built for any parameter values.

    Attributes:
        name: As in parameters files.
        description: What it is, where its markers are, what drives it and which way it swims, in two to five sentences
            for a person or a VLM who has never seen it.
        space: The parameters that are calibrated, with their default scale.
        build: Values to an MjSpec. The spec has one `framepos` sensor a marker, in order, and nothing else there.
        marker_names: M names, head first.
        rest_markers: Marker positions of the straight robot relative to the first, x toward the tail [m]. Shape (M, 2).
        marker_heights: Of the markers above the robot's origin; a camera above sees higher ones farther out [m].
            Shape (M,).
        surge_joints: The two joints that carry the robot along world x and y.
        motor_joint: The joint that an actuation turns.
        tail_markers: Indices of the markers whose sideways motion shows the beat best.
        response: What the built-in physics advisor believes at first.
        fit_plan: How a person would fit it in stages; None where nobody has thought of any.
    """

    name: str
    description: str
    space: ParameterSpace
    build: Callable[[Values], mujoco.MjSpec]
    marker_names: tuple[str, ...]
    rest_markers: NDArray[np.float64]
    marker_heights: NDArray[np.float64]
    surge_joints: tuple[str, str]
    motor_joint: str
    tail_markers: tuple[int, ...]
    response: Response
    fit_plan: FitPlan | None = None

    @property
    def head_length(self) -> float:
        """Distance of the first two markers, which sets the scale of a video [m]."""
        return float(np.linalg.norm(self.rest_markers[1] - self.rest_markers[0]))

"""A policy's network in plain NumPy: its actions, and its file, an .npz without any pickle."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from swimbase.arrays import Array
from swimbase.errors import RunError
from swimbase.parsing import from_json
from swimbase.store import read_arrays, write_arrays

if TYPE_CHECKING:
    from stable_baselines3 import SAC

Weights = NDArray[np.float32]

_LEAST_LOG_STD, _MOST_LOG_STD = -20.0, 2.0  # as Stable-Baselines3 limits them
_ABOUT = "about"


@dataclass(frozen=True)
class Linear:
    """A linear layer: x @ weight + bias.

    Attributes:
        weight: Shape (inputs, outputs).
        bias: Shape (outputs,).
    """

    weight: Weights
    bias: Weights

    def __call__(self, x: Weights) -> Weights:
        return x @ self.weight + self.bias


class _AboutPolicy(BaseModel):
    """Purpose of a policy.

    Attributes:
        observation: Where in an observation each part of it is: first place, and the one after the last.
        actions: Names of the actuators.
    """

    observation: dict[str, list[int]] = {}
    actions: list[str] = []


@dataclass(frozen=True)
class Actor:
    """The actor of soft actor-critic: hidden layers with ReLU, mean and logarithmic deviation of a Gaussian, tanh.

    Attributes:
        hidden: Hidden layers.
        mean: Layer of the mean.
        log_std: Layer of the logarithm of the standard deviation.
        about: What its file says of it.
    """

    hidden: tuple[Linear, ...]
    mean: Linear
    log_std: Linear
    about: _AboutPolicy = field(default_factory=lambda: _AboutPolicy())

    @staticmethod
    def of(learner: SAC) -> Actor:
        """A copy of a learner's actor as it is now."""
        actor = learner.actor

        def layer(module: Any) -> Linear:
            weight, bias = module.weight.detach().numpy(), module.bias.detach().numpy()
            return Linear(np.array(weight.T, order="C"), bias.copy())

        hidden = tuple(layer(module) for module in actor.latent_pi if hasattr(module, "weight"))
        return Actor(hidden, layer(actor.mu), layer(actor.log_std))

    def __call__(self, observations: NDArray[np.float32], commands: Array, step: int) -> Array:
        """The actor as a policy, which is deterministic: it takes the means."""
        return self.best(observations)

    def best(self, observations: NDArray[np.float32]) -> Array:
        """The means of the actions. Shapes (N, n) to (N, A)."""
        return np.tanh(self.mean(self._features(observations)).astype(np.float64))

    def sample(self, observations: NDArray[np.float32], noise: Array) -> Array:
        """Actions of the Gaussian, at so many standard deviations (N, A) from its mean. Shapes (N, n) to (N, A)."""
        features = self._features(observations)
        mean = self.mean(features).astype(np.float64)
        std = np.exp(np.clip(self.log_std(features).astype(np.float64), _LEAST_LOG_STD, _MOST_LOG_STD))
        return np.tanh(mean + std * noise)

    def _features(self, observations: NDArray[np.float32]) -> Weights:
        x = observations
        for layer in self.hidden:
            x = np.maximum(layer(x), np.float32(0.0))
        return x

    def save(self, path: Path, about: Mapping[str, Any]) -> None:
        """Writes the network, and as JSON what it is about and the shapes of its layers."""
        layers = self._layers()
        about = {**about, "layers": {name: list(layer.weight.shape) for name, layer in layers.items()}}
        arrays: dict[str, NDArray[Any]] = {_ABOUT: np.array(json.dumps(about))}
        for name, layer in layers.items():
            arrays[f"{name}.weight"], arrays[f"{name}.bias"] = layer.weight, layer.bias
        write_arrays(path, arrays)

    @staticmethod
    def load(path: Path) -> Actor:
        """Reads a network.

        Raises:
            RunError: The file is damaged.
        """
        try:
            return Actor.from_arrays(read_arrays(path))
        except (OSError, ValueError) as error:
            raise RunError(f"policy '{path}' is damaged: {error}; take another one, or train anew") from error

    @staticmethod
    def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> Actor:
        """The network of the arrays that `save` writes.

        Raises:
            ValueError: An array is missing, has a wrong shape or type, or a number in it isn't finite.
        """

        def layer(name: str) -> Linear:
            for key in (f"{name}.weight", f"{name}.bias"):
                if key not in arrays:
                    raise ValueError(f"its array '{key}' is missing")
                if arrays[key].dtype != np.float32 or not np.isfinite(arrays[key]).all():
                    raise ValueError(f"its array '{key}' must have finite numbers of type float32")
            weight, bias = arrays[f"{name}.weight"], arrays[f"{name}.bias"]
            if weight.ndim != 2 or bias.shape != weight.shape[1:]:
                raise ValueError(f"its layer '{name}' has the shapes {weight.shape} and {bias.shape}")
            return Linear(weight, bias)

        count = sum(name.startswith("hidden") and name.endswith(".weight") for name in arrays)
        hidden, about = tuple(layer(f"hidden{i}") for i in range(count)), from_json(str(arrays.get(_ABOUT, "{}")))
        actor = Actor(hidden, layer("mean"), layer("log_std"), _AboutPolicy.model_validate(about))
        shapes = [layer.weight.shape for layer in (*actor.hidden, actor.mean)]
        if any(one[1] != next_one[0] for one, next_one in pairwise(shapes)) or actor.log_std.weight.shape != shapes[-1]:
            raise ValueError(f"its layers' shapes {shapes} and {actor.log_std.weight.shape} don't fit one another")
        return actor

    def _layers(self) -> dict[str, Linear]:
        hidden = {f"hidden{i}": layer for i, layer in enumerate(self.hidden)}
        return {**hidden, "mean": self.mean, "log_std": self.log_std}

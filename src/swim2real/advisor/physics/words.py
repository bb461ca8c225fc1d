"""Plain sentences: what differs, and which parameters are held responsible."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.advisor.physics.features import Swims
from swim2real.parameters import ParameterSpace, Values

Array = NDArray[np.float64]


def diagnose(frequencies: Array, real: Swims, simulated: Swims, evidence: Mapping[str, Any]) -> str:
    return ""


def reason(space: ParameterSpace, here: Array, point: Array, before: Values, after: Values, effects: Array) -> str:
    return ""

"""A faster `mj_step` for robots in MuJoCo's ellipsoid fluid, with the same numbers.

The engine does everything but the fluid and the solution for the velocities: it is called on a twin of the model
without water, and the forces of the water and their derivative are added in between. Contacts, limits, tendons,
actuators and sensors are the engine's own. Loops are compiled and hold no Python lock; data may be stepped by any
number of threads at a time, each with its own.
"""

# ruff: noqa: N803, N806, SIM110 (matrices are capitals; compiled loops stay loops)

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, cast

import mujoco
import numba
import numpy as np
from numba.core.errors import NumbaError

from swim2real.simulation.fast_plan import (
    MIN,
    Array,
    Calls,
    Indices,
    Plan,
    State,
    UnsupportedModelError,
    call,
    call_flag,
    compiled,
    find_calls,
    make_plan,
    without_fluid,
)
from swim2real.simulation.velocity_derivative import Scratch, add_fluid

_MAX = 1e10  # the engine's mjMAXVAL: beyond it a state counts as diverged
_SOURCES = ("fast_plan", "fast_step", "geom_fluid", "velocity_derivative")
_log = logging.getLogger(__name__)


class Steps(NamedTuple):
    """What steps gave, before each one that was made.

    Attributes:
        sensors: Readings of the sensors. Shape (made, nsensordata).
        qpos: Shape (made, nq).
        qvel: Shape (made, nv).
        failed: Whether the next one couldn't be made, where the engine would have reset itself with a warning.
    """

    sensors: Array
    qpos: Array
    qvel: Array
    failed: bool


class FastStep:
    """Steps one compiled model; any number of threads may use it, each with data of its own."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Plans the steps.

        Args:
            model: Compiled model. Changes to it afterward aren't seen.

        Raises:
            UnsupportedModelError: The fast step doesn't apply; the message has the reason.
        """
        self.model = model
        self._dry = without_fluid(model)
        self._calls = find_calls()
        self.plan = make_plan(model, self._dry)

    def run(self, data: mujoco.MjData, control: Array, steps: int) -> Steps:
        """Makes steps with the data, in place.

        Args:
            data: State at the start; it is the state at the end afterward.
            control: Control of each step, or the same for all. Shape (steps, nu) or (nu,).
            steps: Number of steps.

        Raises:
            UnsupportedModelError: The installed numba can't compile the step.
        """
        model = self.model
        rows = np.empty((steps, model.nu))
        rows[:] = control
        sensors = np.empty((steps, model.nsensordata))
        qpos, qvel = np.empty((steps, model.nq)), np.empty((steps, model.nv))
        try:
            made = _loop()(self._calls, self.plan, State.of(data), scratch_of(model), rows, sensors, qpos, qvel)
        except NumbaError as error:
            raise UnsupportedModelError(f"numba {numba.__version__} can't compile it: {error}") from error
        return Steps(sensors[:made], qpos[:made], qvel[:made], made < steps)


def scratch_of(model: mujoco.MjModel) -> Scratch:
    """Memory that steps of a model need, for one thread."""
    return Scratch(
        np.empty((model.nbody, 36)), np.empty((model.nbody, 6)), np.empty((model.nbody, 10)),
        np.empty((model.nv, 6)), np.empty((model.nv, model.nv)),
    )  # fmt: skip


def disagreement(fast: FastStep, states: int = 8, seed: int = 0) -> float:
    """Largest relative difference between the velocities after one fast step and after the engine's own.

    Args:
        fast: Fast step that is checked.
        states: Number of random states.
        seed: Seed of the states.
    """
    model, rng, worst = fast.model, np.random.default_rng(seed), 0.0
    expected, actual = mujoco.MjData(model), mujoco.MjData(model)
    for _ in range(states):
        for data in (expected, actual):
            mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, expected.qpos, rng.uniform(-0.5, 0.5, model.nv), 1.0)
        expected.qvel[:] = 10 ** rng.uniform(-3, 1) * rng.standard_normal(model.nv)
        expected.ctrl[:] = rng.standard_normal(model.nu)
        actual.qpos[:], actual.qvel[:] = expected.qpos, expected.qvel
        failed = fast.run(actual, expected.ctrl, 1).failed
        mujoco.mj_step(model, expected)
        gap = float(np.abs(expected.qvel - actual.qvel).max() / np.abs(expected.qvel).max())
        worst = max(worst, gap) if np.isfinite(gap) and not failed else np.inf
    return worst


_Loop = Callable[[Calls, Plan, State, Scratch, Array, Array, Array, Array], int]
_made: list[_Loop] = []


def _loop() -> _Loop:
    """The compiled loop, made once a process and kept on the disk.

    The key of a kept function holds the source of that function alone. What it calls lives in other modules, so their
    checksum is made a part of the key: a constant that the function closes over.
    """
    if not _made:
        stamp = checksum()

        def loop(
            calls: Calls, plan: Plan, state: State, scratch: Scratch,
            control: Array, sensors: Array, qpos: Array, qvel: Array,
        ) -> int:  # fmt: skip
            return _run(calls, plan, state, scratch, control, sensors, qpos, qvel) if stamp >= 0 else -1

        try:
            kept = numba.njit(nogil=True, cache=True)(loop)
        except RuntimeError as error:
            _log.info("the compiled step can't be kept on the disk: %s", error)
            kept = numba.njit(nogil=True)(loop)
        _log.info("compiling the fast step, or reading it from the disk")
        _made.append(cast("_Loop", kept))
    return _made[0]


def checksum() -> int:
    """Checksum of the code of the steps."""
    folder = Path(__file__).parent
    return zlib.crc32(b"".join((folder / f"{name}.py").read_bytes() for name in _SOURCES))


@compiled
def _run(
    calls: Calls, plan: Plan, state: State, scratch: Scratch,
    control: Array, sensors: Array, qpos: Array, qvel: Array,
) -> int:  # fmt: skip
    """Steps on and keeps what was before each step; returns how many steps were made."""
    x, kept = np.empty(len(state.qvel)), np.empty(len(state.qvel))
    for step in range(len(control)):
        if bad(state.qpos) or bad(state.qvel):
            return step
        state.ctrl[:] = control[step]
        qpos[step] = state.qpos
        qvel[step] = state.qvel
        if not _step(calls, plan, state, scratch, x, kept, sensors[step]):
            return step
    return len(control)


@compiled
def run_steps(calls: Calls, plan: Plan, state: State, scratch: Scratch, steps: int) -> int:
    """Steps on with the control that is set; returns how many steps were made. Without sensors."""
    x, kept, nothing = np.empty(len(state.qvel)), np.empty(len(state.qvel)), np.empty(0)
    for step in range(steps):
        if bad(state.qpos) or bad(state.qvel):
            return step
        if not _step(calls, plan, state, scratch, x, kept, nothing):
            return step
    return steps


@compiled
def _step(calls: Calls, plan: Plan, state: State, scratch: Scratch, x: Array, kept: Array, sensors: Array) -> bool:
    """One step, with x and kept for its own use; False where it can't be made."""
    A = scratch.A
    call(calls.step1, plan.dry, state.data)
    add_fluid(plan, state, scratch)
    call(calls.actuation, plan.dry, state.data)
    call(calls.acceleration, plan.dry, state.data)
    call(calls.constraint, plan.dry, state.data)
    for i in range(len(sensors)):
        sensors[i] = state.sensordata[i]
    if bad(state.qacc):
        return False
    call_flag(calls.derivative, plan.dry, state.data, 0)
    _assemble(plan, state, A)
    for i in range(len(x)):
        x[i] = state.qfrc_smooth[i] + state.qfrc_constraint[i]
    if not _solve(plan.dof_parent, plan.symmetric, A, x):
        if not plan.symmetric:
            return False
        call(calls.implicit, plan.wet, state.data)  # the engine has its own way with an indefinite matrix
        return True
    # the engine advances with the acceleration it finds; what it remembers is the one before
    for i in range(len(x)):
        kept[i] = state.qacc[i]
        state.qacc[i] = x[i]
    call_flag(calls.advance, plan.dry, state.data, 0)
    for i in range(len(x)):
        state.qacc[i] = kept[i]
        state.qacc_warmstart[i] = kept[i]
    return True


@compiled
def _assemble(plan: Plan, state: State, A: Array) -> None:
    """A += M - h D with the engine's derivative, which has no fluid in it."""
    h = plan.timestep
    for i in range(len(plan.d_rowadr)):
        for k in range(plan.d_rowadr[i], plan.d_rowadr[i] + plan.d_rownnz[i]):
            j = plan.d_colind[k]
            if not plan.symmetric:
                A[i, j] -= h * state.qDeriv[k]
            elif j <= i:  # the engine takes the lower half
                A[i, j] -= h * state.qDeriv[k]
                if j < i:
                    A[j, i] -= h * state.qDeriv[k]
    for i in range(len(plan.m_rowadr)):
        for k in range(plan.m_rowadr[i], plan.m_rowadr[i] + plan.m_rownnz[i]):
            j = plan.m_colind[k]
            A[i, j] += state.M[k]
            if j != i:
                A[j, i] += state.M[k]


@compiled
def _solve(parent: Indices, symmetric: bool, A: Array, b: Array) -> bool:
    """Solves A x = b in place; A only couples degrees of freedom with those above them in the tree: no fill-in.

    False where the engine wouldn't accept a pivot.
    """
    n = len(b)
    for r in range(n - 1, -1, -1):
        pivot = A[r, r] if symmetric else abs(A[r, r])
        if not (pivot >= MIN):  # NaN too
            return False
        inverse = 1.0 / A[r, r]
        i = parent[r]
        while i >= 0:
            f = A[i, r] * inverse
            j = parent[r]
            while j >= 0:
                A[i, j] -= f * A[r, j]
                j = parent[j]
            b[i] -= f * b[r]
            i = parent[i]
    for r in range(n):
        total = b[r]
        j = parent[r]
        while j >= 0:
            total -= A[r, j] * b[j]
            j = parent[j]
        b[r] = total / A[r, r]
    return True


@compiled
def bad(values: Array) -> bool:
    """Whether a number counts as diverged."""
    for value in values:
        if not (value > -_MAX and value < _MAX):  # NaN too
            return True
    return False

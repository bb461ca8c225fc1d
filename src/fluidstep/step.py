"""A faster `mj_step` for models in MuJoCo's fluid, with the same numbers.

The engine does everything but the fluid and the solution for the velocities: it is called on a twin of the model
without water, and the forces of the water and their derivative are added in between. Contacts, limits, tendons,
actuators and sensors are the engine's own. Loops are compiled and hold no Python lock; data may be stepped by any
number of threads at a time, each with its own.
"""

# ruff: noqa: N803, N806, SIM110 (matrices are capitals; compiled loops stay loops)

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numba
import numpy as np
from numba.core.errors import NumbaError

from fluidstep.engine import (
    MIN,
    Addresses,
    Array,
    Calls,
    EngineState,
    Indices,
    UnsupportedModelError,
    addresses,
    array_at,
    borrowing,
    call,
    call_flag,
    compiled,
    find_calls,
    log_warnings,
    sizes,
    state_at,
)
from fluidstep.fluid import Scratch, add_fluid
from fluidstep.plan import Plan, Water, make_plan, without_fluid
from swimbase.errors import EngineError

_MAX = 1e10  # the engine's mjMAXVAL: beyond it a state counts as diverged
READ = ("qpos", "qvel", "ctrl", "act", "qacc_warmstart", "sensordata")  # of a state that sensors are computed with
_SOURCES = ("engine", "plan", "step", "fluid")
_log = logging.getLogger(__name__)


class Steps(NamedTuple):
    """State before each step that was made, and the results of the steps.

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


class Members(NamedTuple):
    """Parameter sets, one row each: the fields of `Water`, and `read`.

    Attributes:
        read: Addresses of the models that sensors are computed with.
    """

    wet: Addresses
    dry: Addresses
    density: Array
    wind: Array
    geoms: Array
    read: Addresses

    @classmethod
    def of(cls, waters: Sequence[Water], readers: Sequence[mujoco.MjModel]) -> Members:
        """The rows of these sets, and of the models that sensors are computed with."""
        wet, dry, density, wind, geoms = map(np.array, zip(*waters, strict=True))
        return cls(wet, dry, density, wind, geoms, np.array([reader._address for reader in readers]))


class Program(NamedTuple):
    """Program of a step: the constants and sizes that it is compiled for.

    Attributes:
        calls: The engine's functions.
        plan: Structure of the models.
        members: What differs between the parameter sets.
        sizes: Sizes of a state's arrays.
        fast: Whether steps are fast ones; else the engine's.
        forces: Whether sensors measure forces or accelerations.
    """

    calls: Calls
    plan: Plan
    members: Members
    sizes: Addresses
    fast: bool
    forces: bool


class Fleet(NamedTuple):
    """Simulations that are stepped, N of them.

    Attributes:
        rows: Addresses of each simulation's state.
        member: Parameter set of each.
        made: Steps that were made, written; -1 where a simulation has diverged at its end. Shape (N,).
        qpos: Positions at the end, written where it hasn't. Shape (N, nq), or (N, 0) to leave them.
        qvel: Velocities. Shape (N, nv) or (N, 0).
        sensors: Readings. Shape (N, nsensordata of the readers) or (N, 0).
    """

    rows: Addresses
    member: Addresses
    made: Addresses
    qpos: Array
    qvel: Array
    sensors: Array


class Workplace(NamedTuple):
    """Memory of one thread beside the simulations.

    Attributes:
        readers: Addresses of the state that sensors are computed with, of each set. Shape (B, ·).
        scratch: Memory for a step.
    """

    readers: Addresses
    scratch: Scratch


class _Kept(NamedTuple):
    """Arrays that keep the state before each step of one simulation; else arrays of no rows.

    Attributes:
        sensors: Shape (steps, nsensordata).
        qpos: Shape (steps, nq).
        qvel: Shape (steps, nv).
    """

    sensors: Array
    qpos: Array
    qvel: Array


NOTHING_KEPT = _Kept(np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0)))


class FastStep:
    """Steps one compiled model; any number of threads may use it, each with data of its own."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Plans the steps.

        Args:
            model: Compiled model. Changes to it afterward aren't seen.

        Raises:
            UnsupportedModelError: The fast step doesn't apply; the message has the reason.
        """
        log_warnings()
        self.model = model
        self._dry = without_fluid(model)
        self._calls = find_calls()
        self.plan, water = make_plan(model, self._dry)
        self._members, self._sizes = Members.of([water], [model]), sizes(mujoco.MjData(model))

    def run(self, data: mujoco.MjData, control: Array, steps: int) -> Steps:
        """Makes steps with the data, in place.

        Args:
            data: State of the engine at the start; afterward it is that at the end.
            control: Control of each step, or the same for all. Shape (steps, nu) or (nu,).
            steps: Number of steps.

        Raises:
            EngineError: The data is not of this model.
            UnsupportedModelError: The installed numba can't compile the step.
        """
        model = self.model
        if not np.array_equal(self._sizes, sizes(data)):
            had, has = sizes(data).tolist(), self._sizes.tolist()  # nq, nv, nu and so on
            raise EngineError(f"the data has sizes {had}, its model {has}; make the data with mujoco.MjData(model)")
        rows = np.empty((1, steps, model.nu))
        rows[:] = control
        kept = _Kept(np.empty((steps, model.nsensordata)), np.empty((steps, model.nq)), np.empty((steps, model.nv)))
        one, nothing = np.zeros(1, np.int64), np.empty((1, 0))
        fleet = Fleet(np.array([addresses(data)]), one, np.zeros(1, np.int64), nothing, nothing, nothing)
        program = Program(self._calls, self.plan, self._members, self._sizes, True, False)
        compiled_loop()(program, fleet, one, rows, steps, Workplace(one[None], scratch_of(model)), kept)
        n = int(fleet.made[0])
        return Steps(kept.sensors[:n], kept.qpos[:n], kept.qvel[:n], n < steps)


def scratch_of(model: mujoco.MjModel) -> Scratch:
    """Memory that steps of a model need, for one thread."""
    return Scratch(
        np.empty((model.nbody, 36)), np.empty((model.nbody, 6)), np.empty((model.nbody, 10)),
        np.empty((model.nv, 6)), np.empty((model.nv, model.nv)), np.empty((3, 36)), np.empty((4, 6)),
        np.empty((2, model.nv)),
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
        if not (np.isfinite(expected.qvel).all() or np.isfinite(actual.qvel).all()):
            continue  # implicitfast can't factor its matrix in some states
        gap = float(np.abs(expected.qvel - actual.qvel).max() / np.abs(expected.qvel).max())
        worst = max(worst, gap) if np.isfinite(gap) and not failed else np.inf
    return worst


_Loop = Callable[..., None]
_made: list[_Loop] = []


def compiled_loop() -> _Loop:
    """The compiled loop of `_run`, made once a process and kept on the disk.

    The kept file is named by the function, and read without a look at the modules that the function calls. So their
    checksum becomes a part of the name: another version of one of them, or of a tuple that is passed, has a file of its
    own.

    Raises:
        UnsupportedModelError: The installed numba can't compile it, when it is called.
    """
    if not _made:
        folder = Path(__file__).parent
        stamp = zlib.crc32(b"".join((folder / f"{name}.py").read_bytes() for name in _SOURCES))
        _run.__qualname__ = f"run_{stamp:08x}"
        try:
            kept_loop = numba.njit(nogil=True, error_model="numpy", cache=True)(_run)
        except RuntimeError as error:
            _log.info("the compiled step can't be kept on the disk: %s", error)
            kept_loop = compiled(_run)
        _log.info("compiling the fast step, or reading it from the disk")

        def guarded(*args: Any) -> None:
            try:
                kept_loop(*args)
            except NumbaError as error:
                reason = str(error).splitlines()[0]
                raise UnsupportedModelError(f"numba {numba.__version__} can't compile it: {reason}") from error

        _made.append(guarded)
    return _made[0]


def _run(
    program: Program, fleet: Fleet, which: Addresses, controls: Array, steps: int, place: Workplace, kept: _Kept
) -> None:
    """Steps simulations on, one after the other, and reads each at its end.

    Args:
        program: How steps are made.
        fleet: The simulations.
        which: Those that are stepped.
        controls: Controls of each simulation, one for all its steps or one per step. Shape (N, 1 or steps, nu).
        steps: Number of steps.
        place: Room to work in.
        kept: What was before each step, written; for one simulation only.
    """
    calls, members, sizes, made = program.calls, program.members, program.sizes, fleet.made
    keeps = len(kept.qpos) > 0
    for index in which:
        of = fleet.member[index]
        state = state_at(fleet.rows[index], sizes)
        water = Water(
            int(members.wet[of]), int(members.dry[of]), float(members.density[of]), members.wind[of], members.geoms[of]
        )
        made[index] = steps
        for step in range(steps):
            if _bad(state.qpos) or _bad(state.qvel):
                made[index] = step
                break
            state.ctrl[:] = controls[index, min(step, controls.shape[1] - 1)]
            if keeps:
                kept.qpos[step] = state.qpos
                kept.qvel[step] = state.qvel
            if not program.fast:
                call(calls.mj_step, water.wet, state.data)
            elif not _step(calls, program.plan, water, state, place.scratch):
                made[index] = step
                break
            if keeps:
                kept.sensors[step] = state.sensordata
        if fleet.qpos.shape[1] == 0:
            continue
        if made[index] < steps or _bad(state.qpos) or _bad(state.qvel):
            made[index] = -1
            continue
        fleet.qpos[index] = state.qpos
        fleet.qvel[index] = state.qvel
        if fleet.sensors.shape[1] > 0:
            act = array_at(fleet.rows[index, 1], (sizes[3],))
            _read(calls, int(members.read[of]), place.readers[of], program.forces, state, act)
            fleet.sensors[index] = array_at(int(place.readers[of, 6]), (fleet.sensors.shape[1],))


@compiled
def _read(calls: Calls, model: int, row: Addresses, forces: bool, state: EngineState, act: Array) -> None:
    """Computes sensors in a state of their own."""
    data = row[0]
    array_at(row[1], (len(state.qpos),))[:] = state.qpos
    array_at(row[2], (len(state.qvel),))[:] = state.qvel
    array_at(row[3], (len(state.ctrl),))[:] = state.ctrl
    array_at(row[4], (len(act),))[:] = act
    array_at(row[5], (len(state.qvel),))[:] = state.qacc_warmstart
    if forces:
        call(calls.mj_forward, model, data)
        return
    call(calls.mj_kinematics, model, data)
    call(calls.mj_comPos, model, data)
    call(calls.mj_comVel, model, data)
    call(calls.mj_sensorPos, model, data)
    call(calls.mj_sensorVel, model, data)


@borrowing
def _step(calls: Calls, plan: Plan, water: Water, state: EngineState, scratch: Scratch) -> bool:
    """One step; False where it can't be made."""
    A, x, kept = scratch.A, scratch.vectors[0], scratch.vectors[1]
    call(calls.mj_step1, water.dry, state.data)
    add_fluid(plan, water, state, scratch)
    call(calls.mj_fwdActuation, water.dry, state.data)
    call(calls.mj_fwdAcceleration, water.dry, state.data)
    call(calls.mj_fwdConstraint, water.dry, state.data)
    if _bad(state.qacc):
        return False
    call_flag(calls.mjd_smooth_vel, water.dry, state.data, 0)
    _assemble(plan, state, A)
    for i in range(len(x)):
        x[i] = state.qfrc_smooth[i] + state.qfrc_constraint[i]
    if not _solve(plan.dof_parent, plan.symmetric, A, x):
        if not plan.symmetric:
            return False
        call(calls.mj_implicit, water.wet, state.data)  # the engine has its own way with an indefinite matrix
        return True
    # the engine advances with the acceleration it finds; what it remembers is the one before
    for i in range(len(x)):
        kept[i] = state.qacc[i]
        state.qacc[i] = x[i]
    call_flag(calls.mj_EulerSkip, water.dry, state.data, 0)
    for i in range(len(x)):
        state.qacc[i] = kept[i]
        state.qacc_warmstart[i] = kept[i]
    return True


@borrowing
def _assemble(plan: Plan, state: EngineState, A: Array) -> None:
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


@borrowing
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


@borrowing
def _bad(values: Array) -> bool:
    """True if a number counts as diverged."""
    for value in values:
        if not (value > -_MAX and value < _MAX):  # NaN too
            return True
    return False

"""Steps many simulations of one robot in compiled calls, without Python between them.

Each simulation has a model, one of several parameter sets, and a state of its own. A call makes the same number of
steps with each of them and then reads positions, velocities and sensors. What a simulation gives depends neither on the
others nor on how they are shared out among threads.
"""

# what numba and llvmlite make has no types
# pyright: reportUnknownParameterType=false, reportMissingParameterType=false, reportUntypedFunctionDecorator=false
# pyright: reportPrivateImportUsage=false, reportCallIssue=false, reportArgumentType=false

from __future__ import annotations

import copy
import itertools
import logging
import math
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple, cast

import mujoco
import numba
import numpy as np
from numba.core import types
from numba.core.errors import NumbaError
from numba.extending import intrinsic
from numpy.typing import NDArray

from swim2real.errors import EngineError
from swim2real.simulation import fast_step
from swim2real.simulation.fast_plan import (
    Array,
    Calls,
    Plan,
    State,
    UnsupportedModelError,
    call,
    compiled,
    engine_plan,
    find_calls,
    make_plan,
    without_fluid,
)
from swim2real.simulation.fast_step import bad, run_steps, scratch_of
from swim2real.simulation.velocity_derivative import Scratch

Addresses = NDArray[np.int64]

_READ = ("qpos", "qvel", "ctrl", "act", "qacc_warmstart", "sensordata")  # of the data that sensors are computed with
_STEPPED = ("act", *State._fields[1:])
_SHARE = 5  # simulations that a thread takes at a time
_log = logging.getLogger(__name__)


class Members(NamedTuple):
    """What differs between the parameter sets, one row each.

    Attributes:
        wet: Addresses of the models.
        dry: Addresses of their twins without water; the models themselves where the engine steps.
        read: Addresses of the models that sensors are computed with.
        density: Density of the water [kg/m³].
        wind: Velocity of the water [m/s]. Shape (B, 3).
        geoms: Constants of the geoms in the water. Shape (B, G, COLUMNS).
    """

    wet: Addresses
    dry: Addresses
    read: Addresses
    density: Array
    wind: Array
    geoms: Array


class Batch:
    """N simulations.

    Attributes:
        qpos: Positions at the end of the last call. Shape (N, nq).
        qvel: Velocities. Shape (N, nv).
        sensors: Readings of the sensors. Shape (N, nsensordata).
        failed: Whether a simulation has diverged in the last call. Shape (N,).
        fast: Whether the fast step makes the steps; else the engine's own.
        pool: Threads beside the caller's, which may be given other work between two calls; None with one thread.
    """

    def __init__(
        self, models: Sequence[mujoco.MjModel], readers: Sequence[mujoco.MjModel], count: int, threads: int = 1
    ) -> None:
        """Plans the steps.

        Args:
            models: Model of each parameter set, to be stepped; without sensors, which would be computed at every step.
            readers: The same robots with the sensors that are read after a call.
            count: Number of simulations.
            threads: Threads that step them.

        Raises:
            EngineError: The engine can't be called directly, or the sets differ in more than numbers.
        """
        self._models, self._readers = [copy.copy(model) for model in models], list(readers)
        first = self._models[0]
        self._calls = find_calls()
        self._dry, self._plan, self._members = self._plan_steps()
        nothing_more = [int(mujoco.mjtStage.mjSTAGE_POS), int(mujoco.mjtStage.mjSTAGE_VEL)]
        self._forces = not np.isin(readers[0].sensor_needstage, nothing_more).all()  # among the sensors
        self.qpos, self.qvel = np.zeros((count, first.nq)), np.zeros((count, first.nv))
        self.sensors, self.failed = np.zeros((count, readers[0].nsensordata)), np.zeros(count, np.bool_)
        self._member = np.zeros(count, np.int64)
        self._rows = np.zeros((count, 1 + len(_STEPPED)), np.int64)
        self._data: dict[tuple[int, int], mujoco.MjData] = {}
        self.pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None
        self._threads = threads
        self._free: list[_Workplace] = [_Workplace(first, self._readers) for _ in range(threads)]
        one = mujoco.MjData(first)
        self._sizes = np.array([first.nq, first.nv, first.nu, first.na, first.nbody, len(one.M), len(one.qDeriv)])

    def _plan_steps(self) -> tuple[list[mujoco.MjModel], Plan, Members]:
        self.fast, dry, plans = True, [without_fluid(model) for model in self._models], list[Plan]()
        try:
            plans = [make_plan(model, twin) for model, twin in zip(self._models, dry, strict=True)]
        except UnsupportedModelError as error:
            _log.warning("steps are the engine's own, which are slower in water: %s", error)
            self.fast = False
        if not self.fast:
            for model in self._models:  # a diverged state is to be seen, not to be replaced by the one at the start
                model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
            dry = self._models
            plans = [engine_plan(model) for model in self._models]
        same = Plan._fields[Plan._fields.index("body_first") :]
        for plan in plans[1:]:
            if plan.geoms.shape != plans[0].geoms.shape or any(
                not np.array_equal(getattr(plan, name), getattr(plans[0], name)) for name in same
            ):
                raise EngineError("parameter sets differ in the structure of the model; give one set at a time")
        members = Members(
            np.array([plan.wet for plan in plans]), np.array([plan.dry for plan in plans]),
            np.array([reader._address for reader in self._readers]), np.array([plan.density for plan in plans]),
            np.array([plan.wind for plan in plans]), np.array([plan.geoms for plan in plans]),
        )  # fmt: skip
        return dry, plans[0], members

    def data(self, index: int) -> mujoco.MjData:
        """State of one simulation, that of its present member; to be changed only between two calls."""
        return self._data[index, int(self._member[index])]

    def member(self, index: int) -> int:
        """Parameter set of one simulation."""
        return int(self._member[index])

    def start(self, index: int, member: int) -> mujoco.MjData:
        """Begins a simulation anew with a parameter set, and returns its state, to be set."""
        if (index, member) not in self._data:
            self._data[index, member] = mujoco.MjData(self._models[member])
        data = self._data[index, member]
        mujoco.mj_resetData(self._models[member], data)
        self._member[index] = member
        self._rows[index] = [data._address, *(getattr(data, name).ctypes.data for name in _STEPPED)]
        return data

    def step(self, controls: Array, steps: int, which: NDArray[np.int64] | None = None) -> None:
        """Makes steps with constant controls, and reads.

        Args:
            controls: Controls of each simulation. Shape (N, nu).
            steps: Number of steps; with 0 it only reads.
            which: Simulations that are stepped; None for all. The others keep what was read.

        Raises:
            EngineError: The installed numba can't compile the loop.
        """
        everything = np.arange(len(self.qpos)) if which is None else which
        size = len(everything) if self.pool is None else min(_SHARE, math.ceil(len(everything) / self._threads))
        shares = [everything[i : i + size] for i in range(0, len(everything), max(size, 1))]
        controls, taken = np.ascontiguousarray(controls, dtype=np.float64), itertools.count()

        def work() -> None:
            place = self._free.pop()
            while (share := next(taken)) < len(shares):
                _loop()(
                    self._calls, self._plan, self._members, self._rows, self._member, shares[share], self._sizes,
                    controls, steps, self.fast, self._forces, place.rows, place.scratch, self.qpos, self.qvel,
                    self.sensors, self.failed,
                )  # fmt: skip
            self._free.append(place)

        try:
            helping = [] if self.pool is None else [self.pool.submit(work) for _ in range(self._threads - 1)]
            work()
            for one in helping:  # one that hasn't begun comes too late
                if not one.cancel():
                    one.result()
        except NumbaError as error:
            reason = str(error).splitlines()[0]
            raise EngineError(f"numba {numba.__version__} can't compile the steps: {reason}") from error

    def close(self) -> None:
        """Ends the threads."""
        if self.pool is not None:
            self.pool.shutdown()


class _Workplace:
    """What a thread needs beside the simulations: memory for a step, and data to compute sensors with."""

    def __init__(self, model: mujoco.MjModel, readers: Sequence[mujoco.MjModel]) -> None:
        self.scratch = scratch_of(model)
        self._data = [mujoco.MjData(reader) for reader in readers]
        self.rows = np.array(
            [[data._address, *(getattr(data, name).ctypes.data for name in _READ)] for data in self._data], np.int64
        )


_Loop = Callable[..., None]
_made: list[_Loop] = []


def _loop() -> _Loop:
    """The compiled loop, made once a process and kept on the disk, as that of `fast_step`."""
    if not _made:
        stamp = fast_step.checksum() ^ zlib.crc32(Path(__file__).read_bytes())

        def loop(
            calls: Calls, plan: Plan, members: Members, rows: Addresses, member: Addresses, which: Addresses,
            sizes: Addresses, controls: Array, steps: int, fast: bool, forces: bool, readers: Addresses,
            scratch: Scratch, qpos: Array, qvel: Array, sensors: Array, failed: Any,
        ) -> None:  # fmt: skip
            if stamp >= 0:
                _run(calls, plan, members, rows, member, which, sizes, controls, steps, fast, forces, readers, scratch,
                     qpos, qvel, sensors, failed)  # fmt: skip

        try:
            kept = numba.njit(nogil=True, cache=True)(loop)
        except RuntimeError as error:
            _log.info("the compiled steps can't be kept on the disk: %s", error)
            kept = numba.njit(nogil=True)(loop)
        _made.append(cast("_Loop", kept))
    return _made[0]


@compiled
def _run(
    calls: Calls, plan: Plan, members: Members, rows: Addresses, member: Addresses, which: Addresses,
    sizes: Addresses, controls: Array, steps: int, fast: bool, forces: bool, readers: Addresses,
    scratch: Scratch, qpos: Array, qvel: Array, sensors: Array, failed: Any,
) -> None:  # fmt: skip
    nq, nv, nu, na = sizes[0], sizes[1], sizes[2], sizes[3]
    for index in which:
        of = member[index]
        state = _state(rows[index], sizes)
        own = Plan(
            members.wet[of], members.dry[of], plan.timestep, members.density[of], plan.symmetric, plan.floor,
            members.wind[of], members.geoms[of], plan.body_first, plan.body_last, plan.body_root, plan.body_parent,
            plan.body_dof, plan.dof_body, plan.dof_parent, plan.dof_last, plan.d_rowadr, plan.d_rownnz, plan.d_colind,
            plan.m_rowadr, plan.m_rownnz, plan.m_colind,
        )  # fmt: skip
        state.ctrl[:] = controls[index]
        if fast:
            ended = run_steps(calls, own, state, scratch, steps) < steps
        else:
            ended = False
            for _ in range(steps):
                call(calls.step, own.wet, state.data)
                if bad(state.qpos) or bad(state.qvel):
                    ended = True
                    break
        ended = ended or bad(state.qpos) or bad(state.qvel)
        failed[index] = ended
        if ended:
            continue
        qpos[index] = state.qpos
        qvel[index] = state.qvel
        if sensors.shape[1] == 0:
            continue
        row, data = readers[of], readers[of, 0]
        _array(row[1], (nq,))[:] = state.qpos
        _array(row[2], (nv,))[:] = state.qvel
        _array(row[3], (nu,))[:] = state.ctrl
        _array(row[4], (na,))[:] = _array(rows[index, 1], (na,))
        _array(row[5], (nv,))[:] = state.qacc_warmstart
        if forces:
            call(calls.forward, members.read[of], data)
        else:
            call(calls.kinematics, members.read[of], data)
            call(calls.com_pos, members.read[of], data)
            call(calls.com_vel, members.read[of], data)
            call(calls.sensor_pos, members.read[of], data)
            call(calls.sensor_vel, members.read[of], data)
        sensors[index] = _array(row[6], (sensors.shape[1],))


@compiled
def _state(row: Addresses, sizes: Addresses) -> State:
    """The arrays of a state, from their addresses in the order of `_STEPPED`."""
    nq, nv, nu, nbody, n_mass, n_derivative = sizes[0], sizes[1], sizes[2], sizes[4], sizes[5], sizes[6]
    return State(
        row[0], _array(row[2], (nq,)), _array(row[3], (nv,)), _array(row[4], (nv,)), _array(row[5], (nv,)),
        _array(row[6], (nu,)), _array(row[7], (nv, 6)), _array(row[8], (nv, 6)), _array(row[9], (nbody, 6)),
        _array(row[10], (nbody, 10)), _array(row[11], (nbody, 3)), _array(row[12], (nbody, 9)),
        _array(row[13], (nbody, 3)), _array(row[14], (n_mass,)), _array(row[15], (n_derivative,)),
        _array(row[16], (nv,)), _array(row[17], (nv,)), _array(row[18], (nv,)), _array(row[19], (nv,)),
        _array(row[20], (0,)),
    )  # fmt: skip


@intrinsic
def _pointer(typingctx: Any, address: Any):
    signature = types.CPointer(types.float64)(types.int64)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(sig.return_type))

    return signature, generate


@compiled
def _array(address: int, shape: Any) -> Array:
    """The numbers at an address."""
    return numba.carray(_pointer(address), shape, np.float64)

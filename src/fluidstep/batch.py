"""Steps many simulations of one model in compiled calls, without Python between them.

Each simulation has a model, one of several parameter sets, and a state of its own. A call makes the same number of
steps with each of them and then reads positions, velocities and sensors. What a simulation gives depends neither on the
others nor on how they are shared out among threads.
"""

from __future__ import annotations

import copy
import itertools
import logging
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
from numpy.typing import NDArray

from fluidstep.engine import STEPPED, Array, UnsupportedModelError, addresses, find_calls, log_warnings, sizes
from fluidstep.plan import Plan, engine_plan, make_plan, without_fluid
from fluidstep.step import (
    NOTHING_KEPT,
    READ,
    Fleet,
    Members,
    Program,
    Workplace,
    compiled_loop,
    scratch_of,
)
from swimbase.errors import ArgumentError, EngineError

_SHARE = 5  # simulations that a thread takes at a time
_log = logging.getLogger(__name__)


class Batch:
    """N simulations.

    Attributes:
        qpos: Positions at the end of the last call. Shape (N, nq).
        qvel: Velocities. Shape (N, nv).
        sensors: Readings of the sensors. Shape (N, nsensordata).
        failed: Whether a simulation has diverged in the last call. Shape (N,).
        members: Parameter set of each simulation. Shape (N,).
        fast: Whether the fast step makes the steps; else the engine's own.
        pool: Threads beside the caller's, which may be given other work between two calls; None with one thread.
    """

    def __init__(
        self, models: Sequence[mujoco.MjModel], count: int, threads: int = 1,
        readers: Sequence[mujoco.MjModel] | None = None,
    ) -> None:  # fmt: skip
        """Plans the steps.

        Args:
            models: Model of each parameter set, to be stepped. Its sensors are computed at every step.
            count: Number of simulations.
            threads: Threads that step them.
            readers: The same models with the sensors that are read after a call; None for `models`.

        Raises:
            EngineError: The engine can't be called directly, or the sets differ in more than numbers.
        """
        log_warnings()
        self._models = [copy.copy(model) for model in models]
        self._readers = readers = self._models if readers is None else list(readers)
        first = self._models[0]
        self._dry, plan, members = self._plan_steps()
        nothing_more = [int(mujoco.mjtStage.mjSTAGE_POS), int(mujoco.mjtStage.mjSTAGE_VEL)]
        forces = not np.isin(readers[0].sensor_needstage, nothing_more).all()  # among the sensors
        self._program = Program(find_calls(), plan, members, sizes(mujoco.MjData(first)), self.fast, bool(forces))
        self.qpos, self.qvel = np.zeros((count, first.nq)), np.zeros((count, first.nv))
        self.sensors, self.failed = np.zeros((count, readers[0].nsensordata)), np.zeros(count, np.bool_)
        self.members = np.zeros(count, np.int64)
        self._made = np.zeros(count, np.int64)
        self._rows = np.zeros((count, 1 + len(STEPPED)), np.int64)
        self._data: list[mujoco.MjData | None] = [None] * count
        self._spare: list[list[mujoco.MjData]] = [[] for _ in models]
        self.pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None
        self._threads = threads
        self._free: list[_Place] = [_Place(first, self._readers) for _ in range(threads)]

    def _plan_steps(self) -> tuple[list[mujoco.MjModel], Plan, Members]:
        self.fast, dry = True, [without_fluid(model) for model in self._models]
        try:
            plans = [make_plan(model, twin) for model, twin in zip(self._models, dry, strict=True)]
        except UnsupportedModelError as error:
            _log.warning("steps are the engine's own, which are slower in water: %s", error)
            self.fast = False
            for model in self._models:  # a diverged state is to be seen, not to be replaced by the one at the start
                model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
            dry = self._models
            plans = [engine_plan(model) for model in self._models]
        (plan, first), waters = plans[0], [water for _, water in plans]
        if not all(plan.same(other) and first.geoms.shape == water.geoms.shape for other, water in plans):
            raise EngineError("parameter sets differ in the structure of the model; give one set at a time")
        return dry, plan, Members.of(waters, self._readers)

    def data(self, index: int) -> mujoco.MjData:
        """State of one simulation that was started; to be changed only between two calls.

        Raises:
            EngineError: It was not started.
        """
        data = self._data[index]
        if data is None:
            raise EngineError(f"simulation {index} has no state yet; start it first")
        return data

    def start(self, index: int, member: int = 0) -> mujoco.MjData:
        """Begins a simulation anew with a parameter set, and returns its state, to be set."""
        data = self._data[index]
        if data is None or self.members[index] != member:
            if data is not None:
                self._spare[self.members[index]].append(data)
            spare = self._spare[member]
            self._data[index] = data = spare.pop() if spare else mujoco.MjData(self._models[member])
        mujoco.mj_resetData(self._models[member], data)
        self.members[index] = member
        self._rows[index] = addresses(data)
        return data

    def step(self, controls: Array, steps: int, which: NDArray[np.int64] | None = None) -> None:
        """Makes steps, and reads.

        Args:
            controls: Controls of each simulation, constant or one per step. Shape (N, nu) or (N, steps, nu).
            steps: Number of steps; with 0 it only reads.
            which: Simulations that are stepped; None for all. The others keep what was read.

        Raises:
            ArgumentError: The controls have another shape.
            EngineError: A simulation was not started.
            UnsupportedModelError: The installed numba can't compile the loop.
        """
        everything = np.arange(len(self.qpos)) if which is None else which
        for index in everything[self._rows[everything, 0] == 0]:
            self.data(int(index))  # raises
        size = len(everything) if self.pool is None else min(_SHARE, math.ceil(len(everything) / self._threads))
        shares = [everything[i : i + size] for i in range(0, len(everything), max(size, 1))]
        count, nu = len(self.qpos), self._models[0].nu
        rows = np.ascontiguousarray(controls if controls.ndim == 3 else controls[:, None], dtype=np.float64)
        if rows.shape != (count, max(rows.shape[1], 1), nu):
            raise ArgumentError(f"controls have shape {controls.shape}; give ({count}, {nu}) or ({count}, steps, {nu})")
        taken, loop = itertools.count(), compiled_loop()
        fleet = Fleet(self._rows, self.members, self._made, self.qpos, self.qvel, self.sensors)

        def work() -> None:
            place = self._free.pop()
            while (share := next(taken)) < len(shares):
                loop(self._program, fleet, shares[share], rows, steps, place.own, NOTHING_KEPT)
            self._free.append(place)

        helping = [] if self.pool is None else [self.pool.submit(work) for _ in range(self._threads - 1)]
        work()
        for one in helping:  # one that hasn't begun comes too late
            if not one.cancel():
                one.result()
        self.failed[:] = self._made < 0

    def close(self) -> None:
        """Ends the threads."""
        if self.pool is not None:
            self.pool.shutdown()


class _Place:
    """Memory and data of one thread beside the simulations: for a step, and to compute sensors with."""

    def __init__(self, model: mujoco.MjModel, readers: Sequence[mujoco.MjModel]) -> None:
        self._data = [mujoco.MjData(reader) for reader in readers]
        self.own = Workplace(np.array([addresses(data, READ) for data in self._data]), scratch_of(model))

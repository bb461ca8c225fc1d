"""Motion to look at: a simulated motion of a furnished model, its markers, and the real ones beside them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from swim2real.checks.probing import excitation, swing
from swim2real.objective import ComparedTrial
from swim2real.parameters import Values
from swim2real.robots.compiled import compiled
from swim2real.robots.file import read_mjcf
from swim2real.robots.robot import Robot
from swim2real.simulation import PlaybackSimulator
from swim2real.simulation.playback import Rollout
from swim2real.simulation.simulator import settling_turns
from swim2real.simulation.stepper import Rolled, Stepper, roll
from swim2real.viewing.scenery import ABOVE, SIDE, furnish
from swimbase.arrays import Array
from swimbase.errors import EngineError

RATE = 60.0  # Hz, of what is kept of a simulation
_GENTLE = 0.3  # of what an actuator bears, where nobody says what drives a robot


@dataclass(frozen=True)
class Motion:
    """A motion that is looked at.

    Attributes:
        title: What it is, in a few words.
        model: Compiled, with cameras and lights.
        times: From 0 [s]. Shape (T,).
        qpos: Positions of the joints, as the engine has them. Shape (T, nq).
        simulated: Simulated markers in the world [m]. Shape (T, M, 3).
        real: Real markers where the simulated robot would have them, NaN where they were lost [m]; M is 0 without
            real ones. Shape (T, M, 3).
        camera: Name of the model's camera that sees it as it was filmed.
    """

    title: str
    model: mujoco.MjModel
    times: Array
    qpos: Array
    simulated: Array
    real: Array
    camera: str = ABOVE

    def nearest(self, time: float) -> int:
        """Index of the sample that is nearest to a time [s]."""
        return int(np.clip(round(time * RATE), 0, len(self.times) - 1))


def shown_swim(
    robot: Robot, values: Values, frequency: float, seconds: float, compared: ComparedTrial | None = None
) -> Motion:
    """A steady swim, which begins at rest and isn't shown before it has settled.

    Args:
        robot: Whose trials are steady swims.
        values: Values of its parameters.
        frequency: Frequency of the motor [Hz].
        seconds: How long it is shown at most; the real swim may be shorter.
        compared: A real swim at this frequency, with the simulated one that it was compared with.

    Raises:
        EngineError: The simulation diverges.
    """
    model, speed = robot.build(values).compile(), 2 * np.pi * frequency
    data = mujoco.MjData(model)
    stepper = Stepper(model, robot, 0.0, speed, 0.0)
    mujoco.mj_setState(model, data, stepper.state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    phase = 0.0 if compared is None or compared.beat is None else compared.beat.phase / (2 * np.pi) % 1.0
    if compared is not None:
        seconds = min(seconds, float(compared.times[-1] - compared.times[0]))
    turns = settling_turns(frequency) + phase
    steps = int(np.ceil((turns / frequency + seconds) / model.opt.timestep * 1.02)) + 1  # a loaded motor lags
    made = _rolled(model, data, stepper.controls(steps))
    first = int(np.searchsorted(stepper.turns(made.qpos), turns))
    title = f"{robot.name}, {frequency:.2f} Hz" + ("" if compared is None else f", trial {compared.name}")
    return _motion(title, robot, values, made, first, seconds, compared, ABOVE)


def shown_trial(
    robot: Robot, values: Values, rollout: Rollout | None, seconds: float, compared: ComparedTrial | None = None
) -> Motion:
    """A recording that is played back; without one, the robot moved by made-up controls.

    Args:
        robot: Whose trials are recordings.
        values: Values of its parameters.
        rollout: The recording, as `PlaybackSimulator.request` makes it; None for made-up controls.
        seconds: How long it is shown at most; the recording may be shorter.
        compared: What came of its comparison.

    Raises:
        EngineError: The simulation diverges.
    """
    simulator, model = PlaybackSimulator(robot), robot.build(values).compile()
    request = rollout or simulator.request(excitation(robot, _GENTLE))
    data, controls = simulator.begin(model, request, values)
    made = _rolled(model, data, controls)
    seconds = min(seconds, float(request.trial.track.duration))
    title = f"{robot.name}, {'made-up controls' if rollout is None else 'trial ' + request.trial.name}"
    return _motion(title, robot, values, made, 0, seconds, compared, SIDE if 2 in robot.plane else ABOVE)


def shown_model(path: Path, frequency: float, seconds: float) -> Motion:
    """A model of nobody's robot file, moved by its actuators: motors turn, others swing within their ranges.

    Args:
        path: MJCF file.
        frequency: Of the motors and of what swings [Hz].
        seconds: How long it is shown.

    Raises:
        RobotError: It can't be read.
        ConsentError: It names files outside of its folder, which wasn't allowed.
        EngineError: The simulation diverges.
    """
    spec, where = read_mjcf(path, alone=True), f"model '{path}'"
    model = compiled(spec, where)
    furnish(spec)
    furnished = compiled(spec, where)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    steps = int(np.ceil(seconds / model.opt.timestep)) + 1
    at = model.opt.timestep * np.arange(steps)
    turning = np.full(steps, 2 * np.pi * frequency)
    controls = [
        turning if _turns(model, i) else swing(model.actuator(i), at, i, _GENTLE, frequency) for i in range(model.nu)
    ]
    made = _rolled(model, data, np.stack(controls, axis=1) if controls else np.empty((steps, 0)))
    times, rows = _sampled(model, made, 0, seconds)
    nothing = np.empty((len(times), 0, 3))
    return Motion(f"{path.name}, {frequency:.2f} Hz", furnished, times, made.qpos[rows], nothing, nothing)


def _turns(model: mujoco.MjModel, actuator: int) -> bool:
    """True if an actuator without a range holds a speed."""
    servo = model.actuator(actuator)
    return bool(servo.biasprm[2] < 0 and servo.biasprm[1] == 0 and not servo.ctrllimited[0])


def _motion(
    title: str, robot: Robot, values: Values, made: Rolled, first: int, seconds: float,
    compared: ComparedTrial | None, camera: str,
) -> Motion:  # fmt: skip
    """A robot's motion from a step on, with the real markers beside the simulated ones."""
    spec = robot.build(values)
    furnish(spec)
    model = spec.compile()
    times, rows = _sampled(model, made, first, seconds)
    count = len(robot.marker_names)
    sensors = made.sensors[rows]
    markers = sensors[:, sensors.shape[1] - 3 * count :].reshape(len(times), count, 3)
    real = markers[:, :0] if compared is None else _ghosts(compared, robot, times, markers)
    return Motion(title, model, times, made.qpos[rows], markers, real, camera)


def _rolled(model: mujoco.MjModel, data: mujoco.MjData, controls: Array) -> Rolled:
    made = roll(model, data, controls)
    if made.failed_at is not None:
        raise EngineError(
            f"the simulation diverges {made.failed_at:.2f} s after its start, so there is no motion to show; "
            f"use other parameters, or a shorter --seconds"
        )
    return made


def _sampled(model: mujoco.MjModel, made: Rolled, first: int, seconds: float) -> tuple[Array, NDArray[np.intp]]:
    """Times of what is kept [s], and the steps that they are nearest to."""
    times = np.arange(int(seconds * RATE + 1e-6) + 1) / RATE
    steps = first + np.round(times / float(model.opt.timestep)).astype(int)
    return times, np.minimum(steps, len(made.qpos) - 1)


def _ghosts(compared: ComparedTrial, robot: Robot, times: Array, markers: Array) -> Array:
    """Real markers at given times: a recording's where they were, a swim's as near as one rigid motion brings them."""
    since = compared.times - compared.times[0]
    real = compared.path_real[np.abs(since[:, None] - times).argmin(axis=0)]  # the frames that are nearest
    ghosts = markers.copy()  # as far from the camera as the simulated ones
    simulated = markers[:, :, robot.plane]
    turn, shift = _rigid(real, simulated) if robot.trials.steady else (np.eye(2), np.zeros(2))
    ghosts[:, :, robot.plane] = real @ turn + shift
    return ghosts


def _rigid(places: Array, wanted: Array) -> tuple[Array, Array]:
    """The turn, for row vectors, and the shift that bring places closest to others; NaN is left out."""
    known = np.isfinite(places).all(axis=2) & np.isfinite(wanted).all(axis=2)
    if not known.any():
        return np.eye(2), np.zeros(2)
    here, there = places[known], wanted[known]
    middle, other = here.mean(axis=0), there.mean(axis=0)
    left, _, right = np.linalg.svd((here - middle).T @ (there - other))
    turn = left @ np.diag([1.0, np.linalg.det(left @ right)]) @ right
    return turn, other - middle @ turn

"""Assesses a trained policy on fixed seeded starts, against open-loop waves, and in open and closed loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from swim2real.parameters import Values
from swim2real.rl import rollout
from swim2real.rl.body import Actuators, policy_setup
from swim2real.rl.conditions import CONTROL_INTERVAL, UNDISTURBED, Disturbances, StateEstimate
from swim2real.rl.environment import make_environments
from swim2real.rl.state import MOST_PLACE
from swim2real.rl.training_run import TrainingRun
from swim2real.robots.robot import Robot
from swimbase.arrays import Array
from swimbase.errors import ArgumentError

TEST_SEED = 2_000_000  # of the episodes that a policy is assessed in
SCANNED_PHASES = 4  # starts of each wave, where starts are at any phase
SIDE_BY_SIDE = 50  # environments
_SPEEDS = 20  # constant commands, of each sign
_AMPLITUDES = (0.5, 1.0)  # of sines, shares of the commands' range
_FREQUENCIES = 0.25 * np.arange(1, 21)  # Hz, of sines
_LAGS = np.arange(-3, 5) / 4  # of a sine from one actuator to the next [half turns]


@dataclass(frozen=True)
class Wave:
    """Commands that don't look at the robot: a sine about the middle of each actuator's range, or constant ones.

    Attributes:
        amplitude: Amplitude, or the constant command, as a share of half the range, with its sign.
        frequency: Frequency [Hz]; 0 for constant commands.
        lag: Phase by which each actuator is behind the one before it [rad].
    """

    amplitude: float
    frequency: float = 0.0
    lag: float = 0.0

    def commands(self, actuators: Actuators, times: Array) -> Array:
        """Commands at times [unit]. Shapes (T,) to (T, A)."""
        middle, half = (actuators.upper + actuators.lower) / 2, (actuators.upper - actuators.lower) / 2
        if self.frequency == 0:
            return np.tile(middle + self.amplitude * half, (len(times), 1))
        behind = self.lag * np.arange(len(actuators))
        return middle + self.amplitude * half * np.sin(2 * np.pi * self.frequency * times[:, None] - behind)


def constant_waves() -> list[Wave]:
    """Constant commands over the whole range."""
    shares = np.arange(1, _SPEEDS + 1) / _SPEEDS
    return [Wave(float(share)) for share in (*-shares[::-1], *shares)]


def sine_waves(actuators: int) -> list[Wave]:
    """Sines of all frequencies, with two amplitudes and, where there are several actuators, several lags."""
    lags = [0.0] if actuators == 1 else [math.pi * float(lag) for lag in _LAGS]
    return [Wave(a, float(f), lag) for a in _AMPLITUDES for f in _FREQUENCIES for lag in lags]


@dataclass(frozen=True)
class WaveScan:
    """Waves and what each reaches, from the same starts as a policy.

    Attributes:
        waves: The waves.
        distances: Mean distances over the starts [m]. Shape (W,).
        returns: Mean episode returns. Shape (W,).
        phases: Motor angles at the starts [rad].
    """

    waves: tuple[Wave, ...]
    distances: Array
    returns: Array
    phases: tuple[float, ...]

    @property
    def farthest(self) -> Wave:
        """The wave that comes farthest."""
        return self.waves[int(np.argmax(self.distances))]

    @property
    def best_distance(self) -> float:
        """Greatest distance [m]."""
        return float(self.distances.max())

    @property
    def best_return(self) -> float:
        """Highest return."""
        return float(self.returns.max())


@dataclass(frozen=True)
class LoopResult:
    """Results of a policy in one kind of loop.

    Attributes:
        statistics: Figures of the episodes.
        drift: Mean distance between a swim's end and the undisturbed swim at the same time [m].
        sideways: Mean of |y| at the end [m].
        episodes: The episodes.
    """

    statistics: rollout.EpisodeStatistics
    drift: float
    sideways: float
    episodes: list[rollout.Episode]


@dataclass(frozen=True)
class Assessment:
    """Results of a policy in all loops.

    Attributes:
        task: Task of the policy.
        which: Which policy of the run, `best` or `last`.
        episodes: Episodes of the policy.
        statistics: Their figures.
        scans: What waves reach, by name: `constant` commands of motors, and `sine`; empty in a task with goals.
        loops: Results by loop, as `compare_loops` gives them; empty where they weren't compared.
    """

    task: str
    which: rollout.Which
    episodes: list[rollout.Episode]
    statistics: rollout.EpisodeStatistics
    scans: dict[str, WaveScan]
    loops: dict[str, LoopResult]

    def as_dict(self) -> dict[str, object]:
        """Plain JSON: `policy`, the scans by their names, and `loops` where they were compared."""
        content: dict[str, object] = {"task": self.task, "which": self.which, "policy": asdict(self.statistics)}
        for name, scan in self.scans.items():
            content[name] = {
                "waves": [asdict(wave) for wave in scan.waves], "distances": scan.distances.tolist(),
                "returns": scan.returns.tolist(), "best_distance": scan.best_distance,
                "farthest": asdict(scan.farthest), "best_return": scan.best_return, "phases": list(scan.phases),
            }  # fmt: skip
        if self.loops:
            content["loops"] = {
                name: {**asdict(loop.statistics), "drift": loop.drift, "sideways": loop.sideways}
                for name, loop in self.loops.items()
            }
        return content


def assess(
    run: TrainingRun, episodes: int, *, parameters: Sequence[Values] | None = None,
    robot: Robot | None = None, disturbances: Disturbances | None = None, which: rollout.Which = "best",
    estimate: StateEstimate | None = None, stage: int | None = None, threads: int = 1,
) -> Assessment:  # fmt: skip
    """Assesses a policy.

    Args:
        run: Its training.
        episodes: Number of episodes; their starts depend on their numbers alone.
        parameters: Parameter sets of the simulator; None for those that it was trained with.
        robot: Robot whose sets they are; None for that of the training.
        disturbances: Disturbances of the simulator; None for those that it was trained with.
        which: Which policy of the run.
        estimate: Tracker's view to compare open and closed loop with, under `disturbances`; None for no comparison.
        stage: Stage of the curriculum, for goals and threshold; None for the last.
        threads: Threads that simulate.

    Raises:
        RunError: The run has no policy, or it doesn't fit the robot.
        ArgumentError: No episodes are asked for.
    """
    if episodes < 1:
        raise ArgumentError(f"{episodes} episodes are asked for; an assessment needs at least 1")
    settings, robot = run.settings, robot or run.robot
    sets: list[Values] = list(settings.parameters if parameters is None else parameters)
    disturbed = settings.disturbances if disturbances is None else disturbances
    seeds = range(TEST_SEED, TEST_SEED + episodes)
    swims = run_policy(run, seeds, robot, sets, disturbed, which=which, stage=stage, threads=threads)
    scans, loops = dict[str, WaveScan](), dict[str, LoopResult]()
    if swims[0].goal is None:
        scans = _scans(run.task, sets[0], robot, swims[0].duration, replace(disturbed, estimate=None), threads)
    if estimate is not None:
        policy, few = rollout.load_policy(run, which), seeds[:SIDE_BY_SIDE]
        loops = compare_loops(policy, run.task, sets[0], robot, few, disturbed, estimate, stage=stage)
    return Assessment(settings.task, which, swims, rollout.EpisodeStatistics.of(swims), scans, loops)


def run_policy(
    run: TrainingRun, seeds: Sequence[int], robot: Robot, parameters: Sequence[Values], disturbances: Disturbances, *,
    which: rollout.Which = "best", stage: int | None = None, threads: int = 1,
) -> list[rollout.Episode]:  # fmt: skip
    """Episodes of a policy.

    Args:
        run: Its training.
        seeds: Seeds of their starts.
        robot: Robot that is simulated: that of the training, or one with the same actuators and observations.
        parameters: Its parameter sets.
        disturbances: Disturbances of the simulator.
        which: Which policy of the run.
        stage: Stage of the curriculum; None for the last.
        threads: Threads that simulate.

    Raises:
        RunError: The run has no policy, or it doesn't fit the robot.
    """
    policy, episodes = rollout.load_policy(run, which), list[rollout.Episode]()
    for first in range(0, len(seeds), SIDE_BY_SIDE):
        chunk = seeds[first : first + SIDE_BY_SIDE]
        environments = make_environments(
            run.task, parameters, len(chunk), robot=robot, disturbances=disturbances, threads=threads, stage=stage
        )
        run.check_fits(policy, environments)
        episodes += rollout.run_episodes(environments, policy, chunk)
        environments.close()
    return episodes


def _scans(
    task: str, parameters: Values, robot: Robot, seconds: float, disturbances: Disturbances, threads: int
) -> dict[str, WaveScan]:
    low, high = disturbances.start_phase
    # phases in the middle of equal shares of the range that starts are drawn from
    shares = [(i + 0.5) / SCANNED_PHASES for i in range(SCANNED_PHASES)]
    phases = [low + (high - low) * share for share in shares] if high > low else [low]
    waves = {"sine": sine_waves(len(policy_setup(robot).actuators))}
    if robot.motor_joint is not None:
        waves = {"constant": constant_waves(), **waves}
    return {
        name: scan_waves(some, task, parameters, robot, phases, seconds, disturbances=disturbances, threads=threads)
        for name, some in waves.items()
    }


def scan_waves(
    waves: Sequence[Wave], task: str, parameters: Values, robot: Robot, phases: Sequence[float], seconds: float, *,
    disturbances: Disturbances = UNDISTURBED, threads: int = 1,
) -> WaveScan:  # fmt: skip
    """Scans what waves reach in a task, within the actuators' limits and rates.

    Args:
        waves: Waves to try.
        task: Task whose rewards count.
        parameters: Parameters of the simulator.
        robot: Robot whose values they are.
        phases: Motor angles at the start [rad]; each wave begins at each. [0.0] for a robot without such a motor.
        seconds: Length of each episode [s].
        disturbances: Disturbances of the simulator.
        threads: Threads that simulate.
    """
    environments = make_environments(
        task, [parameters], len(waves), robot=robot, seconds=seconds, disturbances=disturbances, threads=threads
    )
    actuators = environments.bodies.actuators
    times = CONTROL_INTERVAL * np.arange(1.0, round(seconds / CONTROL_INTERVAL) + 1)
    policy = rollout.followed(np.stack([wave.commands(actuators, times) for wave in waves], axis=1), actuators)
    distances, returns = np.zeros(len(waves)), np.zeros(len(waves))
    for phase in phases:
        episodes = rollout.run_episodes(environments, policy, range(len(waves)), [{"phase": phase}] * len(waves))
        distances += [episode.distance for episode in episodes]
        returns += [episode.episode_return for episode in episodes]
    environments.close()
    return WaveScan(tuple(waves), distances / len(phases), returns / len(phases), tuple(phases))


def compare_loops(
    policy: rollout.Policy, task: str, parameters: Values, robot: Robot, seeds: Sequence[int],
    disturbances: Disturbances, estimate: StateEstimate, seconds: float | None = None, stage: int | None = None,
) -> dict[str, LoopResult]:  # fmt: skip
    """Runs each start four times, to see how far a disturbed robot strays from the undisturbed one.

    `nominal` is without the disturbances. The others are with them: `open` repeats the nominal actions, as the paper's
    transfer does; `closed` sees the true state; `tracked` sees what a marker tracker reports.

    Args:
        policy: Policy that commands.
        task: Task, as `make_environments` takes it.
        parameters: Parameters of the simulator.
        robot: Robot whose values they are.
        seeds: Seeds of the starts.
        disturbances: What is added; its start phases hold for the nominal swims, too.
        estimate: The tracker's view.
        seconds: Length of the episodes [s]; None for the task's own.
        stage: Stage of the curriculum; None for the last.

    Returns:
        Results by loop.
    """
    true_state = replace(disturbances, estimate=None)

    def swim(policy: rollout.Policy, disturbed: Disturbances) -> list[rollout.Episode]:
        environments = make_environments(
            task, [parameters], len(seeds), robot=robot, disturbances=disturbed, seconds=seconds, stage=stage
        )
        return rollout.run_episodes(environments, policy, seeds)

    nominal = swim(policy, Disturbances(start_phase=disturbances.start_phase))
    episodes = {
        "nominal": nominal,
        "open": swim(rollout.repeated([episode.actions for episode in nominal]), true_state),
        "closed": swim(policy, true_state),
        "tracked": swim(policy, replace(disturbances, estimate=estimate)),
    }
    return {
        name: LoopResult(
            rollout.EpisodeStatistics.of(swims),
            float(np.mean([_drift(swim, reference) for swim, reference in zip(swims, nominal, strict=True)])),
            float(np.mean([abs(swim.heads[-1, 1]) for swim in swims])),
            swims,
        )
        for name, swims in episodes.items()
    }


def policy_commands(
    run: TrainingRun, seconds: float, *, which: rollout.Which = "best", phase: float = 0.0,
    goal: tuple[float, float] | None = None,
) -> tuple[Actuators, rollout.Episode]:  # fmt: skip
    """Commands of a policy in the simulator that it was trained in, from rest.

    An episode that reaches its goal ends there, others when the seconds are over.

    Args:
        run: Its training.
        seconds: Length [s].
        which: Which policy of the run.
        phase: Angle of the motor at the start [rad].
        goal: Goal of a task with goals [m]; ahead is -x. None for 1 m straight ahead.

    Returns:
        The actuators, and the episode with their commands.

    Raises:
        RunError: The run has no policy, or it doesn't fit the robot.
        ArgumentError: The length or the goal isn't allowed, a task without goals is given one, or the simulation
            diverges.
    """
    if goal is not None and not math.hypot(*goal) <= MOST_PLACE:
        raise ArgumentError(f"the goal is {goal[0]:g}, {goal[1]:g} m; it must be within {MOST_PLACE:g} m of the start")
    policy, settings = rollout.load_policy(run, which), run.settings
    environments = make_environments(run.task, settings.parameters, 1, robot=run.robot, seconds=seconds)
    run.check_fits(policy, environments)
    options: dict[str, object] = {"phase": phase, "member": 0, "goal": goal or (-1.0, 0.0)}
    episode = rollout.run_episodes(environments, policy, [TEST_SEED], [options])[0]
    if goal is not None and episode.goal is None:
        raise ArgumentError(f"a goal is for policies of a task with goals; this one was trained for '{settings.task}'")
    if episode.failure:
        raise ArgumentError(f"the policy can't be recorded: {episode.failure}")
    return environments.bodies.actuators, episode


def _drift(episode: rollout.Episode, reference: rollout.Episode) -> float:
    """Distance between two swims at the last time that both have [m]."""
    last = min(len(episode.heads), len(reference.heads)) - 1
    return float(np.linalg.norm(episode.heads[last] - reference.heads[last]))

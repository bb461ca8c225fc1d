"""`train`, `rollout`, `export-policy` and `export-commands`: policies in the calibrated simulator."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional, PositionalRequiredArgs

from swim2real.cli import options as opt
from swim2real.cli.options import PUBLISHED, word
from swim2real.cli.terminal import say, say_json, tell
from swim2real.settings import TrainingSettings, expand_seeds
from swimbase.errors import ArgumentError, Swim2RealError

if TYPE_CHECKING:
    from swim2real.rl.assessment import Assessment
    from swim2real.rl.training import TrainingProgress
    from swim2real.rl.training_run import TrainingOutcome

_stop: Any = None  # in a process that trains one of several seeds: the event that asks for its end


def train(
    settings: PositionalRequiredArgs[TrainingSettings], *, parameters: Path, out: Path, ensemble: Path | None = None,
    robot: str | None = None, seeds: tuple[int | str, ...] = (), workers: int = 0, threads: int = 0,
    any_phase: bool = False, tendon_friction: float = 0.0, noise: float | None = None, delay: int | None = None,
    anyway: bool = False, resume: opt.Resume = False, json: opt.Json = False, quiet: opt.Quiet = False,
) -> int:  # fmt: skip
    """Train a policy in the calibrated simulator: soft actor-critic, as in the paper.

    Reads a run folder or parameters file; writes a folder with settings.json, policy.npz and best.npz, checkpoints,
    records of every episode and evaluation, TensorBoard logs, outcome.json, and training.html, a page with the learning
    curve that reloads itself during training. The robot file's [policy] defines what is commanded and observed. Takes
    some minutes for 300,000 steps and about half an hour for the paper's 5 million on two cores. Ctrl-C writes a
    checkpoint; --resume continues from it.

    Args:
        settings: What decides the result; the defaults are the paper's.
        parameters: Run folder or parameters file; 'published' for the prior work's values, or the model's of --robot.
        out: Folder to write; with --seeds it contains one folder per seed.
        ensemble: File from `swim2real ensemble`: one of its sets is drawn per episode; of --parameters only the robot
            counts then.
        robot: Robot or robot file, for --parameters published, or if the file has moved.
        seeds: Several seeds instead of --seed: numbers, and ranges without their end: 0:3 is 0 1 2.
        workers: Seeds trained in parallel; 0 for all cores.
        threads: Threads of one run; 0 for all cores, or for one if several seeds are trained in parallel. Results don't
            depend on it.
        any_phase: Start episodes at any angle of the motor, not only at 0.
        tendon_friction: Share of the rubbing tendon's tension that friction takes.
        noise: Let the policy observe tracked markers with this noise [m], not the true state.
        delay: Age of the tracked markers [control intervals of 20 ms]; by default 2 if only --noise is given.
        anyway: Train even in a simulator that isn't usable, or that swims tail first from rest.
    """
    if workers < 0 or threads < 0:
        raise ArgumentError(f"--workers is {workers} and --threads {threads}; they must be 0 or above")
    from swim2real.cli.subject import heed, robot_for, values_for
    from swim2real.identification.ensemble import read_ensemble
    from swim2real.pipeline.training import train as run_training
    from swim2real.rl.conditions import Disturbances, StateEstimate

    cores = os.cpu_count() or 1
    trained = robot_for(parameters, robot)
    heed(parameters, anyway or resume, "train in it")
    phases = (-math.pi, math.pi) if any_phase else (0.0, 0.0)
    estimate = None
    if noise is not None or delay is not None:
        estimate = StateEstimate(
            StateEstimate.noise if noise is None else noise, StateEstimate.delay if delay is None else delay
        )
    run = partial(
        run_training, parameters=read_ensemble(ensemble, trained) if ensemble else [values_for(parameters, trained)],
        robot=trained, reference=str(ensemble or parameters), anyway=anyway, threads=threads or (1 if seeds else cores),
        disturbances=Disturbances(phases, tendon_friction=tendon_friction, estimate=estimate),
    )  # fmt: skip
    if seeds:
        each = [replace(settings, seed=seed) for seed in expand_seeds(seeds)]
        return _train_seeds(run, each, out, workers or cores, resume, json, quiet)
    from swim2real.cli.progress import training_shown
    from swim2real.interruption import Interruption

    with Interruption() as interruption, training_shown(settings.env_steps, quiet) as show:
        outcome = _train_one(run, settings, out, resume, show, lambda: bool(interruption))
    _report_outcome(outcome, out, json)
    if not outcome.complete:
        tell(f"interrupted at step {outcome.step}; --resume goes on")
    return 0 if outcome.complete else 1


def _train_one(
    run: Callable[..., TrainingOutcome], settings: TrainingSettings, out: Path, resume: bool,
    show: Callable[[TrainingProgress], None], stop: Callable[[], bool],
) -> TrainingOutcome:  # fmt: skip
    """Trains into a folder and writes its page after every evaluation."""
    from swim2real.report.training_page import write_training_page
    from swim2real.rl.training_run import TrainingRun

    def progress(state: TrainingProgress) -> None:
        show(state)
        if state.evaluation:
            write_training_page(TrainingRun.open(out), out)

    outcome = run(settings, out=out, resume=resume, on_progress=progress, stop=stop)
    write_training_page(TrainingRun.open(out), out)
    return outcome


def _train_seeds(
    run: Callable[..., TrainingOutcome], each: list[TrainingSettings], out: Path, workers: int, resume: bool,
    json: bool, quiet: bool,
) -> int:  # fmt: skip
    """Trains each seed in a process, so many at a time as there are workers. Ctrl-C leaves checkpoints."""
    from concurrent.futures import CancelledError, wait

    from swim2real.interruption import Interruption
    from swim2real.processes import ProcessPool

    stop, unfinished = get_context("spawn").Event(), list[int]()
    with Interruption() as interruption, ProcessPool(workers, tries=1, initializer=_connect, initargs=(stop,)) as pool:
        futures = {pool.submit(_train_seed, run, one, out / f"seed-{one.seed}", resume, quiet): one for one in each}
        left = set(futures)
        while left:
            done, left = wait(left, 0.2)
            if interruption and not stop.is_set():
                stop.set()
                _ = [future.cancel() for future in left]
            for future in done:
                seed = futures[future].seed
                try:
                    outcome = future.result()
                except CancelledError:
                    unfinished.append(seed)
                except Swim2RealError as error:
                    tell(f"seed {seed}: {error}")
                    unfinished.append(seed)
                else:
                    _report_outcome(outcome, out / f"seed-{seed}", json)
                    unfinished += [] if outcome.complete else [seed]
    if unfinished:
        tell(f"seeds {', '.join(map(str, sorted(unfinished)))} aren't done; the same command with --resume goes on")
    return 1 if unfinished else 0


def _connect(stop: Any) -> None:
    global _stop
    _stop = stop


def _train_seed(
    run: Callable[..., TrainingOutcome], settings: TrainingSettings, out: Path, resume: bool, quiet: bool
) -> TrainingOutcome:
    """Trains one of several seeds, in a process of its own, and prints a line for every evaluation."""
    from swim2real.cli.progress import training_line
    from swim2real.rl.training_run import SETTINGS

    def show(state: TrainingProgress) -> None:
        if state.evaluation and not quiet:
            tell(f"seed {settings.seed}: {training_line(state)}")

    return _train_one(run, settings, out, resume and (out / SETTINGS).exists(), show, _stop.is_set)


def rollout(
    policy: Positional[opt.Policy], *, episodes: int = 50, goals: int = 0, parameters: Path | None = None,
    robot: opt.RobotOfRun = None, which: opt.Which = "best", stage: int | None = None,
    tendon_friction: float | None = None, current: tuple[float, float] | None = None, closed_loop: bool = False,
    noise: float = 0.001, delay: int = 2, beside: tuple[Path, ...] = (), out: Path | None = None, film: bool = True,
    json: opt.Json = False,
) -> int:  # fmt: skip
    """Assess a trained policy: distance and return, success and time to target, compared with waves of commands.

    Reads a training folder; writes into it (or --out) rollout.json, episodes.npz, rollout.mp4 and training.html, a page
    with learning curves and paths. Starts and goals are the same every time. Takes some ten seconds for forward and
    some minutes for 100 goals.

    Args:
        episodes: Episodes to run.
        goals: For a task with goals: number of random goals, instead of --episodes.
        parameters: Run folder or parameters file of another simulator, which may be of another robot with the same
            observations and actuators: fish-rolling for a policy that was trained in fish. By default that of the
            training.
        stage: Stage of the curriculum: distance of the goals and how closely they must be met; by default the last.
        tendon_friction: Share of the rubbing tendon's tension that friction takes; by default as in the training.
        current: Velocity of the water along x (backward) and y [m/s]; by default as in the training.
        closed_loop: Also compare recorded commands with closed loop on the true and on the tracked state, under the
            disturbances.
        noise: Noise of tracked markers in the closed loop [m].
        delay: Delay of tracked markers in the closed loop [control intervals of 20 ms].
        beside: Further training folders, whose policies swim beside this one in the film, in the same simulator and
            from the same start.
        out: Folder to write; by default the policy's.
        film: Whether the film is written; --no-film leaves it out.
    """
    from swim2real.cli.subject import robot_for, values_for
    from swim2real.report.training_page import write_training_page
    from swim2real.rl.assessment import TEST_SEED, assess, run_policy
    from swim2real.rl.conditions import StateEstimate
    from swim2real.rl.film import Scene, write_film
    from swim2real.rl.rollout import save_episodes
    from swim2real.rl.tasks import STAGES, ReachGoal, find_task
    from swim2real.rl.training_run import TrainingRun
    from swimbase.store import source_at, write_json

    run = TrainingRun.open(policy, robot=robot)
    others = [TrainingRun.open(folder, robot=robot) for folder in beside]
    task = find_task(run.task)
    stages = task.stages
    if goals and not stages:
        raise ArgumentError(f"--goals is for tasks with goals; this policy's is {run.settings.task}: use --episodes")
    if stage is not None and stage not in stages:
        raise ArgumentError(f"--stage is {stage}; this task has {', '.join(map(str, stages)) or 'no stages'}")
    body, cores = run.robot, os.cpu_count() or 1
    if robot is None and parameters is not None and str(parameters) != PUBLISHED:
        body = robot_for(parameters)
    values = None if parameters is None else [values_for(parameters, body)]
    disturbances = run.settings.disturbances
    if tendon_friction is not None:
        disturbances = replace(disturbances, tendon_friction=tendon_friction)
    if current is not None:
        disturbances = replace(disturbances, current=current)
    assessment = assess(
        run, goals or episodes, parameters=values, robot=body, disturbances=disturbances, which=which, stage=stage,
        estimate=StateEstimate(noise, delay) if closed_loop else None, threads=cores,
    )  # fmt: skip
    source = str(parameters or source_at(policy, run.settings.reference))
    content = {**assessment.as_dict(), "parameters": source, "robot": body.name}
    folder = out or policy
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "rollout.json", content)
    save_episodes(folder / "episodes.npz", assessment.episodes)
    filmed = folder / "rollout.mp4" if film else None
    if filmed:
        sets = run.settings.parameters if values is None else values
        swims = [assessment.episodes[0]]
        for other in others:
            swims += run_policy(other, [TEST_SEED], body, sets, disturbances, which=which, stage=stage)
        titles = ["/".join(one.folder.resolve().parts[-2:]) for one in (run, *others)] if others else [""]
        scenes = [Scene(title, swim, body) for title, swim in zip(titles, swims, strict=True)]
        threshold = STAGES[stage or stages[-1]].threshold if issubclass(task, ReachGoal) else None
        write_film(filmed, scenes, width=1280 if others else 720, threshold=threshold)
    page = write_training_page(run, folder, assessment, filmed)
    if json:
        say_json(content)
    else:
        _print(assessment)
        if body.name != run.settings.robot:
            say(f"Trained in a simulator of robot '{run.settings.robot}', assessed in one of '{body.name}'")
        say(f"Written: {page}, rollout.json, episodes.npz{', rollout.mp4' if film else ''}")
    return 0


def export_policy(
    policy: Positional[opt.Policy], *, out: Path, robot: opt.RobotOfRun = None, which: opt.Which = "best"
) -> int:
    """Write a policy for other programs: .onnx, or .zip, which Stable-Baselines3 trains on.

    The .onnx takes observations (N, n) and gives actions (N, A) from -1 to 1, at 50 Hz, as float32. The .zip is the
    last checkpoint: networks, optimizers and settings, without the replay buffer.

    Args:
        out: File to write, .onnx or .zip.
    """
    from swim2real.rl import export

    path = export.export_policy(policy, out, which=which, robot=robot)
    reads = "onnxruntime.InferenceSession" if path.suffix == ".onnx" else "stable_baselines3.SAC.load"
    say(f"{path}: {reads} reads it")
    return 0


def export_commands(
    policy: Positional[opt.Policy], *, out: Path, seconds: float, robot: opt.RobotOfRun = None,
    which: opt.Which = "best", phase: float = 0.0, goal: tuple[float, float] | None = None,
    ensemble: Path | None = None, json: opt.Json = False,
) -> int:  # fmt: skip
    """Write a policy's commands as a table, 50 rows per second: .csv for `deploy`, or .npz for other controllers.

    Beside it, in NAME.expected.json, is what the robot is expected to do under them: path, heading, roll where it has
    any, and time to the goal. `evaluate` compares that with a film of the real run.

    The policy runs from rest in the simulator that it was trained in, within the limits and rates of its robot file's
    [policy]. The table has a column per actuator, named after it and its unit. An .npz has the arrays times, commands,
    names and units. `deploy` checks the motors' own limits and adds ramps from and to rest.

    Args:
        out: Table to write, .csv or .npz.
        seconds: Length [s].
        phase: Angle of the motor at the start [rad].
        goal: Goal of a task with goals [m]: x (ahead is negative) and y; by default 1 m straight ahead.
        ensemble: File from `swim2real ensemble`, whose sets give the spread of what is expected; by default the further
            sets that the policy was trained with.
    """
    from motorline.commands import FISH, RATE, CommandTable, write_table
    from swim2real.identification.ensemble import read_ensemble
    from swim2real.objective.expected_run import ENDING
    from swim2real.rl.assessment import policy_commands
    from swim2real.rl.rollout import expect
    from swim2real.rl.training_run import TrainingRun
    from swimbase.store import write_arrays, write_json

    if out.suffix not in (".csv", ".npz"):
        raise ArgumentError(f"--out is '{out}'; it must end in .csv, for `deploy`, or in .npz, for other controllers")
    run = TrainingRun.open(policy, robot=robot)
    actuators, episode = policy_commands(run, seconds, which=which, phase=phase, goal=goal)
    commands = episode.commands
    sets = run.settings.parameters[1:] if ensemble is None else read_ensemble(ensemble, run.robot)
    expected = expect(run, episode, phase, sets)
    columns = {
        f"{name}_{unit.replace('/', '_')}": commands[:, i].tolist()
        for i, (name, unit) in enumerate(zip(actuators.names, actuators.units, strict=True))
    }  # fmt: skip
    if actuators.units == ("rad/s",):  # the one motor of a steady swimmer, whose column has no name
        columns = {FISH: commands[:, 0].tolist()}
    table = CommandTable.of(columns)
    if out.suffix == ".csv":
        write_table(out, table)
    else:
        times = [k / RATE for k in range(len(commands))]
        write_arrays(out, {"times": times, "commands": commands, "names": actuators.names, "units": actuators.units})
    about = {"commands": len(table.rows), "seconds": table.duration, "columns": list(columns), "out": str(out)}
    beside = out.with_suffix(ENDING)
    if expected is not None:
        write_json(beside, expected.model_dump(), indent=None)
        about |= {"expected": str(beside), "arrivals": expected.arrivals}
    if json:
        say_json(about)
    else:
        trial = f"; `swim2real deploy {word(out)} --dry-run` prints what would be sent" if out.suffix == ".csv" else ""
        say(f"{out}: {len(table.rows)} rows of {', '.join(columns)}, {table.duration:.2f} s{trial}")
        if expected is not None:
            say(f"{beside}: {expected.sentence}")
            say(f"`swim2real evaluate {word(beside)} --reference TRACKS` compares a film of the real run with it")
    if episode.goal is not None and not episode.success:
        tell(f"the goal isn't reached in {table.duration:.2f} s: {episode.goal_distance:.2f} m are left; take a nearer "
             f"goal or more --seconds")  # fmt: skip
    return 0


def _report_outcome(outcome: TrainingOutcome, out: Path, json: bool) -> None:
    if json:
        say_json(asdict(outcome))
    else:
        say(_summary(outcome, out))


def _summary(outcome: TrainingOutcome, out: Path) -> str:
    last, evaluation = outcome.last_evaluation, ""
    if last:
        success = "" if last["goal_distance"] is None else f", success {100 * last['success']:.0f} %"
        evaluation = f"return {last['episode_return']:.1f}, distance {last['distance']:.3f} m{success}; "
    return (
        f"{out}: {outcome.step} steps, {outcome.gradient_steps} updates, {outcome.steps_per_second:.0f} steps/s "
        f"(learning took {100 * outcome.learner_share:.0f} % of the time, simulating at the same time "
        f"{100 * outcome.simulator_share:.0f} %); {evaluation}`swim2real rollout {word(out)}` assesses it"
    )


def _print(assessment: Assessment) -> None:
    from swim2real.cli import tables

    policy = assessment.statistics
    rows = [
        ("episodes", str(policy.episodes)),
        ("return", f"{policy.episode_return:.2f} ± {policy.episode_return_std:.2f}"),
        ("distance", f"{policy.distance:.3f} ± {policy.distance_std:.3f} m"),
    ]
    if policy.goal_distance is not None:
        median = policy.median_time_to_target
        rows.append(("reached", f"{100 * policy.success:.0f} %"))
        rows.append(("time to target, median", "–" if median is None else f"{median:.1f} s"))
        rows.append(("left to the goal", f"{policy.goal_distance:.3f} m"))
    for name, scan in assessment.scans.items():
        wave = scan.farthest
        about = f"{100 * wave.amplitude:+.0f} % of the range" + (
            f" at {wave.frequency:.2f} Hz" if wave.frequency else ""
        )
        rows.append((f"best {name} command, distance", f"{scan.best_distance:.3f} m: {about}"))
        rows.append((f"best {name} command, return", f"{scan.best_return:.2f}"))
    tables.table(f"Policy for {assessment.task}", ("figure", "value"), rows)
    if assessment.loops:
        loops = [
            (name, f"{loop.statistics.episode_return:.3f}", f"{loop.statistics.distance:.3f}", f"{loop.drift:.3f}",
             f"{loop.sideways:.3f}", f"{100 * loop.statistics.success:.0f} %")
            for name, loop in assessment.loops.items()
        ]  # fmt: skip
        tables.table("Loops", ("loop", "return", "distance m", "drift m", "sideways m", "reached"), loops)

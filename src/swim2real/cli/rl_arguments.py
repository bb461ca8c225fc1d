"""The arguments of `train`, `rollout` and `export-commands`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

Positional = tyro.conf.Positional


@dataclass(frozen=True)
class Train:
    """Train a policy for the fish's motor in the calibrated simulator: soft actor-critic, as in the paper.

    Reads a run folder or parameters file; writes a folder with settings.json, policy.zip and best.zip, checkpoints,
    records of every episode and evaluation, TensorBoard logs and outcome.json. Costs some minutes for 300,000 steps on
    one core and hours for the paper's 5 million. Ctrl-C writes a checkpoint; --resume goes on with it.
    """

    task: Positional[Literal["forward", "target"]]
    """forward: as far as possible in 2 s. target: to a goal on the water, in three stages."""
    parameters: Path
    """Run folder or parameters file; 'published' for the prior work's values."""
    out: Path
    """Folder to write; with --seeds one for each seed is in it."""
    ensemble: Path | None = None
    """File that `swim2real ensemble` wrote: one of its sets is drawn for every episode, instead of --parameters."""
    env_steps: int = 5_000_000
    """Environment steps, 50 a second."""
    seed: int = 0
    """Decides the network's start, exploration and every episode."""
    seeds: tuple[str, ...] = ()
    """Several seeds instead of --seed: numbers, and ranges without their end: 0:3 is 0 1 2."""
    workers: int = 0
    """Seeds trained at a time; 0 for as many as there are cores."""
    environments: int = 8
    """Stepped together; a divisor of 200."""
    threads: int = 1
    """Of the environments of one run. Results don't depend on it."""
    exploration: int | None = None
    """Random steps before learning; by default 50,000, and a tenth of a shorter run."""
    updates: int | None = None
    """Gradient steps after every 200 environment steps; by default 1 for 5 million steps, as in the prior work, and
    more for fewer steps, so that a run makes about 25,000, but at most 200, one for each step."""
    checkpoint_every: int | None = None
    """Environment steps between checkpoints; by default a twentieth of the run."""
    any_phase: bool = False
    """Start episodes at any angle of the motor, not at 0."""
    tendon_friction: float = 0.0
    """Share of the left tendon's tension that friction takes."""
    resume: bool = False
    """Go on with what is in --out."""
    json: bool = False
    """Print the outcome as JSON."""
    quiet: bool = False
    """Print no progress."""


@dataclass(frozen=True)
class Rollout:
    """Assess a trained policy: distance and return, success and time to target, against constant frequencies.

    Reads a training folder; writes into it (or --out) rollout.json, episodes.npz, rollout.mp4 and training.html, a page
    with learning curves and paths. Starts and goals are the same every time. Costs some ten seconds for forward and
    some minutes for 100 goals.
    """

    policy: Positional[Path]
    """Folder that `train` wrote."""
    episodes: int = 50
    """Episodes to swim."""
    goals: int = 0
    """For a target policy: random goals to swim to, instead of --episodes."""
    parameters: Path | None = None
    """Run folder or parameters file of another simulator; by default that of the training."""
    which: Literal["best", "last"] = "best"
    """best: in the evaluations while it learned. last: at the end."""
    stage: int = 3
    """Of target's curriculum: how far goals are away, and how closely they must be met."""
    tendon_friction: float | None = None
    """Share of the left tendon's tension that friction takes; by default as in the training."""
    current: tuple[float, float] | None = None
    """Velocity of the water along x (backward) and y [m/s]; by default as in the training."""
    closed_loop: bool = False
    """Also compare recorded commands with closed loop on the true and on the tracked state, under the disturbances."""
    noise: float = 0.001
    """Of tracked markers in the closed loop [m]."""
    delay: int = 2
    """Of tracked markers in the closed loop [control intervals of 20 ms]."""
    out: Path | None = None
    """Folder to write; by default the policy's."""
    film: bool = True
    """Write the film."""
    json: bool = False
    """Print the figures as JSON."""


@dataclass(frozen=True)
class ExportCommands:
    """Write a policy's motor commands as a table for `deploy`: time_s,velocity_rad_s, 50 rows a second.

    The policy swims from rest in the simulator that it was trained in; its commands are checked against the motor's
    limits and put between ramps from and to rest.
    """

    policy: Positional[Path]
    """Folder that `train` wrote."""
    out: Path
    """Table to write."""
    seconds: float
    """Length without the ramps [s]."""
    which: Literal["best", "last"] = "best"
    """best: in the evaluations while it learned. last: at the end."""
    phase: float = 0.0
    """Angle of the motor at the start [rad]."""
    goal: tuple[float, float] | None = None
    """Of a target policy [m]: x (ahead is negative) and y; by default 1 m straight ahead."""
    ramp: float = 20.0
    """Acceleration of the ramps from and to rest [rad/s²]."""
    max_speed: float | None = None
    """Refuse faster commands [rad/s]; by default 7.29, the motor's own limit as it is sold."""
    max_acceleration: float | None = None
    """Refuse steeper changes from one command to the next [rad/s²]; by default 100."""
    clip: bool = False
    """Cut commands off at the limits instead of refusing them."""
    json: bool = False
    """Print what was written as JSON."""

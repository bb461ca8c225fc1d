"""What decides a training run: the task, the paper's numbers, and the rules for runs shorter than the paper's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from swim2real.errors import ArgumentError

Task = Literal["forward", "target"]
TASKS: tuple[Task, ...] = get_args(Task)

PAPER_STEPS = 5_000_000
PAPER_EXPLORATION = 50_000
BLOCK = 200  # transitions between two rounds of learning: the prior work's train_freq
MOST_REPLAY = 1_000_000  # transitions kept, as Stable-Baselines3 does


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of a run; the defaults are the paper's.

    The prior work learns once after every 200 transitions: 25,000 updates in 5 million steps. A shorter run makes about
    as many: it still learns after every 200 transitions, but `ceil(5 M / env_steps)` times, and at most 200 times: one
    update a transition is soft actor-critic's own ratio. Stable-Baselines3 counts `train_freq` in steps of all
    environments together, so it gets 200 divided by their number.

    Attributes:
        task: `forward` or `target`.
        env_steps: Environment steps, of all environments together.
        seed: Decides the network's start, exploration, and every episode.
        environments: Stepped together; a divisor of 200.
        exploration: Random steps before learning; None for the paper's 50,000, or a tenth of a shorter run.
        updates: Gradient steps after every 200 transitions; None for the rule above.
        checkpoint_every: Environment steps between checkpoints; None for a twentieth of the run, 10,000 at least.
        learning_rate: Of actor, critics and entropy coefficient.
        batch: Transitions of a gradient step.
        discount: Of rewards, a step.
        target_rate: Share by which the target critics follow, a gradient step.
        layers: Widths of the hidden layers of actor and critics.
        reward_scale: By which the learner sees rewards multiplied; episode returns are reported unscaled.
    """

    task: Task
    env_steps: int = PAPER_STEPS
    seed: int = 0
    environments: int = 8
    exploration: int | None = None
    updates: int | None = None
    checkpoint_every: int | None = None
    learning_rate: float = 2e-3
    batch: int = 256
    discount: float = 0.99
    target_rate: float = 0.1
    layers: tuple[int, ...] = (256, 256)
    reward_scale: float = 1.0

    def __post_init__(self) -> None:
        if self.task not in TASKS:
            raise ArgumentError(f"task is '{self.task}'; there are {' and '.join(TASKS)}")
        if self.env_steps < BLOCK:
            raise ArgumentError(f"env_steps is {self.env_steps}; learning needs {BLOCK} at least")
        if not 0 <= self.seed < 2**31:
            raise ArgumentError(f"seed is {self.seed}; it must be 0 or more and below 2^31")
        if self.environments < 1 or BLOCK % self.environments:
            raise ArgumentError(f"environments is {self.environments}; it must divide {BLOCK}: 1, 2, 4, 5, 8, 10, 20 …")
        for name, value in (("updates", self.updates), ("checkpoint_every", self.checkpoint_every)):
            if value is not None and value < 1:
                raise ArgumentError(f"{name} is {value}; it must be at least 1")
        if self.exploration is not None and not 0 <= self.exploration < self.env_steps:
            raise ArgumentError(f"exploration is {self.exploration}; it must be 0 or more and below env_steps")
        if not (math.isfinite(self.reward_scale) and self.reward_scale > 0):
            raise ArgumentError(f"reward_scale is {self.reward_scale}; it must be finite and above 0")

    @property
    def exploration_steps(self) -> int:
        """Random steps before learning."""
        return min(PAPER_EXPLORATION, self.env_steps // 10) if self.exploration is None else self.exploration

    @property
    def updates_a_block(self) -> int:
        """Gradient steps after every 200 transitions."""
        wanted = min(BLOCK, math.ceil(PAPER_STEPS / self.env_steps))
        return wanted if self.updates is None else self.updates

    @property
    def checkpoint_steps(self) -> int:
        """Environment steps between checkpoints, a multiple of 200."""
        wanted = max(10_000, self.env_steps // 20) if self.checkpoint_every is None else self.checkpoint_every
        return max(BLOCK, wanted // BLOCK * BLOCK)

    @property
    def total_steps(self) -> int:
        """Environment steps that are made: a multiple of 200."""
        return math.ceil(self.env_steps / BLOCK) * BLOCK

    @property
    def replay(self) -> int:
        """Transitions that the replay buffer holds."""
        return min(MOST_REPLAY, self.total_steps)

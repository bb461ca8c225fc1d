"""When the next stage of a curriculum begins."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

ENOUGH = 0.7  # share of successes
WINDOW = 50  # episodes


class Curriculum:
    """Goes on to the next stage once most episodes of this one succeed.

    The paper names three stages but not when they change; 70 % of the last 50 episodes is ours. A policy that never
    gets there stays in its stage: farther goals would only teach it to stand still.

    Attributes:
        stage: The stage now.
    """

    def __init__(self, stages: Sequence[int]) -> None:
        """Begins with the first of the stages."""
        self._stages = tuple(stages)
        self.stage = self._stages[0]
        self._recent: deque[bool] = deque(maxlen=WINDOW)

    def note(self, success: bool, stage: int) -> None:
        """Takes an episode's end; one that was begun in an earlier stage doesn't count."""
        if stage == self.stage:
            self._recent.append(success)

    def advance(self) -> bool:
        """Goes on to the next stage if this one is learned; whether it did."""
        place = self._stages.index(self.stage)
        learned = len(self._recent) == WINDOW and sum(self._recent) >= ENOUGH * WINDOW
        if not learned or place + 1 == len(self._stages):
            return False
        self.stage = self._stages[place + 1]
        self._recent.clear()
        return True

    def state(self) -> tuple[int, list[bool]]:
        """What a resumed run needs."""
        return self.stage, list(self._recent)

    def restore(self, state: tuple[int, list[bool]]) -> None:
        """Goes on as `state` says."""
        self.stage, recent = state
        self._recent = deque(recent, maxlen=WINDOW)

"""The schedule, on a clock of ours and on the real one."""

import math
import time
from itertools import pairwise

import pytest

from motorline.schedule import Punctuality, Schedule


class Clock:
    """Time that goes on when somebody sleeps or looks."""

    def __init__(self, oversleep: float = 0.0) -> None:
        self.now, self.oversleep = 1000.0, oversleep
        self.schedule = Schedule(clock=self, sleep=self.sleep)

    def __call__(self) -> float:
        self.now += 2e-5
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now += seconds + self.oversleep


def run(count, work, oversleep=0.0):
    """Lateness by number of commands that keep one busy for `work(k)` seconds."""
    clock = Clock(oversleep)
    late = {}
    for k in clock.schedule.ticks(count):
        late[k] = clock.now - clock.schedule.due(k)
        clock.now += work(k)
    return clock.schedule, late


@pytest.mark.parametrize("oversleep", [0.0, 0.0004])
def test_a_minute_without_drift_even_where_sleeps_end_late(oversleep):
    _, late = run(50 * 60, lambda k: 0.012, oversleep)
    assert len(late) == 50 * 60
    assert max(late.values()) < 1e-4


def test_a_small_delay_is_caught_up_with_and_a_great_one_skipped_except_for_the_last():
    schedule, late = run(20, lambda k: {3: 0.025, 9: 0.078, 16: 0.5}.get(k, 0.001))
    assert late[4] == pytest.approx(0.005, abs=1e-4)
    assert max(late[5], late[13]) < 1e-4
    assert sorted(set(range(20)) - set(late)) == [10, 11, 12, 17, 18]
    assert schedule.skipped == 5


def test_commands_never_bunch_up():
    clock, at = Clock(), []
    for k in clock.schedule.ticks(500):
        clock.now += 0.03 * abs(math.sin(k * 2.3)) ** 5  # the system had other things to do before it was sent
        at.append(clock.now)
        clock.schedule.sent(k, clock.now)
        clock.now += 0.001 + 0.05 * abs(math.sin(k * 1.7)) ** 3  # and after
    assert min(b - a for a, b in pairwise(at)) > 0.0099
    assert len(at) + clock.schedule.skipped == 500


def test_it_ends_when_it_is_stopped_and_keeps_to_the_real_clock():
    clock = Clock()
    assert list(clock.schedule.ticks(100, stop=lambda: clock.now > 1000.51)) == list(range(26))
    schedule = Schedule()
    assert min(-schedule.left(k) for k in schedule.ticks(10)) >= 0
    assert time.monotonic() - schedule.start >= 9 / 50


def test_punctuality():
    p = Punctuality.of([0.0001] * 98 + [0.0015, 0.003], skipped=1)
    assert (p.sent, p.skipped) == (100, 1)
    assert p.on_time_share == pytest.approx(99 / 101)
    assert (p.median, p.percentile_99, p.worst) == (0.0001, 0.0015, 0.003)
    assert Punctuality.of([]) == Punctuality(0, 0, 0.0, 0.0, 0.0, 0.0)

"""The schedule, on a clock of ours and on the real one."""

import math
import time
from itertools import pairwise

import pytest

from swim2real.deployment.schedule import ON_TIME, Punctuality, Schedule


class Clock:
    """Time that goes on when somebody sleeps or looks."""

    def __init__(self, oversleep: float = 0.0) -> None:
        self.now = 1000.0
        self.oversleep = oversleep

    def __call__(self) -> float:
        self.now += 2e-5
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now += seconds + self.oversleep


def run(count, work, oversleep=0.0):
    """Numbers, and the lateness of each, of commands that keep one busy for `work(k)` seconds."""
    clock = Clock(oversleep)
    schedule = Schedule(clock=clock, sleep=clock.sleep)
    ticks = []
    for k in schedule.ticks(count):
        ticks.append((k, clock.now - schedule.due(k)))
        clock.now += work(k)
    return schedule, ticks


def test_a_minute_without_drift():
    _, ticks = run(50 * 60, lambda k: 0.012)
    assert len(ticks) == 50 * 60
    assert max(late for _, late in ticks) < 1e-4


def test_a_sleep_that_ends_late_is_made_up_for_by_watching_the_clock():
    _, ticks = run(100, lambda k: 0.001, oversleep=0.0004)
    assert max(late for _, late in ticks) < 1e-4


def test_a_small_delay_is_caught_up_with_and_a_great_one_skipped():
    schedule, ticks = run(20, lambda k: {3: 0.025, 9: 0.078}.get(k, 0.001))
    late = dict(ticks)
    assert late[4] == pytest.approx(0.005, abs=1e-4)
    assert late[5] < 1e-4
    assert sorted(set(range(20)) - set(late)) == [10, 11, 12]
    assert schedule.skipped == 3
    assert late[13] < 1e-4


def test_commands_never_bunch_up():
    clock = Clock()
    schedule = Schedule(clock=clock, sleep=clock.sleep)
    at = []
    for k in schedule.ticks(500):
        clock.now += 0.03 * abs(math.sin(k * 2.3)) ** 5  # the system had other things to do before it was sent
        at.append(clock.now)
        schedule.sent(k, clock.now)
        clock.now += 0.001 + 0.05 * abs(math.sin(k * 1.7)) ** 3  # and after
    assert min(b - a for a, b in pairwise(at)) > 0.0099
    assert len(at) + schedule.skipped == 500


def test_the_last_command_is_sent_however_late():
    schedule, ticks = run(5, lambda k: 0.5 if k == 1 else 0.0)
    assert [k for k, _ in ticks] == [0, 1, 4]
    assert schedule.skipped == 2


def test_it_ends_when_it_is_stopped():
    clock = Clock()
    schedule = Schedule(clock=clock, sleep=clock.sleep)
    ticks = list(schedule.ticks(100, stop=lambda: clock.now > 1000.51))
    assert ticks == list(range(26))


def test_on_the_real_clock():
    schedule = Schedule()
    late = [-schedule.left(k) for k in schedule.ticks(10)]
    assert min(late) >= 0
    assert time.monotonic() - schedule.start >= 9 / 50


def test_punctuality():
    p = Punctuality.of([0.0001] * 98 + [0.0015, 0.003], skipped=1)
    assert (p.sent, p.skipped) == (100, 1)
    assert p.on_time_share == pytest.approx(99 / 101)
    assert (p.median, p.percentile_99, p.worst) == (0.0001, 0.0015, 0.003)
    assert ON_TIME == 0.002
    assert Punctuality.of([]) == Punctuality(0, 0, 0.0, 0.0, 0.0, 0.0)

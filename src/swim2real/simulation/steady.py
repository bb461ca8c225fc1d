"""The steady swimming cycle of a robot, found by simulating until it repeats in shape and in speed.

Shape settles within about a cycle. Speed settles more slowly and approaches its limit geometrically: the change from
one cycle to the next tells how much is still to come, and pushing the robot by that much gets there sooner. What is
returned has been checked, whatever the pushes did: a whole cycle that ends as it began.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from swim2real.simulation.stepper import Chunk, Stepper
from swim2real.trials import frames

Array = NDArray[np.float64]

SPEED_TOLERANCE = 2e-4  # m/s, of the mean speed still to come
SPEED_SHARE = 2e-3  # or this share of the speed
SHAPE_TOLERANCE = 1e-3  # m, mean over markers, from one cycle to the next
MAX_CYCLES = 12
SETTLING_TIME = 0.4  # s at least, and half a cycle, before a cycle may count
_SLOW = 0.45  # push when a speed change shrinks by no more than this over a cycle
_CAUTIOUS = 0.8  # the same, for a first decision that it has settled
_PUSH_SHAPE = 5e-3  # m, push only a robot whose shape has nearly settled
_MARGIN_STEPS = 3
_MOTOR_TRIES = 4  # a loaded motor that needs more chunks than that is stuck
_MIN_SAMPLES = 64
_SAMPLE_INTERVAL = 0.01  # s


class DivergedError(Exception):
    """The engine gave up; the message says when."""


@dataclass(frozen=True)
class Cycle:
    """One period of steady swimming.

    Attributes:
        period: Duration of a period [s].
        markers: Positions at equally spaced phases from motor angle 0 to one full turn, both included [m].
            Shape (P + 1, M, 2).
        settled: False when it didn't come to repeat within the cycles allowed.
        speed_to_come: Estimated change of the mean speed that was still to come [m/s].
        shape_change: Mean marker distance in the body frame between start and end [m].
        cycles: Simulated periods that it took.
    """

    period: float
    markers: Array
    settled: bool
    speed_to_come: float
    shape_change: float
    cycles: float

    def unroll(self, count: int) -> tuple[Array, Array]:
        """The swim that repeats this cycle, each one starting where and how the last one ended.

        Args:
            count: Number of cycles.

        Returns:
            Times [s], shape (count P + 1,), and positions [m], shape (count P + 1, M, 2), heading along -x at first.
        """
        samples = len(self.markers) - 1
        heads, axes = frames.heads(self.markers), frames.body_axes(self.markers)
        turn = np.arctan2(
            axes[0, 0] * axes[-1, 1] - axes[0, 1] * axes[-1, 0], axes[0] @ axes[-1]
        )  # from the start of a cycle to its end
        step = heads[-1] - heads[0]
        local = self.markers[:-1] - heads[0]
        pieces: list[Array] = []
        origin = np.zeros(2)
        for k in range(count + 1):
            c, s = np.cos(k * turn), np.sin(k * turn)
            rotation = np.array([[c, s], [-s, c]])  # for row vectors
            pieces.append((local if k < count else local[:1]) @ rotation + origin)
            origin = origin + step @ rotation
        return np.arange(count * samples + 1, dtype=np.float64) * (self.period / samples), np.concatenate(pieces)


def steady_cycle(stepper: Stepper, period: float) -> Cycle:
    """Simulates until the cycle repeats.

    Cycles are counted by the motor's angle, not by time: under load the motor turns a little slower than it should.

    Args:
        stepper: Fresh, with its motor at angle 0.
        period: Period of the motor [s].

    Raises:
        DivergedError: The engine gave up.
    """
    end = max(0.5, np.ceil(2 * SETTLING_TIME / period) / 2) + 1.0  # turns
    swim, change_before = run_to(None, stepper, period, end), None
    while True:
        first, last = _state(swim, end - 1), _state(swim, end)
        shape_change = float(np.linalg.norm(last.body - first.body, axis=1).mean())
        change = last.speed - first.speed
        ratio = _CAUTIOUS if change_before is None else _ratio(change, change_before)
        # the change decays geometrically, so this is missing from the mean speed of the cycle
        to_come = change * np.sqrt(ratio) / (1 - ratio)
        tolerance = max(SPEED_TOLERANCE, SPEED_SHARE * float(np.linalg.norm(last.head - first.head)) / period)
        settled = abs(to_come) < tolerance and shape_change < SHAPE_TOLERANCE
        if settled or end >= MAX_CYCLES:
            break
        if change_before is not None and ratio > _SLOW and shape_change < _PUSH_SHAPE:
            stepper.push(change * ratio / (1 - ratio) * last.forward)
            change_before, end = None, float(swim.turns[-1]) + 1.25
        else:
            change_before, end = change, end + 0.5
        swim = run_to(swim, stepper, period, end)
    return Cycle(period, _one_turn(swim, end, period), bool(settled), float(to_come), shape_change, float(end))


def run_to(swim: Chunk | None, stepper: Stepper, period: float, turns: float) -> Chunk:
    """Simulates until the motor has made so many turns, and a few steps more."""
    wanted = turns + _MARGIN_STEPS * stepper.timestep / period
    made = 0.0
    for _ in range(_MOTOR_TRIES):
        if swim is not None:
            made = float(swim.turns[-1])
            if made >= wanted:
                return swim
        chunk = stepper.run(int(np.ceil((wanted - made) * period / stepper.timestep)) + 1)
        swim = chunk if swim is None else swim.then(chunk)
        if swim.failed_at is not None:
            raise DivergedError(f"the simulation diverged {swim.failed_at:.3f} s after its start")
    raise DivergedError(f"the motor is stuck: {made:.2f} turns where {turns:.2f} were due")


@dataclass(frozen=True)
class _State:
    """The swimmer at one instant: body shape [m], head [m], forward direction, and forward speed up to then [m/s]."""

    body: Array
    head: Array
    forward: Array
    speed: float


def _state(swim: Chunk, turns: float) -> _State:
    step = float(np.interp(turns, swim.turns, np.arange(len(swim.turns))))
    k, share = int(step), step - int(step)
    markers = (1 - share) * swim.markers[k : k + 1] + share * swim.markers[k + 1 : k + 2]
    # over a quarter of a cycle, since the speed at an instant also holds the tail's fast wobble
    lately = slice(int(np.searchsorted(swim.turns, turns - 0.25)), k + 1)
    forward = -frames.body_axes(swim.markers[lately])
    speed = float((swim.velocity[lately] * forward).sum(axis=1).mean())
    return _State(frames.to_body(markers)[0], frames.heads(markers)[0], forward[-1], speed)


def _ratio(change: float, before: float) -> float:
    """By how much a change shrinks over a cycle, from two that lie half a cycle apart."""
    return float(np.clip((change / before) ** 2, 0.01, 0.8)) if before else _CAUTIOUS


def _one_turn(swim: Chunk, end: float, period: float) -> Array:
    """The last cycle, resampled to start at motor angle 0. Shape (P + 1, M, 2)."""
    samples = max(_MIN_SAMPLES, int(np.ceil(period / _SAMPLE_INTERVAL)))
    start = end - 1
    first = max(int(np.searchsorted(swim.turns, start)) - 3, 0)
    spline = CubicSpline(swim.turns[first:], swim.markers[first:], axis=0)
    cycle = Cycle(period, spline(start + np.arange(samples + 1) / samples), True, 0.0, 0.0, 0.0)
    _, twice = cycle.unroll(2)
    lead = (np.ceil(start) - start) * samples  # to the next angle 0
    return CubicSpline(np.arange(len(twice)), twice, axis=0)(lead + np.arange(samples + 1))

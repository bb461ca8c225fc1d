"""The state as a camera's marker tracks tell it: with noise, late, and with speeds that are differences."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from swim2real.rl.body import FISH_LAYOUT, Body, BodyState, wrap_angle
from swim2real.rl.conditions import CONTROL_INTERVAL, StateEstimate

Array = NDArray[np.float64]

_HEAD = list(FISH_LAYOUT.head_markers)
_TAIL = FISH_LAYOUT.tail_markers
_SPREAD = 0.1  # rad, standard deviation of a joint's angle before any marker is seen
_LEAST_NOISE = 0.0002  # m: markers above the tail move that much when the robot rolls
_ITERATIONS = 2


class StateEstimator:
    """Estimates the state from tracked markers.

    The head's pose is the one that fits its five markers best, and the tail's angles are the most likely ones. Roll and
    pitch aren't seen from above and count as 0. The motor reports its angle and speed, without noise or delay.
    """

    def __init__(self, estimate: StateEstimate) -> None:
        """Takes the noise and the delay of the tracker."""
        self._estimate = estimate
        self._current, self._previous = BodyState(), BodyState()
        self._frames: deque[Array] = deque(maxlen=estimate.delay + 1)

    def begin(self, body: Body, state: BodyState, rng: np.random.Generator) -> None:
        """Begins an episode: the robot has rested where it is for as long as the delay.

        Args:
            body: Body of the robot.
            state: True state at the start.
            rng: Generator of the markers' noise.
        """
        self._rng = rng
        self._head, self._hinge = body.rest_markers[_HEAD], float(body.rest_hinges[0])
        self._tail = TailFit(body.rest_hinges, body.rest_markers[_TAIL, 0], self._estimate.noise)
        self._frames.clear()
        for _ in range(self._estimate.delay + 1):
            self._frames.append(self._measure(state))
        self._current.heading = 0.0
        self._estimate_pose(self._current, self._frames[0], body.posture(state.motor_angle))
        self._estimate_rates(self._current, self._current)
        self._first = True

    def update(self, state: BodyState) -> BodyState:
        """The estimate when the true state is this one. To be called once a control interval."""
        if self._first:
            self._first = False
        else:
            self._frames.append(self._measure(state))
            self._current, self._previous = self._previous, self._current
            self._current.heading = self._previous.heading
            self._estimate_pose(self._current, self._frames[0], self._previous.tail_angles)
            self._estimate_rates(self._current, self._previous)
        self._current.motor_angle, self._current.motor_speed = state.motor_angle, state.motor_speed
        return self._current

    def _measure(self, state: BodyState) -> Array:
        return state.markers + self._estimate.noise * self._rng.standard_normal(state.markers.shape)

    def _estimate_pose(self, state: BodyState, markers: Array, guess: Array) -> None:
        """Sets positions and angles; the heading continues from the one there, the tail's angles begin at a guess."""
        state.markers[:] = markers
        rest, now = self._head - self._head.mean(axis=0), markers[_HEAD] - markers[_HEAD].mean(axis=0)
        sine = float((rest[:, 0] * now[:, 1] - rest[:, 1] * now[:, 0]).sum())
        state.heading += wrap_angle(math.atan2(sine, float((rest * now).sum())) - state.heading)
        c, s = math.cos(state.heading), math.sin(state.heading)
        x, y = self._head.mean(axis=0)
        state.position[:] = markers[_HEAD].mean(axis=0) - (c * x - s * y, s * x + c * y)
        hinge = state.position + self._hinge * np.array([c, s])
        state.tail_angles[:] = self._tail.angles(markers[_TAIL], hinge, state.heading, guess)

    def _estimate_rates(self, state: BodyState, previous: BodyState) -> None:
        """Sets velocities and rates, as differences to the frame before."""
        state.marker_velocities[:] = (state.markers - previous.markers) / CONTROL_INTERVAL
        state.velocity[:] = (state.position - previous.position) / CONTROL_INTERVAL
        state.turning[2] = (state.heading - previous.heading) / CONTROL_INTERVAL
        state.tail_rates[:] = (state.tail_angles - previous.tail_angles) / CONTROL_INTERVAL


class TailFit:
    """The most likely angles of the tail's hinges, from the markers behind them.

    Markers alone determine the angles badly. Each stands so close behind its hinge, and hinges are so close to one
    another, that half a millimeter makes the five angles zigzag by 0.1 rad. So small angles are taken to be more likely
    from the start.
    """

    def __init__(self, hinges: Array, markers: Array, noise: float) -> None:
        """Prepares the fit.

        Args:
            hinges: Hinges of the straight tail [m]. Shape (J,).
            markers: Markers of the straight tail, one behind each hinge, and a last one behind the last [m]. Shape
                (J + 1,).
            noise: Standard deviation of a marker's position [m].
        """
        count, lengths = len(hinges), np.diff(hinges)
        self._levers = np.zeros((count + 1, count))  # of each segment's direction in each marker's place
        for i in range(count + 1):
            segment = min(i, count - 1)
            self._levers[i, :segment] = lengths[:segment]
            self._levers[i, segment] = markers[i] - hinges[segment]
        self._noise = max(noise, _LEAST_NOISE)
        self._joints = np.eye(count) - np.eye(count, k=-1)  # from directions to angles
        self._prior = self._joints.T @ self._joints / _SPREAD**2

    def angles(self, markers: Array, hinge: Array, heading: float, guess: Array) -> Array:
        """Fits the angles [rad].

        Args:
            markers: Markers of the tail [m]. Shape (J + 1, 2).
            hinge: Position of the first hinge [m]. Shape (2,).
            heading: Heading of the body in front of it [rad].
            guess: Angles to begin at [rad]. Shape (J,).

        Returns:
            Shape (J,).
        """
        levers, ahead = self._levers, np.zeros(len(guess))
        ahead[0] = heading
        direction = heading + np.cumsum(guess)
        for _ in range(_ITERATIONS):
            cosine, sine = np.cos(direction), np.sin(direction)
            off = np.concatenate([markers[:, 0] - hinge[0] - levers @ cosine, markers[:, 1] - hinge[1] - levers @ sine])
            slope = np.concatenate([-levers * sine, levers * cosine]) / self._noise
            pull = self._joints.T @ (ahead - self._joints @ direction) / _SPREAD**2
            direction = direction + np.linalg.solve(slope.T @ slope + self._prior, slope.T @ off / self._noise + pull)
        return self._joints @ direction - ahead

"""The state as a camera's marker tracks tell it: with noise, late, and with speeds that are differences."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from swim2real.rl.body import Body
from swim2real.rl.disturbances import StateEstimate
from swim2real.rl.motor import CONTROL_INTERVAL
from swim2real.rl.observation import Reading, wrapped
from swim2real.rl.tail_fit import TailFit

Array = NDArray[np.float64]

_HEAD = [0, 1, 2, 9, 10]  # markers on the stiff front: M0, M1, M2 and the fin tips


class Tracked:
    """Makes the reading that a tracker gives from the true one.

    The head's pose is the one that fits its five markers best, and the tail's angles are the most likely ones. Roll and
    pitch aren't seen from above and count as 0. The motor tells its angle and speed, without noise or delay.
    """

    def __init__(self, estimate: StateEstimate) -> None:
        self._estimate = estimate
        self._seen, self._before = Reading(), Reading()
        self._frames: deque[Array] = deque(maxlen=estimate.delay + 1)

    def begin(self, body: Body, reading: Reading, rng: np.random.Generator) -> None:
        """Begins an episode: the robot has rested where it is for as long as the delay."""
        self._rng = rng
        self._head, self._hinge = body.rest_markers[_HEAD], float(body.rest_hinges[0])
        self._tail = TailFit(body.rest_hinges, body.rest_markers[3:9, 0], self._estimate.noise)
        self._frames.clear()
        for _ in range(self._estimate.delay + 1):
            self._frames.append(self._measured(reading))
        self._seen.heading = 0.0
        self._locate(self._seen, self._frames[0], body.posture(reading.motor_angle))
        self._differ(self._seen, self._seen)
        self._fresh = True

    def see(self, reading: Reading) -> Reading:
        """What is known when the true state is this one. To be called once a control interval."""
        if self._fresh:
            self._fresh = False
        else:
            self._frames.append(self._measured(reading))
            self._seen, self._before = self._before, self._seen
            self._seen.heading = self._before.heading
            self._locate(self._seen, self._frames[0], self._before.tail_angles)
            self._differ(self._seen, self._before)
        self._seen.motor_angle, self._seen.motor_speed = reading.motor_angle, reading.motor_speed
        return self._seen

    def _measured(self, reading: Reading) -> Array:
        return reading.markers + self._estimate.noise * self._rng.standard_normal(reading.markers.shape)

    def _locate(self, seen: Reading, markers: Array, guess: Array) -> None:
        """Positions and angles; a heading goes on from the one before, the tail's are sought from a guess on."""
        seen.markers[:] = markers
        rest, now = self._head - self._head.mean(axis=0), markers[_HEAD] - markers[_HEAD].mean(axis=0)
        sine = float((rest[:, 0] * now[:, 1] - rest[:, 1] * now[:, 0]).sum())
        seen.heading += wrapped(math.atan2(sine, float((rest * now).sum())) - seen.heading)
        c, s = math.cos(seen.heading), math.sin(seen.heading)
        x, y = self._head.mean(axis=0)
        seen.position[:] = markers[_HEAD].mean(axis=0) - (c * x - s * y, s * x + c * y)
        hinge = seen.position + self._hinge * np.array([c, s])
        seen.tail_angles[:] = self._tail.angles(markers[3:9], hinge, seen.heading, guess)

    def _differ(self, seen: Reading, before: Reading) -> None:
        """Speeds since the frame before."""
        seen.marker_velocities[:] = (seen.markers - before.markers) / CONTROL_INTERVAL
        seen.velocity[:] = (seen.position - before.position) / CONTROL_INTERVAL
        seen.turning[2] = (seen.heading - before.heading) / CONTROL_INTERVAL
        seen.tail_rates[:] = (seen.tail_angles - before.tail_angles) / CONTROL_INTERVAL

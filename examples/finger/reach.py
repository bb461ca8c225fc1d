"""A task of one's own: the finger's tip is to be where a goal is, on the arc that the tip can reach.

swim2real train python:examples/finger/reach.py:Reach --parameters runs/finger --env-steps 50000 --out policies/tip
"""

from types import MappingProxyType

import numpy as np

from swim2real.rl.state import MOST_PLACE

TIP = 5  # the last marker
CLOSE = 0.01  # m
SECONDS = 3.0


class Reach:
    """The reward of a step is minus the distance of the tip from its goal, in cm.

    A goal is where the tip of a finger is whose middle joint bends 0.56 times as far as its knuckle, as the wound-up
    cable bends them, so it can be reached.

    Attributes:
        goals: Where the tip is to be [m]. Shape (N, 2).
    """

    observes = ("joint_angles", "joint_rates", "sensors", "commands")
    adds = MappingProxyType({"to_goal": (2, MOST_PLACE)})
    needs_frame = False
    stages = ()
    discount = 0.99

    def __init__(self, robot, count, seconds=SECONDS):
        self._seconds = seconds
        self.goals = np.zeros((count, 2))

    def begin(self, index, rng, options):
        bend = options.get("bend", rng.uniform(0.2, 1.2))  # rad, of the knuckle
        first, second = np.array([0.09, -0.01]), np.array([0.07, -0.01])  # link to the next joint; tip on its link
        self.goals[index] = _turned([first[0], 0.0], bend) + _turned(second, 1.56 * bend)
        return self._seconds

    def observe(self, state):
        return self.goals - state.markers[:, TIP]

    def score(self, state, actions):
        distances = np.linalg.norm(self.goals - state.markers[:, TIP], axis=1)
        return -100 * distances, np.zeros(len(distances), bool)

    def info(self, state, index):
        distance = float(np.linalg.norm(self.goals[index] - state.markers[index, TIP]))
        return {"goal": tuple(self.goals[index]), "goal_distance": distance}


def _turned(point, angle):
    """A point of a link that bends downward."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * point[0] + s * point[1], c * point[1] - s * point[0]])

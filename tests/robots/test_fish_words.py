"""What the texts of the fish's parameters say of their effects, against simulated swims and the learned response."""

import re
from dataclasses import replace

import numpy as np

from swim2real.robots.fish import FISH, FISH_EXTENDED

SPACE = replace(FISH.space, scale="log")
STEP = 0.1  # of a parameter's range
FREQUENCIES = np.array([0.4, 0.75, 1.15, 1.6])  # Hz
TOLD = re.compile(
    r"Measured for a tenth of the range more: (?:less than 2 % of speed, tail and yaw|speed ([+-]\d+), ([+-]\d+) and "
    r"([+-]\d+) % at slow, middle and fast beats, tail ([+-]\d+) %, yaw ([+-]\d+) %)\."
)
NOTICEABLE = 2  # %: smaller effects have no sure sign


def told(robot) -> dict[str, np.ndarray]:
    """Percent of change of each parameter's text: speed slow, middle, fast, tail, yaw. Shape (5,)."""
    found = {one.name: TOLD.search(" ".join(one.meaning.split())) for one in robot.space}
    return {name: np.array([float(part or 0) for part in match.groups()]) for name, match in found.items() if match}


def expected_by_the_response() -> np.ndarray:
    """The median effect over random sets that swim forward, by the learned response. Shape (d, 5)."""
    rng, response = np.random.default_rng(3), FISH.swims.response
    points = rng.random((4000, len(SPACE)))
    speeds, forward = response.speeds(points, FREQUENCIES)
    strides = (speeds / FREQUENCIES).mean(axis=1)
    points = points[(forward > 0.6).all(axis=1) & (strides > 0.04) & (strides < 0.35)]

    def logs(at):
        # the stride without the chance to turn around, the last marker's beat, and the head's yaw
        grown = np.log(FREQUENCIES) - np.log(response.frequencies).mean()
        stride = response.stride(at) + response.growth(at) * grown
        parts = response.average + np.einsum("nc,cfk->nfk", response.motion(at), response.basis)
        half = parts.shape[2] // 2
        sizes = np.log(np.hypot(parts[..., :half], parts[..., half:])).mean(axis=1)
        speed = [stride[:, 0], stride[:, 1:3].mean(axis=1), stride[:, 3]]
        return np.stack([*speed, sizes[:, -3], sizes[:, -1]], axis=1)

    effects = []
    for i in range(len(SPACE)):
        side = STEP / 2 * np.eye(len(SPACE))[i]
        inside = points[np.abs(points[:, i] - 0.5) <= 0.5 - STEP / 2]
        effects.append(np.median(100 * np.expm1(logs(inside + side) - logs(inside - side)), axis=0))
    return np.array(effects)


def test_every_parameter_tells_what_was_measured_with_the_signs_of_the_learned_response():
    assert set(told(FISH)) == set(FISH.space.names)
    assert set(told(FISH_EXTENDED)) == set(FISH_EXTENDED.space.names)
    said, expected = np.array(list(told(FISH).values())), expected_by_the_response()
    sure = np.abs(said) >= NOTICEABLE
    assert sure.sum() >= 15
    np.testing.assert_array_equal(np.sign(said[sure]), np.sign(expected[sure]))
    assert np.abs(expected[~sure]).max() < 6  # what is called weak is weak

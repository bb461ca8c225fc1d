"""Which of the things that are seen over a stretch of film is a marker that was lost.

Things of a marker's colors are followed by flow for as long as they are seen: a tracklet. The known stretches of all
markers are tracklets, too. Each comes before one other at most and after one other at most; the links that explain the
film best are a linear assignment (Jaqaman et al.: Robust single-particle tracking in live-cell time-lapse sequences,
Nature Methods 5, 2008). A link is worth by how much likelier the motion over it is than that a new thing turns up
there, as often as they do in this film. What is linked to a marker is that marker, with a confidence by how much worse
the best explanation is in which it isn't.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import connected_components

from markertrack.quality import DOUBTFUL, runs
from markertrack.tracking.colors import OwnColors
from markertrack.tracking.flow import Flow
from markertrack.tracking.free import MOST_OFF
from markertrack.tracking.tracker import AGREE, Array, Image, contradict

SEVERAL = 2  # frames in which a thing must be seen
ENDS = 3  # steps that tell the velocity of a thing at its ends
MOST = 1000  # tracklets that are linked: those that last longest
CHANGE = 0.5  # of its speed, by which a velocity changes in a frame


@dataclass
class Tracklet:
    """A thing that is followed from frame to frame, or a stretch in which a marker is known.

    Attributes:
        first: Number of its first frame.
        places: Where it is in each [px].
        marker: Index of the marker that it is; -1 of a thing.
    """

    first: int
    places: list[Array]
    marker: int = -1

    @property
    def last(self) -> int:
        """Number of its last frame."""
        return self.first + len(self.places) - 1


class Things:
    """The things of one marker's colors, from frame to frame.

    Attributes:
        tracklets: All of them, those that go on included.
    """

    def __init__(self, colors: OwnColors, marker: int, radius: float) -> None:
        """Takes the colors of all markers, of which marker, and its radius [px]."""
        self.tracklets: list[Tracklet] = []
        self._colors, self._marker, self._radius = colors, marker, radius
        self._going: list[Tracklet] = []
        self._flow: Flow | None = None

    def see(self, image: Image, frame: int, taken: Array, apart: Array) -> None:
        """Takes the next picture.

        Args:
            image: RGB. Shape (H, W, 3).
            frame: Its number.
            taken: Places of markers that are known in it, NaN of others [px]. Shape (M, 2).
            apart: How far from them there is something else [px]. Shape (M,).
        """
        places = self._colors.peaks(image, self._marker, self._radius)
        places = places[~(np.linalg.norm(places[:, None] - taken, axis=2) < apart).any(axis=1)]
        going = [last or Tracklet(frame, []) for last in self._followed(image, places)]
        for one, place in zip(going, places, strict=True):
            one.places.append(place)
        self.tracklets += [one for one in going if one.first == frame]
        self._going = going

    def _followed(self, image: Image, places: Array) -> list[Tracklet | None]:
        """What flow leads to each of places (P, 2)."""
        out: list[Tracklet | None] = [None] * len(places)
        if self._flow is None:
            self._flow = Flow(image)
        elif self._going:
            last, earlier = (np.array([one.places[-at:][0] for one in self._going]) for at in (1, 2))
            radii = np.full(len(last), self._radius)
            moves = self._flow.follow(image, last, radii, last - earlier)
            there = (last + moves.steps)[:, None]
            good = (moves.errors < np.maximum(MOST_OFF[0], MOST_OFF[1] * radii))[:, None]
            good = good & ~contradict(there, places, self._radius)
            near = np.where(good, 1 / (1 + np.linalg.norm(there - places, axis=2)), 0.0)
            for before, after in zip(*linear_sum_assignment(near, maximize=True), strict=True):
                if good[before, after]:
                    out[after] = self._going[before]
        else:
            self._flow.follow(image, np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)))
        return out


def known_stretches(positions: Array, confidence: Array) -> list[Tracklet]:
    """Stretches in which markers are known, in order. Shapes (T, M, 2) [px], (T, M)."""
    return [
        Tracklet(first, list(positions[first:end, m]), m)
        for m in range(positions.shape[1])
        for first, end in runs(confidence[:, m] >= DOUBTFUL).tolist()
    ]


def belonging(
    tracklets: Sequence[Tracklet], marker: int, radius: float, room: float, sure: float
) -> list[tuple[Tracklet, float]]:
    """Things that are a marker, and how sure that is.

    Args:
        tracklets: Things of its colors, and stretches in which markers are known.
        marker: Its index.
        radius: Its radius [px].
        room: Of all pictures, in which things may turn up [px²].
        sure: How sure it must be, from 0 to 1.
    """
    every = [one for one in tracklets if one.marker >= 0 or len(one.places) >= SEVERAL]
    if all(one.marker >= 0 for one in every):
        return []
    every = sorted(every, key=lambda one: (one.marker < 0, -len(one.places)))[:MOST]
    worth = _worth(every, radius, room)
    _, part = connected_components(worth > 0, directed=False)
    near = np.flatnonzero(np.isin(part, [part[n] for n, one in enumerate(every) if one.marker == marker]))
    every, worth = [every[n] for n in near], worth[np.ix_(near, near)]  # nothing else has to do with it
    best, after = _linked(worth)
    before = {later: first for first, later in after.items()}
    found: dict[int, float] = {}
    for start in [n for n, one in enumerate(every) if one.marker == marker]:
        for links, ahead in ((after, True), (before, False)):
            chain = [start]
            while chain[-1] in links and (len(chain) == 1 or every[chain[-1]].marker < 0):
                chain.append(links[chain[-1]])
            least = best
            for cut in range(1, len(chain) if every[chain[-1]].marker in (-1, marker) else 0):
                without = worth.copy()
                without[np.ix_(chain[:cut], chain[cut:]) if ahead else np.ix_(chain[cut:], chain[:cut])] = 0.0
                least = min(least, best - _linked(without)[0])
                if least < np.log(sure / (1 - sure)):
                    break
                found[chain[cut]] = max(found.get(chain[cut], 0.0), least)
    return [(every[n], float(1 / (1 + np.exp(-odds)))) for n, odds in found.items() if every[n].marker < 0]


def _linked(worth: Array) -> tuple[float, dict[int, int]]:
    """The links (first, later) that are worth most in all, and that worth."""
    rows, columns = linear_sum_assignment(worth, maximize=True)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return float(worth[rows, columns].sum()), {first: later for first, later in pairs if worth[first, later] > 0}


def _worth(tracklets: Sequence[Tracklet], radius: float, room: float) -> Array:
    """Logarithm of how much likelier each goes on as each other one than that this is new; 0 for less. Shape (N, N)."""
    markers, begin, end = np.array([(one.marker, one.first, one.last) for one in tracklets]).T
    first, last = (np.array([one.places[at] for one in tracklets]) for at in (0, -1))
    starting = np.array([_velocity(one.places[: ENDS + 1]) for one in tracklets])
    ending = np.array([_velocity(one.places[-ENDS - 1 :]) for one in tracklets])
    speed = np.array([_speed(one.places) for one in tracklets])
    new, moving, frames = markers < 0, end > begin, begin - end[:, None]
    change, noise = CHANGE * np.maximum(speed[:, None], speed), AGREE[0] * radius
    mean = (ending[:, None] + starting) / np.maximum(moving[:, None].astype(int) + moving, 1)[..., None]
    way = _likely(first - last[:, None] - mean * frames[..., None], noise**2 + (frames * change) ** 2)
    longer = ((end - begin)[new] >= (end - begin)[:, None]).sum(axis=1)  # new things that last as long
    later = np.maximum(frames, 1)
    spread = (noise / ENDS) ** 2 + later * change**2
    usual = np.exp(_likely(starting[:, None] - starting[new], np.diag(spread)[:, None])).mean(axis=1)
    turn = _likely(starting - ending[:, None], spread) - np.log(np.maximum(usual, np.finfo(np.float64).tiny))
    worth = way - np.log(later * np.maximum(longer, 1) / room) + np.where(moving & moving[:, None], turn, 0.0)
    other = ~new & ~new[:, None] & (markers != markers[:, None])
    unknown = (begin == 0) & (end[:, None] < 0)  # it may have been there before
    return np.where((frames < 1) | other | unknown, 0.0, np.maximum(worth, 0.0))


def _likely(off: Array, variance: Array) -> Array:
    """Logarithm of the normal density in the plane of what is off (..., 2) with a variance along each axis (...)."""
    return -0.5 * (off**2).sum(axis=-1) / variance - np.log(2 * np.pi * variance)


def _velocity(places: Sequence[Array]) -> Array:
    """Mean step; none of a single place [px]. Shape (2,)."""
    return (places[-1] - places[0]) / max(len(places) - 1, 1)


def _speed(places: Sequence[Array]) -> float:
    """Root mean square of the steps; 0 of a single place [px]."""
    return float(np.sqrt((np.diff(places, axis=0) ** 2).sum() / max(len(places) - 1, 1)))

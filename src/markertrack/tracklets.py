"""Which of the things that are seen over a stretch of film is a marker that was lost.

Things of a marker's colors are followed by flow for as long as they are seen: a tracklet. The known stretches of all
markers are tracklets, too. Each comes before one other at most and after one other at most; the links that explain the
film best are a linear assignment (Jaqaman et al.: Robust single-particle tracking in live-cell time-lapse sequences,
Nature Methods 5, 2008). A link is worth by how much likelier the motion over it is than that a new thing turns up
there, as often as they do in this film: velocities change as those of its markers did, or are anew, and what is linked
to something before isn't new. What is linked to a marker is that marker, if the best explanation in which it isn't is
much worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import connected_components

from markertrack.quality import DOUBTFUL, runs
from markertrack.tracking.colors import OwnColors
from markertrack.tracking.flow import Flow
from markertrack.tracking.looks import Looks
from markertrack.tracking.tracker import AGAIN, AGREE, EVEN, EXACT, Array, Image, Mask, contradict

ENDS = 3  # steps that tell the velocity of a thing at its ends
MOST = 1000  # tracklets that are linked: those that last longest


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


class Motion:
    """How markers move in a film, as it is learned from frame to frame; of few frames nothing is ruled out."""

    def __init__(self) -> None:
        self._frames = self._turns = self._speeds = self._changes = 0.0

    def see(self, places: Array, sure: Mask) -> None:
        """Takes in three frames: places of markers (3, M, 2) [px], and whether they are known (3, M)."""
        steps = np.diff(places[:, sure.all(axis=0)], axis=0)
        steps = steps[:, np.linalg.norm(steps, axis=2).max(axis=0, initial=0.0) > EXACT[0]]
        speeds, changes = (steps.mean(axis=0) ** 2).sum(axis=1), (np.diff(steps, axis=0)[0] ** 2).sum(axis=1)
        turns = changes > speeds
        self._frames += len(turns)
        self._turns += float(turns.sum())
        self._speeds += float(speeds[~turns].sum())
        self._changes += float(changes[~turns].sum())

    @property
    def change(self) -> float:
        """Of its speed, by which a velocity usually changes in a frame."""
        steady = self._frames - self._turns
        return float(np.sqrt((steady * self._changes / max(self._speeds, EXACT[0]) + 1) / (steady + 1)))

    @property
    def turns(self) -> float:
        """Share of frames in which a velocity changes by as much as the speed: one bounces, is kicked, or stops."""
        return (self._turns + 1) / (self._frames + 1)


class Things:
    """The things of one marker's colors, from frame to frame.

    Attributes:
        tracklets: All of them, those that go on included.
        radius: Of the marker [px].
    """

    def __init__(self, colors: OwnColors, looks: Looks, marker: int, radius: float) -> None:
        """Takes the colors of all markers, of which marker, its look alone, and its radius [px]."""
        self.tracklets: list[Tracklet] = []
        self._colors, self._looks, self._marker = colors, looks, marker
        self.radius = radius
        self._going: list[Tracklet] = []
        self._clear: list[float] = []  # how clear it was at its own places
        self._flow: Flow | None = None

    def see(self, image: Image, frame: int, own: Array, taken: Array, apart: Array) -> None:
        """Takes the next picture.

        Args:
            image: RGB. Shape (H, W, 3).
            frame: Its number.
            own: Where the marker is in it, NaN where that isn't known [px]. Shape (2,).
            taken: Places of markers that are known in it, NaN of others [px]. Shape (M, 2).
            apart: How far from them there is something else [px]. Shape (M,).
        """
        spots = self._like(image)
        places, clear = self._colors.peaks(image, self._marker, self.radius, np.vstack([own, spots]))
        self._clear += [float(clear[0])] if np.isfinite(clear[0]) else []
        least = EVEN * np.mean(self._clear or [1.0])
        places = np.concatenate([spots[clear[1:] > least], places])
        free = ~(np.linalg.norm(places[:, None] - taken, axis=2) < apart).any(axis=1)
        for k in np.flatnonzero(free).tolist():  # markers don't overlap
            free[k] = (np.linalg.norm(places[:k][free[:k]] - places[k], axis=1) > 2 * self.radius).all()
        places = places[free]
        going = [last or Tracklet(frame, []) for last in self._followed(image, places)]
        for one, place in zip(going, places, strict=True):
            one.places.append(place)
        self.tracklets += [one for one in going if one.first == frame]
        self._going = going

    def _like(self, image: Image) -> Array:
        """Centers of spots that look like it, however fast they move, the likest first. Shape (P, 2)."""
        spots = self._looks.find(image, np.array([[0, 0, *image.shape[1::-1]]]))
        like = self._looks.likeness(spots, self._looks.points, np.full(1, np.inf))[0]
        order = np.argsort(-like, kind="stable")
        return spots.centers[order[like[order] > EVEN]]

    def _followed(self, image: Image, places: Array) -> list[Tracklet | None]:
        """What flow leads to each of places (P, 2)."""
        out: list[Tracklet | None] = [None] * len(places)
        if self._flow is None:
            self._flow = Flow(image)
        elif self._going:
            last, earlier = (np.array([one.places[-at:][0] for one in self._going]) for at in (1, 2))
            radii = np.full(len(last), self.radius)
            moves = self._flow.follow(image, last, radii, last - earlier)
            there = (last + moves.steps)[:, None]
            good = moves.agree(radii)[:, None] & ~contradict(there, places, self.radius)
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


def _without_pieces(things: Sequence[Tracklet], radius: float) -> list[Tracklet]:
    """Things of several frames, without what is beside one that lasts longer: a piece of it, or of its streak."""
    taken: dict[int, list[Array]] = {}
    out: list[Tracklet] = []
    for one in sorted(things, key=lambda one: -len(one.places)):
        wide, free = 2 * radius + _speed(one.places), np.ones(len(one.places), dtype=bool)
        for k, place in enumerate(one.places):
            near = np.array(taken.get(one.first + k, [])).reshape(-1, 3)
            free[k] = (np.hypot(*(near[:, :2] - place).T) > near[:, 2]).all()
        for begin, end in runs(free).tolist():
            if end - begin >= AGAIN:
                out.append(Tracklet(one.first + begin, one.places[begin:end]))
                for k in range(begin, end):
                    taken.setdefault(one.first + k, []).append(np.append(one.places[k], wide))
    return out


def belonging(
    tracklets: Sequence[Tracklet], marker: int, radius: float, motion: Motion, room: float, sure: float
) -> list[Tracklet]:
    """Things that are a marker.

    Args:
        tracklets: Things of its colors, and stretches in which markers are known.
        marker: Its index.
        radius: Its radius [px].
        motion: How markers move in this film.
        room: Of all pictures, in which things may turn up [px²].
        sure: How sure it must be, from 0 to 1.
    """
    things = _without_pieces([one for one in tracklets if one.marker < 0], radius)
    every = [*(one for one in tracklets if one.marker >= 0), *things][:MOST]
    if not things:
        return []
    worth = _worth(every, AGREE[0] * radius, motion, room)
    _, part = connected_components(worth > 0, directed=False)
    near = np.flatnonzero(np.isin(part, [part[n] for n, one in enumerate(every) if one.marker == marker]))
    every, worth = [every[n] for n in near], worth[np.ix_(near, near)]  # nothing else has to do with it
    of, odds = np.array([one.marker for one in every]), float(np.log(sure / (1 - sure)))
    found = _surely_linked(worth, of, marker, odds) | _surely_linked(worth.T, of, marker, odds)
    return [every[n] for n in sorted(found)]


def _surely_linked(worth: Array, of: NDArray[np.int64], marker: int, odds: float) -> set[int]:
    """Things that come after a marker, by chains of links.

    Args:
        worth: What links are worth. Shape (N, N).
        of: Marker that each is, -1 of a thing. Shape (N,).
        marker: The marker.
        odds: Logarithm of how much less likely all must be in which a thing doesn't.
    """
    best, after = _linked(worth)
    known = np.flatnonzero(of == marker).tolist()
    found: set[int] = set()
    for start in known:
        chain = [start]
        while chain[-1] in after and (len(chain) == 1 or of[chain[-1]] < 0):
            chain.append(after[chain[-1]])
        if of[chain[-1]] in (-1, marker):
            ways = [(thing, chain[1:at]) for at, thing in enumerate(chain) if of[thing] < 0]
            found |= {thing for thing, way in ways if _severed(worth, of, known, thing, way, best - odds) < best - odds}
    return found


def _severed(worth: Array, of: NDArray[np.int64], known: list[int], thing: int, way: list[int], least: float) -> float:
    """What links are worth in all of which no chain leads from what is known of a marker to a thing.

    What lies on the way to it goes with the one or with the other, whichever is worth more; then there may be another
    way. It isn't looked for if that is less than the least that matters.
    """
    own, other, every = known, [thing], np.arange(len(of))
    while True:
        cuts = [(own + way[:at], other + way[at:]) for at in range(len(way) + 1)]
        without = [np.where(np.isin(every, one)[:, None] & np.isin(every, two), 0.0, worth) for one, two in cuts]
        tried = [_linked(one) for one in without]
        at = int(np.argmax([value for value, _ in tried]))
        (own, other), (value, after) = cuts[at], tried[at]
        before = {later: first for first, later in after.items()}
        way, last = [], before.get(thing)
        while last is not None and last not in own and of[last] < 0:
            way.insert(0, last)
            last = before.get(last)
        if value < least or last not in own:
            return value
        way = [n for n in way if n not in other]


def _linked(worth: Array) -> tuple[float, dict[int, int]]:
    """The links (first, later) that are worth most in all, and that worth."""
    rows, columns = linear_sum_assignment(worth, maximize=True)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return float(worth[rows, columns].sum()), {first: later for first, later in pairs if worth[first, later] > 0}


def _worth(tracklets: Sequence[Tracklet], noise: float, motion: Motion, room: float) -> Array:
    """Logarithm of how much likelier each goes on as each other one than that this is new; 0 for less. Shape (N, N).

    What goes on as another one saves a new thing, which is as rare as those that last as long as the shorter one. What
    another one goes on as isn't new: this is found out by linking them, again until no fewer are new.
    """
    markers, begin, end = np.array([(one.marker, one.first, one.last) for one in tracklets]).T
    thing, frames = markers < 0, begin - end[:, None]
    fits = (frames > 0) & ~(~thing & ~thing[:, None] & (markers != markers[:, None]))
    fits &= ~((begin == 0) & (end[:, None] < 0))  # it may have been there before
    motions = _motions(tracklets, noise, motion)
    length = np.where(thing, end - begin + 1, np.inf)
    lasts, new, count = length[:, None] >= length, thing, len(thing) + 1
    worth = np.zeros_like(motions)
    while new.sum() < count:
        rate = (lasts & new[:, None]).sum(axis=0) + 1
        worth = np.where(fits, np.maximum(motions - np.log(np.maximum(rate[:, None], rate) / room), 0.0), 0.0)
        count, new = new.sum(), thing & ~np.isin(np.arange(len(thing)), list(_linked(worth)[1].values()))
    return worth


def _motions(tracklets: Sequence[Tracklet], noise: float, motion: Motion) -> Array:
    """How much likelier each goes on as each other one, by place [1/px²] and velocity, than this has its velocity.

    Either a velocity changes as usual, or it is anew: a bounce, a kick. That of a new thing is as those of all.

    Returns:
        Logarithm. Shape (N, N).
    """
    begin, end = np.array([(one.first, one.last) for one in tracklets]).T
    first, last = (np.array([one.places[at] for one in tracklets]) for at in (0, -1))
    starting = np.array([_velocity(one.places[: ENDS + 1]) for one in tracklets])
    ending = np.array([_velocity(one.places[-ENDS - 1 :]) for one in tracklets])
    moving, frames, blur = end > begin, begin - end[:, None], (noise / ENDS) ** 2
    later, known, both = np.maximum(frames, 1), moving[:, None].astype(int) + moving, moving[:, None] & moving
    own = np.sqrt(np.array([_speed(one.places) for one in tracklets]) ** 2 + blur)  # a slower one may be at rest
    usual = float(np.sqrt((own[moving] ** 2).mean())) if moving.any() else 0.0
    speed = np.where(known > 0, np.maximum(own[:, None], own), usual)
    mean = (ending[:, None] + starting) / np.maximum(known, 1)[..., None]
    off = first - last[:, None] - mean * frames[..., None]

    def likely(way: Array, kept: Array) -> Array:  # shares of the way by which it is off, and of the velocity
        turn = _likely(starting - kept[..., None] * ending[:, None], (1 - kept**2) * speed**2 / 2 + blur)
        return _likely(off, (way * later * speed) ** 2 / 2 + noise**2) + np.where(both, turn, 0.0)

    changed, anew = motion.change * later, np.ones_like(speed)
    steady = likely(
        np.where(known > 0, np.minimum(changed / (2 * np.maximum(known, 1)), 1.0), 1.0),
        np.maximum(1 - changed**2 / 2, 0.0),
    )
    anew = np.log(motion.turns * later) + likely(anew, 0 * anew)
    new = np.where(both, _likely(starting, np.full(len(own), usual**2 / 2 + blur)), 0.0)
    return np.logaddexp(steady, anew) - np.log1p(motion.turns * later) - np.log(later) - new


def _likely(off: Array, variance: Array) -> Array:
    """Logarithm of the normal density in the plane of what is off (..., 2) with a variance along each axis (...)."""
    return -0.5 * (off**2).sum(axis=-1) / variance - np.log(2 * np.pi * variance)


def _velocity(places: Sequence[Array]) -> Array:
    """Mean step; none of a single place [px]. Shape (2,)."""
    return (places[-1] - places[0]) / max(len(places) - 1, 1)


def _speed(places: Sequence[Array]) -> float:
    """Root mean square of the steps; 0 of a single place [px]."""
    return float(np.sqrt((np.diff(places, axis=0) ** 2).sum() / max(len(places) - 1, 1)))

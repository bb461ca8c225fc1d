"""Tracks markers: dots on robots, arms, plates, skins, persons; balls, pucks, lamps; those along a swimmer.

What connects some of them tells where they are: rigid bodies (`bodies`) where they fit, in each frame. All others are
carried on by the flow of their points (`flow`), and put right by a second opinion: a spot that looks like the marker
(`looks`), a spot of whatever color it has now, or its picture, where its colors are (`colors`) and nowhere else near.
Flow alone is doubtful, so is one that was lost and found again, until it was seen where it was expected from one frame
to the next. What connects the markers of a swimmer (`chain`) is one more opinion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from markertrack.tracking.bodies import Bodies, Placed
from markertrack.tracking.chain import Chain
from markertrack.tracking.colors import OwnColors
from markertrack.tracking.flow import Flow, Moves
from markertrack.tracking.looks import NEARBY, Looks, squares
from markertrack.tracking.patches import SURELY
from markertrack.tracking.spots import Spots
from markertrack.tracking.tracker import AGAIN, AGREE, DOUBT, EVEN, Image, check_order, contradict, inside
from swimbase.arrays import Array, Mask

REASONS = "nothing like it is found", "others like it are near", "it doesn't look as it did"
CERTAIN, RIGHT, LIKELY = 1.0, 0.9, 0.8  # confidence by spot, own spot, spot elsewhere
FAR = 1.5  # radii within which one is looked for that wasn't carried, besides how it may have moved
CLEAR = 0.65  # likeness of a spot, below which it is measured anew in its colors of now
REPEATED = 0.02  # px that nothing moves by in a picture that repeats the last one
SAME = 0.75  # correlation with its picture where it was carried to, from which on it is the marker: elsewhere `SURELY`
HALF = 4 / (3 * np.pi)  # radii from the edge of a picture at which the center of half a marker is
NEVER = 1e3  # cost of what a marker can't be
STREAK = 2.0  # radii that a marker of a body moves in a frame, from which on it may be a streak
SLOWER = 0.9  # of the speed, and of the largest one, that is left in each frame in which it isn't seen


class MarkerTracker:
    """Follows markers on rigid or soft bodies and such that move by themselves. See `tracker.Tracker`.

    Attributes:
        radii: Radius of each marker as it is now [px]. Shape (M,).
        reasons: In how many frames each marker was lost or doubtful, by the reason. Shapes (M,).
        colors: Theirs, as they were when they were last seen without a doubt.
        looks: Those of markers that nothing connects and that are or were in doubt, likewise, by their index.
    """

    def __init__(self, bodies: Sequence[int], fixed: int | None = None, chain: bool = False) -> None:
        """Takes what the robot file knows.

        Args:
            bodies: Number of the rigid body that carries each marker. Shape (M,).
            fixed: The body that can't move, if any marker is on one.
            chain: Whether the markers stand in a row along a flexible body, in their order; no two are on a rigid one.
        """
        self._numbers, self._fixed = np.arange(len(bodies)) if chain else np.asarray(bodies), fixed
        self._chained = chain

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Learns what the markers look like and how they lie on their bodies."""
        looks = Looks(image, points, equal=self._chained)
        self.take_over(image, looks, looks.points, time)
        return looks.points.copy(), np.ones(len(points))

    def take_over(self, image: Image, looks: Looks, places: Array, time: float) -> None:
        """Follows markers from a frame on in which it is known what they look like.

        Args:
            image: RGB. Shape (H, W, 3).
            looks: What they look like.
            places: Where they are [px]. Shape (M, 2).
            time: Time stamp [s].
        """
        count = len(places)
        self._looks, self._flow, self.colors = looks, Flow(image), OwnColors(image, places, looks.radii)
        self._places, self.radii = places.copy(), looks.radii
        self._steps, self._fastest = np.zeros((count, 2)), np.zeros(count)
        self._doubtful = np.zeros(count, dtype=np.int64)  # frames since it was certain
        self._jumped = np.zeros(count, dtype=bool)  # whether it was found elsewhere, as was another like it
        self._rivals = np.zeros((count, count), dtype=bool)  # others that may have been what was found there
        self._lost = np.zeros(count, dtype=bool)  # whether flow didn't carry it on since it was certain
        self._agreed = np.full(count, AGAIN)  # frames in which it was seen, one after the other
        self._drifted = np.zeros((count, 2))  # by which the pictures taken on the way are beside the first one [px]
        self._asked, self._flowed = np.zeros((2, count), dtype=bool)  # whether flow followed it, on a body that didn't
        self._aliased = np.zeros(count, dtype=bool)  # whether flow led it where another one of its body may be
        self._time = time
        self._bodies, self._chain = Bodies(self._numbers, self._fixed, places, time), Chain(places, self._chained)
        self.looks = dict[int, Looks]()
        self.reasons = {reason: np.zeros(count, dtype=np.int64) for reason in REASONS}

    def turn(self) -> None:
        """Takes in that the film is played backward from here on."""
        self._steps = -self._steps
        self._bodies.turn()

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Finds the markers in the next frame."""
        check_order(time, self._time)
        self._time = time
        placed, on = self._bodies.place(image, self._looks, time), self._bodies.on
        firm = placed.confidence > DOUBT
        asked = ~firm | self._flowed
        ahead = self._places + self._steps
        self._steps[asked & on & ~self._asked] = 0.0  # their bodies knew them up to now: they were pushed
        moves, carried, expected = self._carried(image, asked, placed.laid)
        self._looks.grow(np.where(carried & ~firm, moves.growths, 1.0))
        found = self._spots(image, expected, carried, asked, moves)
        positions, confidence = self._seen(image, expected, carried, asked, found)
        positions[~asked], confidence[~asked] = placed.positions[~asked], placed.confidence[~asked]
        lost = asked & (self._doubles(positions, confidence) | ~inside(positions, image, HALF * self.radii))
        strained = self._chain.strained(np.where(lost[:, None], np.nan, positions))
        carried, lost = carried & ~strained, lost | strained
        positions[lost], confidence[lost], found.chosen[lost] = np.nan, 0.0, -1
        self._agreed = np.where(confidence > DOUBT, self._agreed + 1, 0)
        sure = asked & self._sure(positions, confidence, expected, found)
        sure &= ~(on & self._contradicted(positions, confidence, placed, ahead))
        leading = on & sure & ~firm  # flow tells its body where it may be; a lost one is there if the body says so, too
        sure &= ~(on & self._lost) | np.isfinite(placed.laid[:, 0]) & ~contradict(positions, placed.laid, self.radii)
        apart = firm & sure & (np.linalg.norm(positions - placed.positions, axis=1) > self.radii)
        self._flowed = on & sure & (~firm | apart)  # flow brought it there, whatever its body says
        told, more = firm & ~apart, sure & ~firm
        positions[told], confidence[told] = placed.positions[told], placed.confidence[told]
        moves.steps[told] = (positions - self._places)[told]
        self._count(positions, sure | told, found.alone)
        self._take(positions, (confidence > DOUBT) | firm, sure | told, moves, carried, image)
        self._agreed[told] = np.maximum(self._agreed[told], AGAIN)
        self._learn(image, positions, told | more, more, found)
        self._bodies.learn(np.where((told | more | leading)[:, None], positions, np.nan), leading, placed)
        self._asked = asked
        seen = on & ~(sure | firm) & np.isfinite(placed.positions[:, 0])
        positions[seen], confidence[seen] = placed.positions[seen], placed.confidence[seen]
        return positions, np.where(told | more, confidence, np.minimum(confidence, DOUBT))

    def _carried(self, image: Image, asked: Mask, laid: Array) -> tuple[Moves, Mask, Array]:
        """How flow moves the markers that it is asked for, which it carries on, and where all are expected then."""
        moves = self._flow.follow(image, np.where(asked[:, None], self._places, np.nan), self.radii, self._steps)
        carried = moves.agree(self.radii)
        there = self._places + moves.steps
        carried &= inside(there, image) & ~self._stayed(image, there, carried)
        carried &= ~self._lost | (self._agreed > 0)  # from where it isn't, flow leads nowhere
        carried &= ~self._chain.strained(np.where(carried[:, None], there, np.nan))
        otherwise = np.where(np.isfinite(laid), laid, self._places + self._steps)
        return moves, carried, self._chain.filled(np.where(carried[:, None], there, np.nan), otherwise)

    def _sure(self, positions: Array, confidence: Array, expected: Array, found: _Found) -> Mask:
        """Markers that were seen where they were expected from one frame to the next, or that others vouch for."""
        sure = self._agreed >= AGAIN
        elsewhere = self._lost & (confidence > DOUBT) & contradict(positions, expected, self.radii)
        self._jumped |= elsewhere & found.more
        self._rivals |= elsewhere[:, None] & found.rivals
        settled = sure & ~self._jumped & ~self._rivals.any(axis=1)
        sure &= ~self._jumped & ~(self._rivals & ~settled).any(axis=1)
        return sure | (self._agreed >= AGAIN) & self._chain.vouched(positions, self._doubtful == 0)

    def _contradicted(self, positions: Array, confidence: Array, placed: Placed, ahead: Array) -> Mask:
        """Markers that flow led where another of their body may be, or, without a spot, beside the body. Shape (M,)."""
        off = np.linalg.norm(positions[:, None] - ahead, axis=2)
        other = np.where(self._numbers[:, None] == self._numbers, off, np.inf)
        np.fill_diagonal(other, np.inf)
        self._aliased |= np.diag(off) > EVEN * other.min(axis=1)
        self._aliased &= placed.confidence <= DOUBT
        beside = contradict(positions, placed.laid, self.radii) & (confidence < CERTAIN)
        streaked = ~(np.linalg.norm(positions - self._places, axis=1) < STREAK * self.radii)
        return self._aliased | beside | streaked

    def _stayed(self, image: Image, there: Array, carried: Mask) -> Mask:
        """Markers that flow led elsewhere, while something like them is where they would be by their last step.

        An equal one that comes near may take the flow with it. Shapes (M, 2), (M,).
        """
        expected = self._places + self._steps
        aside = carried & contradict(there, expected, self.radii)
        if not aside.any():
            return aside
        ways = np.hypot(*self._steps.T)
        boxes = np.where(aside[:, None], squares(expected, 1.5 * self.radii + 1.0), 0)
        spots = self._looks.find(image, boxes, ways)
        like = self._looks.likeness(spots, self._places, ways) > CLEAR
        near = ~contradict(spots.centers, expected[:, None], self.radii[:, None])
        return aside & (like & near).any(axis=1)

    def _spots(self, image: Image, expected: Array, carried: Mask, asked: Mask, moves: Moves) -> _Found:
        """The spots that look like the markers where they are looked for."""
        speed = np.maximum(self._fastest, np.hypot(*self._steps.T))
        far = FAR * self.radii + np.maximum(speed, self.radii) * (1 + self._doubtful)
        near = carried | self._bodies.on  # where else one of a body is, only all of them tell together
        reach = np.where(near, AGREE[0] * self.radii + AGREE[1], self._chain.reaches(far, carried))
        boxes = np.where(asked[:, None], squares(expected, reach + 0.5 * self.radii), 0)
        spots, of = self._measured(image, expected, boxes)
        chosen, alone = np.full(len(expected), -1), np.ones(len(expected), dtype=bool)
        more, rivals = ~alone, np.zeros((len(expected), len(expected)), dtype=bool)
        if not len(spots):
            return _Found(spots, chosen, np.zeros(len(expected)), alone, more, rivals, reach)
        like = self._looks.likeness(spots, self._places, np.hypot(*moves.steps.T))
        away = np.linalg.norm(spots.centers - expected[:, None], axis=2)
        own = of == np.arange(len(expected))[:, None]
        possible = (like > EVEN) & (away < reach[:, None]) & (own | self._chained)  # what one of a chain sees, all see
        apart = np.linalg.norm(spots.centers[:, None] - spots.centers, axis=2) > self.radii[of] / 2
        things, thing_of = np.unique(apart.argmin(axis=1), return_inverse=True)  # several markers may see the same
        cost = np.where(possible, away / reach[:, None] + 1 - like, NEVER)
        thing, margins = _assigned(_least(cost, thing_of)), np.zeros(len(expected))
        if linked := self._chained and not carried.all():
            off = (2 * away / reach[:, None]) ** 2 if carried.any() else 0.0  # else nobody knows where the chain is
            costs = _least(np.where(possible, off + 1 - like, NEVER), thing_of)
            known = carried & (thing >= 0) & (self._doubtful == 0)
            costs[known[:, None] & (np.arange(len(things)) != thing[:, None])] = NEVER
            thing, margins = self._chain.fit(costs, spots.centers[things])
        chosen = np.where(thing >= 0, np.where(thing_of == thing[:, None], cost, np.inf).argmin(axis=1), -1)
        for marker in np.flatnonzero(chosen >= 0):
            spot, off = chosen[marker], away[marker, chosen[marker]]
            here = np.linalg.norm(spots.centers - spots.centers[spot], axis=1) < self.radii[marker]
            taken = np.linalg.norm(spots.centers[:, None] - spots.centers[chosen[chosen >= 0]], axis=2)
            free = possible[marker] & (taken.min(axis=1) > self.radii[marker])
            rivals[marker] = (possible & here).any(axis=1) & ~carried & (np.arange(len(away)) != marker)
            others = np.concatenate([away[marker, free], away[rivals[marker]][:, spot]])
            alone[marker], more[marker] = off < EVEN * others.min(initial=np.inf), free.any()
        chosen[carried & ~alone] = -1
        if linked:
            alone, more[~carried], rivals[~carried] = np.where(carried, alone, margins > EVEN), False, False
        like = np.where(chosen >= 0, like[np.arange(len(like)), chosen], 0.0)
        return _Found(spots, chosen, like, alone, more, rivals, reach)

    def _measured(self, image: Image, expected: Array, boxes: NDArray[np.int64]) -> tuple[Spots, NDArray[np.int64]]:
        """The spots in each marker's box by its own colors, told apart from those beside it, and whose box it was."""
        first, last = boxes[:, None, :2], boxes[:, None, 2:]
        beside = np.all((first < boxes[:, 2:]) & (last > boxes[:, :2]), axis=2)[..., None]
        own, ways = np.eye(len(boxes), dtype=bool)[..., None], np.hypot(*self._steps.T)
        asked = np.flatnonzero((boxes[:, :2] < boxes[:, 2:]).all(axis=1))
        found = [
            self._looks.find(image, np.where(own[m], boxes, 0), ways, np.where(beside[m], expected, np.nan))
            for m in asked.tolist()
        ]
        of = np.repeat(asked, [len(spots) for spots in found])
        return self._looks.find(image, np.zeros_like(boxes)).and_(*found), of

    def _seen(self, image: Image, expected: Array, carried: Mask, asked: Mask, found: _Found) -> tuple[Array, Array]:
        """Positions and confidence by the best opinion on each marker."""
        positions, confidence = np.full_like(expected, np.nan), np.zeros(len(expected))
        chosen = found.chosen
        for m in np.flatnonzero(asked).tolist():
            place = found.spots.centers[chosen[m]] if chosen[m] >= 0 else expected[m]
            told = self._chained and bool(self._looks.plain[m])  # by color and by others: better than by a picture
            if carried[m] and not self._lost[m] and found.like[m] < CLEAR and not told:
                again = self._looks.pick_again(image, m, expected[m])
                if again is not None:
                    positions[m], confidence[m], chosen[m] = again, RIGHT, -1
                    continue
            if carried[m] and chosen[m] >= 0:
                positions[m], confidence[m], self._drifted[m] = place, CERTAIN, 0.0
                continue
            near = not contradict(place, expected[m], self.radii[m])
            whole = near or found.like[m] > CLEAR  # and not a part of one that is blurred
            nearby = min(found.reach[m], NEARBY * self.radii[m] + np.hypot(*self._steps[m]))
            reach = AGREE[0] * self.radii[m] + 1 if carried[m] else 1.5 if chosen[m] >= 0 else nearby
            peak, score, only = self._looks.find_picture(image, m, place, reach)
            own = carried[m] and not self._lost[m] and score > SAME and not told
            own = own and not contradict(peak - self._drifted[m], place, self.radii[m])
            if own and self.colors.are_at(image, m, place, self.radii[m]):
                positions[m], confidence[m] = place, RIGHT
                if score < SURELY:
                    self._looks.learn_picture(image, m, place)
                    self._drifted[m] += place - peak
            elif chosen[m] >= 0:
                known = (whole and score > SAME) or (near and told)
                positions[m], confidence[m] = place, LIKELY if known and found.alone[m] else DOUBT
            elif score > SURELY and not told:
                again = self._looks.pick_again(image, m, peak) if only else None
                positions[m], confidence[m] = (peak, DOUBT) if again is None else (again, LIKELY)
            elif carried[m]:
                positions[m], confidence[m] = place, DOUBT
        return positions, confidence

    def _doubles(self, positions: Array, confidence: Array) -> Mask:
        """Markers at another's place, which is certain, or was later; of two equal ones, both."""
        confidence = confidence + 1 / (1 + self._doubtful)
        near = np.linalg.norm(positions[:, None] - positions, axis=2) < self._chain.closest(self.radii)
        np.fill_diagonal(near, False)
        return (near & (confidence[:, None] <= confidence)).any(axis=1)

    def _count(self, positions: Array, sure: Mask, alone: Mask) -> None:
        seen = np.isfinite(positions[:, 0])
        for reason, why in zip(REASONS, (~seen, seen & ~alone, seen & alone), strict=True):
            self.reasons[reason] += ~sure & why

    def _take(self, positions: Array, good: Mask, known: Mask, moves: Moves, carried: Mask, image: Image) -> None:
        """Takes in where the markers were seen, and how they moved."""
        seen, corner = np.isfinite(positions[:, 0]) & (good | carried), np.array(image.shape[1::-1]) - 1
        slower = SLOWER * self._steps
        if (np.abs(moves.steps) > REPEATED).any():
            steps = np.where(carried[:, None], moves.steps, slower)
            self._steps = np.where((self._agreed > 1)[:, None], positions - self._places, steps)
        self._places = np.where(seen[:, None], positions, np.clip(self._places + slower, 0, corner))
        self._doubtful = np.where(known, 0, self._doubtful + 1)
        self._lost = ~known & (self._lost | ~carried)
        self._jumped, self._rivals = self._jumped & ~known, self._rivals & ~known[:, None]
        fastest = np.maximum(SLOWER * self._fastest, np.hypot(*self._steps.T))
        self._fastest = np.where(known, fastest, self._fastest)

    def _learn(self, image: Image, positions: Array, known: Mask, flowed: Mask, found: _Found) -> None:
        """Takes in how markers look that flow followed, and where all are along a chain."""
        alone = ~self._bodies.on & (not self._chained)
        for marker in np.flatnonzero((self._doubtful == 1) & alone).tolist():  # before they change by looking for it
            self.looks[marker] = self._looks.of(np.array([marker]))
        certain = np.flatnonzero(flowed & (found.chosen >= 0))
        self._looks.learn(image, found.spots, certain, found.chosen[certain], np.zeros((len(certain), 2)))
        for markers in [np.arange(len(positions))] if self._chained else self._bodies.large:
            self._looks.grow_together(markers)
        self.radii = self._looks.radii
        for marker in certain.tolist():
            self.colors.learn(image, marker, positions[marker], self.radii[marker])
        step = float(np.median(np.hypot(*self._steps.T)))
        self._chain.learn(np.where(known[:, None], positions, np.nan), float(np.median(self.radii)), step)


def _least(costs: Array, thing_of: NDArray[np.int64]) -> Array:
    """Least costs of things, of which each spot is one. Shapes (M, P), (P,), (M, K)."""
    return np.array([costs[:, thing_of == one].min(axis=1) for one in range(thing_of.max() + 1)]).T


def _assigned(costs: Array) -> NDArray[np.int64]:
    """The thing that each marker is at least cost in all, -1 for none. Shapes (M, K), (M,)."""
    out = np.full(len(costs), -1)
    rows, columns = linear_sum_assignment(costs)
    out[rows] = np.where(costs[rows, columns] < NEVER, columns, -1)
    return out


class _Found(NamedTuple):
    """Spots that look like the markers.

    Attributes:
        spots: What was found.
        chosen: That of each marker, or -1. Shape (M,).
        like: How much it looks like it. Shape (M,).
        alone: Whether it can't be another's. Shape (M,).
        more: Whether another one is like it where it was looked for. Shape (M,).
        rivals: Markers that each one's spot may be as well. Shape (M, M).
        reach: How far from where it was expected each was looked for [px]. Shape (M,).
    """

    spots: Spots
    chosen: NDArray[np.int64]
    like: Array
    alone: Mask
    more: Mask
    rivals: Mask
    reach: Array

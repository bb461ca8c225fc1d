"""Tracks markers by candidates from flow, looks and pictures, weighed by all that is known, and linked over the film.

In each frame a marker has a few candidates: where the flow from its last candidates leads, spots that look like it,
places that look like its picture. Each has a cost (see `trellis`): how little it looks like the marker, how badly its
distances from other markers' candidates fit those that they have kept in this film so far, and how likely another
marker is there; those of one body go together (`configurations`). What nothing fits becomes *not seen*, from where
every place is possible again. No rule decides in a frame: the costs add up, and the film decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from configurations import Body, Candidates, said
from numpy.typing import NDArray
from trellis import SAME, Claims, Frame, advanced, decide, through

from markertrack.tracking.free import _Flow as Flow
from markertrack.tracking.looks import Looks
from markertrack.tracking.spots import Spots
from markertrack.tracking.tracker import REASONS, Array, Image, Mask, check_order, inside

MOST = 5  # candidates that are kept of each marker, besides that it isn't seen
UNSEEN, LOSING = 2.0, 5.0  # cost of a frame in which a marker isn't seen, and of becoming so
PICTURE, UNLIKE = 1.5, 12.0  # cost of a place that looks like the picture, and of one that doesn't at all
FADING = 0.9  # of its step that a marker goes on by in each frame in which it isn't seen
STRANGE = 0.01  # share of steps that nothing foresees
LEAST_LIKE = 0.1  # likeness of a spot that may be the marker
FLOW_NOISE, STEP_NOISE = 0.7, 0.05  # px, and of the step, by which flow is off
GIVE = 0.03  # of a distance within a body by which it changes, until it is known
FORGET = 0.05  # of what is known of a distance, in each frame
WITNESSES = 3.0  # markers that speak for a place independently: a rigid body moves in three ways
FAR = 20.0  # of a path, above which flow isn't asked where it leads
MOST_SAID = 8.0  # cost of a place that no other marker agrees with
CERTAIN = 0.88  # confidence, looking back only, with which a marker is learned from
REPEATED = 0.1  # px that nothing moves by in a picture that repeats the last one
REACH = 2.5  # standard deviations within which a marker is looked for


class LinkedTracker:
    """Follows markers on rigid or soft bodies, or such that nothing connects. See `tracker.Tracker`.

    Attributes:
        reasons: In how many frames each marker was lost or doubtful, by the reason. Shapes (M,).
    """

    def __init__(self, bodies: Sequence[int]) -> None:
        """Takes what the robot file knows.

        Args:
            bodies: Number of the rigid body that carries each marker. Shape (M,).
        """
        numbers = np.asarray(bodies)
        self._pairs = (numbers[:, None] == numbers) & ~np.eye(len(numbers), dtype=bool)

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Learns what the markers look like and how they lie."""
        self._looks, self._flow, self._time = Looks(image, points), Flow(image), time
        places, count = self._looks.points, len(points)
        self._distances = np.linalg.norm(places[:, None] - places, axis=2)
        self._variances = (GIVE * self._distances) ** 2 + 1
        shape = (count, MOST + 1)
        self._places = np.repeat(places[:, None], MOST + 1, axis=1)
        self._velocities = np.zeros((*shape, 2))
        self._costs = np.full(shape, np.inf)
        self._costs[:, 1] = 0.0
        self._fastest, self._unsure = np.zeros(count), np.zeros(count)
        self._unseen = np.zeros(shape)  # frames for which no candidate on the way there was seen
        self._spotted, self._moving = np.ones(shape, dtype=bool), np.zeros(shape, dtype=bool)  # its step is known
        self.reasons = {reason: np.zeros(count, dtype=np.int64) for reason in REASONS}
        self._alone = self._costs  # of paths, whatever other markers do
        none = np.zeros((*shape, MOST + 1))
        self._frames = [Frame(self._places, self._costs, none, none > 0, self.radii)]
        self._claims = Claims.of(self._frames[0], self._costs, np.full(shape, np.inf))
        self._bodies: list[Body] = []
        free = set(np.flatnonzero(self._pairs.any(axis=1)).tolist())
        while free:
            self._bodies.append(Body(places, self._distances, self._pairs, min(free)))
            free -= set(self._bodies[-1].markers.tolist())
        self._ways = [[(body.chosen, body.edges)] for body in self._bodies]
        self._moved = time  # when the picture last changed
        return places.copy(), np.ones(count)

    def decided(self) -> tuple[Array, Array]:
        """Positions and confidence over all frames, as `trellis.decide` has them. Shapes (T, M, 2), (T, M)."""
        paths = [
            through([edges[None] for _, edges in ways], [np.zeros((1, len(chosen))) for chosen, _ in ways])
            for ways in self._ways
        ]
        frames, margins = list(self._frames), []
        for t, frame in enumerate(self._frames):
            bodies = [
                (body.markers, ways[t][0], path[t][0])
                for body, ways, path in zip(self._bodies, self._ways, paths, strict=True)
            ]
            costs, most = said(frame.costs.shape, bodies)
            frames[t] = frame._replace(costs=frame.costs + costs)
            margins.append(most)
        return decide(frames, margins)

    @property
    def radii(self) -> Array:
        """Radius of each marker as it is now [px]. Shape (M,)."""
        return self._looks.radii

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Takes the next frame; positions and confidence are by what was seen so far."""
        check_order(time, self._time)
        self._time, self._steps = time, self._velocities * (time - self._moved)
        count, radii = len(self._costs), self.radii
        every, first = np.arange(count), self._costs.argmin(axis=1)
        foreseen, sigmas, carried, growths, flowed, blind = self._foreseen(image)
        fastest = np.maximum(2 * radii + 4, self._fastest * (time - self._moved))
        wide = np.maximum(fastest[:, None], np.linalg.norm(self._steps, axis=2))
        wide = wide * np.sqrt(1 + self._unseen)
        if self._cut:  # all may be anywhere
            wide = np.maximum(wide, max(image.shape) / REACH)
        blind = np.where(self._moving, np.minimum(blind, wide), wide)
        sigmas = np.where(carried, sigmas, blind)
        sure = carried[every, first] & (self._unsure == 0)
        self._looks.grow(np.where(sure, growths[every, first], 1.0))
        narrow = carried & self._spotted
        boxes = self._boxes(image, foreseen, np.where(narrow, 0.6 * radii[:, None] + 3, REACH * wide))
        spots = self._looks.find(image, boxes)
        last = self._places[every, first]
        stepped = np.linalg.norm(foreseen[every, first] - last, axis=1)
        likeness = self._looks.likeness(spots, last, stepped, 0.7 * radii)
        found = [
            self._candidates(image, m, spots, likeness[m] if len(spots) else np.zeros(0), foreseen[m], flowed[m],
                             sigmas[m], wide[m])
            for m in range(count)
        ]  # fmt: skip
        size = 1 + max(len(costs) for _, costs, _ in found)
        places = np.repeat(foreseen[every, first][:, None], size, axis=1)
        places = places.clip(0, np.array(image.shape[1::-1]) - 1)
        costs, spot = np.full((count, size), np.inf), np.full((count, size), -1)
        costs[:, 0] = UNSEEN
        for m, (there, cost, which) in enumerate(found):
            places[m, 1 : len(cost) + 1], costs[m, 1 : len(cost) + 1], spot[m, 1 : len(cost) + 1] = there, cost, which
        off = ((places[:, None] - foreseen[:, :, None]) ** 2).sum(axis=3)
        moves = _surprise(off, sigmas[:, :, None], wide[:, :, None])
        moves[:, :, 0] = np.where(np.arange(MOST + 1) == first[:, None], LOSING, MOST_SAID + LOSING)
        frame = Frame(places, costs, moves, off < (REACH * sigmas[:, :, None]) ** 2, radii)
        off = ((places[:, None] - (self._places + self._steps)[:, :, None]) ** 2).sum(axis=3)
        unaided = _surprise(off, blind[:, :, None], wide[:, :, None])
        at = Candidates(places, costs, np.stack([moves, unaided]), self._distances, self._variances, radii)
        same = np.maximum(SAME[0], SAME[1] * radii)
        for body in self._bodies:
            before = body.chosen
            body.advance(at, same, UNSEEN)
            body.open(frame.moves, before, body.chosen)
        frame = frame._replace(costs=costs + self._agreement(frame))
        self._keep(image, frame, spots, spot)
        return self._seen

    def _foreseen(self, image: Image) -> _Foreseen:
        """Where each candidate leads."""
        radii, fastest = self.radii, self._fastest * (self._time - self._moved)
        follow = np.isfinite(self._costs) & (self._costs < FAR) & inside(self._places, image)
        follow[:, 0] = False
        rows, columns = np.nonzero(follow)
        steps, carried = self._steps.copy(), np.zeros(follow.shape, dtype=bool)
        growths, sigmas = np.ones(follow.shape), np.broadcast_to(radii[:, None], follow.shape).copy()
        sigmas = 1.0 + 0.3 * sigmas + 0.5 * np.maximum(np.linalg.norm(steps, axis=2), fastest[:, None])
        sigmas += fastest[:, None] * self._unseen  # it may have gone anywhere meanwhile
        blind = sigmas.copy()
        moves = self._flow.follow(image, self._places[rows, columns], radii[rows], self._steps[rows, columns])
        good = moves.errors < np.maximum(1.0, 0.1 * radii[rows])
        good &= inside(self._places[rows, columns] + moves.steps, image)
        self._cut = len(radii) > 1 and len(good) > 1 and not good.any()
        self._repeats = bool(good.any() and np.abs(moves.steps[good]).max() < REPEATED)
        flowed = np.full_like(self._places, np.nan)
        flowed[rows[good], columns[good]] = (self._places[rows, columns] + moves.steps)[good]
        rows, columns = rows[good], columns[good]
        carried[rows, columns], steps[rows, columns] = True, moves.steps[good]
        growths[rows, columns] = moves.growths[good]
        sigmas[rows, columns] = FLOW_NOISE + STEP_NOISE * np.linalg.norm(moves.steps[good], axis=1)
        return _Foreseen(self._places + steps, sigmas, carried, growths, flowed, blind)

    def _boxes(self, image: Image, foreseen: Array, reaches: Array) -> NDArray[np.int64]:
        """Where each marker is looked for: left, top, right, bottom [px]. Shape (M, 4)."""
        used = np.isfinite(self._costs)
        reach = reaches + 0.5 * self.radii[:, None]
        low = np.where(used[..., None], foreseen - reach[..., None], np.inf).min(axis=1)
        high = np.where(used[..., None], foreseen + reach[..., None], -np.inf).max(axis=1)
        size = np.array(image.shape[1::-1])
        return np.concatenate([np.floor(low.clip(0, size)), np.ceil(high.clip(-1, size - 1)) + 1], 1).astype(np.int64)

    def _candidates(
        self, image: Image, m: int, spots: Spots, likeness: Array, foreseen: Array, flowed: Array, sigmas: Array,
        wide: Array,
    ) -> tuple[Array, Array, NDArray[np.int64]]:  # fmt: skip
        """Places of a marker's candidates, their costs by their looks, and the spot of each, -1 for none."""
        radius, used = self.radii[m], np.isfinite(self._costs[m])
        likely = np.flatnonzero(likeness > LEAST_LIKE)
        centers = spots.centers[likely]
        costs = -np.log(likeness[likely])
        if len(likely) > MOST:
            off = ((centers[:, None] - foreseen[used]) ** 2).sum(axis=2)
            path = (self._costs[m, used] + _surprise(off, sigmas[used], wide[used])).min(axis=1)
            nearest = np.argsort(costs + path, kind="stable")[: 2 * MOST]
            likely, centers, costs = likely[nearest], centers[nearest], costs[nearest]
        places, all_costs, which = list(centers), list(costs), likely.tolist()
        plain = bool((costs < 0.7).any())
        flowed = flowed[np.isfinite(flowed[:, 0]) & (self._costs[m] < MOST_SAID)]
        for place in flowed:
            if plain and np.linalg.norm(centers - place, axis=1).min() < 0.1 * radius + 1:
                continue
            peaks = self._looks.find_pictures(image, np.array([m]), place[None], np.array([0.3 * radius + 1]))
            likest = int(peaks.fills.argmax()) if len(peaks) else -1
            fill = float(np.clip(peaks.fills[likest], 0, 1)) if len(peaks) else 0.5
            places.append(peaks.centers[likest] if len(peaks) and radius < 5 else place)
            all_costs.append(PICTURE + UNLIKE * (1 - fill))
            which.append(-1)
        if not plain:  # flow alone may be that of something else
            there = foreseen[self._costs[m].argmin()].clip(0, np.array(image.shape[1::-1]) - 1)
            reach = min(float(wide.max()), (3 if len(flowed) else 6) * radius)
            peaks = self._looks.find_pictures(image, np.array([m]), there[None], np.array([reach]))
            places += list(peaks.centers)
            all_costs += list(PICTURE + UNLIKE * (1 - peaks.fills.clip(0, 1)))
            which += [-1] * len(peaks)
        return np.array(places).reshape(-1, 2), np.array(all_costs), np.array(which, dtype=np.int64)

    def _agreement(self, frame: Frame) -> Array:
        """Cost of each candidate by its distances from those of others, as far as they kept them. Shape (M, C)."""
        out = np.zeros_like(frame.costs)
        if not self._pairs.any():
            return out
        rows, columns = np.nonzero(self._pairs)
        for m in np.unique(rows):
            others = columns[rows == m]
            apart = np.linalg.norm(frame.places[m][None, :, None] - frame.places[others][:, None], axis=3)  # (n, C, C)
            known, variance = self._distances[m, others, None, None], self._variances[m, others, None, None]
            fit = np.minimum((apart - known) ** 2 / (2 * variance), MOST_SAID)
            fit[:, :, 0] = 0.0  # one that isn't seen is nowhere
            said = (frame.costs[others][:, None] + fit).min(axis=2)
            said -= said.min(axis=1, keepdims=True)
            out[m] = np.minimum(said.sum(axis=0) / max(1.0, len(others) / WITNESSES), MOST_SAID)
            out[m, 0] = out[m].min()
        return out

    def _keep(self, image: Image, frame: Frame, spots: Spots, spot: NDArray[np.int64]) -> None:
        """Takes in the cheapest candidates, and learns from what is certain."""
        count, radii = len(frame.costs), self.radii
        every = np.arange(count)
        parents = (self._costs[:, :, None] + frame.moves).argmin(axis=1)
        told, margins = said(frame.costs.shape, [(body.markers, body.chosen, body.costs) for body in self._bodies])
        alone = advanced(self._alone, frame.costs + told, frame.moves)
        claims = self._claims.next(frame, alone, margins)
        costs = advanced(self._costs, frame.costs + told + claims.taken(frame), frame.moves)
        kept = np.zeros((count, MOST + 1), dtype=np.int64)
        used = np.zeros((count, MOST + 1), dtype=bool)
        used[:, 0] = True
        together: list[set[int]] = [set() for _ in range(count)]
        for body in self._bodies:
            for m, own in zip(body.markers.tolist(), body.chosen.T.tolist(), strict=True):
                together[m] = set(own) - {0}
        for m in range(count):
            chosen: list[int] = sorted(together[m])
            for i in np.argsort(costs[m, 1:], kind="stable").tolist():
                if i + 1 in chosen:
                    continue
                if len(chosen) == MOST or not np.isfinite(costs[m, i + 1]):
                    break
                place = frame.places[m, i + 1]
                others = frame.places[m, chosen]
                if not chosen or np.linalg.norm(others - place, axis=1).min() > max(1.0, 0.3 * radii[m]):
                    chosen.append(i + 1)
            kept[m, 1 : len(chosen) + 1], used[m, 1 : len(chosen) + 1] = chosen, True
        rows = every[:, None]
        places = frame.places[rows, kept]
        parent = parents[rows, kept]
        near = frame.steady[rows, parent, kept] & (parent > 0)
        if self._repeats:  # what moves goes on
            velocities = self._velocities[rows, parent]
        else:
            velocities = (places - self._places[rows, parent]) / (self._time - self._moved)
            velocities = np.where(near[..., None], velocities, 0.0)  # of a jump nothing follows
            near[:, 0] = self._moving[every, parents[:, 0]]
            velocities[:, 0] = FADING * self._velocities[every, parents[:, 0]]
            self._moved = self._time
        moves = np.where(used[:, None], np.take_along_axis(frame.moves, kept[:, None], axis=2), np.inf)
        own = np.where(used, np.take_along_axis(frame.costs, kept, axis=1), np.inf)
        self._unseen = np.where(np.arange(MOST + 1) == 0, self._unseen[rows, parent] + 1, 0.0)
        steady = np.take_along_axis(frame.steady, kept[:, None], axis=2)
        self._frames.append(Frame(places, own, moves, steady, radii))
        slots = (kept[:, :, None] == np.arange(frame.costs.shape[1])).argmax(axis=1)
        for body, ways in zip(self._bodies, self._ways, strict=True):
            body.chosen = slots[body.markers, body.chosen]
            ways.append((body.chosen, body.edges))
        margins = np.take_along_axis(margins, kept, axis=1)
        self._places, self._velocities, self._moving = places, velocities, near
        self._costs, self._alone = (np.where(used, np.take_along_axis(a, kept, axis=1), np.inf) for a in (costs, alone))
        index = np.where(kept == claims.chosen[:, None], np.arange(MOST + 1), 0).max(axis=1)
        self._claims = claims._replace(chosen=index)
        self._seen = positions, confidence = Claims.of(self._frames[-1], self._costs, margins).seen(self._frames[-1])
        certain = confidence > CERTAIN
        like = np.where(positions[:, 0] == positions[:, 0], own.min(axis=1) < UNSEEN / 2, False)
        for reason, why in zip(REASONS, (np.isnan(positions[:, 0]), like, ~like), strict=True):
            self.reasons[reason] += (confidence < 0.5) & why & ((reason == REASONS[0]) | np.isfinite(positions[:, 0]))
        self._unsure = np.where(certain, 0, self._unsure + 1)
        first = self._costs.argmin(axis=1)
        speed = np.linalg.norm(velocities[every, first], axis=1)
        self._fastest = np.where(certain, np.maximum(0.9 * self._fastest, speed), self._fastest)
        self._spotted = used & (spot[rows, kept] >= 0)
        of = spot[every, kept[every, first]]
        learned = np.flatnonzero(certain & (of >= 0))
        self._looks.learn(image, spots, learned, of[learned], np.zeros((len(learned), 2)))
        known = np.where(certain[:, None], positions, np.nan)
        apart = np.linalg.norm(known[:, None] - known, axis=2)
        both = self._pairs & np.isfinite(apart)
        off = np.where(both, apart - self._distances, 0.0)
        self._variances += np.where(both, FORGET * ((4 * off**2).clip(0.5, 9 * self._variances) - self._variances), 0.0)
        self._distances += 0.4 * FORGET * off


class _Foreseen(NamedTuple):
    """Where candidates lead.

    Attributes:
        places: Places in the next frame [px]. Shape (M, C, 2).
        sigmas: Standard deviation of the marker beside them [px]. Shape (M, C).
        carried: Whether flow says so. Shape (M, C).
        growths: By how much each grows. Shape (M, C).
        flowed: Where flow leads, NaN for nowhere [px]. Shape (M, C, 2).
        blind: Standard deviation by the last step alone [px]. Shape (M, C).
    """

    places: Array
    sigmas: Array
    carried: Mask
    growths: Array
    flowed: Array
    blind: Array


def _surprise(squares_off: Array, sigma: Array, wide: Array) -> Array:
    """Cost of a step that ends off where it was foreseen: a Gaussian, or rarely a wide one [1 / px²]."""
    narrow = (1 - STRANGE) / sigma**2 * np.exp(-squares_off / (2 * sigma**2))
    return -np.log(narrow + STRANGE / wide**2 * np.exp(-squares_off / (2 * wide**2)) + 1e-12)

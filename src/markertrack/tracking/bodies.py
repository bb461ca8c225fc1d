"""What bodies of several markers tell of them, rigid or soft: pendulums, arms, plates, rows of equal dots, skins.

In each frame: predict how each body moves (`body`), find spots that look like its markers (`looks`), label the markers
of all bodies together (`rigid`), and doubt a body whose labels could as well be others. A body that is lost is searched
for farther away in each frame. One that was doubted is doubted until its labels are certain from where it may have
gone since. What has no spot, or is in doubt, flow follows (`markers`), from which the body learns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.body import STIFF, Body
from markertrack.tracking.looks import Looks, squares
from markertrack.tracking.rigid import LEAD, Expected, Labeled, distance, label, rigid_fit
from markertrack.tracking.spots import Spots, are_whole, streaks
from markertrack.tracking.tracker import AGAIN, DOUBT, EXACT, Array, Image, Mask, inside

FAR = 4.0  # times how far a body may easily be from where it is expected: a push, or a mistake
LEAST_LIKE = 0.3  # likeness of a spot that is certain to be the marker
ADAPT_TIME = 1.0  # s over which a body's shape in the picture changes: perspective, lens


class Bodies:
    """Which spots the markers on each body are, all of them at once.

    Attributes:
        on: Markers that are on a body with others. Shape (M,).
    """

    def __init__(self, numbers: NDArray[np.int64], fixed: int | None, places: Array, time: float) -> None:
        """Takes the first frame.

        Args:
            numbers: Number of the body that carries each marker; one that is alone on its body is told nothing. Shape
                (M,).
            fixed: The body that can't move, if any marker is on one.
            places: Of the markers [px]. Shape (M, 2).
            time: Time stamp [s].
        """
        self._numbers, self._bodies = numbers, list[Body]()
        for number, count in zip(*np.unique(numbers, return_counts=True), strict=True):
            markers = np.flatnonzero(numbers == number)
            if count > 1:
                self._bodies.append(Body(markers, number == fixed, places[markers], time))
        self.on = np.isin(numbers, [numbers[body.markers[0]] for body in self._bodies])
        self._time = time
        self._fastest = 0.0

    @property
    def large(self) -> list[NDArray[np.int64]]:
        """Markers of each body that has three or more."""
        return [body.markers for body in self._bodies if len(body.markers) > 2]

    def turn(self) -> None:
        """Takes in that the film is played backward from here on."""
        for body in self._bodies:
            body.turn_back()

    def place(self, image: Image, looks: Looks, time: float) -> Placed:
        """Finds the markers in the next frame, and has their looks learned where they are certain."""
        self._looks = looks
        if not self._bodies:
            nowhere = np.full((len(self._numbers), 2), np.nan)
            return Placed(nowhere, np.zeros(len(self._numbers)), nowhere)
        predicted = [body.predicted(time) for body in self._bodies]
        expected = self._expected(predicted, [False] * len(predicted))
        spots, likeness, labeled = self._labeled(image, expected)
        missing = [
            bool(np.count_nonzero(one.spots >= 0) < inside(places, image).sum())
            for one, places in zip(labeled, predicted, strict=True)
        ]
        if any(missing):
            expected = self._expected(predicted, missing)
            spots, likeness, labeled = self._labeled(image, expected)
        placed = self._taken(image, spots, likeness, labeled, time)
        self._time = time
        return placed

    def learn(self, positions: Array, more: Mask, placed: Placed) -> None:
        """Takes in where markers are that flow found in the newest frame.

        Args:
            positions: All that are known, NaN of others [px]. Shape (M, 2).
            more: Those that flow found. Shape (M,).
            placed: What the bodies told.
        """
        for body in self._bodies:
            of, believed = body.markers, placed.confidence[body.markers] > DOUBT
            if more[of].any() and body.doubt == 0.0:
                body.adapt(positions[of], 0.0, self._firm(body))
            if more[of].sum() > 1 and not believed.any():
                body.carry(positions[of], self._time, self._radius(body))

    def _expected(self, predicted: list[Array], pushed: list[bool]) -> list[Expected]:
        """Where the bodies should be, of which some may have been pushed farther than they are usually looked for."""
        expected: list[Expected] = []
        for body, places, far in zip(self._bodies, predicted, pushed, strict=True):
            radius = self._radius(body)
            usual, reach = body.spread(radius), 3 * radius + 4
            spread = usual + body.doubt
            near = reach if body.fixed else max(3 * spread, reach)
            reach = near if body.fixed or not far else max(near, 18 * radius)
            tolerance = min(0.3 * radius + 1.0 + 0.08 * body.step, radius)
            lost = not body.fixed and body.doubt > 0
            swing = STIFF + 0.5 * body.turn + body.swing
            held = places if body.held is None else body.held
            expected.append(Expected(places, held, body.pairs, spread, usual, swing, near, reach, tolerance, lost))
        return expected

    def _firm(self, body: Body) -> float:
        return EXACT[1] * self._radius(body) + 0.3

    def _radius(self, body: Body) -> float:
        return float(np.median(self._looks.radii[body.markers]))

    def _labeled(self, image: Image, expected: list[Expected]) -> tuple[Spots, Array, list[Labeled]]:
        """The spots of the markers' colors, how much each looks like each marker, and labels of the bodies."""
        boxes, places = np.zeros((len(self._numbers), 4), dtype=np.int64), np.full((len(self._numbers), 2), np.nan)
        for body, one in zip(self._bodies, expected, strict=True):
            boxes[body.markers], places[body.markers] = squares(one.places, one.reach), one.places
        spots = self._looks.find(image, boxes, self._steps(), places)
        looks = self._likeness(spots)
        size = (image.shape[1], image.shape[0])
        return spots, looks, label(expected, spots.centers, [looks[body.markers] for body in self._bodies], size)

    def _likeness(self, spots: Spots) -> Array:
        """How much each spot looks like each marker, of which none is blurred by more than it moved. Shape (M, P)."""
        last = np.zeros((len(self._numbers), 2))
        for body in self._bodies:
            last[body.markers] = body.history[-1][1]
        return self._looks.likeness(spots, last, self._steps())

    def _steps(self) -> Array:
        """How far each marker's body moved last [px]. Shape (M,)."""
        steps = np.zeros(len(self._numbers))
        for body in self._bodies:
            steps[body.markers] = body.step
        return steps

    def _taken(self, image: Image, spots: Spots, likeness: Array, labeled: list[Labeled], time: float) -> Placed:
        """Positions and confidence; each body takes in how it moved and how certain that is."""
        found = _Found(len(self._numbers), likeness)
        for body, one in zip(self._bodies, labeled, strict=True):
            found.leads[body.markers] = one.own_leads
            self._take(body, spots, one, found, time)
        for body in self._twice(found.positions):
            body.lose(2 * self._radius(body))
            body.doubt = body.doubt or body.spread(self._radius(body))
            found.spots[body.markers], found.positions[body.markers] = -1, np.nan
        seen, sure = found.spots >= 0, np.zeros(len(self._numbers), dtype=bool)
        for body in self._bodies:
            sure[body.markers] = body.doubt == 0.0
        sure &= (found.leads >= LEAD) & (found.likes > LEAST_LIKE)
        confidence = self._confidence(found)
        confidence = np.where(seen, np.where(sure, confidence, np.minimum(confidence, DOUBT)), 0.0)
        certain = confidence > DOUBT
        known = np.where(certain[:, None], found.positions, np.nan)
        for body in self._bodies:
            if body.doubt == 0.0 and not body.fixed:
                rate = min(1.0, (time - self._time) / ADAPT_TIME)
                body.adapt(known[body.markers], rate, self._firm(body))
        self._looks.learn(image, spots, np.flatnonzero(certain), found.spots[certain], found.blur[certain])
        laid = np.full_like(found.positions, np.nan)
        for body in self._bodies:
            if certain[body.markers].any():
                laid[body.markers] = body.history[-1][1]
        return Placed(found.positions, confidence, laid)

    def _take(self, body: Body, spots: Spots, one: Labeled, found: _Found, time: float) -> None:
        """Takes in what one body's labels are: where it is, or that it is lost, and whether that is certain."""
        places, seen, radius = one.places, one.spots >= 0, self._radius(body)
        last, frames, guess = body.history[-1][1], body.unseen + 1, body.predicted(time)
        away = distance(rigid_fit(guess, places), guess) if seen.any() else 0.0
        far, few = not body.fixed and away > FAR * body.spread(radius), len(seen) < 3
        less = body.doubt > 0 and seen.sum() < min(len(seen), 2)
        way = max(1.5 * self._fastest, 2 * radius)
        if not seen.any() or less or (far and one.lead < LEAD):
            body.lose(way)
            return
        markers, chosen = body.markers[seen], one.spots[seen]
        found.spots[markers], found.positions[markers] = chosen, places[seen]
        found.likes[markers], found.fills[markers] = found.looks[markers, chosen], spots.fills[chosen]
        found.blur[markers] = streaks(self._looks.spread(spots, markers, chosen))
        found.shares[markers] = self._looks.share(spots, markers, chosen)
        if few and not (found.likes[markers] > LEAST_LIKE).any():  # better where it was expected than there
            body.doubt = body.doubt or body.spread(radius)
            body.lose(0.5 * (radius + body.step))
            return
        if far:
            body.doubt = body.doubt or body.spread(radius)
            body.begin(places, time, self._fastest if few else 0.0)
        else:
            body.follow(places, time)
        found.off[markers] = np.linalg.norm(rigid_fit(body.shape, places) - places, axis=1)[seen]
        body.followed = body.followed + 1 if one.lead >= LEAD else 0
        if one.lead >= LEAD:
            if body.doubt == 0.0 or (body.followed >= AGAIN and not self._rivals(body)):
                body.hold(0.0, 0.0)
        elif seen.all() or body.fixed:
            body.hold(max(one.apart, body.spread(radius)), one.turned)
        else:
            body.hold(body.doubt + way, body.swing, last)
        if body.doubt == 0.0 and not body.fixed:
            self._fastest = max(self._fastest, distance(body.history[-1][1], last) / frames)

    def _rivals(self, body: Body) -> bool:
        """Whether a body of the same shape isn't found again for sure either, and may be what was found."""
        lost = [one for one in self._bodies if one is not body and one.doubt > 0 and one.followed < AGAIN]
        alike = [one for one in lost if len(one.shape) == len(body.shape)]
        return any(distance(rigid_fit(one.shape, body.shape), body.shape) < self._radius(body) for one in alike)

    def _twice(self, positions: Array) -> list[Body]:
        """Bodies of which a marker is where that of another body is, which is the more certain of the two (M, 2)."""
        apart = np.linalg.norm(positions[:, None] - positions, axis=2)
        near = (apart < self._looks.radii) & (self._numbers[:, None] != self._numbers)
        bodies = {int(m): body for body in self._bodies for m in body.markers}
        pairs = [(bodies[int(i)], bodies[int(j)]) for i, j in np.argwhere(near) if i < j]
        return [max(pair, key=lambda body: (body.doubt, -body.followed)) for pair in pairs]

    def _confidence(self, found: _Found) -> Array:
        """How much spots look like their marker at its place, from 0 to 1. Shape (M,)."""
        radii = self._looks.radii
        allowed = 0.3 * radii + 1.0
        confidence = (0.5 + 0.5 * np.minimum(found.fills, 1.0)) * (1 - 0.3 * np.minimum(found.off / allowed, 1.0) ** 2)
        sure = are_whole(found.shares) & (found.off < allowed)
        return np.where(sure, confidence, np.minimum(confidence, DOUBT))


class Placed(NamedTuple):
    """What bodies tell of a frame.

    Attributes:
        positions: Of their markers, NaN of others and such that aren't seen [px]. Shape (M, 2).
        confidence: From 0 to 1. Shape (M,).
        laid: Where all markers of bodies are that were found [px]. Shape (M, 2).
    """

    positions: Array
    confidence: Array
    laid: Array


class _Found:
    """What was found of each marker in a frame.

    Attributes:
        looks: How much each spot looks like each marker. Shape (M, P).
        spots: Spot of each, -1 for none. Shape (M,).
        positions: Its place [px]. Shape (M, 2).
        off: How far that is from its place on the body [px]. Shape (M,).
        blur: How far it moved during the exposure [px]. Shape (M, 2).
        likes: How much its spot looks like it. Shape (M,).
        shares: Area of its spot, as a share of what is usual. Shape (M,).
        fills: How evenly its spot is covered. Shape (M,).
        leads: By how much its label is better than any other. Shape (M,).
    """

    def __init__(self, count: int, looks: Array) -> None:
        self.looks, self.spots = looks, np.full(count, -1)
        self.positions, self.blur = np.full((count, 2), np.nan), np.zeros((count, 2))
        self.off, self.likes, self.shares, self.fills = np.zeros((4, count))
        self.leads = np.full(count, np.inf)

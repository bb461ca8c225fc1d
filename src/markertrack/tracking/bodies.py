"""Tracks markers on bodies of several, rigid or soft: pendulums, arms, plates, rows of equal dots, skins.

In each frame: predict how each body moves (`body`), find spots that look like its markers (`looks`), label the markers
of all bodies together (`rigid`), and doubt a body whose labels could as well be others. A body that is lost is searched
for farther away in each frame. One that was doubted is doubted until its labels are certain from where it may have
gone since.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from markertrack.tracking.body import AGAIN_FRAMES, STIFF, Body, distance
from markertrack.tracking.looks import LIKE, NEARBY, Looks, squares
from markertrack.tracking.rigid import Expected, Labeling, label, rigid_fit
from markertrack.tracking.spots import Spots, streaks
from markertrack.tracking.tracker import DOUBT, REASONS, Array, Image, Mask, check_order, inside

LEAD = 4.0  # by which labels must be better than any others to be sure: two fifths of a missing marker
MANY = 5  # markers of a body of which it can be seen that it isn't rigid
WHOLE = (0.72, 1.4)  # area of a spot, as a share of a marker's, that is neither partly hidden nor more than one
FAR = 4.0  # times how far a body may easily be from where it is expected: a push, or a mistake
LEAST_LIKE = 0.3  # likeness of a spot that is certain to be the marker
ADAPT_TIME = 1.0  # s over which a body's shape in the picture changes: perspective, lens
SOFT = 1.0  # radii by which the shape of a body of many markers changed that isn't rigid
FIRM = 0.1  # radii by which markers may be beside their places on a rigid body


class BodyTracker:
    """Follows markers on rigid bodies. See `tracker.Tracker`.

    Attributes:
        reasons: In how many frames each marker was lost or doubtful, by the reason. Shapes (M,).
    """

    def __init__(self, bodies: Sequence[int], fixed: int | None = None) -> None:
        """Takes what the robot file knows.

        Args:
            bodies: Number of the rigid body that carries each marker. Shape (M,).
            fixed: The body that can't move, if any marker is on one.
        """
        self._numbers = np.asarray(bodies)
        self._fixed = fixed

    def start(self, image: Image, points: Array, time: float) -> tuple[Array, Array]:
        """Learns what the markers look like and how they lie on their bodies."""
        self._looks = Looks(image, points)
        positions = self._looks.points
        self._bodies: list[Body] = []
        for number in dict.fromkeys(self._numbers.tolist()):
            markers = np.flatnonzero(self._numbers == number)
            self._bodies.append(Body(markers, number == self._fixed, positions[markers], time))
        self.reasons = {reason: np.zeros(len(points), dtype=np.int64) for reason in REASONS}
        self._time = time
        self._fastest = 0.0
        return positions.copy(), np.ones(len(points))

    def follow(self, image: Image, time: float) -> tuple[Array, Array]:
        """Finds the markers in the next frame."""
        check_order(time, self._time)
        if not self._bodies:  # all were left
            return np.full((len(self._numbers), 2), np.nan), np.zeros(len(self._numbers))
        predicted = [body.predicted(time) for body in self._bodies]
        expected = self._expected(predicted, [False] * len(predicted))
        spots, labeling = self._labeled(image, expected)
        spots, labeling, pictures = self._with_pictures(image, spots, labeling, expected)
        missing = [
            bool(np.count_nonzero(labels >= 0) < inside(places, image).sum())
            for labels, places in zip(labeling.spots, predicted, strict=True)
        ]
        if any(missing):
            expected = self._expected(predicted, missing)
            spots, labeling = self._labeled(image, expected, pictures)
            spots, labeling, _ = self._with_pictures(image, spots, labeling, expected)
        result = self._taken(image, spots, labeling, expected, time)
        self._time = time
        return result

    def turn(self) -> None:
        """Takes in that the film is played backward from here on."""
        for body in self._bodies:
            body.turn_back()

    def _expected(self, predicted: list[Array], pushed: list[bool]) -> list[Expected]:
        """Where the bodies should be, of which some may have been pushed farther than they are usually looked for."""
        expected: list[Expected] = []
        for body, places, far in zip(self._bodies, predicted, pushed, strict=True):
            radius = self._radius(body)
            usual, reach = body.spread(radius), 3 * radius + 4
            spread = max(usual, body.doubt)
            near = reach if body.fixed else max(3 * spread, reach)
            reach = near if body.fixed or not far else max(near, 18 * radius)
            tolerance = min(0.3 * radius + 1.0 + 0.08 * body.step, radius)
            lost = not body.fixed and body.doubt > 0
            swing = STIFF + 0.5 * body.turn + body.swing
            expected.append(Expected(places, body.pairs, spread, usual, swing, near, reach, tolerance, lost))
        return expected

    def soft(self) -> list[NDArray[np.int64]]:
        """Markers of each body that doesn't keep its shape."""
        many = [body for body in self._bodies if len(body.markers) >= MANY]
        return [body.markers for body in many if body.changed > SOFT * self._radius(body)]

    def parts(self) -> list[NDArray[np.int64]]:
        """Markers of each body."""
        return [body.markers for body in self._bodies]

    def known(self, markers: NDArray[np.int64]) -> tuple[Looks, Array]:
        """What the markers of a body look like and where it was last [px]."""
        return self._looks.of(markers), self.laid(markers)

    def laid(self, markers: NDArray[np.int64]) -> Array:
        """Where the markers of a body lie by where it was last [px]. Shape (M, 2)."""
        return self._of(markers).history[-1][1]

    def carry(self, markers: NDArray[np.int64], places: Array, time: float) -> None:
        """Takes in where flow brought a body that wasn't found, NaN where it doesn't know [px]. Shape (M, 2)."""
        body = self._of(markers)
        body.carry(places, time, self._radius(body))

    def learn(self, markers: NDArray[np.int64], places: Array, more: Mask, looks: Looks) -> None:
        """Takes in where flow found more markers of a body, and how they look now.

        Args:
            markers: Those of the body. Shape (M,).
            places: Where they are in the newest frame, NaN of those that nobody found [px]. Shape (M, 2).
            more: Which were found by flow. Shape (M,).
            looks: What they look like to it.
        """
        body = self._of(markers)
        self._looks.take(markers[more], looks, np.flatnonzero(more))
        if body.doubt == 0.0:
            body.adapt(places, 0.0, self._firm(body))

    def _firm(self, body: Body) -> float:
        return FIRM * self._radius(body) + 0.3

    def leave(self, markers: NDArray[np.int64]) -> tuple[Looks, Array]:
        """Doesn't follow a body any longer, which is that of these markers: what is `known` of it."""
        known = self.known(markers)
        self._bodies = [body for body in self._bodies if body.markers[0] != markers[0]]
        return known

    def _of(self, markers: NDArray[np.int64]) -> Body:
        return next(body for body in self._bodies if body.markers[0] == markers[0])

    @property
    def radii(self) -> Array:
        """Radius of each marker as it is now [px]. Shape (M,)."""
        return self._looks.radii

    def _radius(self, body: Body) -> float:
        return float(np.median(self._looks.radii[body.markers]))

    def _labeled(self, image: Image, expected: list[Expected], others: Spots | None = None) -> tuple[Spots, Labeling]:
        """Labels of the bodies among the spots of the markers' colors, and others."""
        boxes, places = np.zeros((len(self._numbers), 4), dtype=np.int64), np.full((len(self._numbers), 2), np.nan)
        for body, one in zip(self._bodies, expected, strict=True):
            boxes[body.markers], places[body.markers] = squares(one.places, one.reach), one.places
        spots = self._looks.find(image, boxes, self._steps(), places)
        if others is not None:
            spots = self._looks.added(spots, self._likeness(spots), others)
        return self._among(image, spots, expected)

    def _among(self, image: Image, spots: Spots, expected: list[Expected]) -> tuple[Spots, Labeling]:
        looks = self._likeness(spots)
        height, width = image.shape[:2]
        return spots, label(expected, spots.centers, [looks[body.markers] for body in self._bodies], (width, height))

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

    def _with_pictures(
        self, image: Image, spots: Spots, labeling: Labeling, expected: list[Expected]
    ) -> tuple[Spots, Labeling, Spots | None]:
        """Looks by their pictures for markers of which no spot of their color was found that is like them."""
        looks = self._likeness(spots)
        markers: list[int] = []
        places: list[Array] = []
        reaches: list[float] = []
        for body, labels, one in zip(self._bodies, labeling.spots, expected, strict=True):
            like = np.where(labels >= 0, looks[body.markers, labels] if len(spots) else 0.0, 0.0)
            found = np.full_like(one.places, np.nan)
            good = like > LIKE
            found[good] = spots.centers[labels[good]]
            laid = rigid_fit(one.places, found)
            reach = one.tolerance + 1.0
            if not good.any() or (len(labels) < 3 and distance(laid, one.places) > 2 * one.usual):
                good[:], laid = False, one.places
                reach = min(one.near, one.tolerance + 2 * one.usual, NEARBY * self._radius(body))
            for m in np.flatnonzero(~good & inside(laid, image)):
                markers.append(int(body.markers[m]))
                places.append(laid[m])
                reaches.append(reach)
        if not markers:
            return spots, labeling, None
        more = self._looks.find_pictures(image, np.array(markers), np.array(places), np.array(reaches))
        if not len(more):
            return spots, labeling, None
        return (*self._among(image, self._looks.added(spots, looks, more), expected), more)

    def _taken(
        self, image: Image, spots: Spots, labeling: Labeling, expected: list[Expected], time: float
    ) -> tuple[Array, Array]:
        """Positions and confidence; each body takes in how it moved and how certain that is."""
        found = _Found(len(self._numbers), self._likeness(spots))
        for body, labels, lead, own, one in zip(
            self._bodies, labeling.spots, labeling.leads, labeling.own_leads, expected, strict=True
        ):
            found.leads[body.markers] = own
            self._take(body, spots, labels, lead, one, found, time)
        for body in self._twice(found.positions):
            body.lose(2 * self._radius(body))
            body.doubt = body.doubt or body.spread(self._radius(body))
            found.spots[body.markers], found.positions[body.markers] = -1, np.nan
        seen, sure = found.spots >= 0, np.zeros(len(self._numbers), dtype=bool)
        for body in self._bodies:
            sure[body.markers] = body.doubt == 0.0
        sure &= (
            (found.leads >= LEAD) & (found.likes > LEAST_LIKE) & ~self._cut(np.linalg.norm(found.blur, axis=1), seen)
        )
        confidence = self._confidence(found)
        confidence = np.where(seen, np.where(sure, confidence, np.minimum(confidence, DOUBT)), 0.0)
        for reason, why in zip(REASONS, (~seen, ~sure & seen, sure), strict=True):
            self.reasons[reason] += (confidence <= DOUBT) & why
        certain = np.flatnonzero(confidence > DOUBT)
        colored = certain[~self._looks.by_picture(spots, found.spots[certain])]
        known = np.full_like(found.positions, np.nan)
        known[colored] = found.positions[colored]
        for body in self._bodies:
            if body.doubt == 0.0 and not body.fixed:
                rate = min(1.0, (time - self._time) / ADAPT_TIME)
                body.adapt(known[body.markers], rate, self._firm(body))
        self._looks.learn(image, spots, certain, found.spots[certain], found.blur[certain])
        return found.positions, confidence

    def _take(
        self, body: Body, spots: Spots, labels: NDArray[np.int64], lead: float, one: Expected, found: _Found,
        time: float,
    ) -> None:  # fmt: skip
        """Takes in what one body's labels are: where it is, or that it is lost, and whether that is certain."""
        seen, radius = labels >= 0, self._radius(body)
        places = np.full((len(labels), 2), np.nan)
        places[seen] = spots.centers[labels[seen]]
        last, frames, guess = body.history[-1][1], body.unseen + 1, body.predicted(time)
        away = distance(rigid_fit(guess, places), guess) if seen.any() else 0.0
        far, few = not body.fixed and away > FAR * body.spread(radius), len(seen) < 3
        if far and few and self._looks.by_picture(spots, labels[seen]).any():
            seen[:] = False  # a picture alone isn't enough to find it elsewhere
        less = body.doubt > 0 and seen.sum() < min(len(seen), 2)
        if not seen.any() or less or (far and lead < LEAD):
            body.lose(max(1.5 * self._fastest, 2 * radius))
            return
        markers, chosen = body.markers[seen], labels[seen]
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
        if lead < LEAD:
            body.doubt = body.doubt or 0.5 * one.reach
        elif body.followed >= AGAIN_FRAMES and not self._rivals(body):
            body.doubt = body.swing = 0.0
        if body.doubt == 0.0 and not body.fixed:
            self._fastest = max(self._fastest, distance(body.history[-1][1], last) / frames)

    def _rivals(self, body: Body) -> bool:
        """Whether a body of the same shape isn't found again for sure either, and may be what was found."""
        lost = [one for one in self._bodies if one is not body and one.doubt > 0 and one.followed < AGAIN_FRAMES]
        alike = [one for one in lost if len(one.shape) == len(body.shape)]
        return any(distance(rigid_fit(one.shape, body.shape), body.shape) < self._radius(body) for one in alike)

    def _twice(self, positions: Array) -> list[Body]:
        """Bodies of which a marker is where that of another body is, which is the more certain of the two (M, 2)."""
        apart = np.linalg.norm(positions[:, None] - positions, axis=2)
        near = (apart < self._looks.radii) & (self._numbers[:, None] != self._numbers)
        bodies = {int(m): body for body in self._bodies for m in body.markers}
        pairs = [(bodies[int(i)], bodies[int(j)]) for i, j in np.argwhere(near) if i < j]
        return [max(pair, key=lambda body: (body.doubt, -body.followed)) for pair in pairs]

    def _cut(self, streaks: Array, seen: Mask) -> Mask:
        """Markers with a streak that is too long or too short for how far they moved, off its middle. Shape (M,)."""
        steps = np.zeros(len(seen))
        for body in self._bodies:
            if len(body.history) > 1:
                steps[body.markers] = np.linalg.norm(body.history[-1][1] - body.history[-2][1], axis=1)
        radii = self._looks.radii
        fast = seen & (steps > radii)
        if fast.sum() < 3:
            return np.zeros(len(seen), dtype=bool)
        shutter = np.median(streaks[fast] / steps[fast])
        return fast & (np.abs(streaks - shutter * steps) > np.maximum(6.0, 0.6 * radii))

    def _confidence(self, found: _Found) -> Array:
        """How much spots look like their marker at its place, from 0 to 1. Shape (M,)."""
        radii = self._looks.radii
        allowed = 0.3 * radii + 1.0
        confidence = (0.5 + 0.5 * np.minimum(found.fills, 1.0)) * (1 - 0.3 * np.minimum(found.off / allowed, 1.0) ** 2)
        sure = (found.shares > WHOLE[0]) & (found.shares < WHOLE[1]) & (found.off < allowed)
        return np.where(sure, confidence, np.minimum(confidence, DOUBT))


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

"""The markers on a body, as far as tracking knows it: names, places at rest, and which keep their distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from swimbase.arrays import Array
from swimbase.errors import TrackingError


@dataclass(frozen=True)
class Layout:
    """M markers on a body.

    Attributes:
        names: Names of the markers; of a chain head first.
        rest: Positions at rest in the plane of the camera [m]. Shape (M, 2).
        heights: Heights toward the camera, which sees higher ones nearer [m]. Shape (M,).
        bodies: Number of the rigid body that carries each marker: markers of one body keep their distances.
        chain: Whether the markers stand in a row along a flexible body, the first two on its head.
        body: The body, as a sentence names it.
    """

    names: tuple[str, ...]
    rest: Array
    heights: Array
    bodies: tuple[int, ...]
    chain: bool = False
    body: str = "this body"

    def __post_init__(self) -> None:
        count = len(self.names)
        if not count == len(self.rest) == len(self.heights) == len(self.bodies):
            raise TrackingError(
                f"the layout has {count} names, {len(self.rest)} places at rest, {len(self.heights)} heights and "
                f"{len(self.bodies)} bodies; each marker needs one of each"
            )

    @classmethod
    def of(cls, names: Sequence[str], rest: object = None) -> Layout:
        """Markers of which nothing but names, and places at rest, is known: each is on a body of its own.

        Args:
            names: Names of the markers.
            rest: Positions at rest [m], shape (M, 2); all 0 where they aren't known.
        """
        count = len(names)
        places = np.zeros((count, 2)) if rest is None else np.asarray(rest, dtype=np.float64)
        return cls(tuple(names), places, np.zeros(count), tuple(range(count)))

    @property
    def rigid(self) -> tuple[int, ...]:
        """Indices of the first marker and of those on its body, whose distances tell the scale of a film."""
        return tuple(m for m, body in enumerate(self.bodies) if body == self.bodies[0])

    @property
    def level(self) -> Layout:
        """The same, with all markers as high as the first: a midline is seen in one plane, however high sites stand."""
        return replace(self, heights=np.full(len(self.names), self.heights[0]))

    @property
    def places_along(self) -> Array:
        """Where the markers are along the body at rest, from 0 at the first, the head, to 1 at the last. Shape (M,).

        Raises:
            TrackingError: They don't stand in a row.
        """
        travel = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.rest, axis=0).T))])
        ahead = np.diff(self.rest @ (self.rest[-1] - self.rest[0]))
        if len(self.names) < 2 or not (ahead > 0).all():
            raise TrackingError(
                f"the markers of {self.body} ({', '.join(self.names)}) don't stand in a row from head to tail at rest; "
                "a midline takes sites on the spine, the first at the head and the last at the tail"
            )
        return travel / travel[-1]

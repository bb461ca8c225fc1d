"""The parameters that were found: where they lie within their bounds and what they do."""

from __future__ import annotations

from dataclasses import dataclass

from swim2real.report.run import Json, ReportedRun
from swim2real.report.units import NOTHING, mm, significant

ON_BOUND = 0.01  # of the unit cube


@dataclass(frozen=True)
class ParameterRow:
    """One parameter, as texts.

    Attributes:
        name: Identifier.
        unit: Empty for a pure number.
        value: At the best parameters.
        lower: Bound.
        upper: Bound.
        published: Value of the prior work.
        meaning: In a sentence or two.
        position: Within the bounds on the run's scale [%].
        published_position: Likewise [%].
        bound: `lower` or `upper` when it lies on that bound, else empty.
        down: Change of the loss for a step down [mm], signed; empty when it wasn't determined.
        up: Likewise for a step up.
        verdict: `identified`, `weak`, `not identified`, or empty.
    """

    name: str
    unit: str
    value: str
    lower: str
    upper: str
    published: str
    meaning: str
    position: float
    published_position: float
    bound: str
    down: str
    up: str
    verdict: str


def parameter_rows(run: ReportedRun) -> tuple[ParameterRow, ...]:
    """One row a parameter, in the order of the space."""
    values: Json = run.best["values"]
    published = {p.name: min(max(p.published, p.lower), p.upper) for p in run.space}
    positions, published_positions = run.space.to_cube(values), run.space.to_cube(published)
    rows: list[ParameterRow] = []
    for i, p in enumerate(run.space):
        position = float(positions[i])
        found: Json = run.sensitivity.get(p.name) or {}
        rows.append(
            ParameterRow(
                name=p.name,
                unit="" if p.unit == "-" else p.unit,
                value=significant(values[p.name]),
                lower=significant(p.lower),
                upper=significant(p.upper),
                published=significant(p.published),
                meaning=p.meaning,
                position=round(100 * position, 1),
                published_position=round(100 * float(published_positions[i]), 1),
                bound="lower" if position <= ON_BOUND else "upper" if position >= 1 - ON_BOUND else "",
                down=_effect(found, "lower"),
                up=_effect(found, "upper"),
                verdict=str(found.get("verdict") or ""),
            )
        )
    return tuple(rows)


def _effect(found: Json, side: str) -> str:
    return "" if not found else NOTHING if found.get(side) is None else mm(found[side], 2, signed=True)

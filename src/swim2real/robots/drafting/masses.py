"""Candidates of masses, which are better weighed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from swim2real.robots.drafting.candidate import Candidate, around, base_name, grouped, line, names

_WEIGH = "a mass is better weighed than calibrated"
_SPREAD = 2.0


def masses(spec: mujoco.MjSpec) -> Iterator[Candidate]:
    """Of bodies with an <inertial>, and of the geoms of others."""
    from_geoms = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    bodies = [body for body in spec.bodies if body.explicitinertial and not from_geoms]
    moving = [geom for geom in spec.geoms if geom.parent.name != "world"]
    geoms = [geom for geom in moving if not geom.parent.explicitinertial or from_geoms]
    for mass, members in grouped(bodies, lambda body: float(body.mass)):
        yield from _candidate("body", "mass", "kg", mass, members)
    for mass, members in grouped([geom for geom in geoms if np.isfinite(geom.mass)], lambda geom: float(geom.mass)):
        yield from _candidate("geom", "mass", "kg", mass, members)
    dense = [geom for geom in geoms if geom.name and not np.isfinite(geom.mass)]
    for density in dict.fromkeys(float(geom.density) for geom in dense):
        members = tuple(geom for geom in dense if geom.density == density)
        yield from _candidate("geom", "density", "kg/m³", density, members, "geom")


def _candidate(
    kind: str, name: str, unit: str, value: float, members: tuple[Any, ...], base: str = ""
) -> Iterator[Candidate]:
    if value > 0:
        yield Candidate(
            f"{base or base_name(kind, members)}_{name}", kind, unit, *around(value, _SPREAD), 0.0,
            f"{name.capitalize()} of {kind} {', '.join(member.name for member in members)}.",
            (line(kind, members, name),), group=names(members), aside=_WEIGH,
        )  # fmt: skip

"""Candidates of the fluid: coefficients of ellipsoids, density and viscosity."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco

from swim2real.robots.attributes import attribute, class_name
from swim2real.robots.drafting.candidate import SPREAD, Candidate, around, line, quoted

_COEFFICIENTS = (
    ("blunt_drag", "Drag of every wet part against motion along its broad faces; more of it slows what is pushed."),
    ("slender_drag", "Drag along slender directions, skin-like; more of it slows what glides."),
    ("angular_drag", "Resistance to rotation in the fluid; more of it damps turning."),
    ("kutta_lift", "Lift of plates at an angle of attack; more of it pushes a beating fin harder."),
    ("magnus_lift", "Lift of parts that rotate while they translate."),
)
_MOST, _OFFSET = 10.0, 0.1
_DRY = "option density is 0, so there is no fluid"
_KNOWN = "it is known for most fluids: water has 1000 kg/m³ and 0.001 Pa·s, air 1.2 kg/m³ and 2e-5 Pa·s"


def fluid(spec: mujoco.MjSpec) -> Iterator[Candidate]:
    """Of a model in a fluid, or of one with ellipsoids that could be in one."""
    wet = [geom for geom in spec.geoms if geom.fluid_ellipsoid]
    if wet:
        yield from _ellipsoids(spec, wet)
    for name, unit, meaning in (
        ("density", "kg/m³", "Density of the fluid: forces that grow with the square of the speed."),
        ("viscosity", "Pa·s", "Viscosity of the fluid: forces that grow with the speed."),
    ):
        value = float(getattr(spec.option, name))
        if value > 0:
            bounds = around(value)
            aside = _KNOWN if wet else None
            yield Candidate(f"fluid_{name}", "option", unit, *bounds, 0.0, meaning, (f"option {name}",), aside=aside)


def _ellipsoids(spec: mujoco.MjSpec, wet: list[Any]) -> Iterator[Candidate]:
    place = _place(wet)
    for i, (name, meaning) in enumerate(_COEFFICIENTS):
        values = {_coefficient(geom, i) for geom in wet}
        relative, absent = len(values) > 1, values == {0.0}
        lower, upper = (1 / SPREAD, SPREAD) if relative else (0.0, _MOST) if absent else around(min(values))
        aside = "the model has none" if absent else _DRY if spec.option.density == 0 else None
        yield Candidate(
            f"fluid_{name}", "geom", "-", lower, upper, _OFFSET if absent else 0.0, meaning,
            (f"{place} fluidcoef[{i}]",), relative, aside=aside,
        )  # fmt: skip


def _coefficient(geom: Any, index: int) -> float:
    found = attribute(geom, "fluidcoef")
    return 0.0 if found is None else found.read(index)


def _place(wet: list[Any]) -> str:
    """The wet geoms by their names, or by their classes where some have none: coefficients of dry ones don't count."""
    if all(geom.name for geom in wet):
        return line("geom", wet, "").rstrip()
    classes = dict.fromkeys(class_name(geom) for geom in wet)
    return f"geom class {', '.join(map(quoted, classes))}"

"""What a reader wants to know first: how far off the best parameters are, and what the error is made of."""

from __future__ import annotations

from dataclasses import dataclass

from swim2real.report.run import Json, ReportedRun
from swim2real.report.units import NOTHING, mm, percent

_AFTER_ALIGNMENT = (
    "Mean distance between simulated and real markers once phase and placement of the markers are accounted for"
)


@dataclass(frozen=True)
class Tile:
    """One large number.

    Attributes:
        label: What it is.
        value: At the best parameters, with unit.
        first: At the first evaluation, with unit.
        held_out: On held-out trials, with unit; empty without any.
        meaning: In a sentence.
    """

    label: str
    value: str
    first: str
    held_out: str
    meaning: str


@dataclass(frozen=True)
class SplitRow:
    """One line of the table that splits the error.

    Attributes:
        label: What it is.
        name: The figure's name in files.
        cells: With unit: at the first evaluation, at the best, and on held-out trials where there are any.
        meaning: In a sentence.
        main: Whether the line is a sum, not a part.
    """

    label: str
    name: str
    cells: tuple[str, ...]
    meaning: str
    main: bool = False


def tiles(run: ReportedRun) -> tuple[Tile, ...]:
    """The large numbers; the loss first."""
    chosen = [
        ("Aligned marker error", "aligned_marker_error", "mm", _AFTER_ALIGNMENT + "."),
        ("Shape error", "shape_error", "mm", "The part of it that is body shape alone."),
        ("Velocity error", "velocity_error", "mm/s", "Mean difference between simulated and real forward speed."),
    ]
    if run.paper_protocol:
        meaning = "Mean distance without any alignment (the paper's Eq. 1); this run minimized it."
        chosen.insert(0, ("Marker error", "marker_error", "mm", meaning))
    first = run.first["evidence"]
    return tuple(
        Tile(
            label,
            with_unit(run.fit, name, unit),
            with_unit(first, name, unit),
            "" if run.held_out is None else with_unit(run.held_out, name, unit),
            meaning,
        )
        for label, name, unit, meaning in chosen
    )


def split(run: ReportedRun) -> tuple[SplitRow, ...]:
    """The lines of the small table."""
    columns: list[Json] = [run.first["evidence"], run.fit]
    if run.held_out is not None:
        columns.append(run.held_out)

    def lengths(name: str, unit: str = "mm") -> tuple[str, ...]:
        return tuple(with_unit(figures, name, unit) for figures in columns)

    lost = tuple(_lost(figures) for figures in columns)
    left_out = tuple(percent(figures.get("left_out_share")) for figures in columns)
    return (
        SplitRow(
            "Aligned marker error", "aligned_marker_error", lengths("aligned_marker_error"),
            f"{_AFTER_ALIGNMENT}: shape and thrust together.", True,
        ),
        SplitRow(
            "Shape", "shape_error", lengths("shape_error"),
            "How the body bends: the same without how far the fish has come.",
        ),
        SplitRow(
            "Thrust", "progress_error", lengths("progress_error"),
            "How far the fish has come along its path: mean difference over the compared time.",
        ),
        SplitRow(
            "Speed", "velocity_error", lengths("velocity_error", "mm/s"),
            "Mean difference in forward speed, over whole trials.",
        ),
        SplitRow(
            "Registration", "static_offset", lengths("static_offset"),
            "Markers are placed by hand: mean constant shift of a marker against its place in the simulation. "
            "Reported, not counted above.",
        ),
        SplitRow(
            "Lost tracks", "unweighted_error − aligned_marker_error", lost,
            "How the aligned error would change if frames in which tracking lost a marker counted too.",
        ),
        SplitRow(
            "Left out", "left_out_share", left_out,
            "Share of marker positions that don't count because tracking lost the marker.",
        ),
        SplitRow(
            "Marker error, the paper's Eq. 1", "marker_error", lengths("marker_error"),
            "Mean distance over all markers and frames, no registration, nothing left out; only start and heading are "
            "removed.", True,
        ),
    )  # fmt: skip


def diverged(figures: Json) -> bool:
    """Whether the simulation of any trial has failed."""
    return any(trial.get("divergence") for trial in figures.get("trials", {}).values())


def with_unit(figures: Json, name: str, unit: str) -> str:
    """A figure in mm or mm/s, with its unit, or that the simulation diverged."""
    if diverged(figures):
        return "diverged"
    shown = mm(figures.get(name))
    return shown if shown == NOTHING else f"{shown} {unit}"


def _lost(figures: Json) -> str:
    counted, unweighted = figures.get("aligned_marker_error"), figures.get("unweighted_error")
    if counted is None or unweighted is None or diverged(figures):
        return NOTHING
    return f"{mm(unweighted - counted, signed=True)} mm"

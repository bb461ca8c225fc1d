"""`track`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from swim2real.cli import tables
from swim2real.cli.arguments import Track
from swim2real.cli.film_progress import films_shown, print_films
from swim2real.cli.hints import for_robot
from swim2real.errors import ArgumentError, Swim2RealError
from swim2real.pipeline import TRACKS, Filmed, track_films
from swim2real.robots import robot_named
from swim2real.settings import TrackingSettings


def track(a: Track) -> int:
    """Tracks videos into a reference folder; 1 when one of them failed."""
    settings = TrackingSettings(a.tracker, a.camera, a.smooth, a.overlay)
    if a.workers < 0:
        raise ArgumentError(f"--workers is {a.workers}; it must be 0 (as many as there are cores) or above")
    robot = robot_named(a.robot)
    try:
        with films_shown(a.quiet or a.json) as (on_progress, on_done):
            results = track_films(
                a.videos, _points(a), robot, settings, a.to, frequencies=_frequencies(a),
                controls=_tables("controls", a.controls, len(a.videos)),
                sensors=_tables("sensors", a.sensors, len(a.videos)), workers=a.workers or None,
                on_progress=on_progress, on_done=on_done,
            )  # fmt: skip
    except KeyboardInterrupt:
        print("swim2real: interrupted; the same command goes on with the videos that aren't done", file=sys.stderr)
        return 1
    done = [one for one in results if isinstance(one, Filmed)]
    failed = [(video, one) for video, one in zip(a.videos, results, strict=True) if isinstance(one, Swim2RealError)]
    if a.json:
        print(json.dumps({one.name: one.report for one in done}, indent=2))
    elif not a.quiet and done:
        print_films(done, robot.marker_names)
        tables.console.print(
            f"Reference: {a.to}   Overlays: {a.to / TRACKS}   "
            f"Next: swim2real calibrate {a.to} --out RUN{for_robot(a.robot)}",
            soft_wrap=True, markup=False,
        )  # fmt: skip
    for video, error in failed:
        where = "" if str(video) in str(error) else f"{video}: "
        print(f"swim2real: {where}{error}", file=sys.stderr)
    return 1 if failed else 0


def _points(a: Track) -> list[Path | None]:
    if a.markers == ("auto",):
        return [None] * len(a.videos)
    if len(a.markers) != len(a.videos):
        raise ArgumentError(
            f"--markers has {len(a.markers)} files for {len(a.videos)} videos; "
            f"give one for each video in order, or auto"
        )
    return [None if one == "auto" else Path(one) for one in a.markers]


def _tables(option: str, tables: tuple[Path, ...], count: int) -> list[Path] | None:
    if tables and len(tables) != count:
        raise ArgumentError(
            f"--{option} has {len(tables)} tables for {count} videos; give one for each video in order, or none"
        )
    return list(tables) or None


def _frequencies(a: Track) -> list[float | None] | None:
    if not a.frequency:
        return None
    if len(a.frequency) != len(a.videos):
        raise ArgumentError(
            f"--frequency has {len(a.frequency)} values for {len(a.videos)} videos; give one for each, or none"
        )
    for one in a.frequency:
        if not 0 < one < float("inf"):
            raise ArgumentError(f"--frequency is {one:g} Hz; it must be finite and above 0")
    return list(a.frequency)

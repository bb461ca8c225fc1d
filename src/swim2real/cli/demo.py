"""`demo`."""

from __future__ import annotations

import time
from typing import Any

from swim2real.cli import tables
from swim2real.cli.arguments import Demo
from swim2real.cli.calibrate import finish
from swim2real.cli.film_progress import films_shown
from swim2real.cli.progress import Watch
from swim2real.demo import DEMO_FREQUENCIES, FULL_FREQUENCIES, Told, demo_settings, film_and_track, fit


def demo(a: Demo) -> int:
    """Runs the embedded example."""
    began = time.monotonic()
    settings = demo_settings(a.budget, a.seed)
    frequencies = FULL_FREQUENCIES if a.full else DEMO_FREQUENCIES
    with films_shown(a.quiet) as (on_frame, on_film):
        told = Told((lambda text: None) if a.quiet else _say, on_frame, on_film)
        film_and_track(a.out, frequencies=frequencies, resume=a.resume, told=told)

    def work(watch: Watch) -> dict[str, Any]:
        return fit(a.out, settings, watch.progress)

    code = finish(work, a.budget, a.out / "run", a.quiet, False)
    if not a.quiet:
        _say(f"The demo took {time.monotonic() - began:.0f} s. Overlays: {a.out / 'reference' / 'tracks'}")
    return code


def _say(text: str) -> None:
    tables.console.print(text, soft_wrap=True, markup=False)

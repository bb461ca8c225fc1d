"""The page of a training run: what the policy reaches, how it learned, and the ways that it swims, in one file."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np

from swim2real.report.palette import COLORS, DARK_OF_LIGHT, Figure
from swim2real.report.template import fill, write_page
from swim2real.report.training_figures import commands, learning_curve, paths, scan
from swim2real.report.units import duration, percent, text
from swim2real.rl import run_files
from swim2real.rl.assessment import Assessment

PAGE = "training.html"
_LOOPS = {
    "nominal": "without disturbance",
    "open": "recorded commands (open loop)",
    "closed": "closed loop, true state",
    "tracked": "closed loop, tracked markers",
}


def write_training_page(run: str | Path, out: str | Path, found: Assessment) -> Path:
    """Writes the page.

    Args:
        run: Folder of the training.
        out: Folder to write; a film `rollout.mp4` in it comes into the page.
        found: Assessment of the policy.

    Returns:
        Where the page is.

    Raises:
        MissingExtraError: plotly or jinja2 isn't installed.
        RunError: The run is damaged, or the page can't be written.
    """
    return write_page(Path(out) / PAGE, render_training(Path(run), Path(out) / "rollout.mp4", found))


def render_training(run: Path, film: Path, found: Assessment) -> str:
    """The page as text.

    Raises:
        MissingExtraError: plotly or jinja2 isn't installed.
    """
    shown = base64.b64encode(film.read_bytes()).decode() if film.is_file() else None
    content = {**training_content(run, found), "film": shown, "colors": COLORS}
    return fill("training.html.j2", content, style="report.css", script="report.js")


def training_content(run: Path, found: Assessment) -> dict[str, Any]:
    """Everything that the template shows."""
    settings = run_files.read_json(run / run_files.SETTINGS)
    outcome_path = run / run_files.OUTCOME
    outcome = run_files.read_json(outcome_path) if outcome_path.is_file() else None
    episodes, evaluations = (run_files.read_lines(run / name) for name in (run_files.EPISODES, run_files.EVALUATIONS))
    constant, task = found.content.get("constant"), settings["task"]
    shared = {"exploration": settings["exploration"]}
    figures: dict[str, Figure] = {
        "return": learning_curve(
            episodes, evaluations, "episode_return", "episode return",
            baseline=constant["best_return"] if constant else None, **shared,
        )
    }  # fmt: skip
    if task == "forward":
        figures["distance"] = learning_curve(
            episodes, evaluations, "distance", "distance (mm)", 1e3,
            baseline=constant["best_distance"] if constant else None, **shared,
        )  # fmt: skip
    else:
        figures["success"] = learning_curve(episodes, evaluations, "success", "reached (%)", 100.0, **shared)
    figures["paths"] = paths(
        [one.heads for one in found.episodes], [one.goal for one in found.episodes],
        [one.success for one in found.episodes],
    )  # fmt: skip
    first = found.episodes[0]
    times = np.arange(len(first.commands)) / first.rate
    series = {"policy": (times, first.commands)}
    if found.scan is not None:
        best = float(found.scan.speeds[found.scan.farthest])
        series["best constant frequency"] = (times, np.full(len(times), best))
        figures["scan"] = scan(
            found.scan.speeds / (2 * np.pi), found.scan.distances, found.content["policy"]["distance"]
        )
    figures["commands"] = commands(series)
    return {
        "name": run.resolve().name,
        "task": task,
        "settings": settings,
        "outcome": outcome,
        "tiles": _tiles(found),
        "loops": [
            (_LOOPS[name], [text(one[key], 3) for key in ("episode_return", "distance", "drift", "sideways")],
             percent(one["success"], 0))
            for name, one in found.content.get("loops", {}).items()
        ],
        "times": _times(outcome),
        "plots": {"figures": figures, "darkOfLight": DARK_OF_LIGHT},
    }  # fmt: skip


def _tiles(found: Assessment) -> list[tuple[str, str, str]]:
    """Name, value and remark of the headline figures."""
    own, constant = found.content["policy"], found.content.get("constant")
    tiles = [
        (
            "Return",
            text(own["episode_return"], 2),
            f"± {text(own['episode_return_std'], 2)} over {own['episodes']} episodes",
        ),
        ("Distance", f"{text(own['distance'], 0, 1e3)} mm", f"± {text(own['distance_std'], 0, 1e3)} mm"),
    ]
    if constant:
        frequency = constant["best_distance_frequency"]
        tiles.append((
            "Best constant frequency", f"{text(constant['best_distance'], 0, 1e3)} mm", f"at {text(frequency, 2)} Hz",
        ))  # fmt: skip
        tiles.append((
            "Its highest return", text(constant["best_return"], 2),
            f"at {text(constant['best_return_frequency'], 2)} Hz",
        ))  # fmt: skip
    if own["goal_distance"] is not None:
        median = own["median_time_to_target"]
        tiles.append(("Goals reached", percent(own["success"], 0), f"of {own['episodes']}"))
        tiles.append((
            "Time to target", "–" if median is None else duration(median), "median of those reached"
        ))  # fmt: skip
    return tiles


def _times(outcome: dict[str, Any] | None) -> str:
    if outcome is None:
        return "The run hasn't ended yet."
    return (
        f"{outcome['step']:,} environment steps and {outcome['gradient_steps']:,} gradient steps in "
        f"{duration(outcome['seconds']['total'])}: {outcome['steps_per_second']:.0f} steps a second, "
        f"{percent(outcome['learner_share'], 0)} of the time learning and {percent(outcome['simulator_share'], 0)} "
        f"simulating."
    )

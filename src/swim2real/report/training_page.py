"""The page of a training run: what the policy reaches, how it learned, and the ways that it swims, in one file."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from swim2real.formatting import NOTHING, duration, mm, number, percent
from swim2real.report.pages import Charts, PageContext, write_page
from swim2real.report.style import LIGHT, WIDE, chart_name, legend_over, new_chart, titled
from swim2real.rl.assessment import Assessment, LoopResult, WaveScan
from swim2real.rl.body import Actuators, policy_setup
from swim2real.rl.rollout import Episode
from swim2real.rl.training_run import RecordedSettings, TrainingOutcome, TrainingRun

PAGE = "training.html"
_MOST_POINTS = 400  # of a learning curve
_MOST_PATHS = 40
_WINDOW = 50  # episodes of a running mean
_WAVES = {"constant": "constant command", "sine": "sine"}
_LOOPS = {
    "nominal": "without disturbance",
    "open": "recorded commands (open loop)",
    "closed": "closed loop, true state",
    "tracked": "closed loop, tracked markers",
}


@dataclass(frozen=True)
class _TrainingPage(PageContext):
    """Everything that the page shows.

    Attributes:
        settings: Settings of the training.
        outcome: What it came to; None before its end.
        running: Whether it goes on, so that the page loads itself again.
        tiles: Name, value and remark of each headline figure.
        loops: Results of the open and closed loops, by name.
        film: The film of a rollout, in base64; None without one.
    """

    settings: RecordedSettings
    outcome: TrainingOutcome | None
    running: bool
    tiles: list[tuple[str, str, str]]
    loops: dict[str, LoopResult]
    film: str | None


def write_training_page(
    run: TrainingRun, out: str | Path, assessment: Assessment | None = None, film: Path | None = None
) -> Path:
    """Writes the page.

    Args:
        run: The training.
        out: Folder to write.
        assessment: Assessment of the policy; None while it learns: then the page has the learning curves, and loads
            itself again every minute until the run has ended.
        film: Film of the assessment, which the page then holds.

    Returns:
        Where the page is.

    Raises:
        RunError: The run is damaged, or the page can't be written.
    """
    shown = None if film is None else base64.b64encode(film.read_bytes()).decode()
    return write_page(Path(out) / PAGE, _context(run, shown, assessment), "training.html.j2", "report.js")


def _context(run: TrainingRun, film: str | None, assessment: Assessment | None) -> _TrainingPage:
    """Everything that the template shows."""
    scans = {} if assessment is None else assessment.scans
    best = {
        "episode_return": max((scan.best_return for scan in scans.values()), default=None),
        "distance": max((scan.best_distance for scan in scans.values()), default=None),
    }
    with_goals = any(one.get("goal_distance") is not None for one in run.evaluations)
    way = ("success", "reached (%)", 100.0) if with_goals else ("distance", "distance (mm)", 1e3)
    charts: Charts = {
        key: partial(_learning_curve, run, key, title, factor, best.get(key))
        for key, title, factor in (("episode_return", "episode return", 1.0), way)
    }
    if assessment is not None:
        shown = assessment.episodes
        charts["paths"] = partial(_paths_from_above, shown)
        if "constant" in scans:
            charts["scan"] = partial(_wave_scans, scans, assessment.statistics.distance)
        charts["commands"] = partial(_motor_commands, shown[0], Actuators.of(policy_setup(run.robot).actuators))
    return _TrainingPage(
        title=run.folder.resolve().name,
        charts=charts,
        settings=run.settings,
        outcome=run.outcome,
        running=assessment is None and not (run.outcome is not None and run.outcome.complete),
        tiles=[] if assessment is None else _tiles(assessment),
        loops={} if assessment is None else {_LOOPS[name]: loop for name, loop in assessment.loops.items()},
        film=film,
    )


def _tiles(assessment: Assessment) -> list[tuple[str, str, str]]:
    """Name, value and remark of the headline figures."""
    policy = assessment.statistics
    deviation = f"± {number(policy.episode_return_std, 2)} over {policy.episodes} episodes"
    tiles = [
        ("Return", number(policy.episode_return, 2), deviation),
        ("Distance", f"{mm(policy.distance, 0)} mm", f"± {mm(policy.distance_std, 0)} mm"),
    ]
    for name, scan in assessment.scans.items():
        wave = scan.farthest
        rate = f"{number(wave.frequency, 2)} Hz, " if wave.frequency else ""
        share = f"{rate}{percent(wave.amplitude, 0)} of its range"
        tiles.append((f"Best {_WAVES[name]}", f"{mm(scan.best_distance, 0)} mm", share))
        tiles.append((f"Highest return of a {_WAVES[name]}", number(scan.best_return, 2), "open loop"))
    if policy.goal_distance is not None:
        median = policy.median_time_to_target
        tiles.append(("Goals reached", percent(policy.success, 0), f"of {policy.episodes}"))
        took = NOTHING if median is None else duration(median)
        tiles.append(("Time to target", took, "median of those reached"))
    return tiles


def _learning_curve(run: TrainingRun, key: str, title: str, factor: float, baseline: float | None) -> Figure:
    """A figure of every episode over the environment steps: their running mean, and the evaluations.

    Args:
        run: Its episodes and evaluations, those without exploration.
        key: The figure's name.
        title: Title of the y axis, with unit.
        factor: Factor by which values are multiplied.
        baseline: What the best wave of commands reaches, in the same unit before the factor.
    """
    figure, axes = new_chart(WIDE, 2.9, "environment steps", title, legend_rows=1)
    evaluations = run.evaluations  # from a file
    while_learning, shown = (
        np.reshape([(one["step"], factor * one[key]) for one in entries if one.get(key) is not None], (-1, 2))
        for entries in (run.episodes, evaluations)
    )
    if len(while_learning):
        window = min(_WINDOW, len(while_learning))
        mean = np.convolve(while_learning[:, 1], np.ones(window) / window, mode="valid")
        places = np.unique(np.linspace(0, len(mean) - 1, _MOST_POINTS).astype(int))
        steps, label = while_learning[window - 1 :, 0], f"while learning, mean of {window} episodes"
        axes.plot(steps[places], mean[places], color=LIGHT["faint"], label=label)
    if len(shown):
        axes.plot(*shown.T, "-o", color=LIGHT["simulated"], linewidth=1.5, label="evaluated, without exploration")
    if baseline is not None:
        axes.axhline(factor * baseline, linestyle="--", color=LIGHT["real"], label="best open-loop wave")
    if run.settings.exploration:
        axes.axvspan(0, run.settings.exploration, color=LIGHT["grid"], alpha=0.5, linewidth=0, zorder=0)
    stages = {one["stage"]: one["step"] for one in reversed(evaluations) if one.get("stage") is not None}
    for stage, step in stages.items():
        axes.axvline(step, color=LIGHT["faint"], linewidth=0.8, zorder=0)
        axes.annotate(f"\u00a0stage {stage}", (step, 1.0), xycoords=("data", "axes fraction"), va="top", size="small")
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    legend_over(axes)
    return figure


def _paths_from_above(episodes: Sequence[Episode]) -> Figure:
    """Paths of the robot [m]; goals that were reached are green, the others hollow."""
    figure, axes = new_chart(WIDE, 4.2, "x (m), forward is to the left", "y (m)", legend_rows=1)
    drawn = episodes[:_MOST_PATHS]
    for i, episode in enumerate(drawn):
        thin = episode.heads[:: max(1, len(episode.heads) // 150)]
        color = LIGHT["simulated"] if episode.success or episode.goal is None else LIGHT["faint"]
        (line,) = axes.plot(thin[:, 0], thin[:, 1], color=color, linewidth=0.9, alpha=0.7)
        titled(line, f"episode {i}")
    for name, reached, face, color in (("reached", True, "good", "good"), ("not reached", False, "surface", "real")):
        places = [one.goal for one in drawn if one.goal is not None and one.success == reached]
        if places:
            look = {"facecolors": LIGHT[face], "edgecolors": LIGHT[color], "linewidths": 1.2}
            axes.scatter(*np.array(places)[:, :2].T, s=20, label=name, zorder=3, **look)
            legend_over(axes)
    axes.set_aspect("equal", adjustable="datalim")
    return figure


def _motor_commands(episode: Episode, actuators: Actuators) -> Figure:
    """Commands of an episode over time, a line per actuator."""
    units = ", ".join(dict.fromkeys(actuators.units))
    figure, axes = new_chart(WIDE, 2.4, "time (s)", chart_name(f"command ({units})"), legend_rows=1)
    times = np.arange(len(episode.commands)) / episode.rate
    for i, name in enumerate(actuators.names):
        axes.step(times, episode.commands[:, i], where="post", label=chart_name(name))
    legend_over(axes)
    return figure


def _wave_scans(scans: Mapping[str, WaveScan], policy: float) -> Figure:
    """Greatest distance that waves of commands reach, over their amplitude, and that of the policy [m]."""
    figure, axes = new_chart(
        WIDE, 2.5, "amplitude or constant command (% of its range)", "distance (mm)", legend_rows=1
    )
    for (name, scan), color in zip(scans.items(), ("real", "good"), strict=False):
        amplitudes = np.array([wave.amplitude for wave in scan.waves])
        each = np.unique(amplitudes)
        farthest = [scan.distances[amplitudes == one].max() for one in each]
        axes.plot(100 * each, 1e3 * np.array(farthest), "-o", color=LIGHT[color], markersize=2.6, label=_WAVES[name])
    axes.axhline(1e3 * policy, color=LIGHT["simulated"], linewidth=1.5, label="policy")
    legend_over(axes)
    return figure

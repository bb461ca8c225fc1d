"""The page of a training run: what the policy reaches, how it learned, and the ways that it swims, in one file."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter
from numpy.typing import NDArray

from swim2real.report.pages import Charts, render_page, write_page
from swim2real.report.style import LIGHT, WIDE, chart_name, legend_over, new_chart, titled
from swim2real.report.units import duration, percent, text
from swim2real.rl.assessment import Assessment, WaveScan
from swim2real.rl.body import Actuators, policy_setup
from swim2real.rl.rollout import Episode
from swim2real.rl.training_run import TrainingOutcome, TrainingRun

Array = NDArray[np.float64]

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


def write_training_page(run: TrainingRun, out: str | Path, assessment: Assessment | None = None) -> Path:
    """Writes the page.

    Args:
        run: The training.
        out: Folder to write; a film `rollout.mp4` in it comes into the page.
        assessment: Assessment of the policy; None while it learns: then the page has the learning curves, and loads
            itself again every minute until the run has ended.

    Returns:
        Where the page is.

    Raises:
        RunError: The run is damaged, or the page can't be written.
    """
    return write_page(Path(out) / PAGE, render_training(run, Path(out) / "rollout.mp4", assessment))


def render_training(run: TrainingRun, film: Path, assessment: Assessment | None) -> str:
    """The page as text."""
    shown = base64.b64encode(film.read_bytes()).decode() if assessment and film.is_file() else None
    content = training_content(run, assessment)
    charts: Charts = content.pop("charts")
    return render_page("training.html.j2", {**content, "film": shown}, charts, style="report.css", script="report.js")


def training_content(run: TrainingRun, assessment: Assessment | None) -> dict[str, Any]:
    """Everything that the template shows."""
    episodes, evaluations = run.episodes, run.evaluations
    scans = {} if assessment is None else assessment.scans
    with_goals = any(one.get("goal_distance") is not None for one in evaluations)
    names = {"episode_return": ("episode return", 1.0)}
    names |= {"success": ("reached (%)", 100.0)} if with_goals else {"distance": ("distance (mm)", 1e3)}
    best = {
        "episode_return": max((scan.best_return for scan in scans.values()), default=None),
        "distance": max((scan.best_distance for scan in scans.values()), default=None),
    }
    charts: dict[str, Any] = {
        key: partial(learning_curve, episodes, evaluations, key, title, factor, baseline=best.get(key),
                     exploration=run.settings.exploration)
        for key, (title, factor) in names.items()
    }  # fmt: skip
    outcome = run.outcome
    content = {
        "name": run.folder.resolve().name, "task": run.settings.task, "settings": run.settings, "tiles": [],
        "loops": [], "times": _times(outcome), "charts": charts,
        "running": assessment is None and not (outcome is not None and outcome.complete),
    }  # fmt: skip
    if assessment is None:
        return content
    shown = assessment.episodes
    charts["paths"] = partial(paths_from_above,
        [episode.heads for episode in shown], [episode.goal for episode in shown],
        [episode.success for episode in shown],
    )  # fmt: skip
    if "constant" in scans:
        charts["scan"] = partial(wave_scans, scans, assessment.statistics.distance)
    charts["commands"] = partial(motor_commands, shown[0], Actuators.of(policy_setup(run.robot).actuators))
    loops = [
        (_LOOPS[name],
         [text(value, 3) for value in (loop.statistics.episode_return, loop.statistics.distance, loop.drift,
                                       loop.sideways)],
         percent(loop.statistics.success, 0))
        for name, loop in assessment.loops.items()
    ]  # fmt: skip
    return {**content, "tiles": _tiles(assessment), "loops": loops}


def _tiles(assessment: Assessment) -> list[tuple[str, str, str]]:
    """Name, value and remark of the headline figures."""
    policy = assessment.statistics
    tiles = [
        (
            "Return",
            text(policy.episode_return, 2),
            f"± {text(policy.episode_return_std, 2)} over {policy.episodes} episodes",
        ),
        ("Distance", f"{text(policy.distance, 0, 1e3)} mm", f"± {text(policy.distance_std, 0, 1e3)} mm"),
    ]
    for name, scan in assessment.scans.items():
        wave = scan.farthest
        about = f"{text(100 * wave.amplitude, 0)} % of its range" if wave.frequency == 0 else (
            f"{text(wave.frequency, 2)} Hz, {text(100 * wave.amplitude, 0)} % of the range")  # fmt: skip
        tiles.append((f"Best {_WAVES[name]}", f"{text(scan.best_distance, 0, 1e3)} mm", about))
        tiles.append((f"Highest return of a {_WAVES[name]}", text(scan.best_return, 2), "open loop"))
    if policy.goal_distance is not None:
        median = policy.median_time_to_target
        tiles.append(("Goals reached", percent(policy.success, 0), f"of {policy.episodes}"))
        tiles.append((
            "Time to target", "–" if median is None else duration(median), "median of those reached"
        ))  # fmt: skip
    return tiles


def _times(outcome: TrainingOutcome | None) -> str:
    if outcome is None:
        return "The run hasn't ended yet."
    return (
        f"{outcome.step:,} environment steps and {outcome.gradient_steps:,} gradient steps in "
        f"{duration(outcome.seconds.total)}: {outcome.steps_per_second:.0f} steps a second, "
        f"{percent(outcome.learner_share, 0)} of the time learning and {percent(outcome.simulator_share, 0)} "
        f"simulating."
    )


def learning_curve(
    episodes: Sequence[Mapping[str, Any]], evaluations: Sequence[Mapping[str, Any]], key: str, title: str,
    factor: float = 1.0, baseline: float | None = None, exploration: int | None = None,
) -> Figure:  # fmt: skip
    """A figure of every episode over the environment steps: their running mean, and the evaluations.

    Args:
        episodes: Entries with `step` and the figure.
        evaluations: The same, of the policy without exploration.
        key: The figure's name.
        title: Title of the y axis, with unit.
        factor: Factor by which values are multiplied.
        baseline: What the best wave of commands reaches, in the same unit before the factor.
        exploration: Steps of random actions at the start.
    """
    figure, axes = new_chart(WIDE, 2.9, "environment steps", title, legend_rows=1)
    known = [(one["step"], one[key]) for one in episodes if one.get(key) is not None]
    steps, values = np.array([k[0] for k in known], float), factor * np.array([k[1] for k in known], float)
    if len(steps):
        window = min(_WINDOW, len(values))
        mean = np.convolve(values, np.ones(window) / window, mode="valid")
        places = np.unique(np.linspace(0, len(mean) - 1, _MOST_POINTS).astype(int))
        axes.plot(
            steps[window - 1 :][places], mean[places], color=LIGHT["faint"],
            label=f"while learning, mean of {window} episodes",
        )  # fmt: skip
    shown = [(one["step"], factor * one[key]) for one in evaluations if one.get(key) is not None]
    if shown:
        axes.plot(
            *np.array(shown).T, "-o", color=LIGHT["simulated"], linewidth=1.5, label="evaluated, without exploration"
        )
    if baseline is not None:
        last = max([*steps.tolist(), *(s for s, _ in shown), 1.0])
        axes.plot(
            [0, last], [factor * baseline] * 2, "--", color=LIGHT["real"], label="best open-loop wave"
        )  # fmt: skip
    if exploration:
        axes.axvspan(0, exploration, color=LIGHT["grid"], alpha=0.5, linewidth=0, zorder=0)
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    legend_over(axes)
    return figure


def paths_from_above(heads: Sequence[Array], goals: Sequence[Array | None], reached: Sequence[bool]) -> Figure:
    """Paths of the robot [m]; goals that were reached are green, the others hollow."""
    figure, axes = new_chart(WIDE, 4.2, "x (m), forward is to the left", "y (m)", legend_rows=1)
    for i, (path, ok) in enumerate(zip(heads[:_MOST_PATHS], reached, strict=False)):
        thin = path[:: max(1, len(path) // 150)]
        color = LIGHT["simulated"] if ok or goals[i] is None else LIGHT["faint"]
        (line,) = axes.plot(thin[:, 0], thin[:, 1], color=color, linewidth=0.9, alpha=0.7)
        titled(line, f"episode {i}")
    for name, wanted, face, color in (("reached", True, "good", "good"), ("not reached", False, "surface", "real")):
        places = [g for g, ok in zip(goals[:_MOST_PATHS], reached, strict=False) if g is not None and ok == wanted]
        if places:
            axes.scatter(
                *np.array(places)[:, :2].T, s=20, facecolors=LIGHT[face], edgecolors=LIGHT[color], linewidths=1.2,
                label=name, zorder=3,
            )  # fmt: skip
            axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=2, borderaxespad=0.1)
    axes.set_aspect("equal", adjustable="datalim")
    return figure


def motor_commands(episode: Episode, actuators: Actuators) -> Figure:
    """Commands of an episode over time, a line an actuator."""
    units = ", ".join(dict.fromkeys(actuators.units))
    figure, axes = new_chart(WIDE, 2.4, "time (s)", chart_name(f"command ({units})"), legend_rows=1)
    times = np.arange(len(episode.commands)) / episode.rate
    for i, name in enumerate(actuators.names):
        axes.step(times, episode.commands[:, i], where="post", label=chart_name(name))
    legend_over(axes)
    return figure


def wave_scans(scans: Mapping[str, WaveScan], policy: float) -> Figure:
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

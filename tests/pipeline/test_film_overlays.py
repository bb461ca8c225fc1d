"""Simulated markers on a film: they lie where the loss sees them, and the film shows them there."""

from dataclasses import replace

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from recorded import FLOATER, PENDULUM, floater_reference, pendulum_reference
from swim2real.calibration import Problem
from swim2real.pipeline.overlays import in_world
from swim2real.robots.fish import FISH
from swim2real.trials import TrialSet


def distances(problem: Problem, values: dict[str, float]) -> list[tuple[float, float]]:
    """Mean distance of what is drawn from the tracked markers, and the error that the loss is made of, by trial [m]."""
    found = []
    for compared, trial in zip(problem.evaluate(values).trials, problem.trials, strict=True):
        real = trial.track.positions[: len(compared.times)]
        apart = np.linalg.norm(in_world(compared, real) - real, axis=2)
        known = np.isfinite(apart) & (compared.weights > 0)
        found.append((float(apart[known].mean()), float(getattr(compared, compared.loss_figure))))
    return found


def turned(reference: TrialSet, angle: float) -> TrialSet:
    """The same trials elsewhere in the world, on another course."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    trials = [
        replace(t, track=MarkerTrack(t.track.times, t.track.positions @ turn + [0.3, -0.7], t.track.confidence))
        for t in reference
    ]
    return TrialSet(tuple(trials), reference.marker_names)


def test_a_recording_is_drawn_as_it_is_in_the_world_or_beside_the_real_robot() -> None:
    problem = Problem(PENDULUM, pendulum_reference(1e-3), horizon=0.5)
    for drawn, error in distances(problem, PENDULUM.space.published):
        assert drawn == pytest.approx(error)
        assert error > 1e-3
    for angle in (0.0, 2.0):
        problem = Problem(FLOATER, turned(floater_reference(), angle), horizon=0.5)
        for drawn, error in distances(problem, FLOATER.space.published):
            assert drawn == pytest.approx(error, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["motion", "aligned"])
def test_a_swim_is_drawn_on_its_path_as_the_loss_sees_it(pool: TrialSet, protocol) -> None:
    problem = Problem(FISH, turned(pool, 0.8), protocol, None)
    for drawn, error in distances(problem, FISH.space.published):
        assert drawn == pytest.approx(error, rel=0.02)

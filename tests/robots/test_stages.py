"""How the fish is fitted stage by stage."""

import numpy as np
import pytest

from swim2real.calibration import Problem
from swim2real.objective import evidence
from swim2real.optimizers import Evaluation, RandomSearch, first_point, streams
from swim2real.optimizers.staged import Stage, Staged
from swim2real.robots.fish import FISH
from swim2real.robots.fish.stages import beat_distance, fish_plan
from swim2real.trials import TrialSet

WAVE = 0.05 * np.exp(1j * np.linspace(0, 2, 9))

FISH_PLAN = fish_plan()


def listed(wave):
    return {
        "amplitude": [None if np.isnan(z) else abs(z) for z in wave],
        "phase": [None if np.isnan(z) else float(np.angle(z)) for z in wave],
    }


def evidence_of(*pairs):
    """Evidence of trials with these simulated and real fundamentals."""
    beats = [{"beat_simulated": listed(simulated), "beat_real": listed(real)} for simulated, real in pairs]
    return {"trials": {f"swim{i}": trial for i, trial in enumerate(beats)}}


def test_each_parameter_is_fitted_in_one_stage_or_held():
    names = [name for stage in FISH_PLAN.stages for name in stage.parameters] + list(FISH_PLAN.held)
    assert sorted(names) == sorted(FISH.space.names)
    assert [stage.name for stage in FISH_PLAN.stages] == ["stiffness", "motor arm", "fluid"]
    assert [stage.share for stage in FISH_PLAN.stages] == [1.0, 1.0, 5.0]
    assert [stage.together for stage in FISH_PLAN.stages] == [True, True, False]
    assert FISH_PLAN.stages[2].score is None
    assert set(FISH_PLAN.held.values()) == {0.0}
    FISH.space.check({**FISH.space.published, **FISH_PLAN.held})
    assert FISH.swims.fit_plan == FISH_PLAN


def test_amplitude_and_phase_along_the_body_make_the_distance():
    assert beat_distance(evidence_of((WAVE, WAVE), (0.5 * WAVE, 0.5 * WAVE))) == pytest.approx(0.0, abs=1e-12)
    assert beat_distance(evidence_of((WAVE * np.exp(1.3j), WAVE))) == pytest.approx(0.0, abs=1e-12)
    assert beat_distance(evidence_of((1.2 * WAVE, WAVE))) == pytest.approx(0.01)
    assert beat_distance(evidence_of((np.conj(WAVE), WAVE))) > 0.03  # the wave runs the other way
    assert beat_distance(evidence_of((WAVE, WAVE), (1.2 * WAVE, WAVE))) == pytest.approx(0.005)


def test_markers_that_are_not_known_do_not_count():
    simulated, real, nothing = 1.2 * WAVE, WAVE.copy(), np.full(9, np.nan + 0j)
    simulated[5], real[3] = np.nan, np.nan
    assert beat_distance(evidence_of((simulated, real), (nothing, WAVE))) == pytest.approx(0.01)
    assert np.isnan(beat_distance(evidence_of((nothing, WAVE))))


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["aligned", "paper"])
def test_stages_calibrate_a_simulated_fish(pool, protocol):
    space, plan = FISH.space, FISH_PLAN
    stages = [
        Stage(
            stage.name, tuple(space.names.index(name) for name in stage.parameters), stage.share,
            "scan" if stage.together else "search", stage.score,
        )
        for stage in plan.stages
    ]  # fmt: skip
    at = space.to_cube({**space.published, **plan.held})
    held = {space.names.index(name): float(at[space.names.index(name)]) for name in plan.held}
    problem = Problem(FISH, TrialSet(pool.trials[-1:], pool.marker_names), protocol, 1.0, threads=1)
    optimizer = Staged(first_point(16, 0), stages, 16, RandomSearch, streams(0)[1], held)
    seen = []
    for _ in range(16):
        candidate = optimizer.ask()
        result = problem.evaluate(space.to_values(candidate.point))
        detail = evidence(result)
        seen.append((result.loss, beat_distance(detail)))
        optimizer.tell(Evaluation(candidate, result.loss, result.divergence is not None, detail))
    values = space.to_values(candidate.point)
    assert {values[name] for name in plan.held} == {0.0}
    assert len({round(values[f"hinge_stiffness_{i}"], 12) for i in range(5)}) == 1
    assert min(distance for _, distance in seen) < 0.5 * seen[0][1]
    if protocol == "aligned":
        assert min(loss for loss, _ in seen) < 0.8 * seen[0][0]

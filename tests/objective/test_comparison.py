import json
from dataclasses import replace

import numpy as np
import pytest

from markertrack.frames import composed
from markertrack.track import MarkerTrack
from swim2real.calibration import Problem
from swim2real.objective import FAILED_LOSS, Comparison, compare_steady, evidence, steady_target
from swim2real.objective.figures import (
    FitFigures,
    TrialFigures,
)
from swim2real.robots.fish import FISH
from swim2real.trials import Trial, TrialSet
from swimbase.errors import TrialError

FREQUENCY = 1.0
REST = np.array([[0.0, 0.0], [0.2, 0.0], [0.5, 0.0]])
REAL_SPEED, SIM_SPEED = 0.10, 0.15
OFFSET = 0.03  # m, by which the real tail marker was placed to the side


def swim(speed, duration, offset=0.0, beat=0.0, phase=0.0, heading=0.0, fps=50.0):
    """Three markers on a stick that swims straight; the tail one may beat. A track."""
    times = np.arange(round(duration * fps) + 1) / fps
    positions = np.broadcast_to(REST, (len(times), 3, 2)).copy()
    positions[:, 2, 1] += offset + beat * np.cos(2 * np.pi * FREQUENCY * times + phase)
    positions[:, :, 0] -= speed * times[:, None]
    c, s = np.cos(heading), np.sin(heading)
    return MarkerTrack(times, positions @ np.array([[c, s], [-s, c]]) + [0.7, -0.3])


def compared(real, simulated, protocol="aligned", weights=None, horizon=None, name="a"):
    weights = np.ones(real.positions.shape[:2]) if weights is None else weights
    target = steady_target(Trial(name, real), weights, FREQUENCY, horizon=horizon)
    return compare_steady(target, simulated, fit_phase=protocol == "aligned")


def aligned(real, sim, weights=None, horizon=None):
    return Comparison((compared(real, Trial("a", sim), "aligned", weights, horizon),), "aligned", horizon)


@pytest.fixture
def pair():
    """A real swim of 4 s and a simulated one that is faster, along another heading."""
    return swim(REAL_SPEED, 4.0, OFFSET, heading=1.0), swim(SIM_SPEED, 5.5, heading=-2.0)


def test_every_figure_of_a_case_done_by_hand(pair):
    ahead = (SIM_SPEED - REAL_SPEED) * pair[0].times
    expected = {
        "progress_error": ahead.mean(), "aligned_marker_error": ahead.mean(), "unweighted_error": ahead.mean(),
        "loss": ahead.mean(), "shape_error": 0.0, "static_offset": OFFSET / 3, "left_out_share": 0.0,
        "marker_error": np.mean([2 * ahead + np.hypot(ahead, OFFSET)]) / 3, "velocity_error": SIM_SPEED - REAL_SPEED,
    }  # fmt: skip
    figures = aligned(*pair).figures()
    assert {name: figures[name] for name in expected} == pytest.approx(expected, abs=1e-9)
    of_trial = {"velocity_real": REAL_SPEED, "velocity_simulated": SIM_SPEED, "frequency": FREQUENCY, **expected}
    assert {name: figures["trials"]["a"][name] for name in of_trial} == pytest.approx(of_trial, abs=1e-9)


def test_a_shape_that_differs_is_all_shape_error():
    real = swim(REAL_SPEED, 4.0, beat=0.05, phase=0.7, heading=2.0)
    perfect, wider = (aligned(real, swim(REAL_SPEED, 5.5, beat=beat)) for beat in (0.05, 0.08))
    assert perfect.loss < 1e-4
    assert perfect.figure("marker_error") < 2e-4
    assert perfect.trials[0].beat.phase == pytest.approx(0.7, abs=2e-3)
    expected = 0.03 * np.abs(np.cos(2 * np.pi * real.times)).mean() / 3  # one marker of three
    assert [wider.figure("shape_error"), wider.loss] == pytest.approx([expected] * 2, rel=0.01)
    assert wider.figure("progress_error") == pytest.approx(0.0, abs=1e-9)


def test_lost_marker_frames_dont_count(pair):
    real, sim = pair
    positions = real.positions.copy()
    positions[50:150, 2] += 0.4
    weights = np.ones((201, 3))
    weights[50:150, 2] = 0.0
    clean, damaged = aligned(real, sim), aligned(MarkerTrack(real.times, positions), sim, weights)
    for name in ("aligned_marker_error", "shape_error", "static_offset", "velocity_error"):
        expected = clean.figure(name)
        tolerance = 2e-3 if name == "aligned_marker_error" else 1e-6  # other frames weigh more in the mean
        assert damaged.figure(name) == pytest.approx(expected, abs=tolerance), name
    assert damaged.figure("left_out_share") == pytest.approx(100 / 603)
    assert damaged.figure("marker_error") > clean.figure("marker_error") + 0.05  # the paper's has no weights
    assert damaged.figure("unweighted_error") > damaged.figure("aligned_marker_error") + 0.02


def test_missing_marker_frames_are_left_out(pair):
    real, sim = pair
    positions = real.positions.copy()
    positions[30:60, 1] = np.nan  # without its second marker a frame has no body frame
    positions[100:120, 2] = np.nan
    figures = aligned(MarkerTrack(real.times, positions), sim).figures()
    assert figures["left_out_share"] == pytest.approx((3 * 30 + 20) / 603)
    assert figures["velocity_error"] == pytest.approx(SIM_SPEED - REAL_SPEED, abs=1e-6)
    assert figures["shape_error"] == pytest.approx(0.0, abs=1e-9)


def test_the_horizon_cuts_errors_but_not_speeds(pair):
    whole, short = aligned(*pair), aligned(*pair, horizon=2.0)
    assert short.trials[0].times[-1] == pytest.approx(2.0)
    assert short.loss == pytest.approx(0.05)
    assert whole.loss == pytest.approx(0.1)
    assert short.figure("velocity_error") == pytest.approx(whole.figure("velocity_error"))
    assert short.figures()["horizon"] == 2.0


def test_the_papers_protocol_has_no_phase_no_registration_and_no_weights():
    real = swim(REAL_SPEED, 4.0, OFFSET, beat=0.05, phase=np.pi)
    weights = np.zeros((201, 3))
    weights[:, :2] = 1.0
    trial = compared(real, Trial("a", swim(REAL_SPEED, 4.0, beat=0.05)), "paper", weights)
    assert trial.beat.phase == 0.0
    np.testing.assert_array_equal(trial.registration, 0.0)
    expected = np.abs(OFFSET - 0.1 * np.cos(2 * np.pi * real.times)).mean() / 3
    assert trial.loss == trial.marker_error == pytest.approx(expected, rel=1e-3)


def test_overall_figures_are_means_over_trials_and_a_diverged_one_costs_a_metre():
    reals = [swim(REAL_SPEED, 4.0), swim(0.2, 4.0)]
    good, bad = Trial("b", swim(0.26, 5.5)), Trial("b", swim(0.0, 1.0), divergence="it diverged")
    for protocol, second in (("aligned", good), ("aligned", bad), ("paper", bad)):
        pairs = zip(reals, (Trial("a", swim(0.12, 5.5)), second), strict=True)
        trials = tuple(compared(real, sim, protocol, horizon=4.0, name=sim.name) for real, sim in pairs)
        comparison = Comparison(trials, protocol, 4.0)
        found = json.loads(json.dumps(evidence(comparison), allow_nan=False))
        assert list(found["trials"]) == ["a", "b"]
        if second is good:
            assert (comparison.figure("velocity_error"), comparison.loss) == pytest.approx((0.04, 0.08))
        else:
            assert comparison.loss == found["trials"]["b"]["marker_error"] == FAILED_LOSS == 1.0
            assert comparison.divergence == "trial 'b': it diverged"
            assert found["velocity_error"] is None


def test_a_simulation_that_is_too_short_is_refused():
    with pytest.raises(TrialError, match=r"trial 'a': simulated for 4\.50 s, 5\.00 s are compared"):
        aligned(swim(REAL_SPEED, 4.0), swim(REAL_SPEED, 4.5))


def test_evidence_goes_through_json_unchanged_and_is_what_the_models_say(pair):
    real, sim = pair
    weights = np.ones((201, 3))
    weights[:, 1] = 0.0  # a marker that never counts
    found = evidence(aligned(real, sim, weights))
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert FitFigures.model_validate(found).model_dump(exclude_unset=True) == found
    trial = found["trials"]["a"]
    assert set(trial) <= set(TrialFigures.model_fields)
    assert trial["aligned_marker_errors"][1] is trial["beat_real"]["amplitude"][1] is trial["divergence"] is None
    assert trial["marker_errors"][1] is not None


def test_evidence_tells_the_beat_of_every_marker():
    real = swim(REAL_SPEED, 4.0, offset=0.02, beat=0.05, phase=0.7)
    trial = evidence(aligned(real, swim(REAL_SPEED, 5.5, beat=0.06)))["trials"]["a"]
    was, now = trial["beat_real"], trial["beat_simulated"]
    assert was["amplitude"] == pytest.approx([0.0, 0.0, 0.05], abs=5e-4)
    assert was["mean"] == pytest.approx([0.0, 0.0, 0.02], abs=5e-4)
    assert now["amplitude"][2] == pytest.approx(0.06, abs=5e-4)
    # after alignment
    assert [was["phase"][2], now["phase"][2], trial["phase"]] == pytest.approx([0.7] * 3, abs=0.01)


def test_the_published_parameters_have_their_known_figures(tracks, new_fluid_law):
    known = {"f0_50", "f1_00", "f1_25", "f1_50", "f1_75", "f2_00"}
    if not known <= set(tracks.names) or new_fluid_law:
        pytest.skip("not all six published tracks are there, or with the newer lift force")
    six = TrialSet(tuple(trial for trial in tracks if trial.name in known))
    comparison = Problem(FISH, six, threads=2).evaluate(FISH.space.published)
    for name, value, miss in (("marker_error", 58.2, 1.5), ("shape_error", 6.1, 0.7), ("velocity_error", 19.4, 1.5)):
        assert 1e3 * comparison.figure(name) == pytest.approx(value, abs=miss)


@pytest.fixture(scope="module")
def whole_motion(pool) -> Comparison:
    """The published fish against the pool, in the frame of the path."""
    return Problem(FISH, pool, "motion").evaluate(FISH.space.published)


def test_the_whole_motion_is_shape_recoil_and_progress(whole_motion):
    for trial in whole_motion.trials:
        real, simulated = trial.head.real, trial.head.simulated
        turned = composed(trial.shape_residual, simulated.axes[:, None])
        turned -= turned[:, :2].mean(axis=1, keepdims=True)  # of the head, on which the frame stands
        behind = np.column_stack([real.progress - simulated.progress, np.zeros(len(trial.times))])
        np.testing.assert_allclose(turned + trial.recoil_residual + behind[:, None], trial.motion_residual, atol=1e-12)


def test_the_whole_motion_sees_what_the_body_frame_hides(whole_motion, pool):
    figures = whole_motion.figures()
    alone = Problem(FISH, pool, "aligned", start="rest").evaluate(FISH.space.published).figures()
    assert figures["aligned_marker_error"] == alone["loss"]  # beside it, the same figure
    assert figures["loss"] == figures["motion_error"] > figures["recoil_error"] > 0
    for trial in figures["trials"].values():
        assert trial["yaw_error"] == abs(trial["yaw_simulated"] - trial["yaw_real"])
        assert trial["yaw_real_std"] < 0.1 * trial["yaw_real"]


def test_tail_first_is_worse_than_anything_that_goes_forward_and_worse_the_faster(whole_motion):
    def backward(speed: float) -> Comparison:
        first, *others = whole_motion.trials
        backward = replace(first, progress=replace(first.progress, velocity_simulated=-speed))
        return replace(whole_motion, trials=(backward, *others))

    assert not whole_motion.tail_first
    assert backward(1e-4).tail_first
    assert whole_motion.loss + 0.5 < backward(1e-4).loss < backward(0.01).loss < backward(0.1).loss


@pytest.mark.parametrize("protocol", ["motion", "aligned", "paper"])
def test_the_residual_vector_holds_what_the_loss_measures(pool, protocol):
    found = Problem(FISH, pool, protocol).evaluate(FISH.space.published)
    vector = found.residual_vector()
    assert np.isfinite(vector).all()
    squares = []
    for trial in found.trials:
        residuals = {"motion": trial.motion_residual, "aligned": trial.residual, "paper": trial.beat.swim_residual}
        residual = residuals[protocol]
        counts = np.isfinite(residual).all(axis=2) if protocol == "paper" else trial.weights > 0
        squares.append(np.mean(np.square(residual[counts]).sum(axis=1)))
    assert np.sum(vector**2) == pytest.approx(np.mean(squares))
    assert np.sqrt(np.sum(vector**2)) >= found.loss  # a root mean square is no smaller than the mean
    failed = replace(found, trials=tuple(replace(trial, divergence="it blew up") for trial in found.trials))
    assert failed.residual_vector().shape == vector.shape
    assert np.sum(failed.residual_vector() ** 2) == pytest.approx(FAILED_LOSS**2)


@pytest.mark.parametrize("protocol", ["motion", "aligned", "paper"])
def test_stages_of_the_residual_begin_without_progress_and_end_with_the_loss(pool, protocol):
    found = Problem(FISH, pool, protocol).evaluate(FISH.space.published)
    stages = found.residual_stages()
    squares = [float(np.sum((residual * weights) ** 2)) for residual, weights in stages]
    np.testing.assert_array_equal(stages[-2][0], found.residual_vector())
    assert squares[-2] == pytest.approx(np.sum(found.residual_vector() ** 2))
    assert squares[-1] == pytest.approx(found.loss, rel=0.02)  # what is below 1 mm counts by its square
    lost = replace(found, trials=tuple(replace(t, weights=t.weights * (np.arange(9) != 7)) for t in found.trials))
    residual, weights = lost.residual_stages()[-1]
    assert np.sum((residual * weights) ** 2) == pytest.approx(lost.loss, rel=0.02)
    assert len(stages) == (2 if protocol == "paper" else 8)
    if protocol == "paper":
        return
    lengths = [float(np.linalg.norm(trial.residual_vector())) for trial in found.trials]
    assert squares[3] == pytest.approx(np.exp(np.mean(np.log(lengths))))  # the geometric mean
    for k in range(3):
        np.testing.assert_array_equal(stages[k][0], stages[4 + k][0])
    stages, squares = stages[4:], squares[4:]
    shape = np.mean([np.mean(np.square(t.shape_residual[t.weights > 0]).sum(axis=1)) for t in found.trials])
    assert squares[0] == pytest.approx(shape) if protocol == "aligned" else squares[0] > shape
    far = [replace(t.progress, simulated=t.progress.simulated + 50.0) for t in found.trials]
    trials = tuple(replace(t, progress=way) for t, way in zip(found.trials, far, strict=True))
    moved = replace(found, trials=trials).residual_stages()[4:]
    np.testing.assert_array_equal(moved[0][0], stages[0][0])
    added = float(np.linalg.norm(moved[1][0] * moved[1][1])) - squares[1] ** 0.5
    assert 0.02 < added < 0.01 * np.log1p(60 / 0.01)  # of 50 m
    assert np.linalg.norm(moved[1][0]) > 49

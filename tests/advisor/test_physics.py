"""The built-in physics advisor: in worlds without a simulator, and once against the real thing."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
from worlds import SPACE, World, hidden_point, search, situation

from pools import LOGARITHMIC, hidden_values
from swim2real.advisor import PhysicsAdvisor, make_advisor
from swim2real.advisor.physics.advisor import caution, trust_radius
from swim2real.advisor.physics.model import (
    MOST_EXCESS,
    Aim,
    Correction,
    Features,
    Kernel,
    from_speed_scale,
    read_swims,
    to_speed_scale,
    without_outliers,
)
from swim2real.demo import Camera, synthetic_reference
from swim2real.errors import ArgumentError
from swim2real.objective.head import head_motion
from swim2real.objective.motion import beat
from swim2real.optimizers import Candidate, Evaluation, Proposal, Round, Situation, Step
from swim2real.optimizers.advisor import DECIMALS
from swim2real.pipeline import calibrate
from swim2real.robots.fish import FISH
from swim2real.robots.fish.response import fish_response
from swim2real.settings import CalibrationSettings
from swim2real.simulation import Simulator, Swim
from swim2real.simulation.stepper import Stepper
from swim2real.trials import Actuation

MIDDLE = np.full(16, 0.5)
FORWARD = 0.9 * hidden_point() + 0.1 * MIDDLE  # where the fish swims
CHANGE = re.compile(r"(raise|lower) (\w+) from ([\d.e+-]+) to ([\d.e+-]+)", re.IGNORECASE)


@pytest.fixture(autouse=True)
def coarse_search(monkeypatch):
    """Fewer points are tried for a proposal, which takes a fifth of the time."""
    monkeypatch.setattr("swim2real.advisor.physics.advisor._SAMPLES", 200)
    monkeypatch.setattr("swim2real.advisor.physics.advisor._STARTS", 1)


def advisor(space=SPACE, seed: int = 0) -> PhysicsAdvisor:
    return PhysicsAdvisor(FISH, space, seed)


def start(world: World, point=MIDDLE, failed: bool = False) -> Situation:
    """The situation after the first evaluation."""
    evaluation = world.evaluate(point, failed)
    return Situation(evaluation, (), evaluation)


def assert_sound(proposal: Proposal, incumbent: np.ndarray, space=SPACE) -> None:
    """Within the cube, with sentences that a person can read and that tell the truth."""
    assert proposal.point.shape == (16,)
    assert np.all((proposal.point >= 0) & (proposal.point <= 1))
    for text in (proposal.diagnosis, proposal.reasoning):
        assert text[:1].isupper()
        assert text.endswith(".")
        assert not re.search(r"\b(nan|inf|None)\b", text)
    json.dumps(proposal.as_dict(), allow_nan=False)
    before, after = space.to_values(incumbent), space.to_values(proposal.point)
    for verb, name, old, new in CHANGE.findall(proposal.reasoning):
        assert before[name] == pytest.approx(float(old), rel=0.01, abs=1e-6)
        assert after[name] == pytest.approx(float(new), rel=0.01, abs=1e-6)
        assert (after[name] > before[name]) == (verb.lower() == "raise")


# proposals


def test_it_is_made_by_name():
    assert isinstance(make_advisor("physics", FISH, SPACE, 0), PhysicsAdvisor)
    with pytest.raises(ArgumentError, match="advisor is 'oracle'; there are physics, files,"):
        make_advisor("oracle", FISH, SPACE, 0)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("space", [SPACE, replace(SPACE, scale="linear")], ids=["log", "linear"])
def test_a_proposal_is_in_the_cube_and_says_what_it_changes_and_why(space, seed):
    point = np.random.default_rng(seed).random(16)
    proposal = advisor(space, seed).propose(start(World(space=space), point))
    assert_sound(proposal, point, space)
    assert CHANGE.search(proposal.reasoning)


def test_the_diagnosis_begins_with_speed_over_frequency():
    evaluation = World().evaluate(MIDDLE)
    proposal = advisor().propose(Situation(evaluation, (), evaluation))
    slowest, *_, fastest = evaluation.detail["trials"].values()
    for frequency, trial in ((0.6, slowest), (1.5, fastest)):
        assert f"At {frequency:.2f} Hz it swims {1e3 * trial['velocity_simulated']:.0f} mm/s" in proposal.diagnosis
        assert f"{1e3 * trial['velocity_real']:.0f} mm/s" in proposal.diagnosis
    assert "The worst trial is f" in proposal.diagnosis


@pytest.mark.slow
def test_the_same_situation_gets_the_same_proposal():
    shown = situation(World(), rounds=2)
    one = advisor()
    first, again, other = one.propose(shown), one.propose(shown), advisor().propose(shown)
    assert first.as_dict() == again.as_dict() == other.as_dict()


SEARCH = """
import json, numpy as np
from worlds import SPACE, World, search
from swim2real.advisor import PhysicsAdvisor
from swim2real.robots.fish import FISH
seen, _ = search(World(), PhysicsAdvisor(FISH, SPACE, 0), np.full(16, 0.5), 4)
print(json.dumps([list(one.candidate.point) for one in seen]))
"""


@pytest.mark.slow
def test_another_processors_linear_algebra_leads_to_the_same_points():
    """OpenBLAS sums in another order on another kind of processor; elsewhere the variable does nothing."""
    found = []
    for kind in ("Nehalem", "Haswell"):
        environment = {**os.environ, "OPENBLAS_CORETYPE": kind, "PYTHONPATH": os.pathsep.join(sys.path)}
        done = subprocess.run([sys.executable, "-c", SEARCH], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found.append(json.loads(done.stdout))
    assert found[0] == found[1]
    assert len(set(map(tuple, found[0]))) == 4


@pytest.mark.slow
def test_a_situation_read_back_from_a_record_gets_the_same_proposal():
    def read(evaluation):
        return replace(evaluation, detail=json.loads(json.dumps(evaluation.detail)))

    shown = start(World(lost=[(1, 5)]))
    back = Situation(read(shown.incumbent), (), read(shown.first))
    assert advisor().propose(back).as_dict() == advisor().propose(shown).as_dict()


@pytest.mark.slow
def test_a_proposal_stays_within_its_trust():
    for rounds in (0, 1, 3):
        shown = situation(World(), rounds)
        apart = np.abs(advisor().propose(shown).point - shown.incumbent.candidate.point).max()
        assert 0 < apart <= trust_radius(shown.rounds) + 10**-DECIMALS


def test_rejected_rounds_change_the_next_proposal():
    world = World()
    first = world.evaluate(MIDDLE)
    plain = Situation(first, (), first)
    proposal = advisor().propose(plain)
    steps = tuple(
        Step(size, replace(world.evaluate(MIDDLE + size * (proposal.point - MIDDLE)), loss=first.loss + 0.1))
        for size in (1.0, 0.5, 0.25)
    )
    rejected = Situation(first, (Round(proposal, first, steps, False),), first)
    after = advisor().propose(rejected)
    assert np.abs(after.point - proposal.point).max() > 0.01
    assert np.abs(after.point - MIDDLE).max() <= trust_radius(rejected.rounds) + 1e-9 < trust_radius(())


def test_it_never_simulates(monkeypatch):
    def forbidden(*arguments, **options):
        raise AssertionError("the advisor simulates")

    shown = start(World())
    monkeypatch.setattr(Stepper, "run", forbidden)
    monkeypatch.setattr("mujoco.rollout.rollout", forbidden)
    monkeypatch.setattr("mujoco.MjData", forbidden)
    robot = replace(FISH, build=forbidden)
    assert_sound(PhysicsAdvisor(robot, SPACE, 0).propose(shown), MIDDLE)


def test_global_random_state_is_left_alone():
    np.random.seed(1)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    advisor().propose(start(World()))
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


# situations that aren't as one would like


@pytest.mark.parametrize(
    "lost",
    [
        pytest.param([(0, 6)], id="one", marks=pytest.mark.slow),
        pytest.param([(trial, 6) for trial in range(4)], id="one in all", marks=pytest.mark.slow),
        pytest.param([(2, 8)], id="tail tip"),
        pytest.param([(trial, 8) for trial in range(4)], id="tail tip in all", marks=pytest.mark.slow),
        pytest.param([(1, marker) for marker in range(9)], id="whole trial", marks=pytest.mark.slow),
        pytest.param([(trial, marker) for trial in range(4) for marker in range(9)], id="everything"),
    ],
)
def test_lost_markers_are_no_obstacle(lost):
    world = World(lost=lost)
    assert_sound(advisor().propose(start(world)), MIDDLE)
    shown = situation(world, rounds=1)
    assert_sound(advisor().propose(shown), shown.incumbent.candidate.point)


@pytest.mark.parametrize(
    "frequencies", [(1.2,), *(pytest.param(f, marks=pytest.mark.slow) for f in ((1.6, 0.8), (0.1, 6.0)))], ids=str
)
def test_few_trials_are_enough(frequencies):
    world = World(frequencies)
    assert_sound(advisor().propose(start(world)), MIDDLE)
    shown = situation(world, rounds=1)
    assert_sound(advisor().propose(shown), shown.incumbent.candidate.point)


def test_a_fish_that_swims_tail_first_gets_a_proposal():
    proposal = advisor().propose(start(World(sign=-1.0)))
    assert_sound(proposal, MIDDLE)
    assert "tail first" in proposal.diagnosis


def test_a_trial_that_swims_backward_alone_is_told():
    evaluation = World().evaluate(FORWARD)
    evaluation.detail["trials"]["f2"]["velocity_simulated"] *= -1
    proposal = advisor().propose(Situation(evaluation, (), evaluation))
    assert_sound(proposal, FORWARD)
    assert "backward at 1.20 Hz" in proposal.diagnosis


def test_a_fish_that_doesnt_move_gets_a_proposal():
    evaluation = World().evaluate(MIDDLE)
    for trial in evaluation.detail["trials"].values():
        trial["velocity_simulated"] = 0.0
    assert_sound(advisor().propose(Situation(evaluation, (), evaluation)), MIDDLE)


def test_after_a_diverged_first_simulation_it_proposes_around_the_middle():
    corner = np.full(16, 0.99)
    first = World().evaluate(corner, failed=True)
    rounds: tuple[Round, ...] = ()
    proposed = []
    for _ in range(4):
        proposal = advisor().propose(Situation(first, rounds, first))
        assert_sound(proposal, corner)
        assert "diverged" in proposal.diagnosis
        assert np.abs(proposal.point - 0.5).max() <= trust_radius(rounds)
        proposed.append(tuple(proposal.point))
        failed = tuple(Step(0.5**k, World().evaluate(corner, failed=True)) for k in range(3))
        rounds = (*rounds, Round(proposal, first, failed, False))
    assert len(set(proposed)) == 4  # another one each time


def test_a_diverged_step_is_no_evidence():
    world = World()
    first, failed = world.evaluate(MIDDLE), world.evaluate(np.full(16, 0.9), failed=True)
    rejected = Round(Proposal(np.full(16, 0.9)), first, (Step(1.0, failed),), False)
    proposal = advisor().propose(Situation(first, (rejected,), first))
    assert_sound(proposal, MIDDLE)


@pytest.mark.parametrize("corner", [0.0, 1.0])
def test_a_start_in_a_corner_is_no_obstacle(corner):
    point = np.full(16, corner)
    assert_sound(advisor().propose(start(World(), point)), point)


def test_the_whole_of_each_trial_may_be_compared():
    evaluation = World().evaluate(MIDDLE)
    evaluation.detail["horizon"] = None
    assert_sound(advisor().propose(Situation(evaluation, (), evaluation)), MIDDLE)


# success


def test_a_fish_that_is_too_fast_is_slowed_and_one_that_is_too_slow_is_sped_up():
    for factor, sooner in ((0.4, True), (2.5, False)):
        evaluation = World().evaluate(FORWARD)
        for trial in evaluation.detail["trials"].values():
            trial["velocity_real"] = factor * trial["velocity_simulated"]
        proposal = advisor().propose(Situation(evaluation, (), evaluation))
        points = np.array([FORWARD, proposal.point])
        before, after = FISH.swims.response.speeds(points, np.array([1.0]))[0][:, 0]
        assert (after < before) == sooner


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_it_gets_close_in_a_world_that_is_like_its_response(seed):
    first = np.random.default_rng(seed).random(16)
    seen, _ = search(World(), advisor(seed=seed), first, 8)
    assert min(evaluation.loss for evaluation in seen) < seen[0].loss / 3


@pytest.mark.slow
def test_it_finds_a_hidden_fish(tmp_path):
    """Noise-free swims; against the simulator itself, in a dozen evaluations."""
    reference = synthetic_reference(FISH, hidden_values(), (0.8, 1.2, 1.6), 2.5, Camera(), seed=3)
    losses = []
    calibrate(
        reference, FISH, CalibrationSettings(budget=12), tmp_path / "run", on_progress=lambda p: losses.append(p.loss)
    )
    assert len(losses) == 12
    assert min(losses) < losses[0] / 3


# trust and caution


def finished_round(loss: float = 0.1, steps: int = 1, accepted: bool = True, before: float = 0.2) -> Round:
    def evaluation(value: float) -> Evaluation:
        return Evaluation(Candidate(MIDDLE), value)

    tried = [Step(0.5**k, evaluation(0.3)) for k in range(steps - 1)]
    return Round(
        Proposal(MIDDLE), evaluation(before), (*tried, Step(0.5 ** (steps - 1), evaluation(loss))), accepted
    )  # fmt: skip


REJECTED = finished_round(loss=0.3, steps=3, accepted=False)


def test_trust_grows_with_full_steps_and_shrinks_with_rejections():
    begin = trust_radius(())
    assert trust_radius((finished_round(),)) > begin
    assert trust_radius((REJECTED,)) < begin
    assert trust_radius((REJECTED, REJECTED)) < trust_radius((REJECTED,))
    assert trust_radius((REJECTED, finished_round())) > trust_radius((REJECTED,))


def test_a_shortened_step_costs_less_trust_than_a_rejection():
    half, quarter = trust_radius((finished_round(steps=2),)), trust_radius((finished_round(steps=3),))
    assert trust_radius((REJECTED,)) <= quarter < half < trust_radius(())


def test_trust_stays_within_limits():
    highest = trust_radius((finished_round(),) * 50)
    assert trust_radius(()) < highest <= 1
    assert trust_radius((finished_round(),) * 51) == highest


def test_trust_that_is_smallest_and_in_vain_begins_anew():
    radii = [trust_radius((REJECTED,) * count) for count in range(20)]
    smallest = int(np.argmin(radii))
    assert radii[smallest] == 0.08
    assert radii[smallest + 1] == radii[0]
    assert np.all(np.diff(radii[: smallest + 1]) < 0)


def test_caution_falls_while_nothing_is_gained_and_returns_with_progress():
    begin = caution(())
    assert caution((REJECTED, REJECTED)) < caution((REJECTED,)) < begin
    assert caution((REJECTED, REJECTED, finished_round(loss=0.1, before=0.2))) == begin
    assert caution((REJECTED, finished_round(), REJECTED)) == caution((REJECTED,))


def test_a_hair_of_progress_isnt_progress():
    assert caution((finished_round(loss=0.1999, before=0.2),)) == caution((REJECTED,))


# what it sees


def test_the_speed_scale_is_odd_and_goes_back():
    speeds = np.array([-0.3, -0.01, 0.0, 0.001, 0.05, 0.4])
    np.testing.assert_allclose(from_speed_scale(to_speed_scale(speeds)), speeds, atol=1e-12)
    np.testing.assert_allclose(to_speed_scale(-speeds), -to_speed_scale(speeds))
    assert np.all(np.diff(to_speed_scale(speeds)) > 0)


def test_the_beat_is_read_relative_to_the_tail_tip():
    evidence = World().evidence(MIDDLE)
    plain = read_swims(evidence, "simulated")
    for trial in evidence["trials"].values():
        trial["beat_simulated"]["phase"] = [phase + 1.234 for phase in trial["beat_simulated"]["phase"]]
    np.testing.assert_allclose(read_swims(evidence, "simulated").beat, plain.beat, atol=1e-12)
    np.testing.assert_allclose(plain.beat[:, 17], 0.0, atol=1e-12)
    assert plain.beat.shape == (4, 18)


def test_a_lost_marker_is_nan_in_what_it_sees_and_nothing_else_is():
    real = read_swims(World(lost=[(1, 5)]).evidence(MIDDLE), "real")
    expected = np.zeros((4, 18), dtype=bool)
    expected[1, [5, 14]] = True
    np.testing.assert_array_equal(np.isnan(real.beat), expected)


FREQUENCIES = np.array([0.4, 0.7, 0.9, 1.1, 1.3, 1.5])


def test_one_staggering_trial_is_replaced_by_what_its_neighbors_suggest():
    smooth = to_speed_scale(0.12 * FREQUENCIES)
    for index in range(1, len(smooth)):  # the slowest, far from the others, has the slope to itself
        spoiled = smooth.copy()
        spoiled[index] -= 1.0
        found = without_outliers(spoiled, FREQUENCIES)
        assert found[index] == pytest.approx(smooth[index], abs=0.1)
        others = np.arange(len(smooth)) != index
        np.testing.assert_array_equal(found[others], spoiled[others])


@pytest.mark.parametrize("power", [0.7, 1.0, 1.3])
def test_smooth_speeds_are_kept_as_they_are(power):
    scaled = to_speed_scale(0.1 * FREQUENCIES**power) + 0.02 * np.sin(7 * FREQUENCIES)
    np.testing.assert_array_equal(without_outliers(scaled, FREQUENCIES), scaled)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_trials_have_no_outliers(count):
    scaled = np.array([1.0, -3.0, 2.0])[:count]
    np.testing.assert_array_equal(without_outliers(scaled, FREQUENCIES[:count]), scaled)


# what the run has shown

KERNEL = Kernel(offset=0.1, slope=0.2, bend=0.6, lengths=np.full(3, 0.35))


@pytest.fixture
def correction():
    rng = np.random.default_rng(0)
    points = 0.5 + 0.1 * (rng.random((6, 3)) - 0.5)
    deviations = np.column_stack([points.sum(axis=1), np.sin(points[:, 0]), 3 * points[:, 1] ** 2])
    return Correction(KERNEL, points, deviations), points, deviations


def test_a_correction_goes_through_what_was_seen(correction):
    model, points, deviations = correction
    mean, variance = model(points)
    np.testing.assert_allclose(mean, deviations, atol=0.02)
    assert variance.max() < 0.02**2


def test_a_correction_is_less_sure_the_farther_away(correction):
    model, points, _ = correction
    away = points.mean(axis=0) + np.outer([0.0, 0.1, 0.2, 0.4, 0.8], np.ones(3))
    assert np.all(np.diff(model(away)[1]) > 0)


def test_a_correction_is_nothing_where_nothing_deviated():
    points = np.random.default_rng(1).random((5, 3))
    mean, _ = Correction(KERNEL, points, np.zeros((5, 2)))(np.random.default_rng(2).random((20, 3)))
    np.testing.assert_array_equal(mean, 0.0)


def test_points_that_were_seen_twice_are_no_obstacle():
    points = np.tile(MIDDLE[:3], (5, 1))
    model = Correction(KERNEL, points, np.array([[1.0], [1.01], [0.99], [1.0], [1.0]]))
    assert model(MIDDLE[None, :3])[0][0, 0] == pytest.approx(1.0, abs=0.01)


def test_outputs_that_jump_are_taken_for_noise():
    points = np.random.default_rng(3).uniform(0.48, 0.52, (40, 3))
    jumps = np.where(np.arange(40) % 2, 1.0, -1.0)[:, None]
    mean, _ = Correction(KERNEL, points, jumps)(points)
    assert np.abs(mean).max() < 0.6
    smooth, _ = Correction(KERNEL, points, points[:, :1])(points)
    np.testing.assert_allclose(smooth, points[:, :1], atol=0.01)


AIM = Aim(np.array([0.05, 0.1]), np.full((2, 4), 0.02), np.full(2, 0.003), 4.0)


def swum(speeds, forward=1.0):
    speed = to_speed_scale(np.array([speeds]))
    return Features(speed, np.full((1, 2), forward), np.full((1, 2, 4), 0.02), np.zeros(1))


def test_an_excess_is_what_features_do_not_explain_of_a_loss():
    right, fast = swum([0.05, 0.1]), swum([0.06, 0.1])
    explained = AIM.losses(fast.speed, fast.beat, 0 * fast.speed, 0 * fast.beat)
    assert explained[0] == pytest.approx(0.003 / 2 + 0.02 / 2, rel=0.05)  # of 10 mm/s over 4 s
    assert AIM.excess(explained, fast)[0] == pytest.approx(0.0, abs=1e-12)
    assert AIM.excess(2 * explained, fast)[0] == pytest.approx(np.log(2))
    assert AIM.excess(np.array([0.5]), right)[0] == MOST_EXCESS
    assert AIM.excess(np.array([0.5]), swum([0.05, 0.1], forward=-1.0))[0] == 0.0


# the learned response


def box(count: int, seed: int = 0) -> np.ndarray:
    """Points all over the cube, corners among them."""
    rng = np.random.default_rng(seed)
    points = rng.random((count, 16))
    points[: count // 4] = rng.integers(0, 2, (count // 4, 16))
    points[0], points[1] = 0.0, 1.0
    return points


def test_the_response_is_finite_over_the_whole_box():
    points = box(400)
    frequencies = np.array([0.05, 0.4, 1.0, 3.0, 8.0])
    response = fish_response()
    for whole_motion in (False, True):
        beats = response.beats(points, frequencies, whole_motion)
        assert beats.shape == (400, 5, 18)
        assert np.isfinite(beats).all()
        if not whole_motion:
            np.testing.assert_allclose(beats[..., -1], 0.0, atol=1e-6)  # turned to the last marker's phase
    speeds, forward = response.speeds(points, frequencies)
    assert speeds.shape == (400, 5)
    assert np.isfinite(speeds).all()
    np.testing.assert_array_equal(np.sign(speeds), np.sign(forward))


def test_it_expects_what_fish_that_it_never_saw_do_from_rest():
    """The published fish and one near it, neither of which it was conditioned on."""
    simulator, driven = Simulator(FISH), np.array([0.5, 1.0, 1.5])
    published = LOGARITHMIC.to_cube(FISH.space.published)
    for values in (FISH.space.published, LOGARITHMIC.to_values(0.9 * published + 0.1 * MIDDLE)):
        swims = [Swim(f"{f}", Actuation(f, 0.0, 0.0), 4 / f) for f in driven]
        trials = simulator.simulate(values, swims)
        point = LOGARITHMIC.to_cube(values)[None]
        expected = fish_response().speeds(point, driven)[0][0]
        assert expected == pytest.approx([trial.track.speed for trial in trials], rel=0.35)
        beats = fish_response().beats(point, driven, whole_motion=True)[0]
        for trial, frequency, expected_beat in zip(trials, driven, beats, strict=True):
            head = head_motion(trial.track.times, trial.track.positions, frequency)
            placed = head.to_path(trial.track.body)
            seen = beat(trial.track.times, placed, np.ones(placed.shape[:2]), frequency)["amplitude"]
            np.testing.assert_allclose(np.hypot(expected_beat[:9], expected_beat[9:]), seen, rtol=0.3, atol=4e-3)


def test_its_file_is_small():
    file = resources.files("swim2real.robots.fish") / "response.npz"
    assert 1e5 < len(file.read_bytes()) < 1e6


def test_the_beat_between_measured_frequencies_is_between_theirs():
    response = fish_response()
    points = hidden_point()[None]
    beyond, ends = (response.beats(points, f)[0] for f in (np.array([1e-3, 1e3]), response.frequencies[[0, -1]]))
    np.testing.assert_allclose(beyond, ends, atol=1e-12)
    low, high = response.frequencies[1:3]
    beats = response.beats(points, np.array([low, np.sqrt(low * high), high]))[0]
    amplitudes = np.hypot(beats[:, :9], beats[:, 9:])
    assert np.all(amplitudes[1] <= amplitudes[[0, 2]].max(axis=0) + 1e-3)
    assert np.all(amplitudes[1] >= amplitudes[[0, 2]].min(axis=0) - 1e-3)

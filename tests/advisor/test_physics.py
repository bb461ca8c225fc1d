"""The built-in physics advisor: in worlds without a simulator, and once against the real thing."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from worlds import SPACE, World, hidden_point, situation

from pools import LOGARITHMIC, hidden_values
from swim2real.advisor import PhysicsAdvisor
from swim2real.advisor.choice import make_advisor
from swim2real.advisor.physics.advisor import caution, trust_radius
from swim2real.advisor.physics.model import (
    MOST_EXCESS,
    Aim,
    Correction,
    Features,
    Kernel,
    read_swims,
    to_speed_scale,
    without_outliers,
)
from swim2real.demo import SyntheticCamera, synthetic_reference
from swim2real.objective.figures import FitFigures
from swim2real.objective.head import head_motion
from swim2real.objective.motion import beat
from swim2real.optimizers import Candidate, Evaluation, Proposal, Round, Situation, Step
from swim2real.optimizers.advisor import DECIMALS
from swim2real.pipeline import calibrate
from swim2real.robots.fish import FISH, FISH_ROLLING
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


def at(evaluation: Evaluation) -> Situation:
    """The situation after a first evaluation."""
    return Situation(evaluation, (), evaluation)


def start(world: World, point=MIDDLE, **velocities: float) -> Situation:
    """The situation after the first evaluation, its velocities multiplied by what is given for each side."""
    evaluation = world.evaluate(point)
    for trial in evaluation.detail["trials"].values():
        for side, factor in velocities.items():
            trial[f"velocity_{side}"] = factor * trial["velocity_simulated"]
    return at(evaluation)


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


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("space", [SPACE, replace(SPACE, scale="linear")], ids=["log", "linear"])
def test_a_proposal_is_in_the_cube_and_says_what_it_changes_and_why(space, seed):
    point = np.random.default_rng(seed).random(16)
    shown = start(World(space=space), point)
    proposal = advisor(space, seed).propose(shown)
    assert_sound(proposal, point, space)
    assert CHANGE.search(proposal.reasoning)
    slowest, *_, fastest = shown.incumbent.detail["trials"].values()
    for frequency, trial in ((0.6, slowest), (1.5, fastest)):
        assert f"At {frequency:.2f} Hz it swims {1e3 * trial['velocity_simulated']:.0f} mm/s" in proposal.diagnosis
        assert f"{1e3 * trial['velocity_real']:.0f} mm/s" in proposal.diagnosis
    assert "The worst trial is f" in proposal.diagnosis


@pytest.mark.slow
def test_a_proposal_is_a_pure_function_within_its_trust():
    for rounds in (0, 1, 3):
        shown = situation(World(lost=[(1, 5)]), rounds)
        state = np.random.get_state()[1].copy()  # noqa: NPY002
        first = advisor().propose(shown)
        np.testing.assert_array_equal(np.random.get_state()[1], state)  # noqa: NPY002
        assert first.as_dict() == advisor().propose(shown).as_dict()
        apart = np.abs(first.point - shown.incumbent.candidate.point).max()
        assert 0 < apart <= trust_radius(shown.rounds) + 10**-DECIMALS


SEARCH = """
import json, numpy as np
from worlds import SPACE, World, search
from swim2real.advisor import PhysicsAdvisor
from swim2real.advisor.choice import make_advisor
from swim2real.robots.fish import FISH, FISH_ROLLING
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


def test_rejected_rounds_change_the_next_proposal():
    world = World()
    first = world.evaluate(MIDDLE)
    proposal = advisor().propose(at(first))
    points = [MIDDLE + size * (proposal.point - MIDDLE) for size in (1.0, 0.5)]
    tried = [replace(world.evaluate(point), loss=first.loss + 0.1) for point in points]
    tried.append(world.evaluate(np.full(16, 0.9), failed=True))  # which is no evidence
    steps = tuple(Step(0.5**k, one) for k, one in enumerate(tried))
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
    assert_sound(PhysicsAdvisor(replace(FISH, build=forbidden), SPACE, 0).propose(shown), MIDDLE)


# situations that aren't as one would like

SLOW = pytest.mark.slow
ODD = {
    "tail tip lost": (lambda: World(lost=[(2, 8)]), ""),
    "tail tip lost in all": (lambda: World(lost=[(trial, 8) for trial in range(4)]), "its beat can't be compared"),
    "a marker lost": (lambda: World(lost=[(0, 6)]), ""),
    "a trial lost": (lambda: World(lost=[(1, marker) for marker in range(9)]), ""),
    "all lost": (lambda: World(lost=[(trial, marker) for trial in range(4) for marker in range(9)]), ""),
    "one trial": (lambda: World((1.2,)), ""), "two trials, slow last": (lambda: World((1.6, 0.8)), ""),
    "far apart": (lambda: World((0.1, 6.0)), ""), "tail first": (lambda: World(sign=-1.0), "tail first"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "rounds"),
    [*((name, 0) for name in ODD), ("all lost", 1), *(pytest.param(name, 1, marks=SLOW) for name in list(ODD)[:8])],
)
def test_odd_trials_are_no_obstacle(name, rounds):
    make, said = ODD[name]
    shown = situation(make(), rounds) if rounds else start(make())
    proposal = advisor().propose(shown)
    assert_sound(proposal, shown.incumbent.candidate.point)
    assert rounds or said in proposal.diagnosis


def test_corners_and_odd_evidence_are_no_obstacle():
    for point in (np.zeros(16), np.ones(16)):
        assert_sound(advisor().propose(start(World(), point)), point)
    still, whole, backward = start(World(), simulated=0.0), start(World()), start(World(), FORWARD)
    whole.incumbent.detail["horizon"] = None  # all of each trial
    backward.incumbent.detail["trials"]["f2"]["velocity_simulated"] *= -1
    for shown in (still, whole, backward):
        assert_sound(advisor().propose(shown), shown.incumbent.candidate.point)
    assert "backward at 1.20 Hz" in advisor().propose(backward).diagnosis


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


@pytest.mark.parametrize(("factor", "slower"), [(0.4, True), (2.5, False)])
def test_a_fish_that_is_too_fast_is_slowed_and_one_that_is_too_slow_is_sped_up(factor, slower):
    proposal = advisor().propose(start(World(), FORWARD, real=factor))
    before, after = FISH.swims.response.speeds(np.array([FORWARD, proposal.point]), np.array([1.0]))[0][:, 0]
    assert (after < before) == slower


@pytest.mark.slow
def test_it_finds_a_hidden_fish(tmp_path):
    """Noise-free swims; against the simulator itself, in a dozen evaluations."""
    reference = synthetic_reference(FISH, hidden_values(), (0.8, 1.2, 1.6), 2.5, SyntheticCamera(), seed=3)
    losses = []
    calibrate(
        reference, FISH, CalibrationSettings(budget=12), tmp_path / "run", on_progress=lambda p: losses.append(p.loss)
    )
    assert len(losses) == 12
    assert min(losses) < losses[0] / 3


def finished_round(loss: float = 0.1, steps: int = 1, accepted: bool = True) -> Round:
    tried = [Step(0.5**k, Evaluation(Candidate(MIDDLE), 0.3)) for k in range(steps - 1)]
    last = Step(0.5 ** (steps - 1), Evaluation(Candidate(MIDDLE), loss))
    return Round(Proposal(MIDDLE), Evaluation(Candidate(MIDDLE), 0.2), (*tried, last), accepted)


FULL, HALF, QUARTER = (finished_round(steps=count) for count in (1, 2, 3))
REJECTED = finished_round(loss=0.3, steps=3, accepted=False)


def test_once_seven_swims_go_forward_it_steps_by_what_they_show():
    world, slopes = World(), np.random.default_rng(0).standard_normal((16, 50)) * 0.01

    def seen(point) -> Evaluation:
        residual = 1e-3 + (point - FORWARD) @ slopes
        length = float(np.linalg.norm(residual))
        stage = (residual, np.full(50, length**-0.5))  # whose squares add up to the loss
        return replace(world.evaluate(point), loss=length, stages=(stage,) * 4, margins=np.array([0.05]))

    middle, rng = np.clip(FORWARD + 0.05, 0, 1), np.random.default_rng(1)
    first, *others = (seen(np.clip(middle + 0.05 * rng.standard_normal(16), 0, 1)) for _ in range(20))
    best = min((first, *others), key=lambda one: one.loss)
    shown = Situation(best, (), first, tuple(others))
    proposal = advisor().propose(shown)
    assert_sound(proposal, best.candidate.point)
    assert seen(proposal.point).loss == pytest.approx(proposal.notes["expected_loss"], rel=0.05)
    assert seen(proposal.point).loss < 0.7 * best.loss
    few = Situation(first, (), first, tuple(others[:4]))
    assert "tried" not in advisor().propose(few).notes
    vain = Round(proposal, best, (Step(1.0, seen(best.candidate.point + 0.01)),), accepted=False)
    assert "tried" in advisor().propose(replace(shown, rounds=(vain,) * 2)).notes
    assert "tried" not in advisor().propose(replace(shown, rounds=(vain,) * 3)).notes  # the response has its turn


def test_where_little_is_promised_it_also_changes_what_nobody_moved():
    world, slopes = World(), np.random.default_rng(0).standard_normal((16, 50)) * 0.01
    left = np.random.default_rng(1).standard_normal(50) * 1e-3
    left -= slopes.T @ np.linalg.lstsq(slopes.T, left, rcond=None)[0]  # what no parameter explains

    def seen(point) -> Evaluation:
        residual = left + (point - FORWARD) @ slopes
        length = float(np.linalg.norm(residual))
        stage = (residual, np.full(50, length**-0.5))
        return replace(world.evaluate(point), loss=length, stages=(stage,) * 4, margins=np.array([0.05]))

    rng, still = np.random.default_rng(1), SPACE.names.index("hinge_stiffness_2")
    moves = 0.05 * rng.standard_normal((24, 16)) * (np.arange(16) != still)
    best, others = seen(FORWARD), [seen(np.clip(FORWARD + move, 0, 1)) for move in moves]
    proposal = advisor().propose(Situation(best, (), others[0], (*others[1:], best)))
    assert proposal.notes["tried"] == "hinge_stiffness_2"
    changed = np.abs(proposal.point - FORWARD)
    assert changed[still] > 2 * np.delete(changed, still).max()


def test_what_the_response_ignores_is_as_in_the_model_until_the_local_model_has_stepped():
    space = replace(FISH_ROLLING.space, scale="log")
    rules = make_advisor("physics", FISH_ROLLING, space, 0)
    assert isinstance(rules, PhysicsAdvisor)
    rng, ours = np.random.default_rng(0), len(SPACE)
    point = rng.random(len(space))
    detail = World(sign=-1).evidence(MIDDLE)
    backward = Evaluation(Candidate(point), 0.7, False, detail)
    forward = replace(backward, loss=0.05, detail=World().evidence(MIDDLE))
    for one in (backward, forward):
        ours_too = rules.propose(at(one)).point[ours:]
        np.testing.assert_allclose(ours_too, space.to_cube(space.published)[ours:], atol=1e-5)
    solved = Round(Proposal(point, notes={"tried": ""}), forward, (Step(1.0, backward),), accepted=False)
    stays = rules.propose(replace(at(forward), rounds=(solved,)))
    np.testing.assert_allclose(stays.point[ours:], point[ours:], atol=1e-5)


def test_trust_and_caution_follow_what_was_gained():
    begin, full, half, quarter, rejected = map(trust_radius, ((), (FULL,), (HALF,), (QUARTER,), (REJECTED,)))
    assert rejected <= quarter < half < begin < full
    assert trust_radius((REJECTED, REJECTED)) < rejected < trust_radius((REJECTED, FULL))
    assert trust_radius((FULL,) * 50) == trust_radius((FULL,) * 51) <= 1
    radii = [trust_radius((REJECTED,) * count) for count in range(20)]
    smallest = int(np.argmin(radii))
    assert radii[smallest] == 0.08
    assert radii[smallest + 1] == radii[0]  # what is smallest and in vain begins anew
    assert np.all(np.diff(radii[: smallest + 1]) < 0)
    begin, rejected = caution(()), caution((REJECTED,))
    assert caution((REJECTED, REJECTED)) < rejected < begin
    assert caution((REJECTED, REJECTED, FULL)) == begin
    assert caution((REJECTED, FULL, REJECTED)) == rejected
    assert caution((finished_round(loss=0.1999),)) == rejected  # a hair of progress isn't progress


def test_the_beat_is_read_relative_to_the_tail_tip_and_only_lost_markers_are_nan():
    evidence = World(lost=[(1, 5)]).evidence(MIDDLE)
    plain = read_swims(FitFigures.model_validate(evidence), "simulated").beat
    for trial in evidence["trials"].values():
        beats = trial["beat_simulated"]
        beats["phase"] = [None if phase is None else phase + 1.234 for phase in beats["phase"]]
    shifted = read_swims(FitFigures.model_validate(evidence), "simulated").beat
    np.testing.assert_allclose(shifted, plain, atol=1e-12)
    np.testing.assert_allclose(plain[:, 17], 0.0, atol=1e-12)
    expected = np.zeros((4, 18), dtype=bool)
    expected[1, [5, 14]] = True
    np.testing.assert_array_equal(np.isnan(plain), expected)


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


@pytest.mark.parametrize(
    "scaled",
    [
        *(to_speed_scale(0.1 * FREQUENCIES**power) + 0.02 * np.sin(7 * FREQUENCIES) for power in (0.7, 1.0, 1.3)),
        *(np.array([1.0, -3.0, 2.0])[:count] for count in (1, 2, 3)),  # few trials have no outliers
    ],
    ids=str,
)
def test_smooth_and_few_speeds_are_kept_as_they_are(scaled):
    np.testing.assert_array_equal(without_outliers(scaled, FREQUENCIES[: len(scaled)]), scaled)


# what the run has shown

KERNEL = Kernel(offset=0.1, slope=0.2, bend=0.6, lengths=np.full(3, 0.35))


def test_a_correction_goes_through_what_was_seen_and_is_less_sure_farther_away():
    points = 0.5 + 0.1 * (np.random.default_rng(0).random((6, 3)) - 0.5)
    deviations = np.column_stack([points.sum(axis=1), np.sin(points[:, 0]), 3 * points[:, 1] ** 2])
    model = Correction(KERNEL, points, deviations)
    mean, variance = model(points)
    np.testing.assert_allclose(mean, deviations, atol=0.02)
    assert variance.max() < 0.02**2
    away = points.mean(axis=0) + np.outer([0.0, 0.1, 0.2, 0.4, 0.8], np.ones(3))
    assert np.all(np.diff(model(away)[1]) > 0)
    nothing, _ = Correction(KERNEL, points, np.zeros((6, 2)))(away)
    np.testing.assert_array_equal(nothing, 0.0)


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


@pytest.mark.slow
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


def test_the_response_is_finite_over_the_whole_box():
    rng = np.random.default_rng(0)
    points = np.vstack([np.zeros(16), np.ones(16), rng.integers(0, 2, (98, 16)), rng.random((300, 16))])
    frequencies = np.array([0.05, 0.4, 1.0, 3.0, 8.0])
    for whole_motion in (False, True):
        assert np.isfinite(fish_response().beats(points, frequencies, whole_motion)).all()
    speeds, forward = fish_response().speeds(points, frequencies)
    assert np.isfinite(speeds).all()
    np.testing.assert_array_equal(np.sign(speeds), np.sign(forward))

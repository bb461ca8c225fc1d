"""Recordings as a calibration problem: posed, evaluated, stopped early, concluded, studied."""

from dataclasses import replace

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from recorded import (
    FLOATER,
    FLOATER_HIDDEN,
    PENDULUM,
    PENDULUM_HIDDEN,
    PENDULUM_SPACE,
    blank,
    floater_reference,
    pendulum_reference,
    recorded,
    telling,
    torque_table,
)
from refused import refusal, says
from run_settings import run_settings, settings_of
from swim2real.calibration import (
    Problem,
    RunFolder,
    Slopes,
    conclude,
    load_trials,
    minimize,
    protocol_for,
    sensitivities,
)
from swim2real.calibration.saved_trials import save_trials
from swim2real.optimizers import RandomSearch, streams
from swim2real.pipeline import calibrate
from swim2real.robots.drives import Drive
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings
from swim2real.trials import Signals, TrialSet
from swimbase.errors import ArgumentError, TrialError
from swimmers import Swimmer, trial_set


@pytest.fixture(scope="module")
def pendulum():
    return pendulum_reference(5e-4)


@pytest.fixture(scope="module")
def problem(pendulum):
    return Problem(PENDULUM, pendulum, threads=2)


@pytest.fixture(scope="module")
def floater():
    return Problem(FLOATER, floater_reference(5e-4), threads=2)


def test_the_robot_decides_what_problem_it_is(problem):
    assert problem.simulator.robot is PENDULUM
    assert (problem.protocol.name, problem.horizon) == ("playback", 4.0)
    assert Problem(FISH, trial_set(Swimmer().track()), threads=1).protocol.name == "motion"
    assert [protocol_for(FISH, "paper").name, protocol_for(PENDULUM, "playback").name] == ["paper", "playback"]
    said = refusal(ArgumentError, protocol_for, PENDULUM, "paper")
    assert says(said, "protocol is 'paper'", "robot 'pendulum' are recordings", "protocol playback")
    said = refusal(ArgumentError, protocol_for, FISH, "playback")
    assert says(said, "steady swims", "protocol motion or aligned or paper")


def test_a_reference_that_isnt_the_robots_is_refused(pendulum):
    def posed(*trials, names=pendulum.marker_names):
        return refusal(TrialError, Problem, PENDULUM, TrialSet(trials, names), threads=1)

    said = posed(*pendulum.trials, names=("pivot", "end", "middle"))
    assert says(said, "pivot, end, middle", "'pendulum' has 3 (pivot, middle, end)", "in the same order")
    one, other = pendulum.trials
    deaf = replace(other, sensors=None)
    assert says(posed(one, deaf), "trial 'b' has no sensors", "a column 'gyro[1]'")
    said = posed(replace(deaf, sensors=Signals([3.0], ["gyro[0]"], [[0.0]])))
    assert says(said, "trial 'b': sensor 'gyro[1]' can't be compared", "no column 'gyro[1]'; there are gyro[0]")
    assert says(posed(replace(other, controls=None)), "trial 'b' has no controls; actuator 'torque'")


def test_what_the_controls_dont_reach_is_told(pendulum):
    def findings(times, robot=PENDULUM):
        table = Signals(times, ["torque"], np.zeros((len(times), 1)))
        trial = replace(pendulum["a"], controls=table)  # 2.5 to 5 s
        return Problem(robot, TrialSet((trial,), pendulum.marker_names), threads=1).examinations()["a"]["findings"]

    assert findings(np.arange(2.0, 5.0, 0.05)) == findings([2.5]) == findings([0.0, 2.6]) == []
    late, short = findings(np.arange(3.0, 4.01, 0.05))
    assert late == "its controls begin at 3 s, its frames at 2.5 s; the first value is held until then"
    assert short == "its controls end at 4 s, its frames at 5 s; the last value is held from there on"
    constant = telling(PENDULUM, controls={"torque": Drive(offset=0.1)})
    assert findings([9.0], constant) == []  # nothing reads the table
    with pytest.raises(TrialError, match="trial 'a': its controls don't drive it: its rows are from 9 s to 9 s"):
        findings([9.0])


def test_lost_markers_are_told_and_dont_count(pendulum):
    trial = pendulum["a"]
    positions, confidence = trial.track.positions.copy(), trial.track.confidence.copy()
    positions[40:60, 2] = np.nan
    confidence[80:90, 1] = 0.3
    positions[80:90, 1] += 0.5
    spoiled = replace(trial, track=MarkerTrack(trial.track.times, positions, confidence))
    problem = Problem(PENDULUM, TrialSet((spoiled,), pendulum.marker_names), threads=1)
    told = problem.examinations()["a"]
    assert told["findings"][:2] == [  # the table is longer, which is told after these
        "middle is lost in 7 % of frames (doubtful 10)", "end is lost in 13 % of frames (missing 20)"
    ]  # fmt: skip
    assert not told["usable"]
    assert (told["controls"], told["sensors"]) == (["torque"], ["gyro[1]"])
    assert problem.evaluate(PENDULUM_HIDDEN).loss < 5e-3


@pytest.fixture(scope="module")
def runs(tmp_path_factory, problem, floater):
    """A short random search of each robot that has found the hidden values."""
    found = {}
    for one, hidden in ((problem, PENDULUM_HIDDEN), (floater, FLOATER_HIDDEN)):
        folder, space = RunFolder(tmp_path_factory.mktemp("run") / one.robot.name), one.robot.space
        with folder.locked():
            reference = TrialSet(one.trials, one.robot.marker_names)
            folder.begin(settings_of(one, reference, budget=3))
            optimizer = RandomSearch(len(space), streams(0)[1], space.to_cube(hidden))
            minimize(one, space, optimizer, 3, folder)
        found[one.robot.name] = folder
    return found


@pytest.mark.parametrize("name", ["pendulum", "floater"])
def test_an_outcome_and_its_recordings_are_kept(name, runs, problem, floater):
    one, hidden = {"pendulum": (problem, PENDULUM_HIDDEN), "floater": (floater, FLOATER_HIDDEN)}[name]
    reference = TrialSet(one.trials, one.robot.marker_names)
    kept, out = reference.split([one.trials[1].name])
    folder = runs[name]
    outcome = conclude(folder, one.of(kept), one.of(out), hidden, sensitivities(one, one.robot.space, hidden))
    outcome = outcome.to_json()
    assert outcome == folder.outcome().to_json()
    assert list(outcome["trials"]) == list(reference.names)
    assert "from_rest" not in outcome
    speeds = [one["speed"] for one in outcome["sensitivity"]]
    assert all(speed is None for speed in speeds) == (name == "pendulum")
    pairs = load_trials(folder)
    assert [(pair.compared.name, pair.held_out) for pair in pairs] == [(kept.names[0], False), (out.names[0], True)]
    fresh = one.evaluate(hidden)
    for pair, trial in zip(pairs, fresh.trials, strict=True):
        kept_figures, figures = pair.compared.figures(), trial.figures()
        assert list(kept_figures) == list(figures)
        for key in set(figures) - {"divergence", "sensor_errors"}:
            assert kept_figures[key] == pytest.approx(figures[key], rel=1e-3, abs=1e-5)
        assert kept_figures.get("sensor_errors", {}) == pytest.approx(figures.get("sensor_errors", {}), rel=1e-3)
        assert np.array_equal(pair.compared.times, trial.times)
        assert pair.compared.frame == trial.frame


def test_a_diverged_recording_is_kept_as_such(problem, tmp_path):
    def build(values):
        spec = PENDULUM.build(values)
        spec.option.gravity = (0, 0, 1e9)
        return spec

    bad = Problem(replace(PENDULUM, build=build), TrialSet(problem.trials, PENDULUM.marker_names), threads=1)
    comparison = bad.evaluate(PENDULUM_HIDDEN)
    assert comparison.loss == 1.0
    save_trials(RunFolder(tmp_path), comparison, None)
    pair = load_trials(RunFolder(tmp_path))[0]
    assert pair.compared.divergence == comparison.trials[0].divergence
    assert np.isnan(pair.compared.path_simulated).all()


class Told(RandomSearch):
    """Keeps what it is told."""

    needs_residual = True

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.heard = []

    def _learn(self, evaluation):
        self.heard.append(evaluation)


def test_optimizers_are_told_the_way_from_the_models_values_and_losses_arent(problem, tmp_path):
    space, runs = PENDULUM.space, {}
    prior = space.to_cube(space.published)
    for name, given in (("plain", None), ("prior", prior)):
        optimizer = Told(len(space), streams(0)[1])
        folder = RunFolder(tmp_path / name)
        with folder.locked():
            folder.begin(run_settings(budget=3))
            minimize(problem, space, optimizer, 3, folder, prior=given)
        runs[name] = optimizer.heard
    length = np.linalg.norm(runs["plain"][0].residual)
    for plain, drawn in zip(runs["plain"], runs["prior"], strict=True):
        assert drawn.loss == plain.loss
        assert np.array_equal(drawn.residual[:-3], plain.residual)
        assert np.allclose(drawn.residual[-3:], 0.01 * length * (drawn.candidate.point - prior))


def test_a_run_by_least_squares_tells_within_which_values_its_error_hardly_rises(tmp_path):
    blanks = [blank(PENDULUM, name, 2.0, controls=torque_table(2.0, k)) for k, name in enumerate("ab")]
    reference = recorded(PENDULUM, PENDULUM_HIDDEN, blanks, 1e-3)
    settings = CalibrationSettings(method="least-squares", budget=30, horizon=1.0, threads=2)
    found = calibrate(reference, telling(PENDULUM, start="rest"), settings, tmp_path / "run", on_warning=None)
    assert set(found.ranges) == set(PENDULUM_SPACE.names)
    for name, (low, high) in found.ranges.items():
        assert low < PENDULUM_HIDDEN[name] < high < 2 * low
    other = replace(settings, method="random", budget=2)
    assert calibrate(reference, PENDULUM, other, tmp_path / "other", on_warning=None).ranges == {}


def test_delays_are_looked_for_from_the_starts_of_the_run(tmp_path, monkeypatch, pendulum):
    asked = []
    monkeypatch.setattr("swim2real.pipeline.calibration.delays", lambda robot, *_: asked.append(robot) or [])
    robot = telling(PENDULUM, start="rest", start_named=False)  # its recordings begin in motion
    settings = CalibrationSettings(method="random", budget=1, horizon=0.5, threads=1)
    calibrate(pendulum, robot, settings, tmp_path / "run", on_warning=lambda line: None)
    assert [one.trials.start for one in asked] == ["fitted"]


def test_slopes_are_those_of_a_plane_and_unknown_where_no_points_lie():
    space, rng = PENDULUM_SPACE, np.random.default_rng(0)
    plane = np.diag([1.0, 0.1, 0.0])  # the third parameter doesn't count
    slopes = Slopes(space)
    assert slopes.ranges() == {}
    for step in [np.zeros(3), *(0.05 * rng.standard_normal((12, 3)))]:
        slopes.add(0.5 + step, np.concatenate([[0.02], plane @ step]))
    ends = {name: [space.to_cube({**space.published, name: end})[k] for end in slopes.ranges()[name]]
            for k, name in enumerate(space.names)}  # fmt: skip
    reach = 0.02 * (1.1**2 - 1) ** 0.5
    assert ends["shoulder_damping"] == pytest.approx([0.5 - reach, 0.5 + reach], rel=1e-3)
    assert ends["elbow_damping"] == pytest.approx([0.5 - 10 * reach, 0.5 + 10 * reach], rel=1e-3)
    assert ends["lower_mass"] == pytest.approx([0, 1])
    flat = Slopes(space)
    for step in 0.05 * np.eye(3)[[0, 1]]:
        flat.add(0.5 + step, np.concatenate([[0.02], plane @ step]))
    flat.add(np.full(3, 0.5), np.array([0.02, 0, 0, 0]))
    assert set(flat.ranges()) == {"shoulder_damping", "elbow_damping"}

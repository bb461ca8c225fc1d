import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import small_run

from markertrack.track import MarkerTrack
from refused import refusal, says
from swim2real.calibration import (
    Problem,
    RunFolder,
    conclude,
    examine_swims,
    load_trials,
    reference_fingerprint,
    sensitivities,
)
from swim2real.parameters import ParameterSpace
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator
from swim2real.trials import Signals, Trial, TrialSet
from swimbase.errors import RunError, TrialError
from swimmers import Swimmer, trial_set

ROBOT = small_run.ROBOT
FEW = TrialSet((Trial("a", MarkerTrack(np.arange(60) / 60, np.random.default_rng(0).random((60, 3, 2)))),))


def test_the_papers_protocol_drives_at_the_nominal_frequency_from_rest(reference):
    problem = Problem(ROBOT, reference, "paper", threads=2)
    for trial, swim in zip(reference, (one.request for one in problem.prepared), strict=True):
        assert swim.actuation.frequency == trial.nominal_frequency
        assert swim.actuation.start_speed is None
    figures = problem.evaluate(small_run.HIDDEN).figures()
    assert figures["loss"] == figures["marker_error"] > figures["aligned_marker_error"] > 0.005


@pytest.mark.parametrize(("pose", "parts"), [
    (lambda: Problem(ROBOT, trial_set(Swimmer().track()), "paper"),
     ("trial 'swim0' has no nominal frequency", "protocol 'paper'", "reference.json")),
    (lambda: Problem(ROBOT, trial_set(Swimmer().track()), "aligned", 0.0), ("horizon is 0.0 s", "above 0")),
    (lambda: Problem(ROBOT, trial_set(Swimmer().track()), "aligned", np.nan), ("horizon is nan s", "above 0")),
    (lambda: examine_swims(FEW, FISH), ("3 markers (M0, M1, M2)", "robot 'fish' has 9 (M0, M1, M2, M3")),
    (lambda: examine_swims(trial_set(Swimmer().track(), Swimmer(amplitude=0.0).track()), FISH),
     ("trial 'swim1'", "no regular beat")),
])  # fmt: skip
def test_a_problem_that_cant_be_posed_is_refused(pose, parts):
    assert says(refusal(TrialError, pose), *parts)


def test_an_outcome_is_written_with_fit_and_held_out_apart(reference, tmp_path):
    kept, out = reference.split(["f1_70"])
    simulator = Simulator(ROBOT, threads=2)
    fitted, unseen = (Problem(ROBOT, trials, simulator=simulator) for trials in (kept, out))
    folder = RunFolder(tmp_path)
    outcome = conclude(folder, fitted, unseen, small_run.HIDDEN)
    assert folder.outcome() == outcome
    assert json.loads(json.dumps(outcome.to_json(), allow_nan=False)) == outcome.to_json()
    assert list(outcome.fit.trials) == ["f1_30"]
    assert outcome.fit.loss == outcome.fit.motion_error == outcome.fit.trials["f1_30"].motion_error
    assert outcome.held_out is not None
    assert list(outcome.held_out.trials) == ["f1_70"]
    assert set(outcome.trials) == {"f1_30", "f1_70"}
    for name, frequency in small_run.FREQUENCIES.items():
        found = outcome.trials[name]
        assert found.frequency == pytest.approx(frequency, abs=0.01)
        assert found.usable
        assert found.findings == []
        assert found.nominal_frequency == frequency
    assert outcome.sensitivity is None
    assert outcome.marker_names == list(ROBOT.marker_names)
    assert simulator.engine.difference(outcome.engine) is None

    saved = load_trials(folder)
    assert [(one.compared.name, one.held_out) for one in saved] == [("f1_30", False), ("f1_70", True)]
    for one, part in zip(saved, (fitted, unseen), strict=True):
        (trial,) = part.evaluate(small_run.HIDDEN).trials
        kept = one.compared
        assert (kept.frequency, kept.frame, kept.sensors) == (pytest.approx(trial.frequency), (0, 1), ())
        for name in ("times", "weights", "real", "simulated", "registration", "path_simulated"):
            np.testing.assert_allclose(getattr(kept, name), getattr(trial, name), atol=1e-6)
        np.testing.assert_allclose(kept.progress.real, trial.progress.real, atol=1e-6)
        assert kept.loss == pytest.approx(trial.loss, abs=1e-6)
        assert kept.figures() == pytest.approx(trial.figures(), abs=1e-5, nan_ok=True)


def test_swims_that_arent_there_or_damaged_are_told(tmp_path):
    folder, path = RunFolder(tmp_path), tmp_path / "trials.npz"
    assert says(refusal(RunError, load_trials, folder), str(tmp_path), "no trials.npz yet")
    for damage in (b"", b"PK\x03\x04 no archive", None):
        path.write_bytes(damage) if damage is not None else np.savez(path, names=np.array(["a"]))
        assert refusal(RunError, load_trials, folder).startswith(f"{path} can't be read: ")


@pytest.mark.slow
def test_sensitivities_tell_parameters_apart(problem):
    space = ParameterSpace(tuple(ROBOT.space[name] for name in small_run.FREE))
    values = {**small_run.HIDDEN, "hinge_damping_0": 0.0}
    found = {one.name: one for one in sensitivities(problem, space, values)}
    assert list(found) == list(small_run.FREE)
    arm, damping = found["motor_arm_length"], found["hinge_damping_0"]
    assert arm.lower is not None
    assert max(abs(arm.lower), abs(arm.upper or 0.0)) > 2e-3
    assert arm.speed > 0  # a longer arm bends the tail farther
    assert damping.lower is None  # at its bound
    assert damping.upper is not None
    assert found["fluid_slender_drag"].speed < 0
    # the same by hand, for one step
    point = space.to_cube(values)
    point[2] += 0.1
    by_hand = (
        problem.evaluate(space.to_values(point)).loss - problem.evaluate(space.to_values(space.to_cube(values))).loss
    )
    assert arm.upper == pytest.approx(by_hand, rel=1e-9)
    assert json.dumps([asdict(one) for one in found.values()], allow_nan=False)


def test_a_reference_has_a_fingerprint_of_all_that_matters(reference):
    same = TrialSet(tuple(reference), reference.marker_names)
    assert reference_fingerprint(same) == reference_fingerprint(reference)
    first, second = reference
    nudged = first.track.positions.copy()
    nudged[0, 0, 0] += 1e-9
    table, two = (Signals([0.0], ["left"], [[value]]) for value in (1.0, 2.0))
    changes = [
        {"name": "other"}, {"nominal_frequency": 0.5}, {"track": MarkerTrack(first.track.times, nudged)},
        {"controls": table}, {"controls": two}, {"sensors": table}, {"start": {"a": 0}}, {"start_velocities": {"a": 0}},
    ]  # fmt: skip
    others = [(second, first), (first,), *((replace(first, **change), second) for change in changes)]
    prints = {reference_fingerprint(TrialSet(tuple(trials))) for trials in [reference, *others]}
    assert len(prints) == len(others) + 1

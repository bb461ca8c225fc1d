"""The embedded example: what its camera does to a swim, and the whole pipeline on it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pools import hidden_values
from swim2real import pipeline
from swim2real.demo import DEMO_FREQUENCIES, HELD_OUT, Camera, demo, synthetic_reference
from swim2real.demo import example as room
from swim2real.errors import ArgumentError, RunError
from swim2real.robots.fish import FISH
from swim2real.simulation import Simulator, Swim
from swim2real.tracking import check_track
from swim2real.trials import Actuation, TrialSet, load_reference

FREQUENCY = 1.6  # Hz


def film(camera: Camera | None = None, seed: int = 3, frequencies=(FREQUENCY,), seconds: float = 1.5) -> TrialSet:
    return synthetic_reference(FISH, hidden_values(), frequencies, seconds, camera or Camera(), seed, threads=2)


def bodies(trials: TrialSet) -> np.ndarray:
    """Positions in the body frame: what place and heading in the pool don't change."""
    return trials.trials[0].track.body


# the camera


def test_the_same_seed_films_the_same_trials():
    camera = Camera(noise=1e-3, placement=3e-3, lost={"f1_60": (6, 7, 0.5)})
    one, other = film(camera), film(camera)
    np.testing.assert_array_equal(one.trials[0].track.positions, other.trials[0].track.positions)


def test_another_seed_films_another_place_and_phase():
    one, other = film(seed=3), film(seed=4)
    heads = [trials.trials[0].track.heads for trials in (one, other)]
    assert np.linalg.norm(heads[0][0] - heads[1][0]) > 1e-3
    assert np.abs(bodies(one) - bodies(other)).max() > 5e-3


def test_trials_are_named_after_their_frequency_and_time_stamped_by_the_camera():
    trials = film(Camera(fps=30.0), frequencies=(1.25, 2.0), seconds=1.0)
    assert trials.names == ("f1_25", "f2_00")
    assert trials.marker_names == FISH.marker_names
    for trial, frequency in zip(trials, (1.25, 2.0), strict=True):
        assert trial.nominal_frequency == frequency
        np.testing.assert_allclose(trial.track.times, np.arange(31) / 30)
        assert trial.provenance == "synthetic, 30 fps, hidden parameters"


def test_a_plain_camera_films_the_swim_itself():
    track = film().trials[0].track
    swim = Swim("swim", Actuation(FREQUENCY, 0.0, 0.1), 1.5)
    expected = Simulator(FISH, 2, 1 / 60).simulate(hidden_values(), [swim]).trials[0].track
    assert track.speed == pytest.approx(expected.speed, rel=0.02)
    np.testing.assert_allclose(np.ptp(track.body, axis=0), np.ptp(expected.body, axis=0), atol=3e-3)


def test_noise_shakes_every_marker_anew():
    difference = film(Camera(noise=1e-3)).trials[0].track.positions - film().trials[0].track.positions
    assert difference.std(axis=0) == pytest.approx(np.full((9, 2), 1e-3), rel=0.35)
    assert np.abs(np.diff(difference, axis=0)).mean() == pytest.approx(2e-3 / np.sqrt(np.pi), rel=0.1)


def test_misplaced_markers_have_a_static_offset_each():
    difference = film(Camera(placement=5e-3)).trials[0].track.positions - film().trials[0].track.positions
    lengths = np.linalg.norm(difference, axis=2)
    np.testing.assert_allclose(lengths, lengths[:1].repeat(len(lengths), axis=0), atol=1e-9)
    assert 2e-3 < lengths.mean() < 15e-3
    assert len(np.unique(lengths[0].round(9))) == 9


def test_misplaced_head_markers_keep_their_distance_along_the_head():
    track = film(Camera(placement=5e-3)).trials[0].track
    length = np.linalg.norm(track.positions[:, 1] - track.positions[:, 0], axis=1)
    assert length == pytest.approx(np.full(len(length), FISH.head_length), rel=0.02)


def test_another_time_step_makes_nearly_the_same_swim():
    difference = np.abs(bodies(film(Camera(timestep=5e-4))) - bodies(film()))
    assert 1e-9 < difference.max() < 5e-3


def test_a_lost_marker_sits_on_its_neighbor_from_then_on():
    whole, lost = film().trials[0].track, film(Camera(lost={"f1_60": (6, 7, 0.5)})).trials[0].track
    late = whole.times >= 0.5
    gap = np.linalg.norm(lost.positions[:, 6] - lost.positions[:, 7], axis=1)
    assert gap[late].max() < 6e-3 < gap[~late].min()
    others = [marker for marker in range(9) if marker != 6]
    np.testing.assert_array_equal(lost.positions[:, others], whole.positions[:, others])
    np.testing.assert_array_equal(lost.positions[~late], whole.positions[~late])


def test_only_the_named_trial_loses_a_marker():
    trials = film(Camera(lost={"f2_00": (6, 7, 0.0)}), frequencies=(FREQUENCY, 2.0), seconds=1.0)
    gaps = [np.linalg.norm(t.track.positions[:, 6] - t.track.positions[:, 7], axis=1).min() for t in trials]
    assert gaps[1] < 6e-3 < gaps[0]


# the demo


def test_the_hidden_fish_is_within_bounds_and_not_the_published_one():
    hidden = room.hidden_values()
    assert FISH.space.check(hidden) == hidden
    assert hidden == room.hidden_values()
    apart = replace(FISH.space, scale="log").to_cube(hidden) - replace(FISH.space, scale="log").to_cube(
        FISH.space.published
    )
    assert np.abs(apart).max() > 0.2


@pytest.fixture(scope="session")
def short_demo(tmp_path_factory):
    """A demo of three evaluations, without the effect of each parameter, which costs ten times as much."""
    patches = pytest.MonkeyPatch()
    patches.setattr(pipeline, "sensitivities", lambda problem, space, values: [])
    out = tmp_path_factory.mktemp("demo") / "out"
    reference, outcome = demo(out, budget=3, threads=2)
    patches.undo()
    return out, reference, outcome


def test_the_demo_leaves_a_reference_and_a_run(short_demo):
    out, reference, outcome = short_demo
    assert {path.name for path in out.iterdir()} == {"reference", "run"}
    assert reference.names == ("f0_50", "f0_75", "f1_00", "f1_25", "f1_50")
    assert len(reference) == len(DEMO_FREQUENCIES)
    files = {path.name for path in (out / "run").iterdir()}
    assert {"settings.json", "record.jsonl", "best.json", "outcome.json", "swims.npz"} <= files
    assert json.loads((out / "run" / "outcome.json").read_text()) == outcome


def test_the_demos_run_belongs_to_the_reference_that_it_leaves(short_demo):
    out, reference, _ = short_demo
    settings = json.loads((out / "run" / "settings.json").read_text())
    found = load_reference(out / "reference")
    assert settings["reference_fingerprint"] == pipeline.reference_fingerprint(found)
    np.testing.assert_array_equal(found["f1_50"].track.positions, reference["f1_50"].track.positions)


def test_the_demo_evaluates_on_the_trial_that_it_left_out(short_demo):
    _, reference, outcome = short_demo
    assert tuple(outcome["held_out"]["trials"]) == (HELD_OUT,)
    assert set(outcome["fit"]["trials"]) == set(reference.names) - {HELD_OUT}
    assert 0 < outcome["held_out"]["aligned_marker_error"] < 1


def test_the_demos_lost_track_is_found(short_demo):
    _, reference, outcome = short_demo
    quality = check_track(reference["f1_25"].track, FISH.rest_markers)
    assert quality.lost_share[6] > 0.6
    assert not quality.usable
    assert [name for name, trial in outcome["trials"].items() if not trial["usable"]] == ["f1_25"]
    assert any(line.startswith("M6 is lost in") for line in outcome["trials"]["f1_25"]["findings"])


def test_a_second_demo_into_the_same_folder_is_refused(short_demo):
    out = short_demo[0]
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    with pytest.raises(RunError, match="holds a demo already; remove it, choose another --out or go on with --resume"):
        demo(out, budget=3)
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


def test_a_demo_without_a_budget_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(ArgumentError, match="budget is 0"):
        demo(tmp_path / "out", budget=0)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_whole_demo_finds_the_hidden_fish(tmp_path, capsys):
    from swim2real.cli import main

    out = tmp_path / "out"
    with pytest.raises(SystemExit) as leaving:
        main(["demo", "--out", str(out), "--quiet"])
    assert leaving.value.code == 0
    assert capsys.readouterr() == ("", "")
    assert (out / "run" / "report.html").is_file()
    outcome = json.loads((out / "run" / "outcome.json").read_text())
    assert outcome["fit"]["aligned_marker_error"] < 25e-3
    assert outcome["held_out"]["aligned_marker_error"] < 50e-3
    assert len(outcome["sensitivity"]) == len(FISH.space)
    assert len((out / "run" / "record.jsonl").read_text().splitlines()) == 40

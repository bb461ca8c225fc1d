"""What a VLM is told, as data."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from waves import EEL_SPACE, Wave, after, eel, evaluate, fish_situation, start
from worlds import SPACE, World

from swim2real.advisor.briefing.facts import facts, wrapped
from swim2real.advisor.briefing.formatting import shortened
from swim2real.advisor.briefing.history import LONGEST
from swim2real.optimizers import Evaluation, Proposal
from swim2real.robots.fish import FISH

MIDDLE = [0.5, 0.5]
REAL = Wave()
WIDER = Wave(speed=0.15, amplitudes=(0.0, 0.0, 0.03, 0.06, 0.12), behind=(0.0, 0.0, 0.0, 10.0, 30.0))


def told(pairs, **more):
    return facts(start(evaluate(MIDDLE, pairs, **more)), eel(), EEL_SPACE)


@pytest.fixture(scope="module")
def plain():
    """Facts of a swim that is half as fast again, beats a fifth wider at the end, and whose wave runs faster."""
    return told([(REAL, WIDER)])


def test_amplitudes_ratios_and_speeds_are_those_of_the_swims(plain):
    trial = plain["incumbent"]["trials"][0]
    assert trial["frequency"] == 1.0
    assert trial["velocity"] == {"real": pytest.approx(0.1, rel=0.02), "simulated": pytest.approx(0.15, rel=0.02)}
    last = trial["markers"][-1]
    assert last["name"] == "P4"
    assert last["amplitude"]["real"] == pytest.approx(0.1, rel=0.01)
    assert last["amplitude"]["simulated"] == pytest.approx(0.12, rel=0.01)
    assert last["amplitude"]["ratio"] == pytest.approx(1.2, rel=0.01)
    found = plain["differences"]["by_trial"][0]
    assert found["speed_ratio"] == pytest.approx(1.5, rel=0.02)
    assert found["amplitude_ratio"] == last["amplitude"]["ratio"]


def test_a_lag_is_how_much_later_the_last_marker_comes(plain):
    found = plain["differences"]
    assert (found["lag_from"], found["lag_to"]) == ("P2", "P4")
    assert found["by_trial"][0]["lag_real_deg"] == pytest.approx(50, abs=1)
    assert found["by_trial"][0]["lag_simulated_deg"] == pytest.approx(30, abs=1)


def test_a_marker_that_is_less_behind_in_simulation_is_ahead(plain):
    markers = plain["incumbent"]["trials"][0]["markers"]
    ahead = [one["phase_difference_deg"] for one in markers[2:]]
    assert ahead[2] - ahead[0] == pytest.approx(20, abs=1)
    assert ahead[1] - ahead[0] == pytest.approx(10, abs=1)


def test_a_marker_that_hardly_moves_has_amplitudes_but_no_ratio_and_no_phase(plain):
    for marker in plain["incumbent"]["trials"][0]["markers"][:2]:
        assert marker["amplitude"]["real"] == pytest.approx(0.0, abs=1e-6)
        assert marker["amplitude"]["ratio"] is None
        assert marker["phase_difference_deg"] is None


@pytest.mark.parametrize("behind", [130.0, 250.0])
def test_a_lag_may_be_long_as_long_as_neighbors_are_close(behind):
    wave = Wave(behind=(0.0, 0.0, 0.0, behind / 2, behind))
    found = told([(wave, wave)])["differences"]["by_trial"][0]
    assert found["lag_real_deg"] == pytest.approx(behind, abs=1)


def test_the_wave_is_followed_from_where_its_phase_is_clear():
    faint = replace(REAL, amplitudes=(0.0, 0.0, 0.005, 0.06, 0.1))
    assert told([(faint, faint)])["differences"]["lag_from"] == "P3"


def test_trials_come_by_frequency_and_the_worst_is_named():
    pairs = [(Wave(f), Wave(f, speed=s)) for f, s in ((1.5, 0.11), (0.5, 0.1), (1.0, 0.3))]
    found = told(pairs)
    assert [trial["frequency"] for trial in found["incumbent"]["trials"]] == [0.5, 1.0, 1.5]
    assert [row["name"] for row in found["differences"]["by_trial"]] == ["swim1", "swim2", "swim0"]
    assert found["differences"]["worst_trial"] == "swim2"


def test_trends_and_exponents():
    pairs = [(Wave(f, 0.1 * f), Wave(f, 0.1 * f**2)) for f in (0.5, 1.0, 2.0)]
    found = told(pairs)["differences"]
    assert found["speed_exponent"]["real"] == pytest.approx(1.0, abs=0.02)
    assert found["speed_exponent"]["simulated"] == pytest.approx(2.0, abs=0.02)
    trend = found["trend"]["speed_ratio"]
    assert (trend["low_frequency"], trend["high_frequency"]) == (0.5, 2.0)
    assert trend["low"] == pytest.approx(0.5, rel=0.02)
    assert trend["high"] == pytest.approx(2.0, rel=0.02)
    assert found["median"]["speed_ratio"] == pytest.approx(1.0, rel=0.02)


def test_what_swims_backward_is_named_and_has_no_exponent():
    found = told([(Wave(0.5), Wave(0.5, -0.05)), (Wave(1.0), Wave(1.0, 0.05))])["differences"]
    assert found["other_way"] == ["swim0"]
    assert found["by_trial"][0]["speed_ratio"] == pytest.approx(-0.5, rel=0.02)
    assert found["speed_exponent"] == {"real": None, "simulated": None}


def test_a_lost_marker_is_unknown_in_its_trial_and_known_by_the_others():
    found = told([(replace(REAL, lost=(4,)), WIDER), (Wave(1.5), replace(WIDER, frequency=1.5))])
    lost = found["incumbent"]["trials"][0]["markers"][4]
    assert lost == {
        "name": "P4", "error": None, "shape_error": None,
        "amplitude": {"real": None, "simulated": None, "ratio": None},
        "phase_deg": {"real": None, "simulated": None}, "phase_difference_deg": None,
        "mean": {"real": None, "simulated": None}, "offset": None, "windows": None,
    }  # fmt: skip
    row = found["differences"]["by_trial"][0]
    assert (row["amplitude_ratio"], row["lag_real_deg"]) == (None, None)
    assert row["speed_ratio"] == pytest.approx(1.5, rel=0.02)
    assert found["differences"]["median"]["amplitude_ratio"] == pytest.approx(1.2, rel=0.01)
    assert found["differences"]["by_marker"][4]["amplitude_ratio"] == pytest.approx(1.2, rel=0.01)


def test_a_marker_that_is_lost_everywhere_is_unknown():
    row = told([(replace(REAL, lost=(3,)), WIDER)])["differences"]["by_marker"][3]
    assert {key: value for key, value in row.items() if key != "name"} == dict.fromkeys(
        ("error", "amplitude_real", "amplitude_simulated", "amplitude_ratio", "phase_difference_deg", "offset")
    )


def test_a_failed_incumbent_has_no_loss_and_says_what_diverged():
    found = told([(REAL, WIDER), (Wave(1.5), "it diverged after 1.20 s")])
    incumbent = found["incumbent"]
    assert incumbent["failed"]
    assert incumbent["loss"] is None
    assert found["history"]["first"]["why"] == "trial 'swim1': it diverged after 1.20 s"
    assert {value for name, value in incumbent["figures"].items() if name.endswith("error")} == {None}
    diverged = incumbent["trials"][1]
    assert diverged["diverged"] == "it diverged after 1.20 s"
    assert diverged["error"] is None
    assert diverged["velocity"]["simulated"] is None
    assert diverged["velocity"]["real"] == pytest.approx(0.1, rel=0.02)
    assert diverged["markers"][4]["amplitude"]["real"] == pytest.approx(0.1, rel=0.01)
    assert diverged["markers"][4]["amplitude"]["simulated"] is None
    assert found["differences"]["by_trial"][0]["speed_ratio"] == pytest.approx(1.5, rel=0.02)


def test_of_an_early_stop_only_what_was_simulated_is_told():
    found = told([(REAL, WIDER)], skipped=2)
    assert found["incumbent"]["skipped"] == 2
    assert [trial["name"] for trial in found["incumbent"]["trials"]] == ["swim0"]


@pytest.mark.parametrize("protocol", ["aligned", "paper"])
def test_errors_are_the_protocols_own(protocol):
    evaluation = evaluate(MIDDLE, [(REAL, WIDER)], protocol)
    found = facts(start(evaluation), eel(), EEL_SPACE)
    assert found["compared"]["protocol"] == protocol
    assert found["compared"]["horizon"] == 2.0
    assert found["incumbent"]["trials"][0]["error"] == found["incumbent"]["loss"] == pytest.approx(evaluation.loss)
    key = {"aligned": "aligned_marker_errors", "paper": "marker_errors"}[protocol]
    expected = evaluation.detail["trials"]["swim0"][key]
    assert [one["error"] for one in found["incumbent"]["trials"][0]["markers"]] == expected


def test_under_the_papers_protocol_a_real_beat_at_another_frequency_isnt_mistaken_for_a_small_one():
    asked, turned = 1.0, 0.75  # Hz
    pairs = [(replace(REAL, frequency=turned), replace(REAL, frequency=asked))]
    found = told(pairs, protocol="paper")
    last = found["incumbent"]["trials"][0]["markers"][-1]
    assert last["amplitude"] == {side: pytest.approx(0.1, rel=0.02) for side in ("real", "simulated")} | {
        "ratio": pytest.approx(1.0, rel=0.02)
    }
    assert last["phase_difference_deg"] is None  # nobody knows where the real motor stood


def test_the_overall_figures_are_all_there(plain):
    names = {"marker_error", "aligned_marker_error", "shape_error", "progress_error", "static_offset"}
    assert names < set(plain["incumbent"]["figures"])
    assert all(isinstance(value, float) for value in plain["incumbent"]["figures"].values())


def test_three_markers_are_enough():
    waves = [replace(wave, amplitudes=(0.0, 0.0, 0.1), behind=(0.0, 0.0, 30.0)) for wave in (REAL, WIDER)]
    found = facts(start(evaluate(MIDDLE, [tuple(waves)])), eel(3), EEL_SPACE)
    assert found["robot"]["markers"] == ["P0", "P1", "P2"]
    assert found["differences"]["lag_from"] is None  # one marker that beats is no wave
    assert found["differences"]["median"]["amplitude_ratio"] == pytest.approx(1.0, rel=0.01)


def test_parameters_are_told_with_where_they_lie():
    first, better = evaluate([0.5, 0.5], [(REAL, WIDER)]), evaluate([0.25, 1.0], [(REAL, REAL)])
    situation = after(first, (Proposal(np.array([0.25, 1.0])), [better]))
    grip, spring = facts(situation, eel(), EEL_SPACE)["parameters"]
    values = EEL_SPACE.to_values([0.25, 1.0])
    assert (grip["name"], grip["unit"], grip["lower"], grip["upper"]) == ("grip", "-", 0.0, 10.0)
    assert grip["meaning"] == "Grip in the water: more of it is faster."
    assert grip["current"] == pytest.approx(values["grip"])
    assert (grip["place"], spring["place"]) == (0.25, 1.0)
    assert spring["current"] == 5.0
    assert spring["first"] == pytest.approx(2.55)


# history


def step(loss, point=(0.75, 0.5), **more):
    return replace(evaluate(point, [(REAL, WIDER)]), loss=loss, **more)


def test_a_round_says_what_changed_and_what_came_of_it():
    first = step(0.1, (0.5, 0.5))
    proposal = Proposal(
        np.array([1.0, 0.5 + 1e-4]), "Too  slow,\nI think.", "", {"clipped": {"grip": 12.0}, "trust": 0.5}
    )
    found = facts(after(first, (proposal, [step(0.2, (1.0, 0.5)), step(0.08)])), eel(), EEL_SPACE)["history"]
    assert found["evaluations"] == 3
    assert found["first"]["loss"] == 0.1
    (one,) = found["rounds"]
    assert one["round"] == 1
    assert one["accepted"]
    assert one["diagnosis"] == "Too slow, I think."
    (change,) = one["changes"]  # the other changed by less than anyone would notice
    assert change["name"] == "grip"
    assert (change["to"], change["from"]) == (10.0, pytest.approx(EEL_SPACE.to_values([0.5, 0.5])["grip"]))
    assert change["kept"] == pytest.approx(EEL_SPACE.to_values([0.75, 0.5])["grip"])
    assert [(tried["step_size"], tried["loss"]) for tried in one["steps"]] == [(1.0, 0.2), (0.5, 0.08)]
    assert one["loss_change"] == pytest.approx(-0.02)
    assert one["notes"] == {"clipped": {"grip": 12.0}}
    assert found["rounds_since_accepted"] == 0


def test_a_step_tells_what_it_did_to_speed_and_amplitude():
    pairs = [(Wave(f), replace(WIDER, frequency=f, speed=s)) for f, s in ((0.5, 0.05), (1.5, 0.12))]
    steps = [replace(evaluate([0.9, 0.5], pairs), loss=0.05)]
    found = facts(after(step(0.1), (Proposal(np.array([0.9, 0.5])), steps)), eel(), EEL_SPACE)["history"]
    tried = found["rounds"][0]["steps"][0]
    assert tried["speed_ratios"] == [pytest.approx(0.5, rel=0.02), pytest.approx(1.2, rel=0.02)]
    assert tried["amplitude_ratio"] == pytest.approx(1.2, rel=0.01)


def test_a_change_that_is_small_but_shown_is_told():
    before = FISH.space.to_cube({**FISH.space.published, "motor_arm_length": 0.0379})
    after_it = FISH.space.to_cube({**FISH.space.published, "motor_arm_length": 0.0383})
    steps = [replace(evaluate(after_it, [(REAL, WIDER)]), loss=0.2)]
    first = replace(evaluate(before, [(REAL, WIDER)]), loss=0.1)
    found = facts(after(first, (Proposal(after_it), steps)), eel(), FISH.space)["history"]
    (change,) = found["rounds"][0]["changes"]
    assert change["name"] == "motor_arm_length"
    assert (change["from"], change["to"]) == (pytest.approx(0.0379), pytest.approx(0.0383))


def test_a_step_tells_the_speed_of_each_trial_its_shape_and_its_recoil():
    real = [Wave(f, yaw=0.1) for f in (0.5, 1.0, 1.5)]
    pairs = [(one, replace(one, speed=s, yaw=0.2)) for one, s in zip(real, (0.05, 0.1, 0.12), strict=True)]
    steps = [evaluate([0.9, 0.5], pairs, "motion", loss=0.05)]
    found = facts(after(step(0.1), (Proposal(np.array([0.9, 0.5])), steps)), eel(), EEL_SPACE)["history"]
    tried = found["rounds"][0]["steps"][0]
    assert tried["speed_ratios"] == [pytest.approx(ratio, rel=0.03) for ratio in (0.5, 1.0, 1.2)]
    assert tried["shape"] < 1e-3 < tried["recoil"]


def test_lower_bounds_and_failures_stay_what_they_are():
    proposal = Proposal(np.array([0.9, 0.9]))
    bound = replace(evaluate([0.9, 0.9], [(REAL, WIDER)], skipped=1), loss=0.3)
    assert bound.lower_bound
    broken = evaluate([0.7, 0.7], [(REAL, "no acceleration is finite")])
    found = facts(after(step(0.1), (proposal, [bound, broken])), eel(), EEL_SPACE)["history"]
    early, failed = found["rounds"][0]["steps"]
    assert (early["lower_bound"], early["loss"], early["speed_ratios"]) == (True, 0.3, None)
    assert (failed["failed"], failed["loss"]) == (True, None)
    assert failed["why"] == "trial 'swim0': no acceleration is finite"
    assert found["rounds"][0]["loss_change"] is None
    assert found["rounds_since_accepted"] == 1


def test_rounds_since_the_last_success_are_counted():
    good, bad = (Proposal(np.array([0.75, 0.5])), [step(0.05)]), (Proposal(np.array([0.1, 0.5])), [step(0.2)])
    found = facts(after(step(0.1), bad, good, bad, bad), eel(), EEL_SPACE)
    assert found["round"] == 5
    assert found["incumbent"]["found_in_round"] == 2
    assert found["history"]["rounds_since_accepted"] == 2
    assert facts(after(step(0.1), bad), eel(), EEL_SPACE)["history"]["rounds_since_accepted"] == 1


def test_an_evaluation_without_evidence_is_no_obstacle():
    bare = Evaluation(step(0.1).candidate, 0.1)
    found = facts(after(bare, (Proposal(np.array([0.9, 0.5])), [replace(bare, loss=0.2)])), eel(), EEL_SPACE)
    assert found["incumbent"]["trials"] == []
    assert found["incumbent"]["loss"] == 0.1
    assert found["differences"]["worst_trial"] is None


@given(
    st.integers(0, 3), st.integers(0, 5), st.sampled_from([1.0, -1.0]), st.booleans(),
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 8)), max_size=12), st.sampled_from(["log", "linear"]),
)  # fmt: skip
@settings(max_examples=8)
def test_facts_are_strict_json_and_a_pure_function(rounds, seed, sign, failed, lost, scale):
    world, space = World(sign=sign, lost=lost), replace(SPACE, scale=scale)
    shown = fish_situation(world, rounds, seed)
    if failed:
        shown = start(world.evaluate(np.full(16, 0.5), failed=True))
    before = json.dumps([one.detail for one in shown.evaluations])
    found = facts(shown, FISH, space)
    text = json.dumps(found, allow_nan=False)
    assert json.loads(text) == found  # plain lists, dicts with text keys, numbers to the last bit
    assert json.dumps(facts(shown, FISH, space), allow_nan=False) == text
    assert json.dumps([one.detail for one in shown.evaluations]) == before
    assert len(found["history"]["rounds"]) == len(shown.rounds)
    for trial in found["incumbent"]["trials"]:
        for marker in trial["markers"]:
            assert marker["phase_difference_deg"] is None or -180 <= marker["phase_difference_deg"] <= 180


@settings(max_examples=30)
@given(st.text(max_size=1000), st.integers(2, LONGEST))
def test_a_shortened_text_is_one_line_that_begins_as_the_text(text, longest):
    short, line = shortened(text, longest), " ".join(text.split())
    assert len(short) <= longest
    assert len(short.splitlines()) <= 1
    assert short == line or (short.endswith("…") and line.startswith(short[:-1]))


@given(st.floats(-1e4, 1e4), st.integers(-3, 3))
def test_wrapped_angles_are_the_same_angles(degrees, turns):
    found = wrapped(degrees + 360 * turns)
    assert -180 <= found < 180
    assert np.cos(np.radians(found)) == pytest.approx(np.cos(np.radians(degrees)), abs=1e-6)


def test_a_marker_that_was_hardly_seen_says_nothing():
    evaluation = evaluate(MIDDLE, [(REAL, WIDER)] * 2)
    for seen, trial in zip((0.05, 1.0), evaluation.detail["trials"].values(), strict=True):
        trial["seen_shares"][4] = seen
    found = facts(start(evaluation), eel(), EEL_SPACE)
    lost, fine = (trial["markers"][4] for trial in found["incumbent"]["trials"])
    assert lost["error"] is lost["shape_error"] is lost["amplitude"]["ratio"] is lost["phase_difference_deg"] is None
    assert fine["amplitude"]["ratio"] == pytest.approx(1.2, rel=0.01)
    assert found["differences"]["by_trial"][0]["lag_real_deg"] is None
    assert found["differences"]["median"]["amplitude_ratio"] == fine["amplitude"]["ratio"]


def test_the_swing_of_the_head_has_a_ratio_by_trial():
    real = [Wave(f, yaw=0.1) for f in (0.5, 1.0)]
    found = facts(start(evaluate(MIDDLE, [(one, replace(one, yaw=0.15)) for one in real], "motion")), eel(), EEL_SPACE)
    assert [row["yaw_ratio"] for row in found["differences"]["by_trial"]] == [pytest.approx(1.5, rel=0.02)] * 2
    bare = facts(start(evaluate(MIDDLE, [(REAL, WIDER)])), eel(), EEL_SPACE)
    assert bare["differences"]["by_trial"][0]["yaw_ratio"] is None

"""What a VLM is told of recordings: where they differ, when, how far they move, and what sensors read."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from playbacks import ARM, CART, Swing, compared, evaluated
from waves import after, start

from swim2real.advisor.briefing.facts import facts
from swim2real.advisor.briefing.prompt import describe
from swim2real.optimizers import Proposal
from swim2real.robots.robot import Recordings, Sine

REAL = Swing()
PAIRS = {"calm": (REAL, Swing(0.11)), "wild": (Swing(0.2), Swing(0.22, force=1.5))}
BESIDE = {"a": (REAL, Swing(at=(0.03, -0.04)))}


def known(pairs=PAIRS, robot=ARM, **more):
    return facts(start(evaluated(compared(pairs, robot, **more), robot)), robot, robot.space)


def told(pairs=PAIRS, robot=ARM, **more) -> str:
    return describe(known(pairs, robot, **more))


def rows(text: str, *heads: str) -> dict[str, list[str]]:
    """The table whose columns begin like this, by the first cell of its rows."""
    for table in re.findall(r"(?:^\|.*\n?)+", text, re.MULTILINE):
        lines = [[cell.strip() for cell in line.strip().strip("|").split(" | ")] for line in table.splitlines()]
        if tuple(lines[0][: len(heads)]) == heads:
            return {line[0]: line for line in [lines[0], *lines[2:]]}
    raise AssertionError(f"no table has the columns {heads}")


# facts


def test_amplitudes_offsets_and_errors_are_those_of_the_motion():
    calm, wild = known()["incumbent"]["trials"]
    hand = calm["markers"][2]
    assert hand["amplitude"]["real"] == pytest.approx(0.4 * 0.1 / np.sqrt(2), rel=0.02)
    assert hand["amplitude"]["ratio"] == pytest.approx(1.1, rel=0.01)
    assert hand["error"] == pytest.approx(0.4 * 0.01 * 2 / np.pi, rel=0.05)
    assert calm["markers"][0]["amplitude"]["ratio"] is None  # it doesn't move
    assert wild["sensors"] == [
        {"name": "force", "unit": "N", "meters_per_unit": 0.01, "error": 0.5, "windows": pytest.approx([0.5] * 8)}
    ]
    assert wild["error"] == pytest.approx(wild["figures"]["aligned_marker_error"] + 0.01 * 0.5)


def test_a_constant_difference_is_the_same_all_the_time():
    for marker in known(BESIDE)["incumbent"]["trials"][0]["markers"]:
        assert (marker["error"], marker["offset"]) == (pytest.approx(0.05), pytest.approx([0.03, -0.04]))
        assert marker["windows"] == [pytest.approx([0.03, -0.04])] * 8


def test_the_worst_are_named():
    found = known()["differences"]
    assert (found["worst_trial"], found["worst_marker"]) == ("wild", "hand")
    assert [row["worst_marker"] for row in found["by_trial"]] == ["hand", "hand"]
    assert found["median"]["amplitude_ratio"] == pytest.approx(1.1, rel=0.01)
    assert found["median"]["speed_ratio"] is None
    assert found["sensors"][0]["error"] == pytest.approx(0.25)


def test_a_difference_that_grows_is_seen_in_the_windows():
    found = known({"a": (REAL, Swing(drift=0.1))})["differences"]
    first, second = found["halves"]
    assert second > 4 * first
    assert found["by_trial"][0]["worst_time"] == [4.5, 5.0]


def test_a_diverged_playback_has_no_figures():
    found = known({"calm": PAIRS["calm"], "wild": (REAL, "the simulation diverged 1.200 s after its start")})
    wild = found["incumbent"]["trials"][1]
    assert found["incumbent"]["loss"] is None
    assert wild["error"] is None
    assert wild["markers"][2]["error"] is None
    assert wild["markers"][2]["amplitude"]["real"] == pytest.approx(0.4 * 0.1 / np.sqrt(2), rel=0.02)
    assert wild["markers"][2]["amplitude"]["simulated"] is None
    assert found["differences"]["worst_trial"] == "calm"
    assert found["history"]["first"]["why"] == "trial 'wild': the simulation diverged 1.200 s after its start"


def test_a_lost_marker_is_unknown():
    hand = known(lost=(2,))["incumbent"]["trials"][0]["markers"][2]
    assert (hand["error"], hand["offset"], hand["windows"]) == (None, None, [None] * 8)
    assert hand["amplitude"] == {"real": None, "simulated": None, "ratio": None}


def test_a_robot_that_travels_has_speeds():
    pairs = {"slow": (Swing(speed=0.1), Swing(speed=0.15)), "back": (Swing(speed=0.1), Swing(speed=-0.05))}
    found = known(pairs, CART)
    assert found["incumbent"]["trials"][0]["velocity"] == {
        "real": pytest.approx(0.1, rel=0.01), "simulated": pytest.approx(0.15, rel=0.01)
    }  # fmt: skip
    ratios = [row["speed_ratio"] for row in found["differences"]["by_trial"]]
    assert ratios == [pytest.approx(1.5, rel=0.02), pytest.approx(-0.5, rel=0.02)]
    assert found["differences"]["other_way"] == ["back"]


@pytest.mark.parametrize("robot", [ARM, CART])
def test_facts_are_strict_json(robot):
    found = known(robot=robot, lost=(1,) if robot is ARM else ())
    text = json.dumps(found, allow_nan=False)
    assert json.loads(text) == found


# words


def test_what_differs_is_said_first():
    text = told()
    assert "The worst trial is wild: " in text
    assert "The marker that is farthest off is hand: " in text
    assert "it is there all the time." in text
    assert "The simulated markers move 10 % wider than in reality: median ratio 1.10" in text
    assert "Sensor force is off by 0.25 N on average, which adds 2.5 mm to the loss." in text


def test_a_constant_difference_is_told_apart():
    said = "Much of that is constant: on average the simulated one is off by 30.0 mm to the right and 40.0 mm down."
    assert said in told(BESIDE)
    assert "Much of that" not in told()


def test_what_grows_and_what_fades_is_said():
    assert "it grows with time." in told({"a": (REAL, Swing(drift=0.1))})
    assert "it fades with time, so the beginning matters most." in told({"a": (REAL, Swing(fade=0.1))})


def test_a_perfect_simulation_has_nothing_to_complain_about():
    text = told({"a": (REAL, REAL)})
    assert "The simulated markers move about as wide as in reality: median ratio 1.00" in text
    assert "are off by" not in text


def test_the_loss_is_explained_as_this_robot_has_it():
    text = told()
    assert (
        "over time, markers and trials, in the world. The mean error of each sensor is added: 1 N of force as 10 mm."
        in text
    )
    assert "played back under its own commands (torque: as recorded). It starts at rest in the model's own pose" in text
    cart = told({"a": (Swing(speed=0.1), Swing(speed=0.15))}, CART)
    assert "in a frame that is fixed to base, with its x axis toward elbow." in cart
    assert "forward is from elbow to base." in cart
    assert "(wheel: always 2). It starts in the pose and at the speed that its first frames show" in cart
    driven = replace(ARM, trials=Recordings({"a": "frequency", "b": Sine(0.5, offset=0.1)}, start="raised"))
    driven_text = told({"a": (REAL, REAL)}, driven)
    assert (
        "(a: a steady speed at the trial's own rate; b: a sine of 0.5 around 0.1 at the trial's own rate)"
        in driven_text
    )
    assert "It starts in the model's pose 'raised'" in driven_text


def test_markers_links_and_axes_are_explained():
    text = told()
    assert "Markers: base, elbow, hand. Lines in the pictures join base to elbow, elbow to hand." in text
    assert "The pictures have x right, z up." in text
    assert "first to the right (the world's x), then up (the world's z)" in text
    cart = told({"a": (REAL, REAL)}, CART)
    assert "The pictures have base at the origin, elbow to its right." in cart
    assert "first from base toward elbow (being behind counts as well), then to the left of that line" in cart


def test_tables_have_what_there_is():
    text = told()
    trials = rows(text, "trial", "s", "error mm")
    assert trials["trial"] == [
        "trial", "s", "error mm", "markers mm", "force N", "amplitude ratio", "worst marker", "most off at s", "lost %",
    ]  # fmt: skip
    assert trials["wild"][4:7] == ["0.5", "1.10", "hand"]
    markers = rows(text, "marker", "error mm", "real mm")
    assert markers["base"][1:] == ["0.0", "0.0", "0.0", "n/a", "0.0, 0.0"]
    assert markers["hand"][4] == "1.10"
    assert rows(text, "marker", "calm", "wild")["base"][1:] == ["0.0", "0.0"]
    windows = rows(text[text.index("Trial wild:") :], "marker", "1.00 to 1.50 s")
    assert windows["force N"][1:] == ["+0.5"] * 8
    assert rows(told(BESIDE), "marker", "1.00 to 1.50 s")["base"][1:] == ["+30, -40"] * 8


def test_speeds_and_headings_are_told_only_where_there_are_any():
    still = told()
    assert "mm/s" not in still
    assert "heading" not in still
    text = told({"a": (Swing(speed=0.1), Swing(speed=0.15)), "b": (Swing(speed=0.1), Swing(speed=-0.05))}, CART)
    assert "The simulated robot goes the other way, last marker first, in b." in text
    trials = rows(text, "trial", "s", "error mm")
    assert trials["trial"][3:9] == [
        "progress mm", "shape mm", "heading deg", "real mm/s", "sim mm/s", "speed ratio",
    ]  # fmt: skip
    assert trials["a"][6:9] == ["100.0", "150.0", "1.50"]


def test_only_the_worst_of_many_trials_are_told_in_detail():
    many = {f"t{k}": (REAL, Swing(at=(0.01 * k, 0.0))) for k in range(10)}
    text = told(many)
    assert [line[0] for line in rows(text, "trial", "s").values()][1:] == list(many)
    assert rows(text, "marker", "t2")["marker"] == ["marker", *(f"t{k}" for k in range(2, 10))]
    assert re.findall(r"^Trial (t\d):$", text, re.MULTILINE) == ["t7", "t8", "t9"]
    assert "The 3 worst trials." in text


def test_a_diverged_playback_is_named():
    text = told({"calm": PAIRS["calm"], "wild": (REAL, "the simulation diverged 1.200 s after its start")})
    assert "These trials have no simulated motion:\n- wild: diverged. the simulation diverged 1.200 s" in text
    assert "1000" not in text  # the loss that stands in for a failure
    assert not re.search(r"\b(nan|inf|None)\b", text)


def test_all_markers_lost_is_no_obstacle():
    text = told(lost=(0, 1, 2))
    assert "In short" in text  # the sensor is there
    assert not re.search(r"\b(nan|inf|None)\b", text)


def test_steps_tell_markers_sensors_and_amplitude():
    first = evaluated(compared(PAIRS))
    better = replace(evaluated(compared({name: (real, real) for name, (real, _) in PAIRS.items()})), loss=0.001)
    early = replace(evaluated(compared({"calm": PAIRS["calm"]}, skipped=1)), loss=0.9)
    text = describe(facts(after(first, (Proposal(np.full(3, 0.6)), [early, better])), ARM, ARM.space))
    assert "what the markers have of it, the mean error of each sensor and the ratio of amplitudes" in text
    assert "1: over 900.0 mm; 0.5: 1.0 mm" in text
    assert ", markers 0.0 mm, force 0 N, amplitude 1.00" in text
    cart = evaluated(compared({"a": (Swing(speed=0.1), Swing(speed=0.15))}, CART), CART)
    text = describe(facts(after(cart, (Proposal(np.full(3, 0.6)), [cart])), CART, CART.space))
    told = "the ratio of speeds (simulated / real), the error in shape, in mm and the ratio of amplitudes"
    assert told in text
    assert ", speed 1.50, shape 0.0, amplitude 1.00" in text


def test_without_numbers_nothing_that_was_measured_is_left():
    text = describe(known(), numbers=False)
    assert "## Simulated and real" not in text
    assert not re.search(r"\bmm\b|\d N\b", text)
    assert "Markers: base, elbow, hand." in text

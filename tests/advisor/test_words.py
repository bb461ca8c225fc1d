"""What a VLM is told, in words."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from waves import EEL_SPACE, Wave, after, eel, evaluate, fish_situation, start
from worlds import SPACE, World

from swim2real.advisor.briefing.facts import facts
from swim2real.advisor.briefing.formatting import estimate_tokens, number, table, value
from swim2real.advisor.briefing.prompt import describe
from swim2real.errors import ArgumentError
from swim2real.optimizers import Evaluation, Proposal
from swim2real.robots.fish import FISH

MIDDLE = [0.5, 0.5]
REAL = Wave()
WIDER = Wave(speed=0.15, amplitudes=(0.0, 0.0, 0.03, 0.06, 0.12), behind=(0.0, 0.0, 0.0, 10.0, 30.0))
EIGHT = tuple(np.linspace(0.5, 2.0, 8))


def told(situation, **options) -> str:
    return describe(facts(situation, eel(), EEL_SPACE), **options)


def swims(pairs, protocol="aligned", **more) -> str:
    return told(start(evaluate(MIDDLE, pairs, protocol, **more)))


def tables(text: str) -> list[list[list[str]]]:
    """All tables, as rows of cells."""
    found = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    return [
        [[cell.strip() for cell in row.strip().strip("|").split(" | ")] for row in one.splitlines()] for one in found
    ]


def step(loss, point=(0.75, 0.5), **more) -> Evaluation:
    return replace(evaluate(point, [(REAL, WIDER)]), loss=loss, **more)


@pytest.fixture(scope="module")
def plain() -> str:
    return swims([(REAL, WIDER)])


def test_what_differs_is_said_first(plain):
    assert "**The loss is" in plain
    assert "The worst trial is swim0 (1.00 Hz):" in plain
    assert "The simulated speed is too fast in all trials: median ratio 1.50." in plain
    assert "The simulated P4, the last marker, beats 20 % wider than in reality: median ratio 1.20." in plain
    assert (
        "P4 is 30 deg of a beat behind in simulation and 50 deg in reality, so the simulated wave runs too fast"
        in plain
    )


def test_speeds_that_are_too_high_here_and_too_low_there_are_told_apart():
    pairs = [(Wave(f, 0.1 * f), Wave(f, s)) for f, s in ((0.5, 0.1), (1.0, 0.1), (2.0, 0.15))]
    text = swims(pairs)
    assert "The simulated speed is too fast in swim0 (0.50 Hz) and too slow in swim2 (2.00 Hz), else right" in text
    assert "so it rises too little with frequency" in text
    assert "(falling)" in text


def test_a_perfect_simulation_has_nothing_to_complain_about():
    text = swims([(Wave(f, 0.1 * f), Wave(f, 0.1 * f)) for f in (0.5, 1.0, 2.0)])
    assert "about right everywhere" in text
    assert "beats about as wide as in reality" in text
    assert "which fits" in text
    assert "too fast" not in text
    assert "too slow" not in text.replace("means 20 % too slow", "")


def test_swimming_backward_is_said():
    assert "goes the other way, last marker first, in all trials." in swims([(REAL, Wave(speed=-0.05))])
    pairs = [(Wave(f), Wave(f, speed)) for f, speed in ((0.5, -0.05), (1.0, 0.1))]
    assert "goes the other way, last marker first, in swim0 (0.50 Hz)." in swims(pairs)


def test_a_beat_that_is_much_too_wide_is_told_in_times():
    wide = replace(REAL, amplitudes=(0.0, 0.0, 0.03, 0.06, 0.25))
    assert "beats 2.5 times as wide as in reality" in swims([(REAL, wide)])


def test_a_tables_numbers_are_the_facts(plain):
    trials = next(one for one in tables(plain) if one[0][0] == "trial")
    row = dict(zip(trials[0], trials[2], strict=True))
    assert (row["trial"], row["Hz"], row["speed ratio"], row["P4 ratio"]) == ("swim0", "1.00", "1.50", "1.20")
    assert (row["real mm/s"], row["sim mm/s"]) == ("100.0", "150.0")
    assert (row["lag P2 to P4 real deg"], row["sim deg"]) == ("50", "30")
    markers = next(one for one in tables(plain) if one[0][:2] == ["marker", "error mm"])
    assert markers[-1][2:5] == ["100.0", "120.0", "1.20"]
    assert markers[2][2:5] == ["0.0", "0.0", "n/a"]


def test_every_parameter_is_told_with_value_bounds_and_meaning(plain):
    rows = {row[0]: row for row in tables(plain)[0][2:]}
    assert set(rows) == {"grip", "spring"}
    assert rows["spring"] == ["spring", "N·m/rad", "0.1", "5", "2.55", "2.55", "0.50", "Stiffness of the only joint."]


def test_nothing_is_said_of_a_fish_or_a_tail_unless_the_robot_does(plain):
    assert "A swimming chain of links." in plain
    assert not re.search(r"fish|\btail|\bfin\b", plain, re.IGNORECASE)
    failed = told(after(step(0.1), (Proposal(np.array([0.9, 0.5])), [step(0.2)])))
    assert not re.search(r"fish|\btail|\bfin\b", failed, re.IGNORECASE)


def test_lost_markers_and_a_lost_end_are_not_available():
    text = swims([(replace(REAL, lost=(4,)), WIDER)])
    assert "The beat of the last marker, P4, can't be compared." in text
    markers = next(one for one in tables(text) if one[0][:2] == ["marker", "error mm"])
    assert markers[-1][1:] == ["n/a"] * 5


def test_a_failed_start_says_what_diverged():
    text = swims([(REAL, WIDER), (Wave(1.5), "it diverged after 1.20 s")])
    assert "The simulation at the current point failed, so it has no loss." in text
    assert "- swim1 (1.50 Hz): diverged. it diverged after 1.20 s" in text
    assert "**The loss is" not in text
    assert "1000" not in text  # the loss that stands in for a failure


def test_what_an_early_stop_left_out_is_said():
    assert "Trials that weren't simulated and that nothing here includes: 2." in swims([(REAL, WIDER)], skipped=2)


def test_the_papers_protocol_is_explained():
    text = swims([(REAL, WIDER)], "paper")
    assert "starts from rest at motor angle 0" in text
    assert "no phase is compared" in text
    assert "Ratio of amplitudes by marker" in text
    assert "Phase by marker" not in text
    assert "Error by marker and trial" in text
    assert "and the loss counts it." in text
    assert "and the loss doesn't count it." in swims([(REAL, WIDER)])


def test_three_markers_and_two_parameters_are_enough():
    waves = [replace(wave, amplitudes=(0.0, 0.0, 0.1), behind=(0.0, 0.0, 30.0)) for wave in (REAL, WIDER)]
    text = describe(facts(start(evaluate(MIDDLE, [tuple(waves)])), eel(3), EEL_SPACE))
    assert "Markers, from head to tail" not in text
    assert "Markers, head first: P0, P1, P2." in text
    assert "runs as a wave" not in text


def test_an_evaluation_without_evidence_says_so():
    bare = Evaluation(step(0.1).candidate, 0.1)
    assert "There are no numbers of this point." in told(start(bare))


# history


def test_the_first_round_has_no_history(plain):
    assert "Nothing yet: this is the first round." in plain


def test_a_round_is_told_with_its_steps_and_what_was_kept():
    proposal = Proposal(np.array([1.0, 0.5]), "Too slow.", "", {"clipped": {"grip": 12.0}, "ignored": ["speed"]})
    text = told(after(step(0.1, (0.5, 0.5)), (proposal, [step(0.2, (1.0, 0.5)), step(0.08)])))
    assert "**Round 1: accepted at step 0.5, loss 100.0 → 80.0 mm**" in text
    assert "- Diagnosis: Too slow." in text
    before, kept = (EEL_SPACE.to_values([place, 0.5])["grip"] for place in (0.5, 0.75))
    assert f"- Proposed: grip {before:.3g} → 10 (kept {kept:.3g})." in text
    did = r"speed 1\.50, shape \d+\.\d, amplitude 1\.20"
    assert re.search(rf"1: 200\.0 mm \(\+100\.0\), {did}; 0\.5: 80\.0 mm \(-20\.0\), {did}", text)
    assert "- grip (12 was given): out of bounds, so moved to the bound." in text
    assert "- speed: no parameters of this simulator, so ignored." in text


def test_rejected_rounds_say_not_to_do_it_again():
    bad = (Proposal(np.array([0.1, 0.5])), [step(0.2)])
    assert "**Round 1: rejected**" in told(after(step(0.1), bad))
    assert "The last round was rejected" in told(after(step(0.1), bad))
    assert "The last 3 rounds were rejected" in told(after(step(0.1), bad, bad, bad))
    good = (Proposal(np.array([0.75, 0.5])), [step(0.05)])
    assert "rejected: what was" not in told(after(step(0.1), bad, good))


def test_lower_bounds_and_failures_are_told_as_such():
    proposal = Proposal(np.array([0.9, 0.9]))
    bound = replace(evaluate([0.9, 0.9], [(REAL, WIDER)], skipped=1), loss=0.3)
    broken = evaluate([0.7, 0.7], [(REAL, "no acceleration is finite")])
    text = told(after(step(0.1), (proposal, [bound, broken])))
    assert "1: over 300.0 mm; 0.5: the simulation diverged (trial 'swim0': no acceleration is finite)" in text


def test_a_proposal_that_changes_hardly_anything_is_told_as_that():
    text = told(after(step(0.1), (Proposal(np.array([0.7501, 0.5])), [step(0.2)])))
    assert "- Proposed: hardly any change." in text


def test_older_rounds_are_told_in_a_line():
    known = facts(fish_situation(World(), 6), FISH, SPACE)
    everything, some, none = (describe(known, rounds=count) for count in (None, 2, 0))
    assert everything.count("- Diagnosis:") == 6
    assert some.count("- Diagnosis:") == 2
    assert re.findall(r"^\*\*Round (\d)", some, re.MULTILINE) == ["5", "6"]
    assert re.findall(r"^Round (\d)", some, re.MULTILINE) == ["1", "2", "3", "4"]
    assert "**Round" not in none
    assert len(none) < len(some) < len(everything)
    assert describe(known, rounds=6) == describe(known, rounds=60) == everything
    assert len(re.findall(r"^Round \d: .*and \d+ smaller changes\.$", none, re.MULTILINE)) == 6


def test_a_negative_number_of_rounds_is_refused(plain):
    with pytest.raises(ArgumentError, match="rounds is -1; it must be at least 0, or None for all"):
        told(start(step(0.1)), rounds=-1)


# without numbers


def test_without_numbers_no_section_on_swims_and_no_loss_is_left():
    known = facts(fish_situation(World(), 5), FISH, SPACE)
    text = describe(known, numbers=False, rounds=3)
    assert "## Simulated and real motion" not in text
    assert "27.31" not in text  # that a diagnosis quotes
    assert not re.search(r"\bmm\b|loss \d|mm/s", text)
    assert "1 rejected; 0.5 rejected" in text
    for one in SPACE:
        assert f"| {one.name} | {one.unit} |" in text


@pytest.mark.slow
@given(st.integers(0, 4), st.integers(0, 5), st.floats(1.01, 5.0))
@settings(max_examples=5)
def test_without_numbers_the_text_doesnt_depend_on_anything_measured(rounds, seed, factor):
    shown = fish_situation(World(), rounds, seed)

    def other(evaluation: Evaluation) -> Evaluation:
        return replace(evaluation, loss=factor * evaluation.loss, detail=World(sign=-1).evidence(np.full(16, 0.3)))

    changed = replace(
        shown,
        incumbent=other(shown.incumbent),
        first=other(shown.first),
        rounds=tuple(
            replace(
                one,
                incumbent=other(one.incumbent),
                steps=tuple(replace(tried, evaluation=other(tried.evaluation)) for tried in one.steps),
                proposal=replace(one.proposal, diagnosis=f"{factor}"),
            )
            for one in shown.rounds
        ),
    )
    texts = [describe(facts(one, FISH, SPACE), numbers=False) for one in (shown, changed)]
    assert texts[0] == texts[1]
    assert describe(facts(shown, FISH, SPACE)) != describe(facts(changed, FISH, SPACE))


# the page as a whole


@given(
    st.integers(0, 3), st.integers(0, 3), st.sampled_from([1.0, -1.0]), st.booleans(), st.booleans(),
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 8)), max_size=20),
)  # fmt: skip
@settings(max_examples=8)
def test_every_table_is_whole_and_nothing_undefined_is_printed(rounds, seed, sign, failed, numbers, lost):
    world = World(sign=sign, lost=lost)
    shown = start(world.evaluate(np.full(16, 0.5), failed=True)) if failed else fish_situation(world, rounds, seed)
    text = describe(facts(shown, FISH, SPACE), numbers=numbers)
    for rows in tables(text):
        assert {len(row) for row in rows} == {len(rows[0])}
        assert set(rows[1]) == {"---"}
    assert not re.search(r"\b(nan|inf|None)\b|-0\.0*\b(?!\d)", text)
    assert re.search(r"\S\n\Z", text)
    assert "\n\n\n" not in text


@pytest.mark.parametrize("frequencies", [EIGHT[:6], EIGHT])
def test_it_is_short_even_after_many_rounds(frequencies):
    known = facts(fish_situation(World(frequencies), 12), FISH, SPACE)
    assert estimate_tokens(describe(known, rounds=3)) < 7000
    assert estimate_tokens(describe(known)) < 12_000


@given(st.floats(1e-6, 1e6))
def test_a_value_that_is_repeated_as_shown_is_no_change(given_value):
    assert abs(float(value(given_value)) - given_value) <= 1e-3 * given_value


@given(st.floats(-1e3, 1e3), st.integers(0, 3), st.booleans())
def test_numbers_are_rounded_and_never_a_negative_zero(given_value, digits, signed):
    shown = number(given_value, digits, signed=signed)
    assert float(shown) == pytest.approx(given_value, abs=0.51 * 10**-digits)
    assert not (float(shown) == 0 and shown[0] in "+-")


def test_a_bar_in_a_cell_doesnt_break_a_table():
    assert table(["a"], [["x | y"]]).splitlines()[-1] == "| x / y |"


@given(st.text(max_size=200), st.text(max_size=200))
def test_the_estimate_of_tokens_adds_up(one, other):
    assert estimate_tokens(one) <= len(one)
    assert estimate_tokens(f"{one} {other}") == estimate_tokens(one) + estimate_tokens(other)


def test_the_estimate_of_tokens_knows_prose_from_numbers():
    prose = "The simulated robot swims too fast at low frequencies and too slow at high ones. " * 50
    assert 0.15 < estimate_tokens(prose) / len(prose) < 0.35
    assert estimate_tokens("12.5") == 4


def test_the_head_and_the_way_from_rest_are_told():
    real = [Wave(f, yaw=0.1) for f in (0.5, 1.0)]
    evaluation = evaluate(MIDDLE, [(one, replace(one, yaw=0.15)) for one in real], "motion")
    known = facts(start(evaluation), eel(), EEL_SPACE, {"swim0": -0.02, "swim1": 0.1})
    text = describe(known)
    assert "The simulated head yaws 50 % wider than in reality" in text
    assert "### Motion of the head" in text
    assert re.search(r"\| swim0 \| 0\.50 \| 5\.7 \| 8\.6 \| \+?-?0 \|", text)
    assert "goes forward in swim1 (1.00 Hz), and backward, last marker first, in swim0 (0.50 Hz)" in text
    assert "in the recoil of the head, its yaw and sway," in text
    assert "500 mm are added" in text
    forward = describe(facts(start(evaluation), eel(), EEL_SPACE, {"swim0": 0.02, "swim1": 0.1}))
    assert "Started at rest, the simulated robot goes forward in all trials." in forward
    aligned = describe(facts(start(evaluate(MIDDLE, [(REAL, WIDER)])), eel(), EEL_SPACE))
    assert "Motion of the head" not in aligned
    assert "Started at rest" not in aligned

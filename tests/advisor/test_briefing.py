"""What a VLM is told and shown, whatever the robot: its numbers, its words, and what is written into pictures."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from playbacks import ARM, CART, Swing, compared, evaluated
from waves import EEL_SPACE, Wave, after, compared_waves, eel, evaluate, start
from worlds import SPACE, World, situation

from markertrack.drawing import Canvas
from markertrack.video import VideoWriter
from swim2real.advisor import ProbingAdvisor
from swim2real.advisor.briefing.facts import RoundFacts
from swim2real.advisor.briefing.prompt import TrialPromptBuilder, describe
from swim2real.advisor.briefing.texts import significant
from swim2real.advisor.vlm.advisor import repair_request
from swim2real.advisor.vlm.exchange import Request
from swim2real.advisor.vlm.files import HOW_TO
from swim2real.optimizers import BacktrackingLineSearch, Candidate, Evaluation, Measurement, Proposal, ScriptedAdvisor
from swim2real.robots.drives import SPEED, Drive
from swim2real.robots.fish import FISH
from swim2real.robots.robot import Trials
from swim2real.settings import BriefingSettings
from swimbase.errors import ArgumentError

MIDDLE = [0.5, 0.5]
REAL = Wave()
WIDER = Wave(speed=0.15, amplitudes=(0.0, 0.0, 0.03, 0.06, 0.12), behind=(0.0, 0.0, 0.0, 10.0, 30.0))
FISH_WORDS = r"\bfish|\bfins?\b|\btails?\b"
SWIM_WORDS = rf"{FISH_WORDS}|\bbeat|\bswi[mu]|\bswam|\bfrequenc|\bthrust|\bHz\b"
CALM_AND_WILD = {"calm": (Swing(), Swing(0.11)), "wild": (Swing(0.2), Swing(0.22, force=1.5))}
BESIDE = {"a": (Swing(), Swing(at=(0.03, -0.04)))}
DIVERGED = {"calm": CALM_AND_WILD["calm"], "wild": (Swing(), "the simulation diverged 1.200 s after its start")}
DRIVEN = replace(ARM, trials=Trials({"a": SPEED, "b": Drive(0.5, offset=0.1)}, start="raised"))
TRAVELS = {"a": (Swing(speed=0.1), Swing(speed=0.15)), "b": (Swing(speed=0.1), Swing(speed=-0.05))}


def told(situation, robot=None, space=EEL_SPACE, from_rest=None, **options) -> str:
    instructions, rounds, current = describe(RoundFacts(situation, robot or eel(), space, from_rest or {}), **options)
    return "\n\n".join([instructions, *rounds, current]) + "\n"


def swims(pairs, protocol="aligned", from_rest=None, robot=None) -> str:
    return told(start(evaluate(MIDDLE, pairs, protocol)), robot, from_rest=from_rest)


def recordings(pairs=CALM_AND_WILD, robot=ARM, **more) -> str:
    return told(start(evaluated(compared(pairs, robot, **more), robot)), robot, robot.space)


def tables(text: str) -> list[list[list[str]]]:
    """All tables, as rows of cells, without the rules below their heads."""
    found = re.findall(r"(?:^\|.*\n?)+", text, re.MULTILINE)
    cells = [[[cell.strip() for cell in row.strip()[1:-1].split("|")] for row in one.splitlines()] for one in found]
    for one in cells:
        assert {len(row) for row in one} == {len(one[0])}
        assert set(one.pop(1)) == {"-"}
    return cells


def row(text: str, name: str, *heads: str) -> dict[str, str]:
    """A row, by its first cell, of the first table whose columns begin like this; of two alike columns the last."""
    rows = next(one for one in tables(text) if tuple(one[0][: len(heads)]) == heads)
    return dict(zip(rows[0], next(one for one in rows if one[0] == name), strict=True))


def test_tables_of_swims_have_their_speeds_and_amplitudes():
    text = swims([(REAL, WIDER)])
    trial = row(text, "swim0", "trial")
    expected = {
        "Hz": "1.00", "real mm/s": "100.0", "speed ratio": "1.50", "P4 ratio": "1.20",
    }  # fmt: skip
    assert trial.items() >= expected.items()
    assert row(text, "P4", "marker", "error mm").items() >= {"real mm": "100.0", "ratio": "1.20"}.items()
    still = row(text, "P1", "marker", "error mm")  # a marker that hardly moves has neither ratio nor phase
    assert (still["real mm"], still["ratio"], still["phase deg"]) == ("0.0", "n/a", "n/a")
    ahead = [int(row(text, f"P{i}", "marker", "error mm")["phase deg"]) for i in (2, 3, 4)]
    assert [phase - ahead[0] for phase in ahead] == [0, 10, 20]
    spring = row(text, "spring", "parameter")
    assert list(spring.values()) == ["spring", "N·m/rad", "0.1", "5", "0.5", "Stiffness of the only joint."]
    assert "grip 0.905 (0.50), spring 2.55 (0.50)" in text


@pytest.mark.parametrize("seen", [0.0, 0.05])
def test_a_marker_that_is_hardly_seen_is_known_by_the_other_trials_alone(seen):
    lost = (4,) if not seen else ()
    evaluation = evaluate(MIDDLE, [(replace(REAL, lost=lost), WIDER), (Wave(1.5), replace(WIDER, frequency=1.5))])
    if seen:
        evaluation.detail["trials"]["swim0"]["seen_shares"][4] = seen
    text = told(start(evaluation))
    trial = row(text, "swim0", "trial")
    assert (trial["P4 ratio"], trial["speed ratio"]) == ("n/a", "1.50")
    assert row(text, "P4", "marker", "error mm")["ratio"] == row(text, "swim1", "trial")["P4 ratio"] == "1.20"


@pytest.mark.parametrize("protocol", ["aligned", "paper"])
def test_errors_are_the_protocols_own(protocol):
    evaluation = evaluate(MIDDLE, [(REAL, WIDER)], protocol)
    text = told(start(evaluation))
    loss = f"{1e3 * evaluation.loss:.1f}"
    assert f"**The loss is {1e3 * evaluation.loss:.1f} mm**" in text
    assert row(text, "swim0", "trial")["error mm"] == loss
    key = {"aligned": "aligned_marker_errors", "paper": "marker_errors"}[protocol]
    expected = [f"{1e3 * error:.1f}" for error in evaluation.detail["trials"]["swim0"][key]]
    assert [row(text, f"P{i}", "marker", "error mm")["error mm"] for i in range(5)] == expected


def test_tables_of_recordings_have_what_there_is():
    text = recordings()
    trial = row(text, "wild", "trial", "s", "error mm")
    assert (trial["force N"], trial["amplitude ratio"], trial["worst marker"]) == ("0.5", "1.10", "hand")
    assert float(trial["error mm"]) == pytest.approx(float(trial["markers mm"]) + 5, abs=0.11)  # 10 mm a newton
    hand, base = (row(text, name, "marker", "error mm") for name in ("hand", "base"))
    assert hand["ratio"] == "1.10"
    assert list(base.values())[1:] == ["0.0", "0.0", "n/a", "0.0, 0.0"]
    wild = text[text.index("Trial wild:") :]
    assert list(row(wild, "force N", "marker", "1.00 to 1.50 s").values())[1:] == ["+0.5"] * 8
    assert list(row(recordings(BESIDE), "base", "marker", "1.00 to 1.50 s").values())[1:] == ["+30, -40"] * 8
    assert "mm/s" not in text
    travels = row(recordings(TRAVELS, CART), "a", "trial", "s", "error mm", "progress mm", "shape mm", "heading deg")
    assert [travels[name] for name in ("real mm/s", "speed ratio")] == ["100.0", "1.50"]


def test_a_robot_without_markers_is_told_by_its_sensors_alone():
    blind = replace(ARM, marker_names=(), rest_markers=np.zeros((0, 2)), marker_heights=np.zeros(0), links=())
    text = recordings(robot=blind)
    assert list(row(text, "wild", "trial").values())[2:] == ["5.0", "0.5"]
    assert "The mean error of each sensor, over time and trials: 1 N of force as 10 mm." in text
    assert not re.search("marker|amplitude", text[text.index("## The robot") :])
    evaluation = evaluated(compared(CALM_AND_WILD, blind), blind)
    question = builder(blind, blind.space, compared(CALM_AND_WILD, blind)).question(start(evaluation))
    assert question.media == ()
    with pytest.raises(ArgumentError, match="show is pictures, and robot 'arm' has no markers to draw; show numbers"):
        TrialPromptBuilder(blind, blind.space, lambda values: None, {}, BriefingSettings("pictures"), False, 2000)


def test_only_the_worst_of_many_trials_are_told_in_detail():
    many = {f"t{k}": (Swing(), Swing(at=(0.01 * k, 0.0))) for k in range(10)}
    text = recordings(many)
    assert re.findall(r"^\| (t\d) \| 4\.00 ", text, re.MULTILINE) == list(many)
    assert list(row(text, "marker", "marker", "t2"))[1:] == [f"t{k}" for k in range(2, 10)]
    assert re.findall(r"^Trial (t\d):$", text, re.MULTILINE) == ["t7", "t8", "t9"]


def waves(real=(), simulated=(), frequencies=(0.5, 1.0, 2.0), protocol="aligned", from_rest=None, **more) -> str:
    """What is told of swims at these speeds [m/s]."""
    speeds = real or [0.1 * frequency for frequency in frequencies]
    pairs = [(Wave(f, v, **more), Wave(f, u, **more)) for f, v, u in zip(frequencies, speeds, simulated, strict=True)]
    return swims(pairs, protocol, from_rest)


SAID = [  # who says what, and with an exclamation mark what not
    (lambda: swims([(REAL, WIDER)]), ["swim0 (1.00 Hz)", "A swimming chain"]),
    (lambda: waves(simulated=(0.1, 0.1, 0.15)), ["rises too little"]),
    (lambda: waves(simulated=(0.025, 0.1, 0.4)), ["to the power 2.00", "to the power 1.00", "rises too steeply"]),
    (lambda: swims([(REAL, WIDER)], from_rest={"swim0": (0.05, 0.004)}), ["| 100.0 | 1.50 | 4.0 | 1.20 |"]),
    (lambda: waves((0.1,) * 3, (0.11, 0.1, 0.3), (1.5, 0.5, 1.0)), ["The worst trial is swim2 (1.00 Hz)"]),
    (lambda: waves(simulated=(-0.05, 0.1, 0.2)), ["last marker first, in swim0 (0.50 Hz)."]),
    (lambda: swims([(REAL, WIDER), (Wave(1.5), "it diverged after 1.20 s")]),
     ["swim1 (1.50 Hz): diverged. it diverged after 1.20 s", "!**The loss", "!1000"]),
    (lambda: swims([(REAL, WIDER)], "paper"), ["no phase is compared"]),
    (lambda: told(start(Evaluation(Candidate(np.array(MIDDLE)), 0.1))), ["There are no numbers of this point."]),
    (recordings, ["worst trial is wild", "0.25 N on average", "2.5 mm", "base to elbow, elbow to hand"]),
    (lambda: recordings(BESIDE), ["30.0 mm to the right and 40.0 mm down."]),
    (lambda: recordings({"a": (Swing(), Swing(drift=0.1))}), ["it grows with time.", "4.50 to 5.00"]),
    (lambda: recordings({"a": (Swing(), Swing(fade=0.1))}), ["it fades with time"]),
    (lambda: recordings({"a": (Swing(), Swing())}), ["!are off by"]),
    (lambda: recordings(TRAVELS, CART), ["from elbow to base", "(wheel: always 2)", "last marker first, in b."]),
    (lambda: recordings({"a": (Swing(), Swing())}, DRIVEN), ["a sine of 0.5 around 0.1", "pose 'raised'"]),
    (lambda: recordings(DIVERGED), ["wild: diverged. the simulation diverged 1.2", "!1000"]),
]  # fmt: skip


@pytest.mark.parametrize(("make", "parts"), SAID)
def test_what_is_said(make, parts):
    text = make()
    assert [part for part in parts if (part.removeprefix("!") in text) == part.startswith("!")] == []
    assert not re.search(r"\b(nan|inf|None)\b", text)


def step(loss, point=(0.75, 0.5), **more) -> Evaluation:
    return replace(evaluate(point, [(REAL, WIDER)]), loss=loss, **more)


BAD, GOOD = (Proposal(np.array([0.1, 0.5])), [step(0.2)]), (Proposal(np.array([0.75, 0.5])), [step(0.05)])


def test_a_round_is_told_with_its_steps_and_what_was_kept():
    notes = {"clipped": {"grip": 12.0}, "ignored": ["speed"], "hope": 0.5}
    proposal = Proposal(np.array([1.0, 0.5 + 1e-4]), "Too  slow,\nI think.", "", notes)
    text = told(after(step(0.1, (0.5, 0.5)), (proposal, [step(0.2, (1.0, 0.5)), step(0.08)])))
    assert "**Round 1: accepted at step 0.5**" in text
    before, kept = (EEL_SPACE.to_values([place, 0.5])["grip"] for place in (0.5, 0.75))
    assert f"- Proposed: grip {before:.3g} → 10." in text  # the other changed by too little to see
    did = r"speed 150, progress \d+\.\d, shape \d+\.\d, amplitude 120"
    assert re.search(rf"- Step 1: 200\.0 mm, {did}\n- Step 0\.5: 80\.0 mm, {did}, kept\n", text)
    assert "- grip (12 was given): out of bounds, so moved to the bound." in text
    assert "- speed: no parameters of this simulator, so ignored." in text
    assert "hope" not in text
    assert f"grip {kept:.4g} (0.75)" in text


def test_what_a_round_was_never_changes_so_that_services_keep_it():
    situations = [situation(World(), rounds) for rounds in (3, 6)]
    (fixed, short, _), (same, long, _) = (describe(RoundFacts(one, FISH, SPACE, {})) for one in situations)
    assert fixed == same
    assert [len(short), len(long)] == [4, 7]
    assert long[:4] == short


def test_a_step_tells_the_speed_of_each_trial_its_parts_and_the_head():
    real = [Wave(f, yaw=0.1) for f in (0.5, 1.0, 1.5)]
    pairs = [(one, replace(one, speed=s, yaw=0.2)) for one, s in zip(real, (0.05, 0.1, 0.12), strict=True)]
    steps = [evaluate([0.9, 0.5], pairs, "motion", loss=0.05)]
    text = told(after(evaluate(MIDDLE, pairs, "motion", loss=0.1), (Proposal(np.array([0.9, 0.5])), steps)))
    assert "in % of the real ones amplitude of P4, head's yaw and sway (phases in deg)" in text
    row = (
        r"speed (\S+) (\S+) (\S+), trials \S+ \S+ \S+, progress \S+, shape (\S+), recoil (\S+), amplitude \S+, "
        r"yaw (\S+) \(\+?-?\d+\), sway"
    )
    *speeds, shape, recoil, yaw = map(float, re.search(f"Step 1: 50.0 mm, {row}", text).groups())
    assert speeds == [pytest.approx(ratio, rel=0.03) for ratio in (50, 100, 120)]
    assert shape < 1 < recoil
    assert yaw == pytest.approx(200, rel=0.03)


def test_steps_of_recordings_tell_markers_sensors_and_amplitude():
    first = evaluated(compared(CALM_AND_WILD))
    exact = evaluated(compared({name: (real, real) for name, (real, _) in CALM_AND_WILD.items()}))
    text = told(after(first, (Proposal(np.full(3, 0.6)), [replace(exact, loss=0.001)])), ARM, ARM.space)
    assert ", markers 0.0 mm, force 0 N, trials 0.0 0.0, amplitude 100" in text
    cart = evaluated(compared({"a": TRAVELS["a"]}, CART), CART)
    text = told(after(cart, (Proposal(np.full(3, 0.6)), [cart])), CART, CART.space)
    assert re.search(r", speed 150, progress \d+\.\d, shape 0\.0, amplitude 100", text)


def test_rejected_rounds_are_counted():
    assert "**Round 1: rejected**" in told(after(step(0.1), BAD))
    assert "The last 2 rounds were rejected" in told(after(step(0.1), BAD, GOOD, BAD, BAD))
    assert "rejected.\n" not in told(after(step(0.1), BAD, GOOD))
    broken = Proposal(np.array([0.9, 0.9])), [step(0.3), evaluate([0.7, 0.7], [(REAL, "nothing is finite")])]
    assert "- Step 0.5: the simulation diverged (trial 'swim0': nothing is finite)" in told(after(step(0.1), broken))


# probes

FIRST = np.array([0.2, 0.8])
YAWING = [Wave(f, yaw=0.1) for f in (0.5, 1.0)]


def faster(point, speed: float, loss: float, **more) -> Evaluation:
    """An evaluation whose swims are all so much faster than the real ones."""
    simulated = [replace(one, speed=speed * one.speed, **more) for one in YAWING]
    return evaluate(point, list(zip(YAWING, simulated, strict=True)), "motion", loss=loss)


def test_parameters_are_measured_in_order_toward_the_middle_then_the_other_proposes():
    search = BacktrackingLineSearch(ProbingAdvisor(ScriptedAdvisor([FIRST, FIRST, [0.5, 0.5]]), EEL_SPACE, 2), FIRST)
    seen = []
    for loss in (1.0, 2.0, 0.9, 0.8):
        seen.append(Evaluation(search.ask(), loss))
        search.tell(seen[-1])
    np.testing.assert_allclose([one.candidate.point for one in seen], [FIRST, [0.3, 0.8], [0.2, 0.7], [0.5, 0.5]])
    assert [one.candidate.note.get("parameter") for one in seen] == [None, "grip", "spring", None]
    with pytest.raises(ArgumentError, match="probes is 3; the robot has 2 parameters"):
        ProbingAdvisor(ScriptedAdvisor([]), EEL_SPACE, 3)


def test_a_measurement_is_told_by_trial():
    first, probe = faster(FIRST, 1.0, 0.1), faster([0.3, 0.8], 1.1, 0.12, yaw=0.12)
    text = told(replace(start(first), measurements=(probe,)))
    values = [EEL_SPACE.to_values(point)["grip"] for point in (FIRST, [0.3, 0.8])]
    change = f"grip {values[0]:.3g} → {values[1]:.3g}"
    ((*speeds, yaw),) = re.findall(
        rf"1\. Measured {change}: 120\.0 mm, speed (\S+) (\S+), .*yaw (\S+) \(\S+\), sway", text
    )
    assert [float(speed) for speed in speeds] == [pytest.approx(110, abs=1)] * 2
    assert float(yaw) == pytest.approx(120, abs=1)
    assert "1. Measured" not in told(start(first))


def test_a_measurement_keeps_its_place_in_finished_rounds():
    first, probe, tried = faster(FIRST, 1.0, 0.1), faster([0.3, 0.8], 1.1, 0.08), faster([0.5, 0.5], 1.2, 0.05)
    search = BacktrackingLineSearch(ScriptedAdvisor([Measurement(np.array([0.3, 0.8])), [0.5, 0.5], FIRST]), FIRST)
    for one in (first, probe, tried):
        search.tell(replace(one, candidate=search.ask()))
    (done,) = search.rounds
    situation = replace(after(first), incumbent=done.steps[-1].evaluation, rounds=search.rounds)
    text = told(situation)
    assert re.search(r"\*\*Round 1: accepted at step 1\*\*\n- Measured grip \S+ → \S+: 80\.0 mm, .*, kept\n", text)
    assert re.search(r"- Proposed: spring \S+ → \S+, grip ", text)


@given(
    st.integers(0, 3), st.integers(0, 5), st.sampled_from([1.0, -1.0]), st.booleans(),
    st.sampled_from(["both", "numbers", "pictures"]),
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 8)), max_size=20), st.sampled_from(["log", "linear"]),
)  # fmt: skip
@settings(max_examples=12)
def test_the_page_is_a_pure_function_with_whole_tables_and_nothing_undefined(
    rounds, seed, sign, failed, show, lost, scale
):
    world = World(sign=sign, lost=lost)
    shown = start(world.evaluate(np.full(16, 0.5), failed=True)) if failed else situation(world, rounds, seed)
    before = json.dumps([one.detail for one in shown.evaluations])
    text, again = (told(shown, FISH, replace(SPACE, scale=scale), show=show) for _ in range(2))
    assert text == again
    assert json.dumps([one.detail for one in shown.evaluations]) == before
    named = [name for one in tables(text)[0][1:] for name in one[0].split(", ")]
    assert sorted(named) == sorted(SPACE.names)
    assert ("blue" in text) == (show != "numbers")
    assert not re.search(r"\b(nan|inf|None)\b|-0\.0*\b(?!\d)", text)
    assert re.search(r"\S\n\Z", text)
    assert "\n\n\n" not in text


@given(st.integers(0, 4), st.integers(0, 5), st.floats(1.01, 5.0))
@settings(max_examples=4)
def test_without_numbers_the_text_doesnt_depend_on_anything_measured(rounds, seed, factor):
    def other(evaluation: Evaluation) -> Evaluation:
        return replace(evaluation, loss=factor * evaluation.loss, detail=World(sign=-1).evidence(np.full(16, 0.3)))

    shown = situation(World(), rounds, seed)
    changed_rounds = []
    for one in shown.rounds:
        steps = tuple(replace(tried, evaluation=other(tried.evaluation)) for tried in one.steps)
        proposal = replace(one.proposal, diagnosis=f"{factor}")
        changed_rounds.append(replace(one, incumbent=other(one.incumbent), proposal=proposal, steps=steps))
    changed = replace(shown, incumbent=other(shown.incumbent), first=other(shown.first), rounds=tuple(changed_rounds))
    assert told(shown, FISH, SPACE, show="pictures") == told(changed, FISH, SPACE, show="pictures")
    assert told(shown, FISH, SPACE) != told(changed, FISH, SPACE)


@pytest.mark.parametrize("trials", [6, 8])
def test_it_is_short_even_after_many_rounds(trials):
    known = RoundFacts(situation(World(tuple(np.linspace(0.5, 2.0, 8))[:trials]), 12), FISH, SPACE, {})
    instructions, rounds, current = describe(known)
    assert len(instructions) < 8_000
    assert len("".join(rounds)) < 13_000
    assert len(current) < 4_000


@given(st.floats(1e-6, 1e6))
def test_a_value_that_is_repeated_as_shown_is_no_change(given_value):
    assert abs(float(significant(given_value)) - given_value) <= 1e-3 * given_value


@pytest.fixture
def burned_in(monkeypatch):
    """What is written into pictures."""
    texts: list[str] = []
    original = Canvas.text

    def text(self, place, text, *more, **others):
        texts.append(text)
        return original(self, place, text, *more, **others)

    monkeypatch.setattr(Canvas, "text", text)
    return texts


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "real.mp4"
    with VideoWriter(path, 64, 48, 10, crf=5) as writer:
        for k in range(60):
            writer.write(np.full((48, 64, 3), 40 + 3 * k, np.uint8))
    return path


def everything(request: Request) -> str:
    """All the text of a question and of its repair."""
    mended = repair_request(request, "{}", "'parameters' is missing", 100)
    parts = [part if isinstance(part, str) else part.label for part in (*request.parts, *mended.parts)]
    return "\n".join([request.instructions, HOW_TO, json.dumps(request.schema), *parts])


def without(text: str, robot) -> str:
    """The text without what the robot itself says."""
    for said in (robot.description, *(one.meaning for one in robot.space)):
        assert said in text
        text = text.replace(said, "")
    return text


def builder(robot, space, comparison, videos=(), takes_video=False) -> TrialPromptBuilder:
    briefing = BriefingSettings("both", "auto", "low")
    return TrialPromptBuilder(robot, space, lambda values: comparison, dict(videos), briefing, takes_video, 2000)


def asked(robot, space, comparison, evaluation, videos=(), takes_video=False) -> Request:
    """The question of the round after one that was rejected and one that was accepted, with the media of the first."""
    notes = {"clipped": {"x": 3.0}, "missing": ["y"]}
    proposal = Proposal(np.full(len(space), 0.6), "It is too lively.", "", notes)
    worse, better = (replace(evaluation, loss=factor * evaluation.loss) for factor in (2, 0.5))
    situation = after(evaluation, (proposal, [worse, worse]), (proposal, [worse, better]))
    asking = builder(robot, space, comparison, videos, takes_video)
    first, later = asking.question(start(evaluation)), asking.question(situation)
    return replace(later, parts=(*(part for part in later.parts if isinstance(part, str)), *first.media))


@pytest.mark.parametrize("takes_video", [False, True])
def test_a_robot_that_swims_is_no_fish_unless_it_says_so(takes_video, film, burned_in):
    pairs = [(Wave(f), Wave(f, 0.15)) for f in (0.8, 1.6)]
    videos = {"swim0": (film, None), "swim1": (film, None)}
    request = asked(eel(), EEL_SPACE, compared_waves(pairs), evaluate([0.5, 0.5], pairs), videos, takes_video)
    assert len(request.media) == 2
    text = "\n".join([everything(request), *burned_in])
    assert "0.80 Hz" in text
    assert not re.search(FISH_WORDS, text, re.IGNORECASE)
    assert "how they depend on frequency" in request.instructions


def test_pictures_come_with_a_new_point_alone():
    pairs = [(Wave(f), Wave(f, 0.15)) for f in (0.6, 0.8, 1.2, 1.6)]
    evaluation = evaluate([0.5, 0.5], pairs)
    far, near, better = (replace(evaluation, loss=factor * evaluation.loss) for factor in (2.0, 1.1, 0.5))
    proposal = Proposal(np.full(2, 0.6))
    asking = builder(eel(), EEL_SPACE, compared_waves(pairs))
    rejected = after(evaluation, (proposal, [far, near]))
    measured = replace(rejected, measurements=(near,))
    accepted = after(evaluation, (proposal, [far, near]), (proposal, [better]))
    shown = [[media.label.split(" (")[0] for media in asking.question(one).media] for one in
             (start(evaluation), rejected, measured, accepted)]  # fmt: skip
    assert [len(labels) for labels in shown] == [1, 0, 0, 1]  # the worst trial
    resumed = builder(eel(), EEL_SPACE, compared_waves(pairs)).question(accepted)
    assert [media.label.split(" (")[0] for media in resumed.media] == shown[3]  # as before the run was left


def test_a_better_measurement_that_was_not_kept_is_pointed_out():
    stays = {"source": "measurement", "parameter": "grip", "stays": True}
    lower, higher = (
        replace(step(loss), candidate=Candidate(step(loss).candidate.point, stays)) for loss in (0.08, 0.2)
    )
    now = replace(start(step(0.1)), measurements=(higher, lower))
    text = told(now)
    assert "2. Measured " in text
    assert "Measurement 2 is better than the current point by 20.0 mm and wasn't kept" in text
    assert 'reply "take": "2"' in text
    assert "wasn't kept" not in told(replace(now, measurements=(higher,)))


@pytest.mark.parametrize("takes_video", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("robot", [ARM, CART])
def test_recordings_know_neither_fish_nor_swims(robot, takes_video, film, burned_in):
    comparison = compared({"a": (Swing(), Swing(0.12)), "b": (Swing(0.2), Swing(0.2, (0.01, 0.0)))}, robot)
    videos = {"a": (film, None), "b": (film, None)}
    request = asked(robot, robot.space, comparison, evaluated(comparison, robot), videos, takes_video)
    kind = "video/mp4" if takes_video else "image/png"
    assert [one.media_type for one in request.media] == [kind] * 2
    assert request.media[-1].label.startswith("The real robot in trial ")
    text = "\n".join([everything(request), *burned_in])
    assert "distance of the markers, simulated to real" in text
    assert "with trial, marker and time" in text
    assert not re.search(SWIM_WORDS, without(text, robot), re.IGNORECASE)

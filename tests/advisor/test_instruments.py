"""Instruments that a reply asks: answered at once from what the run has evaluated, bounded, and on record."""

import json
from dataclasses import replace

import numpy as np
import pytest
from worlds import World, hidden_point

from recorded import PENDULUM
from swim2real.advisor.vlm.advisor import ReplayAdvisor, VlmAdvisor
from swim2real.advisor.vlm.client import ModelClient
from swim2real.advisor.vlm.exchange import Request
from swim2real.advisor.vlm.files import FilesClient
from swim2real.advisor.vlm.instruments import MOST_ASKED, Instruments
from swim2real.advisor.vlm.reply import ReplyError, parse_reply, reply_schema
from swim2real.advisor.vlm.transcript import Transcript
from swim2real.optimizers import Candidate, Evaluation, Measurement, Proposal, Round, Situation, Step
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.robots.fish import FISH
from swim2real.settings import VlmAccess
from swimbase.errors import WaitingForReply
from vlm_server import replies

SPACE = ParameterSpace(
    (
        Parameter("drag", "-", 0.0, 10.0, "slows it", 1.0, log_offset=0.1),
        Parameter("arm", "m", 0.01, 0.06, "bends it", 0.04),
        Parameter("mass", "kg", 0.1, 1.0, "loads it", 0.5),
    )
)
LOWEST = np.array([0.45, 0.62, 0.5])
SLOPES = np.random.default_rng(0).standard_normal((3, 30)) * 0.01
INSTRUMENTS = Instruments(replace(PENDULUM, space=SPACE), SPACE)


def evaluation(*point: float) -> Evaluation:
    residual = 1e-3 + (np.array(point) - LOWEST) @ SLOPES
    length = float(np.linalg.norm(residual))
    stage = (residual, np.full(30, length**-0.5))
    return Evaluation(Candidate(np.array(point)), length, stages=(stage,) * 4, margins=np.array([0.05, point[0] - 0.2]))


def situation() -> Situation:
    """A run in which nobody has moved the mass."""
    first = evaluation(0.5, 0.5, 0.5)
    made = [(0.55, 0.5), (0.5, 0.55), (0.52, 0.47), (0.47, 0.53), (0.49, 0.56)]
    others = tuple(evaluation(*point, 0.5) for point in made)
    best = min((first, *others), key=lambda one: one.loss)
    return Situation(best, (), first, others)


def parsed(now: Situation, **content):
    return parse_reply(json.dumps(content), SPACE, SPACE.to_values(now.incumbent.candidate.point))


def answered(now: Situation, **content) -> str:
    return INSTRUMENTS.answers(parsed(now, **content), now).text


def swims(rng, count: int) -> list[Evaluation]:
    """Swims of the fish by its learned response near a point, with residuals in parts."""
    world, center, made = World(), hidden_point() + 0.04, list[Evaluation]()
    for point in np.clip(center + 0.03 * rng.standard_normal((count, len(center))), 0, 1):
        one = world.evaluate(point)
        rows, parts = list[float](), list[tuple[str, str, int]]()
        for name, trial in one.detail["trials"].items():
            beat = [
                r - s
                for r, s in zip(trial["beat_real"]["amplitude"], trial["beat_simulated"]["amplitude"], strict=True)
            ]
            rows += [2 * (trial["velocity_simulated"] - trial["velocity_real"]), *beat]
            parts += [(name, "progress", 1), (name, "shape", len(beat))]
        stage = (np.array(rows), np.ones(len(rows)))
        made.append(replace(one, stages=(stage,) * 4, parts=tuple(parts)))
    return made


def good(**others) -> str:
    return json.dumps({"diagnosis": "too slow", "reasoning": "less drag", "parameters": {"drag": 2.0}, **others})


def question(situation: Situation, level: int) -> Request:
    return Request("Say what differs.", ("the loss",), reply_schema(SPACE), 2000)


def test_a_prediction_says_the_loss_the_first_beats_and_what_nobody_tried():
    now = situation()
    values = SPACE.to_values(np.array([0.48, 0.58, 0.5]))
    text = answered(now, parameters=values, predict=True)
    assert f"a loss of {1e3 * evaluation(0.48, 0.58, 0.5).loss:.1f} mm" in text
    assert "first beats" in text
    assert "What it expected of the last evaluations" in text
    assert "Little is known" not in text
    text = answered(now, parameters={"mass": 0.9}, predict=True)
    assert "Little is known of mass" in text


def test_values_out_of_bounds_are_predicted_at_the_bound():
    now = situation()
    outside = parsed(now, parameters={"drag": 99.0}, predict=True)
    assert outside.clipped == {"drag": 99.0}
    at_bound = parsed(now, parameters={"drag": 10.0}, predict=True)
    assert INSTRUMENTS.answers(outside, now) == INSTRUMENTS.answers(at_bound, now)


def test_a_step_is_solved_along_the_names_and_says_its_values():
    now = situation()
    text = answered(now, solve=["drag"], radius=0.05)
    assert "drag" in text
    assert "arm 0" not in text
    assert "at most 0.05 of each range" in text
    text = answered(now, solve=["all"])
    assert "drag" in text
    assert "arm" in text
    assert "Expected: a loss of" in text


def test_a_step_along_what_nobody_moved_says_what_it_costs_to_know():
    text = answered(situation(), solve=["mass"])
    assert "Little is known of mass" in text
    assert '"measure" shows what it does, at an evaluation' in text


def test_effects_show_only_what_is_known():
    text = answered(situation(), effects=True)
    assert "| drag |" in text
    assert "| arm |" in text
    assert "| mass |" not in text
    assert "Not known, what may matter most first: mass" in text


def test_without_four_evaluations_there_is_no_model_and_it_says_so():
    first = evaluation(0.5, 0.5, 0.5)
    now = Situation(first, (), first)
    assert "no local model yet" in answered(now, effects=True)


def test_a_model_that_was_wrong_three_times_says_so_and_shrinks_its_steps():
    now = situation()
    wrong = [Evaluation(one.candidate, one.loss + 0.2, stages=one.stages, margins=one.margins) for one in
             (evaluation(0.51, 0.51, 0.5), evaluation(0.49, 0.52, 0.5), evaluation(0.52, 0.5, 0.5))]  # fmt: skip
    later = Situation(now.incumbent, (), now.first, (*now.measurements, *wrong))
    text = answered(later, solve=["all"], radius=0.1)
    assert "wrong three times running" in text
    assert "at most 0.05 of each range" in text


def test_a_prediction_says_by_trial_what_a_swim_does():
    """Of 30 swims within 0.03 of a range the speed ratio of another is predicted to a few percent."""
    rng = np.random.default_rng(0)
    made, space = swims(rng, 31), World().space
    *made, hidden = made
    best = min(made, key=lambda one: one.loss)
    now = Situation(best, (), made[0], tuple(made[1:]))
    instruments = Instruments(FISH, space)
    asked = parse_reply(
        json.dumps({"parameters": space.to_values(hidden.candidate.point), "predict": True}),
        space, space.to_values(best.candidate.point),
    )  # fmt: skip
    text = instruments.answers(asked, now).text
    assert "| trial | error mm | progress mm | shape mm | speed ratio |" in text
    rows = {
        line.split(" | ")[0].lstrip("| "): line.split(" | ") for line in text.splitlines() if line.startswith("| f")
    }
    for name, trial in hidden.detail["trials"].items():
        ratio, std = map(float, rows[name][4].split(" ± "))
        assert ratio == pytest.approx(trial["velocity_simulated"] / trial["velocity_real"], abs=max(2 * std, 0.03))
    assert all(float(rows[name][4].split(" ± ")[1]) <= 0.02 for name in ("f2", "f3"))
    weighed = parse_reply(json.dumps({"solve": ["all"], "weigh": {"f0": 5.0, "shape": 2.0}}), space, {})
    assert "Expected" in instruments.answers(weighed, now).text
    wrong = parse_reply(json.dumps({"solve": ["all"], "weigh": {"shap": 2.0}}), space, {})
    assert "names shap, which is neither a trial nor a part: f0, f1, f2, f3" in instruments.answers(wrong, now).text
    effects = parse_reply(json.dumps({"effects": True}), space, {})
    text = instruments.answers(effects, now).text
    assert "| parameter | loss mm | speed % |" in text
    lift = next(line for line in text.splitlines() if line.startswith("| fluid_kutta_lift |"))
    told = [float(number) for number in lift.split(" | ")[2].split()]
    here, center = best.detail["trials"], best.candidate.point
    raised = World().evaluate(center + 0.02 * np.eye(len(center))[space.names.index("fluid_kutta_lift")])
    faster = [
        250 * (one["velocity_simulated"] - here[name]["velocity_simulated"]) / one["velocity_real"]
        for name, one in raised.detail["trials"].items()
    ]
    assert told == pytest.approx(faster, rel=0.1, abs=12)  # from -76 to 4


def test_measures_say_their_way_and_size():
    now = situation()
    assert parsed(now, measure=["drag +0.05", "arm"]).measure == {"drag": 0.05, "arm": None}
    for wrong in ("drag +2", "drag 0", "drag much", "drag nan"):
        with pytest.raises(ReplyError, match=r"'measure' changes 'drag' by .* share of its range from -1 to 1"):
            parsed(now, measure=[wrong])


def test_a_name_that_is_no_parameter_is_refused():
    with pytest.raises(ReplyError, match=r"'solve' names no parameter.*drga.*drag"):
        parsed(situation(), solve=["drga"])


def test_a_reply_that_asks_for_ever_is_bounded_and_all_is_on_record(vlm, tmp_path):
    vlm.script(*[replies(json.dumps({"effects": True}))] * (MOST_ASKED + 1), replies(good()))
    access = VlmAccess(vlm.url("openai"), timeout=20.0)
    client, transcript = ModelClient("openai:some-model", access, sleep=lambda seconds: None), Transcript(tmp_path)
    advice = VlmAdvisor(client, question, SPACE, transcript, access, instruments=INSTRUMENTS).propose(situation())
    assert SPACE.to_values(advice.point)["drag"] == pytest.approx(2.0)
    outcomes = [call.outcome for call in Transcript(tmp_path).calls]
    assert outcomes == ["asked"] * MOST_ASKED + ["unusable", "used"]
    assert "instruments" in str(Transcript(tmp_path).calls[MOST_ASKED].problem)


def test_the_solved_step_and_measurements_can_be_taken_and_are_replayed(vlm, tmp_path):
    now = replace(situation(), measurements=())
    made = situation().measurements
    now = replace(now, rounds=(Round(Proposal(LOWEST), now.first, tuple(Step(1.0, one) for one in made), True),))
    vlm.script(*(replies(text) for text in (json.dumps({"take": "solved"}), json.dumps({"solve": ["drag"]}),
               json.dumps({"take": "solved", "parameters": {"arm": 0.05}}))))  # fmt: skip
    access = VlmAccess(vlm.url("openai"), timeout=20.0)
    client, transcript = ModelClient("openai:some-model", access, sleep=lambda seconds: None), Transcript(tmp_path)
    advice = VlmAdvisor(client, question, SPACE, transcript, access, instruments=INSTRUMENTS).propose(now)
    unusable, asked, _ = Transcript(tmp_path).calls
    assert "no step was solved in this turn" in str(unusable.problem)
    values = SPACE.to_values(advice.point)
    assert values["drag"] == pytest.approx(asked.solved["drag"], rel=1e-3)
    assert values["arm"] == pytest.approx(0.05)
    assert advice.notes["take"] == "solved"
    again = ReplayAdvisor(Transcript(tmp_path), SPACE).propose(now)
    assert np.array_equal(again.point, advice.point)
    offered = {"2": SPACE.to_values(made[1].candidate.point)}
    taken = parse_reply(json.dumps({"take": 2}), SPACE, SPACE.to_values(now.incumbent.candidate.point), offered)
    assert taken.point(SPACE, now.incumbent.candidate.point) == pytest.approx([0.5, 0.55, 0.5], abs=1e-6)
    with pytest.raises(ReplyError, match=r"'take' is \"7\"; it may be '2'"):
        parse_reply(json.dumps({"take": "7"}), SPACE, {}, offered)


def test_a_round_measures_no_more_than_there_are_parameters(vlm, tmp_path):
    now = situation()
    made = tuple(
        replace(one, candidate=Candidate(one.candidate.point, {"probe": True})) for one in now.measurements[:2]
    )
    vlm.script(replies(json.dumps({"measure": ["drag", "arm"]})), replies(json.dumps({"measure": ["drag"]})))
    access = VlmAccess(vlm.url("openai"), timeout=20.0)
    client, transcript = ModelClient("openai:some-model", access, sleep=lambda seconds: None), Transcript(tmp_path)
    advisor = VlmAdvisor(client, question, SPACE, transcript, access, instruments=INSTRUMENTS)
    assert isinstance(advisor.propose(replace(now, measurements=made)), Measurement)
    problem = str(Transcript(tmp_path).calls[0].problem)
    assert "2 points have been measured in this round and 2 more are asked for, but 1 more can be" in problem


def test_by_files_the_answer_stands_beside_the_reply_and_the_question_stays_as_it_was(tmp_path):
    def ask():
        client = FilesClient(tmp_path, {}, once=True)
        advisor = VlmAdvisor(client, question, SPACE, Transcript(tmp_path), repairs=None, instruments=INSTRUMENTS)
        return advisor.propose(situation())

    folder = tmp_path / "advisor" / "round_001"
    with pytest.raises(WaitingForReply, match=r"briefing\.md"):
        ask()
    briefing = (folder / "briefing.md").stat().st_mtime_ns
    (folder / "reply.json").write_text(json.dumps({"solve": ["drag", "arm"]}))
    with pytest.raises(WaitingForReply, match=r"instruments\.md"):
        ask()
    assert "**solve**" in (folder / "instruments.md").read_text()
    with pytest.raises(WaitingForReply, match=r"instruments\.md"):
        ask()  # resumed without a new reply: answered again, and counted once
    assert [call.outcome for call in Transcript(tmp_path).calls] == ["asked"]
    (folder / "reply.json").write_text(good(probe=True))
    assert isinstance(ask(), Measurement)
    assert (folder / "briefing.md").stat().st_mtime_ns == briefing

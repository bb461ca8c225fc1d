import json

import numpy as np
import pytest

from swim2real.advisor.vlm.advisor import Limits, ReplayAdvisor, VlmAdvisor
from swim2real.advisor.vlm.client import RetryPolicy, make_client
from swim2real.advisor.vlm.exchange import Attempt, Media, Reply, Request
from swim2real.advisor.vlm.reply import reply_schema
from swim2real.advisor.vlm.transcript import Transcript, totals
from swim2real.errors import AdvisorError, ArgumentError
from swim2real.optimizers import Candidate, Evaluation, Proposal, Round, Situation, Step
from swim2real.parameters import Parameter, ParameterSpace
from vlm_server import drops, refuses, replies, sends

SPACE = ParameterSpace(
    (
        Parameter("drag", "-", 0.0, 10.0, "slows it", 1.0, log_offset=0.1),
        Parameter("arm", "m", 0.01, 0.06, "bends it", 0.04),
    )
)
PICTURE = Media("what is seen", "image/png", b"\x89PNG not a real one, but nobody looks at it here")


def evaluation(x: float, y: float, loss: float) -> Evaluation:
    return Evaluation(Candidate(np.array([x, y])), loss)


FIRST = evaluation(0.5, 0.5, 0.05)
START = Situation(FIRST, (), FIRST)


def good(drag: float = 5.0, **others) -> str:
    return json.dumps(
        {"diagnosis": "too slow", "reasoning": "less drag", "parameters": {"drag": drag, "arm": 0.02, **others}}
    )


class Brief:
    """A question with a picture; shorter at the next level."""

    def question(self, situation: Situation, level: int = 0) -> Request:
        text = f"the loss is {1e3 * situation.incumbent.loss:.1f} mm" + " in short" * level
        return Request("Say what differs.", (text, PICTURE), reply_schema(SPACE), 2000)


@pytest.fixture
def ask(vlm, tmp_path):
    """Makes an advisor that asks the test's server, and keeps what it told."""

    def make(limits: Limits | None = None, tries: int = 2, provider="openai", timeout: float = 20.0) -> VlmAdvisor:
        client = make_client(
            f"{provider}:some-model", vlm.url(provider), timeout=timeout,
            retry=RetryPolicy(tries, sleep=lambda seconds: None),
        )  # fmt: skip
        make.events = []
        return VlmAdvisor(client, Brief(), SPACE, Transcript(tmp_path), limits, make.events.append)

    return make


def calls(tmp_path) -> list[dict]:
    return [json.loads(path.read_text()) for path in sorted((tmp_path / "advisor").glob("call_*.json"))]


def refusal(advisor: VlmAdvisor, situation: Situation = START) -> str:
    with pytest.raises(AdvisorError) as caught:
        advisor.propose(situation)
    return str(caught.value)


@pytest.mark.slow
def test_a_good_reply_becomes_a_proposal_with_where_it_came_from(ask, vlm, tmp_path):
    vlm.script(replies(good(drag=12.0, gravity=1), tokens=(900, 80), thinking=20))
    proposal = ask().propose(START)
    values = SPACE.to_values(proposal.point)
    assert values == pytest.approx({"drag": 10.0, "arm": 0.02})
    assert (proposal.diagnosis, proposal.reasoning) == ("too slow", "less drag")
    seconds = proposal.notes["seconds"]
    assert 0 < seconds < 20
    assert proposal.notes == {
        "advisor": "openai:some-model", "model": "some-model", "calls": [1], "input_tokens": 900, "output_tokens": 100,
        "cost": None, "seconds": seconds, "ignored": ["gravity"], "clipped": {"drag": 12.0},
    }  # fmt: skip
    json.dumps(proposal.as_dict(), allow_nan=False)


def test_the_transcript_says_all_with_the_media_beside_it(ask, vlm, tmp_path):
    vlm.script(replies(good()))
    ask().propose(START)
    (call,) = calls(tmp_path)
    assert call["outcome"] == "used"
    assert call["incumbent"] == {"point": [0.5, 0.5], "loss": 0.05}
    assert call["reply"]["text"] == good()
    text, picture = call["request"]["parts"]
    assert text == "the loss is 50.0 mm"
    assert picture["sha256"] == PICTURE.sha256
    assert (tmp_path / "advisor" / picture["media"]).read_bytes() == PICTURE.data
    assert "not a real one" not in json.dumps(call)


def test_a_round_that_is_on_record_is_not_paid_for_twice(ask, vlm):
    vlm.script(replies(good()))
    first = ask().propose(START)
    again = ask().propose(START)
    assert len(vlm.requests) == 1
    assert again.as_dict() == first.as_dict()
    elsewhere = evaluation(0.4, 0.4, 0.06)
    vlm.script(replies(good(drag=3.0)))
    assert ask().propose(Situation(elsewhere, (), elsewhere)).as_dict() != first.as_dict()


BAD = {
    "nan": ('{"parameters": {"drag": NaN}}', "'drag' is NaN; it must be a finite number from 0 to 10"),
    "no change": (
        json.dumps({"parameters": {k: float(f"{v:.4g}") for k, v in SPACE.to_values([0.5, 0.5]).items()}}),
        "no parameter changes",
    ),
    "prose": ("The tail bends too far.", "the reply holds no JSON object"),
    "broken": (good()[:-9], "the reply is not valid JSON"),
}


@pytest.mark.parametrize(
    ("provider", "kind"),
    [("google", "prose"), ("anthropic", "nan"), ("openai", "broken"), ("openai", "no change")],
)
def test_a_bad_reply_is_mended_by_a_question_without_media(ask, vlm, tmp_path, provider, kind):
    text, problem = BAD[kind]
    vlm.script(replies(text), replies(good()))
    advisor = ask(provider=provider)
    proposal = advisor.propose(START)
    assert proposal.notes["calls"] == [1, 2]
    first, second = vlm.requests
    assert len(first.parts) == 3  # text, label, picture
    assert all("text" in part for part in second.parts)
    assert problem in second.text
    assert text[:40] in second.text
    assert "the loss is 50.0 mm" in second.text
    assert [call["outcome"] for call in calls(tmp_path)] == ["unusable", "used"]
    assert [event.kind for event in ask.events] == ["asks", "received", "unusable", "asks", "received", "answered"]


def test_a_cut_reply_is_mended_with_more_room(ask, vlm):
    vlm.script(replies('{"diagnosis": "the tail', "length"), replies(good()))
    ask().propose(START)
    assert "cut off after" in vlm.requests[1].text
    assert "answer more briefly" in vlm.requests[1].text
    assert [asked.max_tokens for asked in vlm.requests] == [2000, 4000]


def test_a_reply_that_is_whole_but_for_its_end_is_used(ask, vlm):
    vlm.script(replies(good() + "\n\nOn the other", "length"))
    ask().propose(START)
    assert len(vlm.requests) == 1


def test_a_refusal_is_answered_once_more_in_words(ask, vlm):
    vlm.script(replies("I can't look at fish.", "refusal"), replies(good()))
    assert ask(provider="anthropic").propose(START).notes["calls"] == [1, 2]
    assert "the reply declined to answer" in vlm.requests[1].text


def test_after_two_repairs_the_round_has_failed_and_is_asked_anew(ask, vlm, tmp_path):
    vlm.script(*[replies("no")] * 3, replies(good()))
    proposal = ask().propose(START)
    assert proposal.notes["calls"] == [1, 2, 3, 4]
    assert len(vlm.requests[3].parts) == 4  # the picture again, and what went wrong
    assert "An earlier answer to this could not be used: the reply holds no JSON object" in vlm.requests[3].text


@pytest.mark.slow
def test_three_failed_rounds_in_a_row_end_the_run_with_a_sentence(ask, vlm, tmp_path):
    vlm.script(then=refuses(503, "the model is overloaded", "UNAVAILABLE"))
    said = refusal(ask(provider="google", tries=2))
    assert said.startswith("round 1: 3 times in a row there was no usable reply from google:some-model; the last time,")
    assert "the model is overloaded" in said
    assert said.endswith("nothing is lost, --resume asks again")
    assert len(vlm.requests) == 6
    assert [call["outcome"] for call in calls(tmp_path)] == ["failed"] * 3
    assert [len(call["attempts"]) for call in calls(tmp_path)] == [2, 2, 2]
    vlm.script(replies(good()))
    assert ask(provider="google").propose(START).notes["calls"] == [1, 2, 3, 4]  # and it goes on


def test_what_passes_is_tried_again_within_the_call(ask, vlm, tmp_path):
    vlm.script(sends("<html>Bad gateway</html>", 502), drops, replies(good()))
    ask(tries=3).propose(START)
    (call,) = calls(tmp_path)
    assert [bool(attempt["error"]) for attempt in call["attempts"]] == [True, True, False]
    assert [event.kind for event in ask.events] == ["asks", "waits", "waits", "received", "answered"]


def test_a_context_that_is_too_long_is_shortened_once(ask, vlm, tmp_path):
    too_long = refuses(400, "This model's maximum context length is 8192 tokens", "context_length_exceeded")
    vlm.script(too_long, replies(good()))
    assert ask().propose(START).notes["calls"] == [1, 2]
    assert "in short" not in vlm.requests[0].text
    assert "in short" in vlm.requests[1].text
    vlm.script(then=too_long)
    situation = later()
    assert "maximum context length" in refusal(ask(), situation)
    assert [call["outcome"] for call in calls(tmp_path)[2:]] == ["failed"] * 6  # each of three rounds, twice


def later() -> Situation:
    """A round later."""
    step = Step(1.0, evaluation(0.6, 0.6, 0.04))
    return Situation(step.evaluation, (Round(Proposal(np.array([0.6, 0.6])), FIRST, (step,), True),), FIRST)


def test_a_safety_filter_fails_the_round(ask, vlm, tmp_path):
    blocked = sends({"promptFeedback": {"blockReason": "PROHIBITED_CONTENT"}, "modelVersion": "some-model"})
    vlm.script(blocked, replies(good()))
    ask(provider="google").propose(START)
    assert [call["outcome"] for call in calls(tmp_path)] == ["failed", "used"]
    assert "PROHIBITED_CONTENT" in calls(tmp_path)[0]["problem"]


def test_a_wrong_setting_ends_the_run_at_once(ask, vlm):
    vlm.script(then=refuses(404, "no such model or key", "not_found"))
    assert "openai:some-model' can't be asked" in refusal(ask())
    assert len(vlm.requests) == 1


def test_calls_are_limited_over_all_sittings(ask, vlm):
    vlm.script(*[replies("no")] * 2)
    said = refusal(ask(Limits(max_calls=2)))
    assert said == "2 calls were made and --max-calls is 2; --resume with a higher one goes on"
    assert refusal(ask(Limits(max_calls=2))) == said
    vlm.script(replies(good()))
    assert ask(Limits(max_calls=3)).propose(START).notes["calls"] == [1, 2, 3]


def test_a_cost_that_nobody_knows_can_not_be_limited(ask):
    with pytest.raises(
        ArgumentError, match=r"max_cost is 2 USD, but the price of openai:some-model isn't known; limit"
    ):
        ask(Limits(max_cost=2.0))


class Dear:
    """A client whose every reply costs 40 cents."""

    name, takes_video, price_known = "shop:dear", False, True

    def call(self, request, on_attempt=None) -> Reply:
        return Reply(good(), "stop", "dear", 100, 10, 0.4, attempts=(Attempt(1.0),))


def test_the_cost_is_limited_before_it_is_spent(tmp_path):
    advisor = VlmAdvisor(Dear(), Brief(), SPACE, Transcript(tmp_path), Limits(max_cost=0.7))
    assert advisor.propose(START).notes["cost"] == 0.4
    said = refusal(advisor, later())
    assert said.startswith(
        "0.40 USD are spent and another call may cost 0.40; --max-cost is 0.7; --resume with a higher"
    )
    more = VlmAdvisor(Dear(), Brief(), SPACE, Transcript(tmp_path), Limits(max_cost=0.9))
    assert more.propose(later()).notes["calls"] == [2]


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"max_calls": 0}, "max_calls is 0; it must be at least 1"),
        ({"max_cost": 0.0}, "max_cost is 0 USD; it must be finite and above 0"),
        ({"max_cost": float("nan")}, "max_cost is nan USD; it must be finite and above 0"),
    ],
)
def test_limits_are_checked(limits, said):
    with pytest.raises(ArgumentError) as caught:
        Limits(**limits)
    assert str(caught.value) == said


def test_another_model_than_the_one_that_was_asked_is_a_warning_once(ask, vlm, tmp_path):
    vlm.script(replies(good(), model="another-model"), then=replies(good(2.0), model="another-model"))
    advisor = ask()
    assert advisor.propose(START).notes["model"] == "another-model"
    advisor.propose(later())
    warnings = [event.text for event in ask.events if event.kind == "warning"]
    assert warnings == ["some-model was asked and another-model answered; the record says which"]
    assert [call["reply"]["model"] for call in calls(tmp_path)] == ["another-model"] * 2


def test_totals_grow_with_the_calls(ask, vlm, tmp_path):
    vlm.script(replies("no", tokens=(100, 10)), replies(good(), tokens=(300, 30)))
    ask().propose(START)
    so_far = totals(Transcript(tmp_path).calls)
    assert (so_far.calls, so_far.failed, so_far.input_tokens, so_far.output_tokens) == (2, 0, 400, 40)
    assert so_far.cost is None
    assert ask.events[-1].totals == so_far


# replay


def test_a_replay_gives_the_same_proposals_without_asking(ask, vlm, tmp_path):
    vlm.script(replies("no"), replies(good()), replies(good(2.0)))
    advisor = ask()
    first, second = advisor.propose(START), advisor.propose(later())
    asked = len(vlm.requests)
    replay = ReplayAdvisor(tmp_path, SPACE)
    assert replay.propose(START).as_dict() == first.as_dict()
    assert replay.propose(later()).as_dict() == second.as_dict()
    assert len(vlm.requests) == asked


def test_a_replay_on_another_processor_is_the_same_run(ask, vlm, tmp_path):
    vlm.script(replies(good()))
    proposal = ask().propose(START)
    here = evaluation(0.5, 0.5, 0.05 * (1 + 1e-14))
    assert ReplayAdvisor(tmp_path, SPACE).propose(Situation(here, (), here)).as_dict() == proposal.as_dict()


def test_a_replay_that_has_come_elsewhere_is_refused(ask, vlm, tmp_path):
    vlm.script(replies(good()))
    ask().propose(START)
    elsewhere = evaluation(0.5, 0.5, 0.07)
    with pytest.raises(AdvisorError, match=r"round 1 of '.*' began at a loss of 50\.000 mm and here it is 70\.000 mm"):
        ReplayAdvisor(tmp_path, SPACE).propose(Situation(elsewhere, (), elsewhere))
    with pytest.raises(AdvisorError, match="end before round 2; a budget up to that run's replays without it"):
        ReplayAdvisor(tmp_path, SPACE).propose(later())


def test_there_must_be_something_to_replay(tmp_path):
    with pytest.raises(ArgumentError, match="has no calls on record, so there is nothing to replay"):
        ReplayAdvisor(tmp_path, SPACE)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text[: len(text) // 2], "can't be read as JSON"),
        (lambda text: text.replace('"format": 1', '"format": 9'), "its format is 9, this version of swim2real reads 1"),
        (lambda text: text.replace('"outcome"', '"income"'), "'outcome' is missing"),
    ],
)
def test_a_damaged_transcript_is_named(ask, vlm, tmp_path, change, said):
    vlm.script(replies(good()))
    ask().propose(START)
    path = tmp_path / "advisor" / "call_0001.json"
    path.write_text(change(path.read_text()))
    message = refusal(ask())
    assert said in message
    assert "call_0001.json" in message

"""The advisor behind a client: a server or a folder of files, what it keeps of its calls, and its replay."""

import json
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from swim2real.advisor.vlm import files
from swim2real.advisor.vlm.advisor import ReplayAdvisor, VlmAdvisor, repair_request
from swim2real.advisor.vlm.client import ModelClient
from swim2real.advisor.vlm.exchange import Attempt, Media, Reply, Request
from swim2real.advisor.vlm.files import FilesClient
from swim2real.advisor.vlm.reply import reply_schema
from swim2real.advisor.vlm.transcript import Transcript, totals
from swim2real.optimizers import (
    BacktrackingLineSearch,
    Candidate,
    Evaluation,
    Proposal,
    Round,
    ScriptedAdvisor,
    Situation,
    Step,
    recorded_advice,
)
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.settings import VlmAccess
from swimbase.errors import AdvisorError, ArgumentError, WaitingForReply
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
_STEP = Step(1.0, evaluation(0.6, 0.6, 0.04))
LATER = Situation(_STEP.evaluation, (Round(Proposal(np.array([0.6, 0.6])), FIRST, (_STEP,), True),), FIRST)


def good(drag: float = 5.0, **others) -> str:
    parameters = {"drag": drag, "arm": 0.02, **others}
    return json.dumps({"diagnosis": "too slow", "reasoning": "less drag", "parameters": parameters})


def brief(situation: Situation, level: int) -> Request:
    """A question with a picture; shorter at the next level."""
    text = f"the loss is {1e3 * situation.incumbent.loss:.1f} mm" + " in short" * level
    return Request("Say what differs.", (text, PICTURE), reply_schema(SPACE), 2000)


@pytest.fixture
def ask(vlm, tmp_path):
    """Makes an advisor that asks the test's server, and keeps what it reported."""

    def make(provider="openai", tries: int = 2, transcript=None, **limits) -> VlmAdvisor:
        access = VlmAccess(vlm.url(provider), timeout=20.0, tries=tries, **limits)
        client = ModelClient(f"{provider}:some-model", access, sleep=lambda seconds: None)
        make.events = []
        return VlmAdvisor(client, brief, SPACE, transcript or Transcript(tmp_path), access, make.events.append)

    return make


def calls(tmp_path) -> list[dict]:
    return [json.loads(path.read_text()) for path in sorted((tmp_path / "advisor").glob("call_*.json"))]


def outcomes(tmp_path) -> list[str]:
    return [call["outcome"] for call in calls(tmp_path)]


def refusal(advisor: VlmAdvisor, situation: Situation = START) -> str:
    with pytest.raises(AdvisorError) as caught:
        advisor.propose(situation)
    return str(caught.value)


def test_a_good_reply_becomes_a_proposal_with_where_it_came_from(ask, vlm, tmp_path):
    text = good(drag=12.0, gravity=1)
    vlm.script(replies(text, tokens=(900, 80), thinking=20))
    proposal = ask().propose(START)
    assert SPACE.to_values(proposal.point) == pytest.approx({"drag": 10.0, "arm": 0.02})
    assert (proposal.diagnosis, proposal.reasoning) == ("too slow", "less drag")
    seconds = proposal.notes["seconds"]
    assert 0 < seconds < 20
    assert proposal.notes == {
        "advisor": "openai:some-model", "model": "some-model", "calls": [1], "input_tokens": 900, "output_tokens": 100,
        "cost": None, "seconds": seconds, "ignored": ["gravity"], "clipped": {"drag": 12.0},
    }  # fmt: skip
    json.dumps(proposal.as_dict(), allow_nan=False)
    (call,) = calls(tmp_path)
    assert (call["outcome"], call["reply"]["text"]) == ("used", text)
    assert call["incumbent"] == {"point": [0.5, 0.5], "loss": 0.05}
    asked, picture = call["request"]["parts"]
    assert (asked, picture["sha256"]) == ("the loss is 50.0 mm", PICTURE.sha256)
    assert (tmp_path / "advisor" / picture["media"]).read_bytes() == PICTURE.data
    assert "not a real one" not in json.dumps(call)


def test_a_round_that_is_on_record_is_not_paid_for_twice(ask, vlm, tmp_path):
    def propose(loss: float) -> dict:
        here = evaluation(0.5, 0.5, loss)
        advisor = ReplayAdvisor(Transcript(tmp_path), SPACE, then=ask())
        return advisor.propose(Situation(here, (), here)).as_dict()

    vlm.script(replies(good()), replies(good(drag=3.0)))
    first = propose(0.05)
    assert propose(0.05) == first
    assert len(vlm.requests) == 1
    assert propose(0.06) != first


def test_a_list_is_measured_parameter_by_parameter_then_asked_again(ask, vlm, tmp_path):
    """From the best point of its time, resumed anywhere, and once paid for."""
    vlm.script(replies(json.dumps({"diagnosis": "unsure", "measure": ["arm", "drag"], "keep": True})), replies(good()))

    def search(advisor):
        """The candidates; what is measured first is better than the first point."""
        optimizer, seen = BacktrackingLineSearch(advisor, np.array([0.5, 0.6])), []
        for loss in (0.05, 0.04, 0.06, 0.03):
            seen.append(optimizer.ask())
            optimizer.tell(Evaluation(seen[-1], loss))
        return seen

    transcripts = [Transcript(tmp_path) for _ in range(2)]
    runs = [search(ReplayAdvisor(one, SPACE, then=ask(transcript=one))) for one in transcripts]
    points = [one.point for one in runs[0]]
    np.testing.assert_allclose(points[:3], [[0.5, 0.6], [0.5, 0.5], [0.6, 0.5]])
    assert [one.note.get("parameter") for one in runs[0]] == [None, "arm", "drag", None]
    np.testing.assert_array_equal(points, [one.point for one in runs[1]])
    assert [one.note for one in runs[0]] == [one.note for one in runs[1]]
    assert len(vlm.requests) == 2
    recorded = [{"note": one.note, "point": list(one.point)} for one in runs[0][1:2]]  # it was stopped within the list
    halfway = ScriptedAdvisor(recorded_advice(recorded), then=ReplayAdvisor(Transcript(tmp_path), SPACE))
    np.testing.assert_array_equal(points, [one.point for one in search(halfway)])


SAME = {name: float(f"{value:.4g}") for name, value in SPACE.to_values([0.5, 0.5]).items()}


def test_measures_stay_at_the_current_point_and_say_their_way(ask, vlm, tmp_path):
    """Both from the first point, though what is measured first is better; the proposal begins there as well."""
    vlm.script(replies(json.dumps({"measure": ["arm +0.2", "drag -0.05"]})), replies(good()))
    transcript = Transcript(tmp_path)
    advisor = ReplayAdvisor(transcript, SPACE, then=ask(transcript=transcript))
    optimizer, seen = BacktrackingLineSearch(advisor, np.array([0.5, 0.6])), []
    for loss in (0.05, 0.04, 0.06, 0.045):
        seen.append(optimizer.ask())
        optimizer.tell(Evaluation(seen[-1], loss))
    np.testing.assert_allclose([one.point for one in seen[:3]], [[0.5, 0.6], [0.5, 0.8], [0.45, 0.6]])
    assert optimizer.rounds[0].incumbent.loss == 0.05


@pytest.mark.parametrize(("provider", "text", "problem"), [
    ("google", "The tail bends too far.", "the reply holds no JSON object"),
    ("anthropic", '{"parameters": {"drag": NaN}}', "'drag' is NaN; it must be a finite number from 0 to 10"),
    ("openai", good()[:-9], "the reply is not valid JSON"),
    ("openai", json.dumps({"parameters": SAME}), "no parameter changes"),
])  # fmt: skip
def test_a_bad_reply_is_mended_by_a_question_without_media(ask, vlm, tmp_path, provider, text, problem):
    vlm.script(replies(text, tokens=(100, 10)), replies(good(), tokens=(300, 30)))
    proposal = ask(provider=provider).propose(START)
    assert proposal.notes["calls"] == [1, 2]
    first, second = vlm.requests
    assert len(first.parts) == 3  # text, label, picture
    assert all("text" in part for part in second.parts)
    for part in (problem, text[:40], "the loss is 50.0 mm"):
        assert part in second.text
    assert outcomes(tmp_path) == ["unusable", "used"]
    assert [event.kind for event in ask.events] == ["asks", "received", "unusable", "asks", "received", "answered"]
    so_far = totals(Transcript(tmp_path).calls)
    assert (so_far.calls, so_far.failed, so_far.input_tokens, so_far.output_tokens) == (2, 0, 400, 40)
    assert ask.events[-1].totals == so_far


@pytest.mark.parametrize(
    ("text", "finish", "words", "tokens"),
    [
        ('{"diagnosis": "the tail', "length", ("cut off after", "answer more briefly"), [2000, 4000]),
        ("I can't look at fish.", "refusal", ("the reply declined to answer",), [2000, 2000]),
        (good() + "\n\nOn the other", "length", (), [2000]),  # whole but for its end
    ],
)
def test_a_reply_that_ends_badly_is_asked_for_again_where_it_must_be(ask, vlm, text, finish, words, tokens):
    vlm.script(replies(text, finish), replies(good()))
    ask(provider="anthropic").propose(START)
    assert [asked.max_tokens for asked in vlm.requests] == tokens
    assert [word for word in words if word not in vlm.requests[1].text] == []


def test_after_two_repairs_the_round_has_failed_and_is_asked_anew(ask, vlm, tmp_path):
    vlm.script(*[replies("no")] * 3, replies(good()))
    assert ask().propose(START).notes["calls"] == [1, 2, 3, 4]
    assert len(vlm.requests[3].parts) == 4  # the picture again, and what went wrong
    assert "An earlier answer to this could not be used: the reply holds no JSON object" in vlm.requests[3].text


def test_three_failed_rounds_in_a_row_end_the_run_with_a_sentence(ask, vlm, tmp_path):
    vlm.script(then=refuses(503, "the model is overloaded", "UNAVAILABLE"))
    said = refusal(ask(provider="google"))
    for part in ("round 1: 3 times in a row", "google:some-model", "the model is overloaded", "--resume asks again"):
        assert part in said
    assert len(vlm.requests) == 6
    assert [(call["outcome"], len(call["attempts"])) for call in calls(tmp_path)] == [("failed", 2)] * 3
    assert [event.kind for event in ask.events] == ["asks", "waits", "failed"] * 3
    vlm.script(drops, replies(good()))
    assert ask(provider="google").propose(START).notes["calls"] == [1, 2, 3, 4]  # and it goes on
    assert [bool(attempt["error"]) for attempt in calls(tmp_path)[3]["attempts"]] == [True, False]


def test_a_context_that_is_too_long_is_shortened_once(ask, vlm, tmp_path):
    too_long = refuses(400, "This model's maximum context length is 8192 tokens", "context_length_exceeded")
    vlm.script(too_long, replies(good()))
    assert ask().propose(START).notes["calls"] == [1, 2]
    assert ["in short" in asked.text for asked in vlm.requests] == [False, True]
    vlm.script(then=too_long)
    assert "maximum context length" in refusal(ask(), LATER)
    assert outcomes(tmp_path)[2:] == ["failed"] * 6  # each of three rounds, twice


def test_a_safety_filter_fails_the_round_and_a_wrong_setting_the_run(ask, vlm, tmp_path):
    blocked = sends({"promptFeedback": {"blockReason": "PROHIBITED_CONTENT"}, "modelVersion": "some-model"})
    vlm.script(blocked, replies(good()))
    ask(provider="google").propose(START)
    assert outcomes(tmp_path) == ["failed", "used"]
    assert "PROHIBITED_CONTENT" in calls(tmp_path)[0]["problem"]
    asked = len(vlm.requests)
    vlm.script(then=refuses(404, "no such model or key", "not_found"))
    assert "openai:some-model' can't be asked" in refusal(ask(), LATER)
    assert len(vlm.requests) == asked + 1


def test_calls_are_limited_over_all_sittings(ask, vlm):
    vlm.script(*[replies("no")] * 2)
    said = refusal(ask(max_calls=2))
    assert "2 calls were made and --max-calls is 2; --resume" in said
    assert refusal(ask(max_calls=2)) == said
    vlm.script(replies(good()))
    assert ask(max_calls=3).propose(START).notes["calls"] == [1, 2, 3]


class Dear:
    """A client whose every reply costs 40 cents."""

    name, takes_video, price_known = "shop:dear", False, True

    def call(self, request, on_attempt=None) -> Reply:
        return Reply(good(), "stop", "dear", 100, 10, 0.4, attempts=(Attempt(1.0),))


def test_the_cost_is_limited_before_it_is_spent(ask, tmp_path):
    advisor = VlmAdvisor(Dear(), brief, SPACE, Transcript(tmp_path), VlmAccess(max_cost=0.7))
    assert advisor.propose(START).notes["cost"] == 0.4
    assert "0.40 USD are spent and another call may cost 0.40; --max-cost is 0.7; --resume" in refusal(advisor, LATER)
    more = VlmAdvisor(Dear(), brief, SPACE, Transcript(tmp_path), VlmAccess(max_cost=0.9))
    assert more.propose(LATER).notes["calls"] == [2]
    with pytest.raises(ArgumentError, match="max_cost is 2 USD, but the price of openai:some-model isn't known; limit"):
        ask(max_cost=2.0)


def test_a_replay_gives_the_same_proposals_without_asking(ask, vlm, tmp_path):
    vlm.script(replies("no"), replies(good()), replies(good(2.0)))
    advisor = ask()
    first, second = advisor.propose(START), advisor.propose(LATER)
    replay = ReplayAdvisor(Transcript(tmp_path), SPACE)
    here = evaluation(0.5, 0.5, 0.05 * (1 + 1e-14))  # on another processor
    for situation, proposal in ((START, first), (LATER, second), (Situation(here, (), here), first)):
        assert replay.propose(situation).as_dict() == proposal.as_dict()
    assert len(vlm.requests) == 3


def test_a_replay_that_has_come_elsewhere_is_refused(ask, vlm, tmp_path):
    with pytest.raises(ArgumentError, match="no calls on record"):
        ReplayAdvisor(Transcript(tmp_path), SPACE)
    vlm.script(replies(good()))
    ask().propose(START)
    elsewhere = evaluation(0.5, 0.5, 0.07)
    for situation, said in (
        (Situation(elsewhere, (), elsewhere), "50.000 mm and here it is 70.000"),
        (LATER, "round 2"),
    ):
        with pytest.raises(AdvisorError, match=said):
            ReplayAdvisor(Transcript(tmp_path), SPACE).propose(situation)


@pytest.mark.parametrize(("change", "said"), [
    (lambda text: text[: len(text) // 2], "can't be read as JSON"),
    (lambda text: text.replace('"format": 1', '"format": 9'), "'format' is 9; it must be 1"),
    (lambda text: text.replace('"outcome"', '"income"'), "'outcome' is missing"),
    (lambda text: text.replace('"media/', '"../media/'), "it names media outside of the transcript"),
])  # fmt: skip
def test_a_damaged_transcript_is_named(ask, tmp_path, change, said):
    VlmAdvisor(Dear(), brief, SPACE, Transcript(tmp_path)).propose(START)
    path = tmp_path / "advisor" / "call_0001.json"
    path.write_text(change(path.read_text()))
    message = refusal(ask())
    assert said in message
    assert "call_0001.json" in message


def test_a_reply_with_a_nul_or_half_a_character_is_read_again(tmp_path):
    class Odd(Dear):
        def call(self, request, on_attempt=None) -> Reply:
            text = good().replace("too slow", r"a\u0000 ü 鱼") + "\0 \ud800"
            return replace(super().call(request), text=text, model="model\0")

    proposal = VlmAdvisor(Odd(), brief, SPACE, Transcript(tmp_path)).propose(START)
    (call,) = Transcript(tmp_path).calls
    assert call.reply.text.endswith("\ufffd ?")
    assert call.reply.model == "model\ufffd"
    assert ReplayAdvisor(Transcript(tmp_path), SPACE).propose(START).as_dict() == proposal.as_dict()


# files

FILM = Media("what is filmed", "video/mp4", b"a film", 12.0)
QUESTION = Request("Say what differs.", ("the loss is 50 mm", PICTURE, FILM), {"type": "object"}, 2000, round=3)
REPAIR = repair_request(QUESTION, "drag: 3", "the reply holds no JSON object", 2000)


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "advisor" / "round_003"


def test_the_question_is_a_page_with_its_pictures_and_films(tmp_path, folder):
    with pytest.raises(WaitingForReply) as waits:
        FilesClient(tmp_path, {"type": "object"}, once=True).call(QUESTION)
    for part in ("round 3 waits", f"'{folder / 'briefing.md'}'", f"'{folder / 'reply.json'}'", "--resume goes on"):
        assert part in str(waits.value)
    assert waits.value.exit_code == 0
    page = (folder / "briefing.md").read_text()
    for part in ("the loss is 50 mm", "what is seen\n\n![1.png](1.png)", "what is filmed\n\n[2.mp4](2.mp4)"):
        assert part in page
    assert (folder / "1.png").read_bytes() == PICTURE.data
    assert (folder / "2.mp4").read_bytes() == b"a film"
    assert json.loads((folder / "reply.schema.json").read_text()) == {"type": "object"}
    assert not list(folder.glob("*.part"))


def test_a_reply_that_is_there_is_taken_at_once_and_what_is_wrong_with_it_is_explained(tmp_path, folder):
    client = FilesClient(tmp_path, {}, once=True)
    folder.mkdir(parents=True)
    (folder / "reply.json").write_bytes(b"\xff\xfe{\x00}\x00")  # no text, but read all the same
    assert client.call(QUESTION).text
    with pytest.raises(WaitingForReply, match=r"'.*reply\.problem\.txt' says what is wrong with '.*reply\.json'; then"):
        client.call(REPAIR)


def test_it_waits_for_a_reply_that_is_whole_and_then_for_a_better_one(tmp_path, folder, monkeypatch):
    monkeypatch.setattr(files, "_POLL", 0.02)
    waits, problems = [], []
    client = FilesClient(tmp_path, {}, on_wait=lambda text, number: waits.append((text, number)))
    folder.mkdir(parents=True)

    def write_slowly():
        for text in ("", " ", "drag:", "drag: 3"):
            (folder / "reply.json").write_text(text)
            time.sleep(0.01)

    def mend():
        problems.append((folder / "reply.problem.txt").read_text())
        (folder / "reply.json").write_text('{"parameters": {"drag": 3}}')

    timers = [threading.Timer(0.1, write_slowly), threading.Timer(0.5, mend)]
    timers[0].start()
    assert client.call(QUESTION).text == "drag: 3"
    assert waits == [(f"'{folder / 'briefing.md'}' waits for '{folder / 'reply.json'}'", 3)]
    timers[1].start()
    assert client.call(REPAIR).text == '{"parameters": {"drag": 3}}'
    assert problems == ["the reply holds no JSON object\n"]
    assert not (folder / "reply.problem.txt").exists()
    for timer in timers:
        timer.join()

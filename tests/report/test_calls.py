"""The calls of an advisor on the page: sums, table, what was put right, what was shown, and what is damaged."""

import base64
import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from test_report import EVIL, ROBOT, Run, page_of, searched, visible

from browser import open_to_scripts, opened
from swim2real.advisor.vlm.exchange import Attempt, Media, Reply, Request
from swim2real.advisor.vlm.transcript import Call, Incumbent, Transcript
from swim2real.cli import main
from swim2real.report.page import content
from swim2real.report.run import read_run
from swim2real.report.units import count, dollars, duration, listed, shortened
from swim2real.robots.fish import FISH
from vlm_server import replies

INCUMBENT = Incumbent((0.5,) * 3, 0.1)
# a picture of one pixel, so that a browser shows it
PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


def picture(name: str, padding: int = 0) -> Media:
    return Media(f"Trial {name}, 1.00 Hz: simulated over real", "image/png", PIXEL + name.encode() + bytes(padding))


def film(name: str) -> Media:
    return Media(f"Trial {name}: at true speed", "video/mp4", f"film of {name}".encode(), 12.0)


def notes(calls: Sequence[int], model: str | None = "some-model", **more: object) -> dict[str, object]:
    """As `proposal_of` leaves them."""
    return {
        "advisor": "openai:some-model", "model": model, "calls": list(calls), "input_tokens": 32000,
        "output_tokens": 1500, "cost": 0.25, "seconds": 75.0, **more,
    }  # fmt: skip


class VlmRun(Run):
    """A run whose advisor was a VLM; the transcript is written as the advisor writes it."""

    advisor = "openai:some-model"

    def ask(
        self, number: int, outcome: str = "used", *media: Media, model: str | None = "some-model",
        cost: float | None = 0.125, problem: str | None = None, repair: bool = False,
        attempts: tuple[Attempt, ...] = (Attempt(12.0),),
    ) -> Call:  # fmt: skip
        reply = None if outcome == "failed" else Reply("{}", "stop", model, 16000, 750, cost, attempts=attempts)
        call = Call(0, number, repair, self.advisor, outcome, problem, INCUMBENT, reply, attempts)
        request = Request("Look.", ("Text", *media), {}, 1000, number, "mend it" if repair else "")
        return Transcript(self.path).write(call, request)

    def tell(self, number: int, miss: float, **more: object) -> None:
        words = {"diagnosis": f"Seen in round {number}.", "reasoning": "Drag.", "point": [0.9, 0.2, 0.9]}
        self.add(
            miss, (0.5, 0.5 - 0.02 * number, 0.5), round=number, step_size=1.0, proposal={**words, "notes": more}
        )  # fmt: skip

    @property
    def transcript(self) -> Path:
        return self.path / "advisor"


@pytest.fixture
def run(tmp_path: Path) -> VlmRun:
    """Three accepted rounds and a rejected one; a repair in the second and a failure in the third."""
    found = VlmRun(tmp_path / "run")
    found.add(0.3, (0.5, 0.5, 0.5))
    found.ask(1, "used", picture("a"), picture("b"), film("a"))
    found.tell(1, 0.2, **notes([1]))
    found.ask(2, "unusable", picture("c"), problem="the reply holds no JSON object")
    found.ask(2, "used", repair=True, attempts=(Attempt(2.0, "503: overloaded", 4.0), Attempt(30.0)))
    mended = {"clipped": {"arm": 0.2, "drag": -3.0}, "ignored": ["fin"], "missing": ["stiffness"], "remarks": ["Hm."]}
    found.tell(2, 0.15, **notes([2, 3], **mended))
    found.ask(3, "failed", picture("d"), problem="no reply in 2 attempts", attempts=(Attempt(1.0, "500", 1.0),) * 2)
    found.ask(3, "used", picture("e"), picture("f"), model="other-model-9", cost=None)
    found.tell(3, 0.1, **notes([4, 5], "other-model-9"))
    found.ask(4, "used", picture("g"), model="some-model-2025-12-11")
    found.tell(4, 0.25, **notes([6]))
    return found


def rounds_of(run: Run) -> list:
    return list(content(read_run(run.path, ROBOT))["rounds"])


def markup(page: str) -> str:
    return re.sub(r"<(script|style)\b.*?</\1>", "", page, flags=re.DOTALL)


def test_the_calls_are_counted_and_listed(run: VlmRun) -> None:
    shown = visible(page_of(run))
    assert (
        "Calls of the advisor 6 calls: 1 failed, 1 with a reply that wasn&#39;t usable and 1 repair "
        "80,000 tokens in 3,750 tokens out 0.50 USD spent, and 1 reply of unknown price 1 min 28 s waited "
        "some-model answered 3 times other-model-9 answered 1 time some-model-2025-12-11 answered 1 time"
    ) in shown
    section = content(read_run(run.path, ROBOT))["calls"]
    assert [(row.number, row.round, row.kind, row.outcome) for row in section.rows] == [
        ("1", "1", "question", "used"), ("2", "2", "question", "not usable"), ("3", "2", "repair", "used"),
        ("4", "3", "question", "failed"), ("5", "3", "question", "used"), ("6", "4", "question", "used"),
    ]  # fmt: skip
    third, fourth, fifth = section.rows[2:5]
    assert (third.input_tokens, third.output_tokens, third.cost) == ("16,000", "750", "0.1250")
    assert (third.seconds, third.attempts) == ("36.0", "2")
    assert third.problems == ("attempt 1: 503: overloaded, then waited 4.0 s",)
    assert (fourth.model, fourth.input_tokens, fourth.cost) == ("–", "–", "–")
    assert fourth.problems[0] == "no reply in 2 attempts"
    assert fifth.cost == "–"


def test_another_model_than_the_one_asked_is_a_warning(run: VlmRun) -> None:
    section = content(read_run(run.path, ROBOT))["calls"]
    assert section.warnings == (
        "Another model answered: some-model was asked, and other-model-9 answered call 5. The result is not that of "
        "some-model alone.",
    )
    assert [row.other for row in section.rows] == [False, False, False, False, True, False]  # a date is no difference
    assert [one.consultation.instead for one in rounds_of(run)] == ["", "", "some-model", ""]
    assert "other-model-9 (some-model was asked)" in visible(page_of(run))


def test_nothing_is_claimed_about_what_nobody_knows(tmp_path: Path) -> None:
    run = VlmRun(tmp_path / "run")
    run.add(0.3, (0.5, 0.5, 0.5))
    run.advisor = "files"
    reply = Reply("{}", "stop", None, None, None, None, attempts=(Attempt(7300.0),))
    call = Call(0, 1, False, "files", "used", None, INCUMBENT, reply, reply.attempts)
    Transcript(run.path).write(call, Request("Look.", ("Text",), {}, 1000))
    shown = visible(page_of(run))
    assert "1 call: none failed and no repairs tokens not counted price not known 2 h 1 min waited" in shown
    assert "was asked" not in shown


def test_rounds_tell_what_they_took_and_what_was_put_right(run: VlmRun) -> None:
    first, second, *_ = rounds_of(run)
    assert first.consultation.took == ("call 1", "32,000 tokens in, 1,500 out", "0.25 USD", "1 min 15 s")
    assert first.consultation.mended == ()
    assert first.notes == ()
    assert second.consultation.took[0] == "calls 2 and 3"
    assert second.consultation.mended == (
        ("clipped", "arm 0.2 → 0.06 m"),
        ("clipped", "drag −3 → 0"),
        ("ignored", "fin (no parameter of this name)"),
        ("missing", "stiffness (kept as before)"),
        ("remark", "Hm."),
    )
    assert "clipped: arm 0.2 → 0.06 m" in visible(page_of(run))


def test_odd_notes_are_left_out(run: VlmRun) -> None:
    odd = {
        "clipped": ["arm"], "ignored": "fin", "missing": {"a": 1}, "remarks": None, "calls": "many", "seconds": "x",
        "cost": "0.5", "input_tokens": None, "output_tokens": [], "own": 0.5,
    }  # fmt: skip
    run.tell(5, 0.2, **(notes([6]) | odd))
    last = rounds_of(run)[-1]
    assert last.consultation.mended == last.consultation.took == ()
    assert last.notes == (("own", "0.5"),)
    page_of(run)


def test_pictures_of_the_first_and_the_last_accepted_round_are_on_the_page(run: VlmRun) -> None:
    first, second, third, fourth = (one.consultation for one in rounds_of(run))
    assert [one.label[:7] for one in first.pictures] == ["Trial a", "Trial b"]
    assert [one.label[:7] for one in third.pictures] == ["Trial e", "Trial f"]
    assert first.pictures[0].brief == "Trial a, 1.00 Hz"
    assert second.pictures == fourth.pictures == ()
    assert [one.label[:7] for one in second.files] == ["Trial c"]  # of the question, not of its repair
    page = markup(page_of(run))
    found = [base64.b64decode(data) for data in re.findall(r'<img src="data:image/png;base64,([^"]+)"', page)]
    assert found == [picture(name).data for name in "abef"]
    for one in (*first.files, *second.files, *fourth.files):
        assert f'<a href="{one.path}">{one.path}</a>' in page
        assert (run.path / one.path).is_file()
    assert [one.path[-4:] for one in first.files] == [".mp4"]


def test_the_page_with_calls_needs_no_network(run: VlmRun) -> None:
    page = page_of(run)
    tags = re.findall(r"<[^>]+>", markup(page))
    assert not [tag for tag in tags if re.search(r"^<(link|iframe|object|base|video)\b", tag)]
    assert all(source.startswith("data:image/") for source in re.findall(r'\ssrc="([^"]*)"', markup(page)))
    assert all(re.match(r"#|advisor/media/\w+\.\w+$", target) for target in re.findall(r'href="([^"]*)"', markup(page)))
    assert page == page_of(run)


def test_large_pictures_are_named_instead(tmp_path: Path) -> None:
    run = VlmRun(tmp_path / "run")
    run.add(0.3, (0.5, 0.5, 0.5))
    for number in (1, 2):
        run.ask(number, "used", *(picture(f"{name}{number}", 220_000) for name in "abcd"))
        run.tell(number, 0.3 - 0.05 * number, **notes([number]))
    for one in rounds_of(run):
        assert (len(one.consultation.pictures), len(one.consultation.files)) == (2, 2)
    assert len(page_of(run)) < 7e6


def test_a_file_that_is_not_what_was_shown_is_not_on_the_page(run: VlmRun) -> None:
    first = rounds_of(run)[0].consultation
    (run.path / first.pictures[0].path).write_bytes(PIXEL)
    (run.path / first.pictures[1].path).unlink()
    (run.path / first.files[0].path).unlink()
    again = rounds_of(run)[0].consultation
    assert again.pictures == ()
    assert [one.problem for one in again.files] == [
        "the file has changed since it was shown", "the file is missing", "the file is missing",
    ]  # fmt: skip
    assert "the file has changed since it was shown" in visible(page_of(run))


def test_a_round_without_a_reply_is_said_to_be_one(run: VlmRun) -> None:
    for _ in range(3):
        run.ask(5, "failed", picture("h"), problem="no reply in 6 attempts")
    assert (
        "Round 5 got no usable reply, so nothing was proposed and nothing simulated; --resume asks again."
    ) in visible(page_of(run))


def test_what_a_model_wrote_is_text(tmp_path: Path) -> None:
    run = VlmRun(tmp_path / "run")
    run.add(0.3, (0.5, 0.5, 0.5))
    shown = Media(f"Trial {EVIL}", "image/png", PIXEL)
    # no such model was asked, so it is named in a warning too
    run.ask(1, "used", shown, Media(EVIL, "video/mp4", b"film"), model=EVIL, problem=EVIL,
            attempts=(Attempt(1.0, f"500: {EVIL}", 1.0), Attempt(1.0)))  # fmt: skip
    told = {"ignored": [EVIL], "missing": [f'" onload="{EVIL}'], "remarks": [EVIL], EVIL: EVIL}
    run.tell(1, 0.2, **notes([1], EVIL, **told))
    page = page_of(run)
    assert "<script>alert" not in page
    assert re.findall(r"<img (?!src=\"data:image/png;base64,)", markup(page)) == []
    assert re.findall(r"<[^>]*\son\w+\s*=", re.sub(r'"[^"]*"', '""', markup(page))) == []
    assert page.count("&lt;script&gt;alert(&#39;no&#39;)") >= 9


BROKEN = "The transcript of the advisor&#39;s calls can&#39;t be read: "


def spoil(run: VlmRun, **changes: object) -> None:
    path = run.transcript / "call_0002.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (lambda run: (run.transcript / "call_0002.json").write_text("{"), "can&#39;t be read as JSON: Expecting"),
        (lambda run: (run.transcript / "call_0002.json").write_text("[" * 100_000), "nested too deeply"),
        (lambda run: (run.transcript / "call_0002.json").write_bytes(b"\xff"), "advisor/call_0002.json&#39; can&#39;t"),
        (lambda run: spoil(run, format=2), "this version of swim2real reads 1"),
        (lambda run: spoil(run, round="two"), "&#39;round&#39; is &#34;two&#34;; it must be a whole number"),
        (lambda run: spoil(run, number=10**15), "&#39;number&#39; is 1000000000000000; it must be below"),
        (lambda run: spoil(run, attempts=[{"seconds": None}]), "&#39;attempts[0].seconds&#39; is null"),
        (lambda run: spoil(run, request={}), "&#39;request.parts&#39; is missing"),
        (lambda run: spoil(run, request={"parts": [{"media": "../../key.png", "label": "", "media_type": "image/png",
                                                    "sha256": ""}]}), "it names media outside of the transcript"),
    ],
    ids=["cut", "nested", "binary", "format", "kind", "number", "attempts", "request", "path"],
)  # fmt: skip
def test_a_damaged_transcript_is_a_sentence(run: VlmRun, damage, sentence: str) -> None:
    damage(run)
    shown = visible(page_of(run))
    assert BROKEN in shown
    assert sentence in shown
    assert str(run.path) not in shown
    for words in ("Seen in round 2.", "clipped: arm 0.2 → 0.06 m", "calls 2 and 3", "4 rounds were accepted"):
        assert words in shown
    assert '<table class="calls' not in page_of(run)


def test_a_missing_transcript_is_a_sentence(run: VlmRun) -> None:
    shutil.rmtree(run.transcript)
    shown = visible(page_of(run))
    assert (
        "their transcript, the folder &#39;advisor&#39; of the run, is missing: what they took and what was shown "
        "can&#39;t be told."
    ) in shown
    assert "Seen in round 2." in shown


def test_missing_calls_are_said(run: VlmRun) -> None:
    (run.transcript / "call_0002.json").unlink()
    assert "Call 2 is missing in the transcript" in visible(page_of(run))
    (run.transcript / "call_0006.json").unlink()  # the last one, which only the record tells of
    shown = visible(page_of(run))
    assert "Calls 2 and 6 are missing in the transcript" in shown
    assert "the sums below are without them" in shown
    assert "4 calls: 1 failed" in shown


def test_a_page_without_calls_has_no_place_for_them(tmp_path: Path) -> None:
    run = searched(tmp_path / "run")
    run.conclude(0.1)
    body = page_of(run).partition("<body>")[2]
    for mark in ("Calls", 'id="calls"', 'class="pictures"', 'class="notes took"', "it saw"):
        assert mark not in body, mark


def test_a_replay_has_no_calls_of_its_own(run: VlmRun) -> None:
    shutil.rmtree(run.transcript)
    path = run.path / "settings.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"advisor": "replay:elsewhere"}))
    replayed = page_of(run)
    assert 'id="calls"' not in replayed
    assert "input_tokens: 32000" in visible(replayed)


@pytest.mark.slow
def test_a_real_run_shows_its_calls(vlm, pool_folder: Path, tmp_path: Path) -> None:
    vlm.script(replies("no"), then=replies('{"diagnosis": "<b>slow</b>", "parameters": {"motor_arm_length": 0.2}}'))
    words = ["--advisor", "openai:m-1", "--base-url", vlm.url("openai"), "--detail", "low", "--budget", "2", "--quiet"]
    with pytest.raises(SystemExit) as end:
        main(["calibrate", str(pool_folder), "--out", str(tmp_path / "run"), *words])
    assert end.value.code == 0
    page = (tmp_path / "run" / "report.html").read_text()
    shown = visible(page)
    assert "2 calls: none failed, 1 with a reply that wasn&#39;t usable and 1 repair 2,000 tokens in" in shown
    assert "price not known" in shown
    assert f"clipped: motor_arm_length 0.2 → {FISH.space['motor_arm_length'].upper:g} m" in shown
    assert "&lt;b&gt;slow" in page
    assert len(page) < 1e6


@pytest.mark.slow
def test_a_browser_shows_pictures_and_closes_them(run: VlmRun, tmp_path: Path) -> None:
    page = open_to_scripts(page_of(run))
    look = (
        "<script>addEventListener('load', () => { const all = [...document.querySelectorAll('.picture')];"
        "all.forEach((one) => (one.open = true)); const fixed = getComputedStyle(all[0].firstElementChild).position;"
        "dispatchEvent(new KeyboardEvent('keydown', {key: 'Escape'}));"
        "document.title = [fixed, all.filter((one) => one.open).length,"
        "...all.map((one) => one.querySelector('img').naturalWidth)].join(' '); });</script></body>"
    )
    (tmp_path / "look.html").write_text(page.replace("</body>", look))
    shown, told = opened(tmp_path / "look.html")
    assert "CONSOLE" not in told, told[-2000:]
    assert "<title>fixed 0 1 1 1 1</title>" in shown


def test_amounts_for_a_person() -> None:
    assert count(1234567) == "1,234,567"
    assert count(None) == "–"
    assert [dollars(value) for value in (0.0, 0.0713, 0.1, 1234.5)] == [
        "0.0000 USD", "0.0713 USD", "0.10 USD", "1,234.50 USD",
    ]  # fmt: skip
    assert [duration(value) for value in (0.0, 9.96, 59.4, 59.6, 3599.6, 7300)] == [
        "0.0 s", "10.0 s", "59 s", "1 min 0 s", "1 h 0 min", "2 h 1 min",
    ]  # fmt: skip
    assert [listed(names) for names in ([], [1], [1, 2], [1, 2, 3])] == ["", "1", "1 and 2", "1, 2 and 3"]
    assert listed("abcd", 2) == "a, b and 2 more"
    assert shortened("abcdef", 4) == "abc…"
    assert shortened("abcd", 4) == "abcd"

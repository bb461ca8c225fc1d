"""The calls of an advisor on the page: sums, table, what was put right, what was shown, and what is damaged."""

import base64
import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from made_pages import Run, missing, page_of, seen_by, shown_of, visible

from swim2real.advisor.vlm.exchange import Attempt, Media, Reply, Request
from swim2real.advisor.vlm.transcript import Call, Incumbent, Transcript

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
        attempts: tuple[Attempt, ...] = (Attempt(12.0),), tokens: tuple[int | None, int | None] = (16000, 750),
    ) -> None:  # fmt: skip
        reply = None if outcome == "failed" else Reply("{}", "stop", model, *tokens, cost, attempts=attempts)
        call = Call(0, number, repair, self.advisor, outcome, problem, INCUMBENT, reply, attempts)
        request = Request("Look.", ("Text", *media), {}, 1000, number, "mend it" if repair else "")
        Transcript(self.path).write(call, request)

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


def test_the_calls_are_counted_and_listed_and_another_model_is_a_warning(run: VlmRun) -> None:
    assert (
        "Calls of the advisor 6 calls: 1 failed, 1 with a reply that wasn&#39;t usable and 1 repair "
        "80,000 tokens in 3,750 tokens out 0.50 USD spent, and 1 reply of unknown price 1 min 28 s waited "
        "some-model answered 3 times other-model-9 answered 1 time some-model-2025-12-11 answered 1 time"
    ) in visible(page_of(run))
    rows = re.findall(r"<tbody>(.*?)</tbody>", page_of(run).partition('<table class="calls')[2], flags=re.DOTALL)
    assert [" ".join(visible(row).split()) for row in rows[:6]] == [
        "Call 1 1 question used some-model 16,000 750 0.1250 12.0 1",
        "Call 2 2 question not usable some-model 16,000 750 0.1250 12.0 1 the reply holds no JSON object",
        "Call 3 2 repair used some-model 16,000 750 0.1250 36.0 2 attempt 1: 503: overloaded, then waited 4.0 s",
        "Call 4 3 question failed – – – – 4.0 2 no reply in 2 attempts attempt 1: 500, then waited 1.0 s",
        "Call 5 3 question used other-model-9 not the one asked 16,000 750 – 12.0 1",
        "Call 6 4 question used some-model-2025-12-11 16,000 750 0.1250 12.0 1",
    ]
    section = shown_of(run).calls
    (warning,) = section.warnings
    assert missing(("some-model was asked", "other-model-9 answered call 5"), warning) == []
    assert [row.is_other for row in section.rows] == [False] * 4 + [True, False]
    assert [one.consultation.instead for one in shown_of(run).rounds] == ["", "", "some-model", ""]


def test_rounds_tell_what_they_took_and_what_was_put_right(run: VlmRun) -> None:
    run.tell(5, 0.2, **(notes([6]) | {
        "clipped": ["arm"], "ignored": "fin", "missing": {"a": 1}, "remarks": None, "calls": "many", "seconds": "x",
        "cost": "0.5", "input_tokens": None, "output_tokens": [], "own": 0.5,
    }))  # fmt: skip
    first, second, *_, odd = shown_of(run).rounds
    assert first.consultation.took == ("call 1", "32,000 tokens in, 1,500 out", "0.25 USD", "1 min 15 s")
    assert first.consultation.mended == first.notes == ()
    assert second.consultation.took[0] == "calls 2 and 3"
    assert second.consultation.mended == (
        ("clipped", "arm 0.2 → 0.06 m"),
        ("clipped", "drag −3 → 0"),
        ("ignored", "fin (no parameter of this name)"),
        ("missing", "stiffness (kept as before)"),
        ("remark", "Hm."),
    )
    assert odd.consultation.mended == odd.consultation.took == ()
    assert odd.notes == (("own", "0.5"),)
    assert "clipped: arm 0.2 → 0.06 m" in visible(page_of(run))


def test_pictures_of_the_first_and_the_last_accepted_round_are_on_the_page(run: VlmRun) -> None:
    first, second, third, fourth = (one.consultation for one in shown_of(run).rounds)
    assert [one.label[:7] for one in first.pictures] == ["Trial a", "Trial b"]
    assert [one.label[:7] for one in third.pictures] == ["Trial e", "Trial f"]
    assert first.pictures[0].brief == "Trial a, 1.00 Hz"
    assert second.pictures == fourth.pictures == ()
    assert [one.label[:7] for one in second.files] == ["Trial c"]  # of the question, not of its repair
    page = page_of(run)
    found = [base64.b64decode(data) for data in re.findall(r'<img src="data:image/png;base64,([^"]+)"', page)]
    assert found == [picture(name).data for name in "abef"]
    for one in (*first.files, *second.files, *fourth.files):
        assert f'<a href="{one.path}">{one.path}</a>' in page
        assert (run.path / one.path).is_file()
    assert [one.path[-4:] for one in first.files] == [".mp4"]


def test_a_file_that_is_not_what_was_shown_is_not_on_the_page(run: VlmRun) -> None:
    first = shown_of(run).rounds[0].consultation
    (run.path / first.pictures[0].path).write_bytes(PIXEL)
    for one in (first.pictures[1], first.files[0]):
        (run.path / one.path).unlink()
    again = shown_of(run).rounds[0].consultation
    assert again.pictures == ()
    changed, gone, also = (one.problem for one in again.files)
    assert "changed" in changed
    assert gone == also == "the file is missing"
    assert changed in visible(page_of(run))


def spoil(run: VlmRun, **changes: object) -> None:
    path = run.transcript / "call_0002.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (lambda run: (run.transcript / "call_0002.json").write_text("{"), "can&#39;t be read as JSON: Expecting"),
        (lambda run: (run.transcript / "call_0002.json").write_text("[" * 100_000), "nested too deeply"),
        (lambda run: (run.transcript / "call_0002.json").write_bytes(b"\xff"), "advisor/call_0002.json&#39; can&#39;t"),
        (lambda run: spoil(run, round="two"), "&#39;round&#39; is &#34;two&#34;; it must be a whole number"),
        (lambda run: spoil(run, number=10**15), "&#39;number&#39; is 1000000000000000; it must be below"),
        (lambda run: spoil(run, request={"parts": [{"media": "../../key.png", "label": "", "media_type": "image/png",
                                                    "sha256": ""}]}), "media outside of the transcript"),
        (lambda run: shutil.rmtree(run.transcript), "the folder &#39;advisor&#39; of the run, is missing"),
    ],
    ids=["cut", "nested", "binary", "kind", "number", "path", "gone"],
)  # fmt: skip
def test_a_damaged_transcript_is_a_sentence(run: VlmRun, damage, sentence: str) -> None:
    damage(run)
    page = page_of(run)
    rest = ("Seen in round 2.", "clipped: arm 0.2 → 0.06 m", "calls 2 and 3", "4 rounds were accepted")
    assert missing((sentence, *rest), visible(page)) == []
    assert str(run.path) not in page
    assert '<table class="calls' not in page


def test_missing_calls_are_said_and_a_replay_has_none_of_its_own(run: VlmRun) -> None:
    for number in (2, 6):  # the last one only the record tells of
        (run.transcript / f"call_000{number}.json").unlink()
    assert missing(("Calls 2 and 6 are missing in the transcript", "4 calls: 1 failed"), visible(page_of(run))) == []
    shutil.rmtree(run.transcript)
    run.change_settings(advisor="replay:elsewhere")
    replayed = page_of(run)
    assert 'id="calls"' not in replayed
    assert "input_tokens: 32000" in visible(replayed)


@pytest.mark.slow
def test_a_browser_shows_pictures_and_closes_them(run: VlmRun, tmp_path: Path) -> None:
    look = """const all = [...document.querySelectorAll('.picture')];
        all.forEach((one) => (one.open = true)); const fixed = getComputedStyle(all[0].firstElementChild).position;
        dispatchEvent(new KeyboardEvent('keydown', {key: 'Escape'}));
        return [fixed, all.filter((one) => one.open).length,
                ...all.map((one) => one.querySelector('img').naturalWidth)];"""
    assert seen_by(page_of(run), tmp_path / "look.html", look) == ["fixed", 0, 1, 1, 1, 1]

import json
import threading
import time

import pytest

from swim2real.advisor.vlm import files
from swim2real.advisor.vlm.advisor import repair_request
from swim2real.advisor.vlm.exchange import Media, Request
from swim2real.advisor.vlm.files import FilesClient
from swim2real.errors import AdvisorError, WaitingForReply

SCHEMA = {"type": "object"}
PICTURE = Media("what is seen", "image/png", b"a picture")
FILM = Media("what is filmed", "video/mp4", b"a film", 12.0)
QUESTION = Request("Say what differs.", ("the loss is 50 mm", PICTURE, FILM), SCHEMA, 2000, round=3)


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "advisor" / "round_003"


def later(action, after: float = 0.1) -> threading.Timer:
    timer = threading.Timer(after, action)
    timer.start()
    return timer


def test_the_question_is_a_page_with_its_pictures_and_films(tmp_path, folder):
    with pytest.raises(WaitingForReply) as waits:
        FilesClient(tmp_path, SCHEMA, once=True).call(QUESTION)
    assert str(waits.value) == (
        f"round 3 waits: read '{folder / 'briefing.md'}'; leave the reply as '{folder / 'reply.json'}'; "
        f"then --resume goes on"
    )
    assert waits.value.exit_code == 0
    page = (folder / "briefing.md").read_text()
    assert "the loss is 50 mm" in page
    assert "what is seen\n\n![1.png](1.png)" in page
    assert "what is filmed\n\n[2.mp4](2.mp4)" in page
    assert (folder / "1.png").read_bytes() == b"a picture"
    assert (folder / "2.mp4").read_bytes() == b"a film"
    assert json.loads((folder / "reply.schema.json").read_text()) == SCHEMA
    assert not list(folder.glob("*.part"))


def test_a_reply_that_is_there_is_taken_at_once(tmp_path, folder):
    folder.mkdir(parents=True)
    (folder / "reply.json").write_text("{}", encoding="utf-8")
    reply = FilesClient(tmp_path, SCHEMA, once=True).call(QUESTION)
    assert (reply.text, reply.model, reply.cost) == ("{}", None, None)


def test_it_waits_for_a_reply_that_is_whole(tmp_path, folder, monkeypatch):
    monkeypatch.setattr(files, "_POLL", 0.05)
    told = []
    client = FilesClient(tmp_path, SCHEMA, on_wait=lambda text, number: told.append((text, number)))

    def write_slowly():
        for text in ("", " ", '{"parameters"', '{"parameters": {}}'):
            (folder / "reply.json").write_text(text)
            time.sleep(0.02)

    timer = later(write_slowly)
    assert client.call(QUESTION).text == '{"parameters": {}}'
    timer.join()
    assert told == [(f"'{folder / 'briefing.md'}' waits for '{folder / 'reply.json'}'", 3)]


def test_what_is_wrong_is_explained_in_place_until_it_is_put_right(tmp_path, folder, monkeypatch):
    monkeypatch.setattr(files, "_POLL", 0.02)
    client = FilesClient(tmp_path, SCHEMA)
    folder.mkdir(parents=True)
    (folder / "reply.json").write_text("drag: 3")
    assert client.call(QUESTION).text == "drag: 3"
    seen = []

    def mend():
        seen.append((folder / "reply.problem.txt").read_text())
        (folder / "reply.json").write_text('{"parameters": {"drag": 3}}')

    timer = later(mend)
    again = client.call(repair_request(QUESTION, "drag: 3", "the reply holds no JSON object", 2000))
    timer.join()
    assert again.text == '{"parameters": {"drag": 3}}'
    assert seen == ["the reply holds no JSON object\n"]
    assert not (folder / "reply.problem.txt").exists()


def test_once_says_where_the_problem_is_explained(tmp_path, folder):
    client = FilesClient(tmp_path, SCHEMA, once=True)
    folder.mkdir(parents=True)
    (folder / "reply.json").write_text("drag: 3")
    client.call(QUESTION)
    with pytest.raises(WaitingForReply, match=r"'.*reply\.problem\.txt' says what is wrong with '.*reply\.json'; then"):
        client.call(repair_request(QUESTION, "drag: 3", "the reply holds no JSON object", 2000))


def test_a_reply_that_is_no_text_is_read_all_the_same(tmp_path, folder):
    folder.mkdir(parents=True)
    (folder / "reply.json").write_bytes(b"\xff\xfe{\x00}\x00")
    assert FilesClient(tmp_path, SCHEMA, once=True).call(QUESTION).text


def test_a_folder_that_cant_be_made_is_named(tmp_path, folder):
    (tmp_path / "advisor").write_text("in the way")
    with pytest.raises(AdvisorError, match=r"can't work in '.*round_003': .*; make room or allow writing, --resume"):
        FilesClient(tmp_path, SCHEMA, once=True).call(QUESTION)

"""The client, against a server that speaks to it as the providers do; and keys, which get into no text."""

import asyncio
import base64
import gc
import gzip
import json
import logging
import os
import signal
import sys
import threading
import time
import tracemalloc
from pathlib import Path

import certifi
import pytest

from swim2real.advisor.vlm.client import AttemptError, ModelClient, classify_error, retrying
from swim2real.advisor.vlm.exchange import CallError, Media, Request
from swim2real.advisor.vlm.providers import price, redact, same_model
from swim2real.settings import VlmAccess
from swimbase.errors import ArgumentError, MissingExtraError
from vlm_server import PROVIDERS, Answer, VlmServer, cuts, drips, drops, hangs, refuses, replies, sends

KEY = "sk-proj-Tk3vQx81LmZp90RbWc27HyUe"
PIECES = [KEY[i : i + 12] for i in range(len(KEY) - 11)]
MODELS = {"google": "gemini-3.1-pro-preview", "openai": "gpt-5.2", "anthropic": "claude-sonnet-5"}
VARIABLES = {"google": "GOOGLE_API_KEY", "openai": "OPENAI_API_KEY", "anthropic": "ANTHROPIC_API_KEY"}
PROPERTIES = {"diagnosis": {"type": "string"}, "mass": {"type": "number"}}
SCHEMA = {"type": "object", "properties": PROPERTIES, "required": list(PROPERTIES), "additionalProperties": False}
REPLY = '{"diagnosis": "too light", "mass": 1.5}'
VIDEO, PICTURE = b"a video " * 4, b"a picture " * 4
each = pytest.mark.parametrize("provider", PROVIDERS)


def question(provider: str) -> Request:
    google = provider == "google"
    media = Media("a clip", "video/mp4", VIDEO, fps=12.0) if google else Media("a sheet", "image/png", PICTURE)
    return Request("You are a physicist.", ("What differs?", media, "Answer."), SCHEMA, 20000)


class Ask:
    """Asks the server as one provider, and keeps how long it was to wait and which attempts were reported."""

    def __init__(self, vlm, provider, *behaviors, tries=6, timeout=20.0, then=None, sleep=None):
        self.provider, self.waits, self.reported = provider, [], []
        vlm.script(*behaviors, then=then)
        access = VlmAccess(vlm.url(provider), "TEST_SERVER_KEY", timeout=timeout, tries=tries)
        self.client = ModelClient(f"{provider}:{MODELS[provider]}", access, sleep=sleep or self.waits.append)

    def __call__(self):
        return self.client.call(question(self.provider), self.reported.append)

    def fails(self) -> CallError:
        with pytest.raises(CallError) as caught:
            self()
        return caught.value


@pytest.fixture(autouse=True)
def key_of_the_server(monkeypatch):
    monkeypatch.setenv("TEST_SERVER_KEY", KEY)


@pytest.fixture(scope="module", autouse=True)
def one_authority(tmp_path_factory):
    """The libraries load all authorities for every call, 20 to 60 ms each time; nothing here is encrypted."""
    with pytest.MonkeyPatch.context() as patch:
        first = Path(certifi.where()).read_text().split("-----END CERTIFICATE-----")[0]
        file = tmp_path_factory.mktemp("authority") / "one.pem"
        file.write_text(first + "-----END CERTIFICATE-----\n")
        patch.setenv("SSL_CERT_FILE", str(file))
        yield
    gc.collect()  # what wasn't closed or awaited warns here, and a warning is an error


@pytest.mark.slow
@each
def test_a_good_reply_and_what_is_on_the_wire(vlm, provider):
    ask = Ask(vlm, provider, replies(REPLY, thinking=300))
    reply = ask()
    assert (reply.text, reply.finish, reply.model) == (REPLY, "stop", MODELS[provider])
    assert (reply.input_tokens, reply.output_tokens) == (1000, 500)
    assert (reply.cost, reply.notes, ask.client.price_known) == (None, (), False)
    (asked,) = vlm.requests
    assert (asked.provider, asked.model, asked.max_tokens) == (provider, MODELS[provider], 20000)
    assert asked.instructions == "You are a physicist."
    assert list(asked.schema["properties"]) == asked.schema["required"] == ["diagnosis", "mass"]
    first, label, media, last = asked.parts
    assert [part["text"] for part in (first, last)] == ["What differs?", "Answer."]
    data = {
        "google": lambda: media["inlineData"]["data"], "openai": lambda: media["image_url"]["url"].split(",")[1],
        "anthropic": lambda: media["source"]["data"],
    }  # fmt: skip
    expected = ("a clip", VIDEO) if provider == "google" else ("a sheet", PICTURE)
    assert (label["text"], base64.b64decode(data[provider]())) == expected
    assert media.get("videoMetadata") == ({"fps": 12.0} if provider == "google" else None)
    header = "x-goog-api-key" if provider == "google" else "authorization"
    assert asked.headers[header].removeprefix("Bearer ") == KEY
    assert KEY not in asked.path


@each
def test_what_later_requests_repeat_comes_first_and_is_marked_for_the_service_that_wants_it(vlm, provider):
    ask = Ask(vlm, provider, replies(REPLY), replies(REPLY))
    for last in ("Now.", "Later."):
        ask.client.call(Request("You are a physicist.", ("Round 1.", "Round 2.", last), SCHEMA, 20000, lasting=2))
    first, second = vlm.requests
    assert first.instructions == second.instructions
    texts = [[part["text"] for part in asked.parts] for asked in (first, second)]
    assert texts == [["Round 1.", "Round 2.", "Now."], ["Round 1.", "Round 2.", "Later."]]
    marked = [part["text"] for part in first.parts if "cache_control" in part]
    assert marked == (["Round 2."] if provider == "anthropic" else [])
    assert ("cache_control" in json.dumps(first.body.get("system", ""))) == (provider == "anthropic")


def chat(**message):
    """A reply of OpenAI whose message has more in it than text."""
    choice = {"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": None} | message}
    return sends({"id": "1", "object": "chat.completion", "created": 1, "model": "gpt-5.2", "choices": [choice]})


@pytest.mark.parametrize(("provider", "behavior", "finish", "text", "model"), [
    ("openai", replies('{"mass', finish="length", model="another-7"), "length", '{"mass', "another-7"),
    ("openai", replies(None, finish="length"), "length", "", "gpt-5.2"),
    ("openai", chat(refusal="I can't help."), "refusal", "I can't help.", "gpt-5.2"),
    ("anthropic", replies("I'd rather not.", finish="refusal"), "refusal", "I'd rather not.", "claude-sonnet-5"),
    ("google", sends({"candidates": [{"content": {"parts": [{"text": REPLY}]}, "finishReason": "STOP"}]}), "stop",
     REPLY, None),
])  # fmt: skip
def test_how_a_reply_ends_and_who_wrote_it(vlm, provider, behavior, finish, text, model):
    reply = Ask(vlm, provider, behavior)()
    assert (reply.finish, reply.text, reply.model) == (finish, text, model)


def test_one_client_for_many_calls_also_within_a_loop(vlm):
    ask = Ask(vlm, "openai", then=replies(REPLY))

    async def notebook():
        return ask()

    assert ask().text == ask().text == asyncio.run(notebook()).text == REPLY


# failures that may pass

PASSING = (
    refuses(408, "Request timeout"),
    refuses(429, "Rate limit reached, see https://platform.openai.com/account/billing.", "rate_limit_exceeded"),
    sends("<html><h1>Bad gateway</h1></html>", 502), sends("<html>Please sign in</html>"), sends({"hello": [1, 2]}),
    sends([1, 2]), sends(""), sends({"error": {"message": "upstream failed", "code": 502}}), drops, cuts,
)  # fmt: skip


@each
def test_what_may_pass_is_tried_again(vlm, provider):
    ask = Ask(vlm, provider, *PASSING, replies(REPLY), tries=len(PASSING) + 1)
    reply = ask()
    assert reply.text == REPLY
    assert len(vlm.requests) == len(reply.attempts) == len(PASSING) + 1
    assert [attempt.waited for attempt in ask.reported] == ask.waits
    assert reply.attempts[:-1] == tuple(ask.reported)
    assert all(attempt.error and "\n" not in attempt.error for attempt in ask.reported)
    assert reply.attempts[-1].error is None


def test_attempts_are_bounded(vlm):
    ask = Ask(vlm, "openai", then=refuses(503, "Busy"), tries=3)
    error = ask.fails()
    assert error.kind == "unreachable"
    assert "'openai:gpt-5.2' gave no reply in 3 attempts, at last: 503: Busy" in str(error)
    assert len(vlm.requests) == len(error.attempts) == 3
    assert [attempt.waited for attempt in error.attempts] == [*ask.waits, 0.0]
    vlm.close()
    assert "the connection failed" in str(ask.fails())


@pytest.mark.parametrize(("provider", "behavior"), [*((provider, drips) for provider in PROVIDERS), ("openai", hangs)])
def test_an_attempt_has_a_deadline_whatever_drips_in(vlm, provider, behavior):
    started = time.monotonic()
    error = Ask(vlm, provider, then=behavior, tries=1, timeout=0.3).fails()
    assert time.monotonic() - started < 20
    assert (error.kind, "no answer in time" in str(error)) == ("unreachable", True)


TYPE = "type.googleapis.com/google.rpc"
RETRY_INFO = [{"@type": f"{TYPE}.RetryInfo", "retryDelay": "38.5s"}]


@pytest.mark.parametrize(("provider", "behavior", "wait"), [
    *((p, refuses(429, "Slow down", headers={"retry-after": "7"}), 7) for p in PROVIDERS),
    ("openai", refuses(429, "Slow down", headers={"retry-after": "3600"}), 120),
    ("google", refuses(429, "Quota", "RESOURCE_EXHAUSTED", details=RETRY_INFO), 38.5),
])  # fmt: skip
def test_the_server_says_how_long_to_wait(vlm, provider, behavior, wait):
    ask = Ask(vlm, provider, behavior, replies(REPLY))
    ask()
    assert ask.waits == [wait]


def test_waits_are_random_and_grow_up_to_a_cap():
    def fail():
        raise AttemptError("retry", "busy")

    sets: list[list[float]] = [[] for _ in range(30)]
    for waits in sets:
        with pytest.raises(AttemptError):
            retrying(9, waits.append, lambda seconds: None)(fail)
    for lengths, longest in zip(zip(*sets, strict=True), (2, 4, 8, 16, 32, 60, 60, 60), strict=True):
        assert 0 <= min(lengths) < longest / 2 < max(lengths) <= longest


BOMB = Answer(200, gzip.compress(b" " * 50_000_000), {"content-encoding": "gzip", "content-type": "application/json"})


@each
@pytest.mark.parametrize("answer", [Answer(how="flood"), Answer(401, how="flood"), BOMB])
def test_no_more_of_an_answer_is_read_than_a_reply_can_have(vlm, provider, answer):
    tracemalloc.start()
    said = str(Ask(vlm, provider, then=lambda asked: answer, tries=1).fails())
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "the answer has more than 4 MB; at most that is read" in said
    assert most < 60e6


@each
def test_a_long_body_of_an_error_takes_no_time(vlm, provider):
    begin = time.monotonic()
    for body in ("<" * 300_000, "<a" * 150_000, "invalid " * 40_000):
        assert Ask(vlm, provider, then=sends(body, 400), tries=1).fails().kind == "settings"
    assert time.monotonic() - begin < 10


# failures that no attempt can mend

PER_DAY = [{"@type": f"{TYPE}.QuotaFailure", "violations": [{"quotaId": "GenerateRequestsPerDayPerModel-FreeTier"}]}]
BAD_KEY = [{"@type": f"{TYPE}.ErrorInfo", "reason": "API_KEY_INVALID"}]
GEMINI_USAGE = {"usageMetadata": {"promptTokenCount": 900, "totalTokenCount": 900}}
LONG = "This model's maximum context length is 8192 tokens. However, you requested 9000 tokens."
FINAL = [
    *(("settings", p, refuses(401, "Invalid key", "authentication_error"), "check TEST_SERVER_KEY") for p in PROVIDERS),
    *(("settings", p, refuses(404, "Not found", "NOT_FOUND"), f"no model '{MODELS[p]}'") for p in PROVIDERS),
    ("settings", "openai", refuses(400, "Odd", "INVALID_ARGUMENT"), "the request was refused (400: Odd)"),
    ("settings", "openai", refuses(402, "Pay first"), "quota or credit of TEST_SERVER_KEY is used up (402"),
    ("settings", "google", refuses(400, "Not valid.", "INVALID_ARGUMENT", details=BAD_KEY), "check TEST_SERVER_KEY"),
    ("settings", "google", refuses(429, "Exceeded", "RESOURCE_EXHAUSTED", details=PER_DAY), "is used up"),
    ("settings", "anthropic", refuses(400, "Your credit balance is too low", "invalid_request_error"), "is used up"),
    ("blocked", "google", sends({"promptFeedback": {"blockReason": "OTHER"}} | GEMINI_USAGE), "OTHER"),
    ("blocked", "google", sends({"candidates": []} | GEMINI_USAGE), "nothing"),
    ("blocked", "google", replies("half", finish="PROHIBITED_CONTENT"), "PROHIBITED_CONTENT"),
    ("blocked", "openai", replies(None, finish="content_filter"), "content_filter"),
    ("blocked", "openai", refuses(400, "Rejected by our safety system.", "moderation_blocked"), "safety system"),
    ("too_long", "openai", refuses(400, LONG, "context_length_exceeded"), LONG),
]


@pytest.mark.parametrize(("kind", "provider", "behavior", "words"), FINAL)
def test_what_no_attempt_can_mend_ends_at_once(vlm, kind, provider, behavior, words):
    ask = Ask(vlm, provider, behavior)
    error = ask.fails()
    assert error.kind == kind
    assert f"'{provider}:{MODELS[provider]}'" in str(error)
    assert words in str(error)
    assert len(vlm.requests) == len(error.attempts) == 1
    assert not ask.waits


# what the three services and servers that imitate them say
MESSAGES = {
    "too_long": [
        (400, "The input token count (1200000) exceeds the maximum number of tokens allowed (1048576)."),
        (400, "Request payload size exceeds the limit: 20971520 bytes."),
        (400, "Your input exceeds the context window of this model."),
        (429, "Request too large for gpt-5.2 on tokens per min (TPM): Limit 30000, Requested 99000."),
        (400, "The decoder prompt (length 9000) is longer than the maximum model length of 8192."),
        (500, "the request exceeds the available context size. try increasing the context size"),
        (400, "prompt is too long: 210000 tokens > 200000 maximum"),
        (400, "input length and `max_tokens` exceed context limit: 190000 + 20000 > 200000"),
        (413, "Request exceeds the maximum size"),
    ],
    "schema": [
        (400, "The specified schema produces a constraint that has too many states for serving."),
        (400, "'response_format.type' must be 'text'"),
        (400, "output_config.format: The compiled grammar is too large"),
    ],
    "blocked": [(400, "Output blocked by content filtering policy")],
    "settings": [(429, "You exceeded your current quota (insufficient_quota)"), (403, "Not for you")],
    "retry": [(409, "Conflict"), (425, "Too early"), (529, "Overloaded"), (500, "Internal error")],
}


@pytest.mark.parametrize("kind", MESSAGES)
def test_messages_are_classified(kind):
    from pydantic_ai.exceptions import ModelHTTPError

    for status, message in MESSAGES[kind]:
        error = classify_error(ModelHTTPError(status, "a-model", {"message": message}), "A_KEY", "a-model", str)
        assert (message, error.kind) == (message, kind)
        assert message in error.reason


def test_the_same_without_a_schema_that_is_refused(vlm):
    message = "Invalid schema for response_format 'proposal'"
    ask = Ask(vlm, "openai", refuses(400, message, "invalid_request_error"), then=replies(REPLY), tries=1)
    reply, again = ask(), ask()
    assert reply.text == REPLY
    assert not ask.waits
    assert message in reply.attempts[0].error
    with_schema, without, later = vlm.requests
    assert [one.schema is None for one in (with_schema, without, later)] == [False, True, True]
    assert '"mass"' in without.instructions
    assert without.parts == with_schema.parts
    assert reply.notes == again.notes == ("asked for JSON in words, since the model or its server takes no schema",)
    assert Ask(vlm, "openai", then=refuses(400, message)).fails().kind == "settings"  # refused once more


def test_models_without_schemas_and_models_that_will_be_switched_off_are_noted(vlm):
    vlm.script(then=replies(REPLY))
    access = VlmAccess(vlm.url("anthropic"))
    reply = ModelClient("anthropic:claude-3-haiku-20240307", access).call(question("anthropic"))
    assert vlm.requests[0].schema is None
    assert '"mass"' in vlm.requests[0].instructions
    assert any(note.startswith("asked for JSON in words") for note in reply.notes)
    reply = ModelClient("anthropic:claude-sonnet-4-5", access).call(question("anthropic"))
    assert any("'claude-sonnet-4-5' is deprecated" in note for note in reply.notes)


# keys: in no file, message, log, traceback or list of processes, whatever the server echoes or redirects


def pieces(text: str) -> list[str]:
    return [piece for piece in PIECES if piece in text]


@each
def test_a_key_that_is_echoed_is_kept_nowhere(vlm, provider, caplog):
    caplog.set_level(logging.DEBUG)
    echo = refuses(429, f"Your key {KEY} is wrong, Bearer {KEY}!", f"key_{KEY}", {"x-echo": KEY})
    echoed = replies(f"{KEY} is what you sent", model=f"model-{KEY}")
    ask = Ask(vlm, provider, echoed, echo, refuses(401, KEY), tries=2)
    reply = ask()
    assert reply.text == "[TEST_SERVER_KEY] is what you sent"
    error = ask.fails()
    assert "[TEST_SERVER_KEY]" in str(error)
    chain, shown = error, [reply, error.attempts, ask.reported, ask.client, vars(ask.client), caplog.text]
    while chain is not None:
        shown += [str(chain), chain, vars(chain)]
        chain = chain.__cause__ or chain.__context__
    assert not pieces(repr(shown))
    media = base64.b64encode(VIDEO if provider == "google" else PICTURE).decode()
    assert not [secret for secret in (media[:30], "physicist") if secret in caplog.text]


@each
def test_a_key_where_a_message_is_cut_off_or_in_an_odd_body_is_replaced_too(vlm, provider):
    for padding in (285, 270):  # what a provider says is cut off at 300 characters
        said = str(Ask(vlm, provider, refuses(401, f"{'x' * padding} {KEY} is wrong")).fails())
        assert "x [TEST_SERVER" in said
        assert not pieces(said)
    for body in ({"headers": f"Bearer {KEY}"}, [KEY], {"candidates": KEY, "choices": KEY, "content": KEY}, KEY):
        assert not pieces(str(Ask(vlm, provider, then=sends(body), tries=1).fails()))


@each
@pytest.mark.parametrize("status", [307, *(pytest.param(n, marks=pytest.mark.slow) for n in (301, 302, 303, 308))])
def test_a_redirect_to_another_host_gets_no_request(vlm, provider, status):
    with VlmServer() as other:
        address = other.url(provider).replace("127.0.0.1", "localhost")
        said = str(Ask(vlm, provider, then=sends("", status, {"location": f"{address}/?key={KEY}"})).fails())
        assert f"the server sends to another address ({status}); check --base-url" in said
        assert not pieces(said)
        assert len(vlm.requests) == 1
        assert not other.requests


def test_a_placeholder_of_a_key_is_no_secret(monkeypatch):
    assert redact(f"<{KEY}>, sk-proj-", ["TEST_SERVER_KEY"]) == "<[TEST_SERVER_KEY]>, sk-proj-"
    monkeypatch.setenv("TEST_SERVER_KEY", "EMPTY")
    assert redact("EMPTY", ["TEST_SERVER_KEY"]) == "EMPTY"


@each
def test_another_server_is_not_sent_the_providers_key(vlm, provider, monkeypatch):
    for name in (*VARIABLES.values(), "GEMINI_API_KEY", "ANTHROPIC_AUTH_TOKEN"):
        monkeypatch.setenv(name, KEY)
    monkeypatch.setenv("ANTHROPIC_CUSTOM_HEADERS", f"x-mine: {KEY}")
    monkeypatch.setenv("OPENAI_BASE_URL", "http://192.0.2.1")
    monkeypatch.delenv("TEST_SERVER_KEY")
    vlm.script(replies(REPLY), refuses(401, "Who are you?"))
    client = ModelClient(f"{provider}:{MODELS[provider]}", VlmAccess(vlm.url(provider)))
    assert client.call(question(provider)).text == REPLY
    assert KEY not in json.dumps([dict(asked.headers) for asked in vlm.requests])
    with pytest.raises(CallError, match="check the key, which --key-variable names"):
        client.call(question(provider))


def test_the_providers_own_addresses(monkeypatch, only_this_machine):
    addresses = {
        "google": "generativelanguage.googleapis.com", "openai": "api.openai.com", "anthropic": "api.anthropic.com",
    }  # fmt: skip
    for name in ("OPENAI_BASE_URL", "ANTHROPIC_BASE_URL", "GOOGLE_GEMINI_BASE_URL"):
        monkeypatch.setenv(name, "http://192.0.2.1")  # which another program may need
    for provider, address in addresses.items():
        monkeypatch.setenv(VARIABLES[provider], KEY)
        client = ModelClient(f"{provider}:{MODELS[provider]}", VlmAccess(tries=1))
        with pytest.raises(CallError, match=f"a test must not reach '{address}'") as caught:
            client.call(question(provider))
        assert caught.value.kind == "unreachable"
        assert set(only_this_machine) == {address}
        only_this_machine.clear()


# what is asked for

HERE = {"base_url": "http://127.0.0.1:1"}
REFUSED = [
    ("googel:gemini-9", HERE, "there is no advisor 'googel:gemini-9'; a VLM is google:MODEL"),
    ("claude-sonnet-5", HERE, "did you mean anthropic:claude-sonnet-5?"),
    ("google", HERE, "'google' names no model; say which one, such as google:"),
    ("openai:gpt 5", HERE, "'openai:gpt 5' names no model"),
    ("openai:m", {"base_url": "127.0.0.1:8000"}, "base URL is '127.0.0.1:8000'; it must begin with http"),
    ("openai:m", {"base_url": f"http://me:{KEY}@127.0.0.1"}, "the base URL holds a password"),
    ("openai:m", {"base_url": f"http://127.0.0.1/v1?key={KEY}"}, "'127.0.0.1' goes on after a '?' or '#'"),
    ("openai:m", {**HERE, "media": "video"}, "media is 'video', which openai doesn't take; choose"),
    ("openai:m", {**HERE, "key_variable": KEY}, "--key-variable must be the name of an environment variable"),
    ("openai:m", {**HERE, "key_variable": "AIza" + KEY.replace("-", "") + 9 * "a"}, "if it is the key itself"),
    ("openai:m", {**HERE, "key_variable": "MY_KEY"}, "set the environment variable MY_KEY"),
    *((f"{p}:m", {}, f"set the environment variable {VARIABLES[p]}") for p in PROVIDERS),
]


@pytest.mark.parametrize(("name", "access", "words"), REFUSED)
def test_what_is_refused_before_a_call_without_a_word_of_a_key(name, access, words):
    access = dict(access)
    media = access.pop("media", "auto")
    with pytest.raises(ArgumentError) as caught:
        ModelClient(name, VlmAccess(**access), media)
    assert words in str(caught.value)
    assert not pieces(str(caught.value))


def test_a_variable_that_holds_no_key_is_named_and_both_of_google_count(monkeypatch):
    monkeypatch.setenv("GOOGLE_API_KEY", f"{KEY}\nsecond line")
    with pytest.raises(ArgumentError, match="GOOGLE_API_KEY holds no key") as caught:
        ModelClient("google:some-model", VlmAccess())
    assert not pieces(str(caught.value))
    monkeypatch.delenv("GOOGLE_API_KEY")
    monkeypatch.setenv("GEMINI_API_KEY", f" {KEY}\n")
    takes = [ModelClient("google:some-model", VlmAccess(), kind).takes_video for kind in ("auto", "video", "images")]
    assert takes == [True, True, False]
    assert ModelClient("google:gemini-3.1-pro-preview", VlmAccess()).price_known


@pytest.mark.parametrize(("asked", "answered", "same"), [
    ("gpt-5.2", "gpt-5.2-2025-12-11", True),
    ("claude-sonnet-4-5", "claude-sonnet-4-5-20250929", True),
    ("gemini-2.0-flash-001", "gemini-2.0-flash", True),
    ("gemini-2.5-pro", "models/gemini-2.5-pro", True),
    ("claude-sonnet-4-5-latest", "claude-sonnet-4-5-20250929", True),
    ("gemini-flash-latest", "gemini-2.5-flash-preview-09-2025", True),
    ("gemini-flash-latest", "gemini-3.5-flash-lite", False),
    ("gemini-2.5-pro", "gemini-3.1-pro-preview", False),
    ("gpt-5", "gpt-5.2", False),
    ("gpt-5-2025-08-07", "gpt-5-2025-12-11", False),
])  # fmt: skip
def test_same_model(asked, answered, same):
    assert same_model(asked, answered) is same


def test_prices():
    whole, cached = (price("google", "gemini-3.1-pro-preview", 1000, 100, cache_read=read) for read in (0, 800))
    assert whole == pytest.approx(1000 * 2e-6 + 100 * 12e-6)  # 2 and 12 USD per million tokens
    assert 0 < cached < whole
    assert price("openai", "a-model-of-tomorrow", 1000, 100) is None


@pytest.mark.parametrize(("provider", "moment"), [("google", "call"), ("openai", "wait"), ("anthropic", "handler")])
def test_an_interrupt_ends_a_call_at_once(vlm, provider, moment):
    then = refuses(503, "Busy") if moment == "wait" else hangs
    ask = Ask(vlm, provider, replies(REPLY), then=then, timeout=60, sleep=lambda _: time.sleep(60))
    ask()  # so that all is imported
    threads = {thread.name for thread in threading.enumerate() if "process_request" not in thread.name}

    def interrupt():
        while len(vlm.requests) < 2:
            time.sleep(0.01)
        time.sleep(0.15)
        os.kill(os.getpid(), signal.SIGINT)

    def raise_at_once(*_):
        raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, raise_at_once if moment == "handler" else signal.default_int_handler)
    try:
        threading.Thread(target=interrupt, name="process_request of the test", daemon=True).start()
        started = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            ask()
        assert time.monotonic() - started < 30
    finally:
        signal.signal(signal.SIGINT, before)
    gc.collect()
    assert {thread.name for thread in threading.enumerate() if "process_request" not in thread.name} == threads


@pytest.mark.parametrize("library", ["pydantic_ai", "google.genai", "openai", "anthropic", "genai_prices", "tenacity"])
def test_a_missing_library_is_named(library, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingExtraError, match=r"install it with: pip install 'swim2real\[vlm\]'") as caught:
        ModelClient("google:gemini-3.1-pro-preview", VlmAccess(**HERE))
    assert library.replace(".", "-") in str(caught.value)

"""The client, against a server that speaks to it as the providers do."""

import asyncio
import base64
import gc
import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from pathlib import Path

import certifi
import pytest

from swim2real.advisor.vlm.client import make_client
from swim2real.advisor.vlm.exchange import CallError, Media, Request
from swim2real.advisor.vlm.prices import price
from swim2real.advisor.vlm.providers import same_model
from swim2real.advisor.vlm.retrying import Patience
from swim2real.errors import ArgumentError, MissingExtraError
from vlm_server import PROVIDERS, cuts, drips, drops, hangs, refuses, replies, sends

KEY = "sk-proj-0123456789abcdef"
MODELS = {"google": "gemini-3.1-pro-preview", "openai": "gpt-5.2", "anthropic": "claude-sonnet-5"}
VARIABLES = {"google": "GOOGLE_API_KEY", "openai": "OPENAI_API_KEY", "anthropic": "ANTHROPIC_API_KEY"}
SCHEMA = {
    "type": "object",
    "properties": {"diagnosis": {"type": "string"}, "mass": {"type": "number"}},
    "required": ["diagnosis", "mass"],
    "additionalProperties": False,
}
REPLY = '{"diagnosis": "too light", "mass": 1.5}'
VIDEO, PICTURE = b"a video " * 4, b"a picture " * 4
each = pytest.mark.parametrize("provider", PROVIDERS)


def question(provider: str) -> Request:
    if provider == "google":
        media = Media("a clip", "video/mp4", VIDEO, fps=12.0)
    else:
        media = Media("a sheet", "image/png", PICTURE)
    return Request("You are a physicist.", ("What differs?", media, "Answer."), SCHEMA, 20000)


class Ask:
    """Asks the server as one provider, and keeps how long it was to wait and which attempts were told."""

    def __init__(self, vlm, provider, *behaviors, tries=6, timeout=20.0, then=None, **more):
        self.vlm, self.provider = vlm, provider
        self.waits, self.told = [], []
        vlm.script(*behaviors, then=then)
        self.client = make_client(
            f"{provider}:{MODELS[provider]}",
            vlm.url(provider),
            key_variable="TEST_SERVER_KEY",
            timeout=timeout,
            patience=Patience(tries, sleep=self.waits.append, random=lambda: 0.5),
            **more,
        )

    def __call__(self):
        return self.client.call(question(self.provider), self.told.append)

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


@pytest.fixture(scope="module", autouse=True)
def nothing_is_left_open():
    yield
    gc.collect()  # what wasn't closed or awaited warns here, and a warning is an error


# good replies


@each
@pytest.mark.parametrize("thinking", [0, 300])
def test_a_good_reply(vlm, provider, thinking):
    ask = Ask(vlm, provider, replies(REPLY, thinking=thinking))
    reply = ask()
    assert (reply.text, reply.finish, reply.model) == (REPLY, "stop", MODELS[provider])
    assert (reply.input_tokens, reply.output_tokens) == (1000, 200 + thinking)
    assert (reply.cost, reply.notes, ask.client.price_known) == (None, (), False)
    assert [attempt.error for attempt in reply.attempts] == [None]
    assert len(vlm.requests) == 1
    assert not ask.told


@each
def test_what_is_on_the_wire(vlm, provider):
    Ask(vlm, provider, replies(REPLY))()
    (asked,) = vlm.requests
    assert asked.provider == provider
    assert asked.model == MODELS[provider]
    assert asked.max_tokens == 20000
    assert asked.instructions == "You are a physicist."
    assert list(asked.schema["properties"]) == ["diagnosis", "mass"]
    assert asked.schema["required"] == ["diagnosis", "mass"]
    first, label, media, last = asked.parts
    assert first["text"] == "What differs?"
    assert last["text"] == "Answer."
    if provider == "google":
        assert label["text"] == "a clip"
        assert base64.b64decode(media["inlineData"]["data"]) == VIDEO
        assert media["videoMetadata"] == {"fps": 12.0}
    else:
        assert label["text"] == "a sheet"
        data = media["image_url"]["url"].split(",")[1] if provider == "openai" else media["source"]["data"]
        assert base64.b64decode(data) == PICTURE
    header = "x-goog-api-key" if provider == "google" else "authorization"
    assert asked.headers[header].removeprefix("Bearer ") == KEY
    assert KEY not in asked.path


@each
def test_the_model_that_answered_is_told(vlm, provider):
    reply = Ask(vlm, provider, replies(REPLY, model="another-model-7"))()
    assert reply.model == "another-model-7"
    assert not same_model(MODELS[provider], reply.model)


def test_a_reply_that_names_no_model(vlm):
    body = {"candidates": [{"content": {"parts": [{"text": REPLY}]}, "finishReason": "STOP"}]}
    reply = Ask(vlm, "google", sends(body))()
    assert (reply.text, reply.model, reply.input_tokens, reply.output_tokens) == (REPLY, None, None, None)


@each
def test_one_client_for_many_calls(vlm, provider):
    ask = Ask(vlm, provider, then=replies(REPLY))
    threads = threading.active_count()
    for _ in range(4):
        assert ask().text == REPLY
    gc.collect()  # what wasn't closed or awaited warns here, and a warning is an error
    deadline = time.monotonic() + 5
    while threading.active_count() > threads and time.monotonic() < deadline:
        time.sleep(0.01)  # the server's own threads end when it sees that a connection is closed
    assert threading.active_count() <= threads


@each
def test_within_a_loop_that_runs_already(vlm, provider):
    async def notebook():
        return Ask(vlm, provider, replies(REPLY))()

    assert asyncio.run(notebook()).text == REPLY


# ends of replies that aren't good


@each
@pytest.mark.parametrize("text", ['{"diagnosis": "too li', "", None])
def test_a_reply_that_was_cut_off(vlm, provider, text):
    reply = Ask(vlm, provider, replies(text, finish="length"))()
    assert (reply.finish, reply.text) == ("length", text or "")
    assert len(vlm.requests) == 1


def chat(**message):
    """A reply of OpenAI whose message has more in it than text."""
    choice = {"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": None} | message}
    return sends({"id": "1", "object": "chat.completion", "created": 1, "model": "gpt-5.2", "choices": [choice]})


@pytest.mark.parametrize(
    ("provider", "behavior", "text"),
    [
        ("openai", chat(refusal="I can't help with fish."), "I can't help with fish."),
        ("anthropic", replies("I'd rather not.", finish="refusal"), "I'd rather not."),
        ("anthropic", replies(None, finish="refusal"), ""),
    ],
)
def test_refusals_in_so_many_words(vlm, provider, behavior, text):
    reply = Ask(vlm, provider, behavior)()
    assert (reply.finish, reply.text) == ("refusal", text)


GEMINI_USAGE = {"usageMetadata": {"promptTokenCount": 900, "totalTokenCount": 900}}
BLOCKS = [
    ("google", sends({"promptFeedback": {"blockReason": "PROHIBITED_CONTENT"}} | GEMINI_USAGE), "PROHIBITED_CONTENT"),
    ("google", sends({"promptFeedback": {"blockReason": "OTHER"}}), "OTHER"),
    ("google", sends({"candidates": []} | GEMINI_USAGE), "nothing"),
    *(("google", replies(None, finish=word), word) for word in ("SAFETY", "RECITATION", "BLOCKLIST", "SPII", "OTHER")),
    ("google", replies("half", finish="PROHIBITED_CONTENT"), "PROHIBITED_CONTENT"),
    ("openai", replies(None, finish="content_filter"), "content_filter"),
    ("openai", refuses(400, "Rejected as a result of our safety system.", "moderation_blocked"), "safety system"),
    ("anthropic", refuses(400, "Output blocked by content filtering policy", "invalid_request_error"), "filtering"),
]


@pytest.mark.parametrize(("provider", "behavior", "reason"), BLOCKS)
def test_safety_blocks(vlm, provider, behavior, reason):
    error = Ask(vlm, provider, behavior).fails()
    assert error.kind == "blocked"
    assert f"'{provider}:{MODELS[provider]}' blocked the request" in str(error)
    assert reason in str(error)
    assert len(vlm.requests) == 1


# failures that may pass


PASSING = {
    "408": refuses(408, "Request timeout"),
    "409": refuses(409, "Conflict"),
    "425": refuses(425, "Too early"),
    "429": refuses(429, "Slow down", "rate_limit_error"),
    "500": refuses(500, "Internal error", "INTERNAL"),
    "502": sends("<html><h1>Bad gateway</h1></html>", 502),
    "503": refuses(503, "The model is overloaded. Please try again later.", "UNAVAILABLE"),
    "504": sends("", 504),
    "529": refuses(529, "Overloaded", "overloaded_error"),
    "html": sends("<html>Please sign in</html>"),
    "json": sends({"hello": [1, 2]}),
    "list": sends([1, 2]),
    "number": sends(7),
    "empty": sends(""),
    "error in a 200": sends({"error": {"message": "upstream failed", "code": 502}}),
    "drop": drops,
    "cut": cuts,
}


@each
@pytest.mark.parametrize("name", PASSING)
def test_what_may_pass_is_tried_again(vlm, provider, name):
    ask = Ask(vlm, provider, PASSING[name], PASSING[name], replies(REPLY))
    reply = ask()
    assert reply.text == REPLY
    assert len(vlm.requests) == 3
    assert ask.waits == [1.0, 2.0]  # half of 2 s and of 4 s
    assert [attempt.waited for attempt in ask.told] == ask.waits
    assert reply.attempts[:2] == tuple(ask.told)
    assert all(attempt.error and "\n" not in attempt.error for attempt in ask.told)
    assert reply.attempts[2].error is None


@each
@pytest.mark.parametrize("name", ["503", "html", "drop"])
def test_attempts_are_bounded(vlm, provider, name):
    ask = Ask(vlm, provider, then=PASSING[name], tries=3)
    error = ask.fails()
    assert error.kind == "unreachable"
    assert str(error).startswith(f"'{provider}:{MODELS[provider]}' gave no reply in 3 attempts, at last: ")
    assert len(vlm.requests) == len(error.attempts) == 3
    assert [attempt.waited for attempt in error.attempts] == [1.0, 2.0, 0.0]
    assert len(ask.told) == 2


@each
@pytest.mark.parametrize("behavior", [hangs, drips])
def test_an_attempt_has_a_deadline_whatever_drips_in(vlm, provider, behavior):
    ask = Ask(vlm, provider, then=behavior, tries=2, timeout=0.3)
    started = time.monotonic()
    error = ask.fails()
    assert time.monotonic() - started < 20
    assert error.kind == "unreachable"
    assert "no answer in time" in str(error)
    assert len(vlm.requests) == 2


def test_nobody_there(vlm):
    ask = Ask(vlm, "openai", tries=2)
    vlm.close()
    error = ask.fails()
    assert error.kind == "unreachable"
    assert "the connection failed" in str(error)


def in_50_s(asked):
    date = format_datetime(datetime.now(UTC) + timedelta(seconds=50), usegmt=True)
    return refuses(503, "Busy", headers={"retry-after": date})(asked)


RETRY_INFO = [{"@type": "type.googleapis.com/google.rpc.RetryInfo", "retryDelay": "38.5s"}]


@pytest.mark.parametrize(
    ("provider", "behavior", "low", "high"),
    [
        *((p, refuses(429, "Slow down", headers={"retry-after": "7"}), 7, 7) for p in PROVIDERS),
        *((p, in_50_s, 40, 50) for p in PROVIDERS),
        *((p, refuses(429, "Slow down", headers={"retry-after": "3600"}), 120, 120) for p in PROVIDERS),
        *((p, refuses(429, "Slow down", headers={"retry-after": "soon"}), 1, 1) for p in PROVIDERS),
        ("google", refuses(429, "Quota", "RESOURCE_EXHAUSTED", details=RETRY_INFO), 38.5, 38.5),
    ],
)
def test_the_server_says_how_long_to_wait(vlm, provider, behavior, low, high):
    ask = Ask(vlm, provider, behavior, replies(REPLY))
    ask()
    assert low <= ask.waits[0] <= high


def test_waits_grow_up_to_a_cap():
    patience = Patience(random=lambda: 1.0)
    assert [patience.wait(failed, None) for failed in range(1, 8)] == [2, 4, 8, 16, 32, 60, 60]
    waits = {Patience().wait(3, None) for _ in range(20)}
    assert len(waits) > 15
    assert all(0 <= wait <= 8 for wait in waits)
    with pytest.raises(ArgumentError, match="tries is 0; it must be at least 1"):
        Patience(0)


# failures that no attempt can mend


PER_DAY = [
    {
        "@type": "type.googleapis.com/google.rpc.QuotaFailure",
        "violations": [{"quotaId": "GenerateRequestsPerDayPerProjectPerModel-FreeTier"}],
    }
]
BAD_KEY = [{"@type": "type.googleapis.com/google.rpc.ErrorInfo", "reason": "API_KEY_INVALID"}]
FINAL = [
    *((p, refuses(401, "Invalid key", "authentication_error"), "check TEST_SERVER_KEY") for p in PROVIDERS),
    *((p, refuses(403, "Not for you", "permission_error"), "check TEST_SERVER_KEY") for p in PROVIDERS),
    *((p, refuses(404, "Not found", "NOT_FOUND"), f"there is no model '{MODELS[p]}'") for p in PROVIDERS),
    *((p, refuses(400, "Odd", "INVALID_ARGUMENT"), "the request was refused (400: Odd)") for p in PROVIDERS),
    *((p, refuses(402, "Pay first"), "quota or credit of TEST_SERVER_KEY is used up (402") for p in PROVIDERS),
    *((p, sends("", 302, {"location": "/elsewhere"}), "check --base-url") for p in PROVIDERS),
    ("google", refuses(400, "API key not valid.", "INVALID_ARGUMENT", details=BAD_KEY), "check TEST_SERVER_KEY"),
    ("google", refuses(429, "You exceeded it", "RESOURCE_EXHAUSTED", details=PER_DAY), "is used up"),
    ("openai", refuses(429, "You exceeded your current quota", "insufficient_quota"), "is used up"),
    ("anthropic", refuses(400, "Your credit balance is too low", "invalid_request_error"), "is used up"),
]


@pytest.mark.parametrize(("provider", "behavior", "words"), FINAL)
def test_what_needs_other_settings_ends_at_once(vlm, provider, behavior, words):
    ask = Ask(vlm, provider, behavior)
    error = ask.fails()
    assert error.kind == "settings"
    assert f"'{provider}:{MODELS[provider]}' can't be asked: " in str(error)
    assert words in str(error)
    assert len(vlm.requests) == len(error.attempts) == 1
    assert not ask.waits


def test_a_rate_limit_that_mentions_billing_passes(vlm):
    words = "Rate limit reached for gpt-5.2. You can increase it at https://platform.openai.com/account/billing."
    assert Ask(vlm, "openai", refuses(429, words, "rate_limit_exceeded"), replies(REPLY))().text == REPLY


VLLM = "This model's maximum context length is 8192 tokens. However, you requested 9000 tokens."
TOO_LONG = [
    ("google", 400, "The input token count (1200000) exceeds the maximum number of tokens allowed (1048576).", "INV"),
    ("google", 400, "Request payload size exceeds the limit: 20971520 bytes.", "INVALID_ARGUMENT"),
    ("openai", 400, "Your input exceeds the context window of this model.", "context_length_exceeded"),
    ("openai", 429, "Request too large for gpt-5.2 on tokens per min (TPM): Limit 30000, Requested 99000.", "tokens"),
    ("openai", 400, VLLM, "BadRequestError"),
    ("openai", 400, "The decoder prompt (length 9000) is longer than the maximum model length of 8192.", "Bad"),
    ("openai", 400, "the request exceeds the available context size, try increasing it", "exceed_context_size_error"),
    ("openai", 500, "the request exceeds the available context size. try increasing the context size", "server_error"),
    ("anthropic", 400, "prompt is too long: 210000 tokens > 200000 maximum", "invalid_request_error"),
    ("anthropic", 400, "input length and `max_tokens` exceed context limit: 190000 + 20000 > 200000", "inv"),
    ("anthropic", 413, "Request exceeds the maximum size", "request_too_large"),
]


@pytest.mark.parametrize(("provider", "status", "message", "kind"), TOO_LONG)
def test_too_long_for_the_model(vlm, provider, status, message, kind):
    error = Ask(vlm, provider, refuses(status, message, kind)).fails()
    assert error.kind == "too_long"
    assert message in str(error)
    assert len(vlm.requests) == 1


# a schema that isn't taken


NO_SCHEMA = [
    ("google", "The specified schema produces a constraint that has too many states for serving."),
    ("openai", "Invalid schema for response_format 'proposal'"),
    ("openai", "'response_format.type' must be 'text'"),
    ("anthropic", "output_config.format: The compiled grammar is too large"),
]


@pytest.mark.parametrize(("provider", "message"), NO_SCHEMA)
def test_the_same_without_a_schema_that_is_refused(vlm, provider, message):
    refusal = refuses(400, message, "INVALID_ARGUMENT" if provider == "google" else "invalid_request_error")
    ask = Ask(vlm, provider, refusal, then=replies(REPLY), tries=1)
    reply = ask()
    assert reply.text == REPLY
    assert not ask.waits
    assert message in reply.attempts[0].error
    with_schema, without = vlm.requests
    assert with_schema.schema is not None
    assert without.schema is None
    assert '"mass"' in without.instructions
    assert without.parts == with_schema.parts
    again = ask()
    assert len(vlm.requests) == 3
    assert vlm.requests[2].schema is None
    assert reply.notes == again.notes == ("asked for JSON in words, since the model or its server takes no schema",)


def test_a_schema_is_refused_only_once(vlm):
    error = Ask(vlm, "openai", then=refuses(400, "Invalid schema for response_format")).fails()
    assert error.kind == "settings"
    assert len(vlm.requests) == 2


def test_models_without_schemas_are_asked_in_words(vlm):
    vlm.script(replies(REPLY))
    client = make_client("anthropic:claude-3-haiku-20240307", vlm.url("anthropic"))
    reply = client.call(question("anthropic"))
    assert vlm.requests[0].schema is None
    assert '"mass"' in vlm.requests[0].instructions
    assert any(note.startswith("asked for JSON in words") for note in reply.notes)


def test_models_that_will_be_switched_off_are_noted(vlm):
    vlm.script(replies(REPLY))
    reply = make_client("anthropic:claude-sonnet-4-5", vlm.url("anthropic")).call(question("anthropic"))
    assert any("'claude-sonnet-4-5' is deprecated" in note for note in reply.notes)


# keys


@each
@pytest.mark.parametrize("status", [400, 401, 429, 500])
def test_a_key_that_is_echoed_is_kept_nowhere(vlm, provider, status, caplog):
    caplog.set_level(logging.DEBUG)
    echo = refuses(status, f"Your key {KEY} is wrong, Bearer {KEY}!", f"key_{KEY}", {"x-echo": KEY})
    ask = Ask(vlm, provider, then=echo, tries=2)
    error = ask.fails()
    assert "[TEST_SERVER_KEY]" in str(error)
    chain, shown = error, []
    while chain is not None:
        shown += [str(chain), repr(chain), repr(vars(chain))]
        chain = chain.__cause__ or chain.__context__
    shown += [repr(error.attempts), repr(ask.told), repr(ask.client), repr(vars(ask.client)), caplog.text]
    assert KEY not in "".join(shown)


@each
def test_nothing_of_a_call_is_logged(vlm, provider, caplog):
    caplog.set_level(logging.DEBUG)
    reply = Ask(vlm, provider, replies(f"{KEY} is what you sent", model=f"model-{KEY}"))()
    assert KEY not in repr(reply)
    assert reply.text == "[TEST_SERVER_KEY] is what you sent"
    media = base64.b64encode(VIDEO if provider == "google" else PICTURE).decode()
    for secret in (KEY, media[:30], "physicist", "too light"):
        assert secret not in caplog.text


@each
def test_another_server_is_not_sent_the_providers_key(vlm, provider, monkeypatch):
    for name in (*VARIABLES.values(), "GEMINI_API_KEY", "ANTHROPIC_AUTH_TOKEN"):
        monkeypatch.setenv(name, KEY)
    monkeypatch.setenv("ANTHROPIC_CUSTOM_HEADERS", f"x-mine: {KEY}")
    monkeypatch.setenv("OPENAI_BASE_URL", "http://192.0.2.1")
    monkeypatch.delenv("TEST_SERVER_KEY")
    vlm.script(replies(REPLY), refuses(401, "Who are you?"))
    client = make_client(f"{provider}:{MODELS[provider]}", vlm.url(provider))
    assert client.call(question(provider)).text == REPLY
    assert KEY not in json.dumps([dict(asked.headers) for asked in vlm.requests])
    with pytest.raises(CallError, match="check the key, which --key-variable names"):
        client.call(question(provider))


@each
def test_a_missing_key_is_named(provider, monkeypatch):
    with pytest.raises(ArgumentError, match=f"set the environment variable {VARIABLES[provider]}"):
        make_client(f"{provider}:{MODELS[provider]}")
    with pytest.raises(ArgumentError, match="set the environment variable MY_KEY"):
        make_client(f"{provider}:{MODELS[provider]}", "http://127.0.0.1:1", key_variable="MY_KEY")
    monkeypatch.setenv(VARIABLES[provider], f"{KEY}\nsecond line")
    with pytest.raises(ArgumentError, match=f"{VARIABLES[provider]} holds no key") as caught:
        make_client(f"{provider}:{MODELS[provider]}")
    assert KEY not in str(caught.value)


def test_both_variables_of_google_count(monkeypatch):
    monkeypatch.setenv("GEMINI_API_KEY", f" {KEY}\n")
    client = make_client("google:gemini-3.1-pro-preview")
    assert client.price_known
    assert client.takes_video


# names


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("googel:gemini-9", "there is no advisor 'googel:gemini-9'; a VLM is google:MODEL, openai:MODEL"),
        ("googel:gemini-9", "did you mean google:gemini-9?"),
        ("gemini:flash", "did you mean google:flash?"),
        ("claude-sonnet-5", "did you mean anthropic:claude-sonnet-5?"),
        ("llama", "there is no advisor 'llama'"),
        ("google", "'google' names no model; say which one, such as google:gemini-3.1-pro-preview"),
        ("google:", "'google:' names no model"),
        ("openai: ", "'openai: ' names no model"),
        ("openai:gpt 5", "'openai:gpt 5' names no model"),
    ],
)
def test_names_that_name_no_model(name, words):
    with pytest.raises(ArgumentError) as caught:
        make_client(name)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"base_url": "127.0.0.1:8000"}, "base URL is '127.0.0.1:8000'; it must begin with http"),
        ({"base_url": "http://me:secret@127.0.0.1"}, "the base URL holds a password"),
        ({"media": "video"}, "media is 'video', which openai doesn't take; choose 'auto' or 'images'"),
        ({"timeout": 0.0}, "timeout is 0 s; it must be positive"),
    ],
)
def test_settings_that_wont_do(more, words):
    with pytest.raises(ArgumentError) as caught:
        make_client("openai:gpt-5.2", **({"base_url": "http://127.0.0.1"} | more))
    assert words in str(caught.value)
    assert "secret" not in str(caught.value)


def test_who_takes_video():
    takes = {
        (name, media): make_client(f"{name}:some-model", "http://127.0.0.1:1", media=media).takes_video
        for name in PROVIDERS
        for media in ("auto", "images")
    }
    assert [which for which, video in takes.items() if video] == [("google", "auto")]
    assert make_client("google:some-model", "http://127.0.0.1:1", media="video").takes_video


@pytest.mark.parametrize(
    ("asked", "answered", "same"),
    [
        ("gpt-5.2", "gpt-5.2-2025-12-11", True),
        ("claude-sonnet-4-5", "claude-sonnet-4-5-20250929", True),
        ("gemini-2.0-flash", "gemini-2.0-flash-001", True),
        ("gemini-2.0-flash-001", "gemini-2.0-flash", True),
        ("gemini-2.5-pro", "models/gemini-2.5-pro", True),
        ("claude-sonnet-4-5-latest", "claude-sonnet-4-5-20250929", True),
        ("gemini-flash-latest", "gemini-3.8-flash", True),
        ("gemini-flash-latest", "gemini-2.5-flash-preview-09-2025", True),
        ("gemini-flash-latest", "gemini-3.5-flash-lite", False),
        ("gemini-2.5-pro", "gemini-3.1-pro-preview", False),
        ("gpt-5.2", "gpt-5.2-mini", False),
        ("gpt-5", "gpt-5.2", False),
        ("gpt-5-2025-08-07", "gpt-5-2025-12-11", False),
        ("claude-sonnet-5", "claude-opus-5", False),
    ],
)
def test_same_model(asked, answered, same):
    assert same_model(asked, answered) is same


def test_prices():
    # USD a million tokens, from the provider's list: 2 for the input and 12 for the output
    assert price("google", "gemini-3.1-pro-preview", 1000, 100) == pytest.approx(1000 * 2e-6 + 100 * 12e-6)
    cached = price("google", "gemini-3.1-pro-preview", 1000, 100, cache_read=800)
    assert 0 < cached < price("google", "gemini-3.1-pro-preview", 1000, 100)
    assert price("openai", "a-model-of-tomorrow", 1000, 100) is None


# Ctrl-C, imports, other machines


@each
@pytest.mark.parametrize("moment", ["call", "wait", "handler"])
def test_an_interrupt_ends_a_call_at_once(vlm, provider, moment):
    ask = Ask(vlm, provider, replies(REPLY), then=hangs if moment != "wait" else refuses(503, "Busy"), timeout=60)
    ask()  # so that all is imported
    threads = {thread.name for thread in threading.enumerate() if "process_request" not in thread.name}
    if moment == "wait":
        object.__setattr__(ask.client._patience, "sleep", time.sleep)
        object.__setattr__(ask.client._patience, "random", lambda: 10.0)

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


@pytest.mark.parametrize("library", ["pydantic_ai", "google.genai", "openai", "anthropic", "genai_prices"])
def test_a_missing_library_is_named(library, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingExtraError, match=r"install it with: pip install 'swim2real\[vlm\]'") as caught:
        make_client("google:gemini-3.1-pro-preview", "http://127.0.0.1:1")
    assert library.replace(".", "-") in str(caught.value)


def test_libraries_of_providers_are_imported_by_the_first_call_only():
    words = "import sys, swim2real.advisor.vlm.client; print([n for n in sys.modules if n in sys.argv[1:]])"
    names = ["pydantic_ai", "openai", "anthropic", "google.genai", "genai_prices", "httpx2"]
    found = subprocess.run([sys.executable, "-c", words, *names], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("provider", "address"),
    [
        ("google", "generativelanguage.googleapis.com"),
        ("openai", "api.openai.com"),
        ("anthropic", "api.anthropic.com"),
    ],
)
def test_the_providers_own_address(provider, address, monkeypatch, only_this_machine):
    monkeypatch.setenv(VARIABLES[provider], KEY)
    for name in ("OPENAI_BASE_URL", "ANTHROPIC_BASE_URL", "GOOGLE_GEMINI_BASE_URL"):
        monkeypatch.setenv(name, "http://192.0.2.1")  # which another program may need
    client = make_client(f"{provider}:{MODELS[provider]}", tries=1)
    with pytest.raises(CallError) as caught:
        client.call(question(provider))
    assert caught.value.kind == "unreachable"
    assert f"a test must not reach '{address}'" in str(caught.value)
    assert set(only_this_machine) == {address}
    only_this_machine.clear()

"""Keys: in no file, message, log, traceback or list of processes, whatever the server echoes, cuts off or redirects."""

import os
import subprocess
import sys

import pytest

from swim2real.advisor.vlm.client import RetryPolicy, make_client
from swim2real.advisor.vlm.errors import redact
from swim2real.advisor.vlm.exchange import CallError, Request
from swim2real.errors import ArgumentError
from vlm_server import PROVIDERS, VlmServer, refuses, sends

KEY = "sk-proj-Tk3vQx81LmZp90RbWc27HyUe"
PIECES = [KEY[i : i + 12] for i in range(len(KEY) - 11)]
each = pytest.mark.parametrize("provider", PROVIDERS)


def ask(vlm, provider):
    """The error of a call."""
    client = make_client(f"{provider}:a-model", vlm.url(provider), "THE_KEY", retry=RetryPolicy(1))
    with pytest.raises(CallError) as caught:
        client.call(Request("Be brief.", ("What differs?",), {"type": "object", "properties": {}}, 1000))
    return str(caught.value)


@pytest.fixture(autouse=True)
def the_key(monkeypatch):
    monkeypatch.setenv("THE_KEY", KEY)


def seen(text):
    return [piece for piece in PIECES if piece in text]


@each
@pytest.mark.slow
@pytest.mark.parametrize("padding", [285, 270])  # what a provider says is cut off at 300 characters
def test_a_key_that_is_cut_off_is_replaced_too(vlm, provider, padding):
    vlm.script(then=refuses(401, f"{'x' * padding} {KEY} is wrong", "authentication_error"))
    said = ask(vlm, provider)
    assert "[THE_KEY]" in said
    assert not seen(said)


@each
def test_a_body_that_is_not_of_the_protocol_and_holds_the_headers(vlm, provider):
    for body in ({"headers": f"Bearer {KEY}"}, [KEY], {"candidates": KEY, "choices": KEY, "content": KEY}, KEY):
        vlm.script(then=sends(body))
        assert not seen(ask(vlm, provider))


@each
@pytest.mark.parametrize("status", [307, *(pytest.param(n, marks=pytest.mark.slow) for n in (301, 302, 303, 308))])
def test_a_redirect_to_another_host_gets_no_request(vlm, provider, status):
    with VlmServer() as other:
        address = other.url(provider).replace("127.0.0.1", "localhost")
        vlm.script(then=sends("", status, {"location": f"{address}/?key={KEY}"}))
        said = ask(vlm, provider)
        assert f"the server sends to another address ({status}); check --base-url" in said
        assert not seen(said)
        assert len(vlm.requests) == 1
        assert not other.requests


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"key_variable": KEY}, "--key-variable must be the name of an environment variable that is set"),
        ({"key_variable": "AIza" + 35 * "a"}, "if it is the key itself"),
        ({"base_url": f"http://127.0.0.1:1/v1?key={KEY}"}, "the base URL of '127.0.0.1' goes on after a '?' or '#'"),
        ({"base_url": f"http://me:{KEY}@127.0.0.1:1/v1"}, "the base URL holds a password"),
    ],
)
def test_a_key_in_a_wrong_place_is_refused_without_a_word_of_it(more, said):
    with pytest.raises(ArgumentError) as caught:
        make_client("openai:a-model", **({"base_url": "http://127.0.0.1:1/v1"} | more))
    assert said in str(caught.value)
    assert not seen(str(caught.value))
    assert "aaaa" not in str(caught.value)


def test_words_that_are_no_piece_of_a_key_stay(monkeypatch):
    monkeypatch.setenv("THE_KEY", KEY)
    assert redact("keys begin with sk-proj-", ["THE_KEY"]) == "keys begin with sk-proj-"
    assert redact(f"<{KEY}><{KEY[3:20]}><{KEY[-12:]}>", ["THE_KEY"]) == "<[THE_KEY]><[THE_KEY]><[THE_KEY]>"
    monkeypatch.setenv("THE_KEY", "EMPTY")
    assert redact("EMPTY", ["THE_KEY"]) == "EMPTY"


@pytest.mark.slow
@each
def test_the_librarys_own_logs_show_no_key_even_where_they_are_on(vlm, provider):
    vlm.script(then=refuses(401, KEY, "authentication_error", headers={"x-echo": KEY}))
    code = f"""
import logging, sys
logging.basicConfig(level=logging.DEBUG)
from swim2real.advisor.vlm.client import RetryPolicy, make_client
from swim2real.advisor.vlm.exchange import Request
for _ in range(2):  # what the first call imports sets its own levels
    client = make_client("{provider}:a-model", "{vlm.url(provider)}", "THE_KEY", retry=RetryPolicy(1))
    client.call(Request("Be brief.", ("What differs?",), {{"type": "object", "properties": {{}}}}, 1000))
"""
    names = ("OPENAI_LOG", "ANTHROPIC_LOG", "HTTPX_LOG_LEVEL", "PYDANTIC_AI_LOG")
    environment = {**os.environ, **dict.fromkeys(names, "debug")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, env=environment)
    assert "CallError" in done.stderr
    assert not seen(done.stdout + done.stderr)
    assert "What differs" not in done.stderr

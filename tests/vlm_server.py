"""A server on this machine that speaks to clients as three providers of VLMs do, well or badly, as a test says."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Literal

Provider = Literal["google", "openai", "anthropic"]
PROVIDERS: tuple[Provider, ...] = ("google", "openai", "anthropic")


@dataclass(frozen=True)
class Asked:
    """A request as it came. Header names are in lower case."""

    path: str
    headers: Mapping[str, str]
    body: Any

    @property
    def provider(self) -> Provider:
        if ":generateContent" in self.path:
            return "google"
        return "anthropic" if self.path.endswith("/messages") or "/messages?" in self.path else "openai"

    @property
    def model(self) -> str:
        if self.provider == "google":
            return self.path.rsplit("/", 1)[1].split(":")[0]
        return self.body["model"]

    @property
    def max_tokens(self) -> int | None:
        if self.provider == "google":
            return self.body["generationConfig"].get("maxOutputTokens")
        return self.body.get("max_tokens", self.body.get("max_completion_tokens"))

    @property
    def schema(self) -> Mapping[str, Any] | None:
        """The JSON schema that the request asks the reply to keep to."""
        match self.provider:
            case "google":
                return self.body["generationConfig"].get("responseJsonSchema")
            case "openai":
                return self.body.get("response_format", {}).get("json_schema", {}).get("schema")
            case "anthropic":
                return self.body.get("output_config", {}).get("format", {}).get("schema")

    @property
    def instructions(self) -> str:
        match self.provider:
            case "google":
                return "\n".join(part["text"] for part in self.body["systemInstruction"]["parts"])
            case "openai":
                return "\n".join(m["content"] for m in self.body["messages"] if m["role"] in ("system", "developer"))
            case "anthropic":
                system = self.body["system"]
                return system if isinstance(system, str) else "\n".join(part["text"] for part in system)

    @property
    def parts(self) -> list[Any]:
        """What the user's turn holds, as it is on the wire."""
        if self.provider == "google":
            return self.body["contents"][-1]["parts"]
        content = self.body["messages"][-1]["content"]
        return [{"type": "text", "text": content}] if isinstance(content, str) else content

    @property
    def text(self) -> str:
        """All texts of the user's turn."""
        return "\n".join(part["text"] for part in self.parts if "text" in part)


@dataclass(frozen=True)
class Answer:
    """What is sent back, and how: whole, byte by byte, without an end, not at all, or with the connection closed."""

    status: int = 200
    body: bytes = b""
    headers: Mapping[str, str] = field(default_factory=dict)
    how: Literal["whole", "drip", "flood", "hang", "drop", "cut"] = "whole"


Behavior = Callable[[Asked], Answer]


def _json(body: Any, status: int = 200, headers: Mapping[str, str] | None = None) -> Answer:
    return Answer(status, json.dumps(body).encode(), {"content-type": "application/json"} | dict(headers or {}))


def replies(
    text: str | None,
    finish: Literal["stop", "length"] | str = "stop",
    model: str | None = None,
    tokens: tuple[int, int] = (1000, 200),
    thinking: int = 0,
) -> Behavior:
    """A good reply in each provider's words: of a model, with tokens of input, output and thinking.

    Without a text it has none at all; `finish` is `stop`, `length` or the provider's own word.
    """

    def answer(asked: Asked) -> Answer:
        body = {"google": _gemini, "openai": _chat, "anthropic": _message}[asked.provider](
            text, finish, model or asked.model, tokens, thinking
        )
        if asked.provider == "anthropic" and asked.body.get("stream"):
            return _streamed(body)
        return _json(body)

    return answer


def _gemini(text: str | None, finish: str, model: str, tokens: tuple[int, int], thinking: int) -> dict[str, Any]:
    candidate: dict[str, Any] = {"finishReason": {"stop": "STOP", "length": "MAX_TOKENS"}.get(finish, finish)}
    if text is not None:
        candidate["content"] = {"role": "model", "parts": [{"text": text}]}
    usage = {"promptTokenCount": tokens[0], "candidatesTokenCount": tokens[1], "thoughtsTokenCount": thinking}
    usage["totalTokenCount"] = sum(usage.values())
    return {"candidates": [candidate], "usageMetadata": usage, "modelVersion": model, "responseId": "r1"}


def _chat(text: str | None, finish: str, model: str, tokens: tuple[int, int], thinking: int) -> dict[str, Any]:
    return {
        "id": "chatcmpl-1",
        "object": "chat.completion",
        "created": 1763600000,
        "model": model,
        "choices": [{"index": 0, "message": {"role": "assistant", "content": text}, "finish_reason": finish}],
        "usage": {
            "prompt_tokens": tokens[0],
            "completion_tokens": tokens[1] + thinking,
            "total_tokens": tokens[0] + tokens[1] + thinking,
            "completion_tokens_details": {"reasoning_tokens": thinking},
        },
    }


def _message(text: str | None, finish: str, model: str, tokens: tuple[int, int], thinking: int) -> dict[str, Any]:
    return {
        "id": "msg_1", "type": "message", "role": "assistant", "model": model,
        "content": [] if text is None else [{"type": "text", "text": text}],
        "stop_reason": {"stop": "end_turn", "length": "max_tokens"}.get(finish, finish), "stop_sequence": None,
        "usage": {"input_tokens": tokens[0], "output_tokens": tokens[1] + thinking},
    }  # fmt: skip


def _streamed(message: dict[str, Any]) -> Answer:
    events: list[dict[str, Any]] = [
        {"type": "message_start", "message": message | {"content": [], "stop_reason": None}},
    ]
    for index, block in enumerate(message["content"]):
        events += [
            {"type": "content_block_start", "index": index, "content_block": {"type": "text", "text": ""}},
            {"type": "content_block_delta", "index": index, "delta": {"type": "text_delta", "text": block["text"]}},
            {"type": "content_block_stop", "index": index},
        ]
    delta = {"stop_reason": message["stop_reason"], "stop_sequence": None}
    events += [{"type": "message_delta", "delta": delta, "usage": message["usage"]}, {"type": "message_stop"}]
    body = "".join(f"event: {event['type']}\ndata: {json.dumps(event)}\n\n" for event in events)
    return Answer(200, body.encode(), {"content-type": "text/event-stream"})


def refuses(
    status: int,
    message: str,
    kind: str = "",
    headers: Mapping[str, str] | None = None,
    details: list[Any] | None = None,
) -> Behavior:
    """An error in each provider's words, with its kind for machines, headers and Gemini's details."""

    def answer(asked: Asked) -> Answer:
        match asked.provider:
            case "google":
                error = {"code": status, "message": message, "status": kind} | ({"details": details} if details else {})
                return _json({"error": error}, status, headers)
            case "openai":
                return _json({"error": {"message": message, "type": kind, "code": kind}}, status, headers)
            case "anthropic":
                return _json({"type": "error", "error": {"type": kind, "message": message}}, status, headers)

    return answer


def sends(body: Any, status: int = 200, headers: Mapping[str, str] | None = None) -> Behavior:
    """Exactly this: JSON, or a text such as a page of HTML."""
    if isinstance(body, str):
        return lambda asked: Answer(status, body.encode(), {"content-type": "text/html"} | dict(headers or {}))
    return lambda asked: _json(body, status, headers)


def hangs(asked: Asked) -> Answer:
    """No answer until the server is closed."""
    return Answer(how="hang")


def drops(asked: Asked) -> Answer:
    """Closes the connection without a word."""
    return Answer(how="drop")


def cuts(asked: Asked) -> Answer:
    """Closes the connection in the middle of the reply."""
    return Answer(200, replies("{}")(asked).body, how="cut")


def drips(asked: Asked) -> Answer:
    """A space every 20 ms, for ever."""
    return Answer(how="drip")


class VlmServer:
    """Answers on 127.0.0.1 as it was told, and keeps all requests in their order."""

    def __init__(self) -> None:
        self.requests: list[Asked] = []
        self._script: list[Behavior] = []
        self._then: Behavior = refuses(500, "the test's server has no answer left")
        self._closed = threading.Event()
        self._lock = threading.Lock()
        outer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self) -> None:
                outer._answer(self)

            def do_GET(self) -> None:
                outer._answer(self)

            def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
                pass

        class Server(ThreadingHTTPServer):
            daemon_threads = True

            def handle_error(self, request: Any, client_address: Any) -> None:
                pass  # a client that went away

        self._server = Server(("127.0.0.1", 0), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True)
        self._thread.start()

    def script(self, *behaviors: Behavior, then: Behavior | None = None) -> VlmServer:
        """Says what to answer to the next requests, one after the other, and what to all others."""
        with self._lock:
            self._script = list(behaviors)
            if then is not None:
                self._then = then
        return self

    def url(self, provider: Provider) -> str:
        """The base URL to give to a client of this provider."""
        host, port = self._server.server_address[:2]
        return f"http://{host}:{port}" + ("/v1" if provider == "openai" else "")

    def close(self) -> None:
        self._closed.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def __enter__(self) -> VlmServer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _answer(self, handler: BaseHTTPRequestHandler) -> None:
        raw = handler.rfile.read(int(handler.headers.get("content-length", 0)))
        asked = Asked(
            handler.path, {k.lower(): v for k, v in handler.headers.items()}, json.loads(raw) if raw else None
        )
        with self._lock:
            self.requests.append(asked)
            behavior = self._script.pop(0) if self._script else self._then
        answer = behavior(asked)
        if answer.how == "hang":
            self._closed.wait()
        if answer.how in ("hang", "drop"):
            handler.close_connection = True
            return
        handler.send_response(answer.status)
        for name, value in answer.headers.items():
            handler.send_header(name, value)
        if answer.how in ("drip", "flood"):
            handler.send_header("content-type", "application/json")
            handler.send_header("content-length", "1000000" if answer.how == "drip" else "1000000000000")
            handler.end_headers()
            while not self._closed.wait(0.02 if answer.how == "drip" else 0):
                handler.wfile.write(b" " if answer.how == "drip" else b" " * 1_000_000)
                handler.wfile.flush()
            return
        handler.send_header("content-length", str(len(answer.body)))
        handler.end_headers()
        if answer.how == "cut":
            handler.wfile.write(answer.body[: len(answer.body) // 2])
            handler.close_connection = True
            return
        handler.wfile.write(answer.body)

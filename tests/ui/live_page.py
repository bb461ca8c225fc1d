"""A server of the page over a small folder, and a client that says what it likes."""

import asyncio
import base64
import http.client
import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

pytest.importorskip("tornado", reason="the page needs tornado; install the extra ui")

from swim2real.ui.project import Project
from swim2real.ui.server import listening, serve

FILM = "f0_50.mp4"


def unpacked(text: str, *shape: int) -> np.ndarray:
    """Places that the page gets."""
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(*shape, 2)


class Response(NamedTuple):
    """What came back."""

    status: int
    body: bytes
    headers: dict[str, str]


class Served:
    """A server under way."""

    def __init__(self, project: Project, address: str) -> None:
        self.project, self.address = project, address
        self.port, self.token = int(address.split(":")[2].split("/")[0]), address.split("#")[1]

    def ask(
        self, method: str, path: str, body: bytes | None = None, *, token: str | None = None, **headers: str
    ) -> tuple[int, bytes]:
        """Status and body of a request; with the page's own headers where none are given."""
        answer = self.response(method, path, body, token=token, **headers)
        return answer.status, answer.body

    def response(
        self, method: str, path: str, body: bytes | None = None, *, token: str | None = None, **headers: str
    ) -> Response:
        """The same with headers."""
        sent = {"Host": f"127.0.0.1:{self.port}", "Authorization": f"Bearer {token or self.token}"}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in {**sent, "Content-Length": str(len(body or b"")), **headers}.items():
                connection.putheader(name, value)
            connection.endheaders(body)
            answer = connection.getresponse()
            return Response(answer.status, answer.read(), dict(answer.headers))
        finally:
            connection.close()

    def call(self, name: str, body: Any = None, query: str = "") -> Any:
        """What a call of the page answers, which must go well."""
        content = None if body is None else json.dumps(body).encode()
        status, answer = self.ask("POST" if content is not None else "GET", f"/api/{name}{query}", content)
        assert status == 200, answer
        return json.loads(answer)

    def ended(self) -> dict[str, Any]:
        """The job, once it has ended."""
        assert self.project.jobs.last is not None
        assert self.project.jobs.last.done.wait(250)
        return self.call("job")


@contextmanager
def serving(folder: Path) -> Iterator[Served]:
    project, loop, ready = Project(folder), asyncio.new_event_loop(), threading.Event()
    address: list[str] = []

    def found(text: str) -> None:
        address.append(text)
        ready.set()

    sockets = listening(0)
    task = loop.create_task(serve(project, sockets, found))

    def run() -> None:
        with pytest.raises(asyncio.CancelledError):
            loop.run_until_complete(task)
        loop.run_until_complete(loop.shutdown_default_executor())
        loop.close()

    thread = threading.Thread(target=run)
    thread.start()
    assert ready.wait(10)
    try:
        yield Served(project, address[0])
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join(30)


class Tunnel:
    """The near end of a tunnel to a port of this machine.

    Attributes:
        to: The port.
        port: Where it listens.
        state: `open`; `cut`: what is open ends and nobody is let in; `silent`: nothing comes through any more.
    """

    def __init__(self, to: int) -> None:
        self.state, self.to = "open", to
        self._near = socket.create_server(("127.0.0.1", 0))
        self.port = self._near.getsockname()[1]

    def __enter__(self) -> "Tunnel":
        threading.Thread(target=self._listen, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.state = "cut"
        self._near.close()

    def _listen(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._near.accept()
                if self.state == "cut":
                    near.close()
                    continue
                far = socket.create_connection(("127.0.0.1", self.to))
                for one, other in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=(one, other), daemon=True).start()

    def _carry(self, one: socket.socket, other: socket.socket) -> None:
        one.settimeout(0.1)
        with suppress(OSError), one, other:
            lost = False
            while self.state != "cut":
                try:
                    content = one.recv(1 << 16)
                except TimeoutError:
                    continue
                if not content:
                    break
                lost |= self.state == "silent"
                if not lost:  # what has lost something stays silent
                    other.sendall(content)

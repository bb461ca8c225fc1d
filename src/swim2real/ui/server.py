"""The server of the page: who may ask, and for what. It listens on 127.0.0.1 alone.

A request is answered that names this machine as its host, comes from the page itself, and has the token in a header.
The token stands behind `#` in the page's address, which a browser sends nowhere; a cookie would be shared by all ports.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import re
import secrets
import shutil
import socket
import sys
import tempfile
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler

from markertrack.pages import filled
from swim2real.ui.calls import CALLS, Picture
from swim2real.ui.project import Project
from swimbase.checking import check
from swimbase.errors import ArgumentError, Swim2RealError

ADDRESS = "127.0.0.1"
_LOCAL = re.compile(r"(localhost|127\.0\.0\.1|\[::1\])(:[0-9]{1,5})?")  # also of the near end of a tunnel
_MOST_BODY, _MOST_HEADER = 1 << 20, 1 << 14  # bytes
_HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'none'", "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer", "Cache-Control": "no-store", "Cross-Origin-Resource-Policy": "same-origin",
}  # fmt: skip


class _Guarded(RequestHandler):
    """Refuses all but the page's own requests; an error is a sentence as JSON."""

    @property
    def project(self) -> Project:
        """The folder that is served."""
        return self.settings["project"]

    def set_default_headers(self) -> None:
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        host, origin = self.request.headers.get("Host", ""), self.request.headers.get("Origin")
        if not _LOCAL.fullmatch(host) or origin not in (None, f"http://{host}"):
            raise HTTPError(403)

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        error = kwargs.get("exc_info", (None, None))[1]
        sentence = str(error) if isinstance(error, Swim2RealError) else f"{status_code}: {self._reason}"
        self.finish({"error": sentence})


class _Page(_Guarded):
    """The page, which holds nothing of the folder: what it shows it asks for, with the secret of its address."""

    def get(self) -> None:
        template = Path(__file__).parent / "ui.html"
        self.finish(filled(template, "swim2real ui", "", {}, allowed=" blob:; connect-src 'self'; media-src 'self'"))


class _Call(_Guarded):
    """A call of the page: arguments from the query or a body of JSON, checked against what the call takes."""

    def prepare(self) -> None:
        super().prepare()
        given = self.request.headers.get("Authorization", "")
        if not secrets.compare_digest(given.encode(errors="replace"), f"Bearer {self.settings['token']}".encode()):
            raise HTTPError(403)

    async def get(self, name: str) -> None:
        await self._answer(name, {key: values[-1].decode("utf-8", "replace")
                                  for key, values in self.request.query_arguments.items()})  # fmt: skip

    async def post(self, name: str) -> None:
        try:
            content = json.loads(self.request.body or b"{}")
        except (ValueError, RecursionError):
            raise HTTPError(400) from None
        await self._answer(name, content)

    async def _answer(self, name: str, content: object) -> None:
        model, call = CALLS.get(f"{self.request.method} {name}", (None, None))
        if model is None or call is None:
            raise HTTPError(404)
        try:
            asked = check(model, content, f"call '{name}'", ArgumentError)
            answer = await asyncio.to_thread(call, self.project, asked)
        except (Swim2RealError, OSError) as error:
            self.set_status(400)
            self.finish({"error": str(error)})
            return
        if isinstance(answer, Picture):
            self.set_header("Content-Type", "image/jpeg")
            self.set_header("X-Frame", str(answer.number))
            self.finish(answer.content)
            return
        self.set_header("Content-Type", "application/json")
        self.finish(json.dumps(answer, default=vars, allow_nan=False))


class _Film(_Guarded, StaticFileHandler):
    """A film for the browser's own player, which sends no header: its address has a secret, of this film alone."""

    async def get(self, path: str, include_body: bool = True) -> None:
        secret, _, name = path.partition("/")
        if not secrets.compare_digest(secret.encode(), self.project.seal(name).encode()):
            raise HTTPError(403)
        self.project.place(name)
        await super().get(name, include_body)

    def compute_etag(self) -> str | None:
        return None  # it would be of all of the film's bytes


def listening(port: int) -> list[socket.socket]:
    """Sockets on a port of this machine alone; port 0 is any that is free.

    Raises:
        ArgumentError: The port can't be used.
    """
    if not 0 <= port < 1 << 16:
        raise ArgumentError(f"--port is {port}; it must be 0 (any that is free) to 65535")
    try:
        one = socket.create_server((ADDRESS, port))
        one.setblocking(False)
        return [one]
    except OSError as error:
        raise ArgumentError(
            f"--port {port} can't be used ({error.strerror}); another program may have it: leave --port out"
        ) from error


async def serve(
    project: Project, sockets: list[socket.socket], on_address: Callable[[str], None], token: str | None = None
) -> None:
    """Serves a folder until it is cancelled.

    Args:
        project: The folder.
        sockets: Where it listens.
        on_address: Called with the page's address, token included.
        token: The token; by default a new one.
    """
    for log in ("tornado.access", "tornado.general"):  # a stranger's requests are no news
        logging.getLogger(log).setLevel(logging.CRITICAL)
    token = token or secrets.token_urlsafe(24)
    routes = [(r"/", _Page), (r"/api/([a-z]+)", _Call), (r"/film/(.+)", _Film, {"path": str(project.root)})]
    app = Application(routes, token=token, project=project)
    server = HTTPServer(app, max_body_size=_MOST_BODY, max_buffer_size=2 * _MOST_BODY, max_header_size=_MOST_HEADER)
    server.add_sockets(sockets)
    try:
        on_address(f"http://{ADDRESS}:{sockets[0].getsockname()[1]}/#{token}")
        await asyncio.Event().wait()
    finally:
        server.stop()
        await server.close_all_connections()


def open_browser(address: str) -> Callable[[], None] | None:
    """Opens the page by way of a file that only its user can read, since others see a browser's command line.

    Returns:
        What removes the file; None where there is no browser.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return None
    folder = Path(tempfile.mkdtemp(prefix="swim2real-ui-"))  # which has the mode 0700
    file = folder / "open.html"
    file.touch(0o600)
    file.write_text(f'<!DOCTYPE html><meta http-equiv="refresh" content="0;url={address}">', "utf-8")
    if webbrowser.open(file.as_uri()):
        return lambda: shutil.rmtree(folder, ignore_errors=True)
    shutil.rmtree(folder)
    return None

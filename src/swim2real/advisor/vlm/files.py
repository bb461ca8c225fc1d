"""A client without a key: a folder a round, in which a person, or any chat window, leaves a reply."""

from __future__ import annotations

import mimetypes
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from swim2real.advisor.vlm.exchange import Attempt, Reply, Request
from swim2real.advisor.vlm.transcript import CALLS
from swimbase.errors import AdvisorError, WaitingForReply
from swimbase.escaping import plain_markdown
from swimbase.store import MOST_TEXT, read_bytes, write_bytes, write_json, write_text, writing

BRIEFING, SCHEMA, REPLY, PROBLEM = "briefing.md", "reply.schema.json", "reply.json", "reply.problem.txt"
INSTRUMENTS = "instruments.md"
_POLL = 0.5  # s

HOW_TO = f"""\
*Leave the answer as `{REPLY}` in this folder. In a chat window: give it this page and the pictures, save its answer. \
By hand: only the parameters that change are needed, as in `{{"parameters": {{"NAME": 1.5}}}}`; with `"probe": true` \
they are only measured. `{SCHEMA}` describes the whole.*
"""


class FilesClient:
    """Writes the question to a folder and waits for the reply there. A `Client`.

    Attributes:
        name: `files`.
        takes_video: Whether films are written beside the page, in place of pictures.
        price_known: False, since a person's reply has no price.
    """

    name = "files"
    price_known = False

    def __init__(
        self, run: str | Path, schema: Mapping[str, Any], takes_video: bool = False, once: bool = False,
        on_wait: Callable[[str, int], None] = lambda text, number: None,
    ) -> None:  # fmt: skip
        """Prepares the client.

        Args:
            run: Run folder.
            schema: JSON schema of a reply, with bounds.
            takes_video: Whether films are written in place of pictures.
            once: Whether to leave with `WaitingForReply` instead of waiting where there is no reply yet.
            on_wait: Called with a sentence and the round when the wait begins.
        """
        self._folder, self._schema, self.takes_video = Path(run) / CALLS, schema, takes_video
        self._once, self._on_wait = once, on_wait
        self._unusable = ""

    def call(self, request: Request, on_attempt: Callable[[Attempt], None] = lambda attempt: None) -> Reply:
        """Writes the page, or what is wrong with the reply that is there, and waits for a reply or a better one.

        Raises:
            WaitingForReply: There is no reply, and the client was made not to wait.
            AdvisorError: The disk failed.
        """
        turn = f"_turn_{request.turn:02d}" if request.turn > 1 else ""
        folder = self._folder / f"round_{request.round:03d}{turn}"
        began = time.monotonic()
        with writing(folder, AdvisorError, "make room or allow writing, --resume goes on"):
            if request.is_repair:
                write_text(folder / PROBLEM, f"{request.problem}\n")
            elif request.answers:
                write_text(folder / INSTRUMENTS, f"{request.answers}\n")
            else:
                self._unusable = ""
                if not ((folder / REPLY).is_file() and (folder / BRIEFING).is_file()):  # what is answered stays
                    self._write_briefing(folder, request)
            try:
                text = self._wait(folder, request)
            except ValueError as error:
                message = f"reply '{folder / REPLY}' isn't read: {error}; shorten it, --resume goes on"
                raise AdvisorError(message) from error
            (folder / PROBLEM).unlink(missing_ok=True)
        self._unusable = text
        return Reply(text, "stop", None, None, None, None, attempts=(Attempt(time.monotonic() - began),))

    def _write_briefing(self, folder: Path, request: Request) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        page = [request.instructions, HOW_TO]
        count = 0
        for part in request.parts:
            if isinstance(part, str):
                page.append(part)
                continue
            count += 1
            name = f"{count}{mimetypes.guess_extension(part.media_type) or ''}"
            write_bytes(folder / name, part.data)
            mark = "!" if part.media_type.startswith("image/") else ""
            page.append(f"{plain_markdown(part.label)}\n\n{mark}[{name}]({name})")
        write_json(folder / SCHEMA, self._schema)
        write_text(folder / BRIEFING, ("\n\n".join(page) + "\n").encode("utf-8", "replace").decode())

    def _wait(self, folder: Path, request: Request) -> str:
        path = folder / REPLY
        announced, before = False, None
        while True:
            text = read_bytes(path, MOST_TEXT).decode("utf-8", "replace") if path.is_file() else ""
            # once more the same: whoever saves it is done
            if text.strip() and text != self._unusable and (text == before or self._once):
                return text
            if self._once:
                page, what = folder / (INSTRUMENTS if request.answers else BRIEFING), "leave the reply as"
                if request.is_repair:
                    what = f"'{folder / PROBLEM}' says what is wrong with"
                raise WaitingForReply(
                    f"round {request.round} waits: read '{page}'; {what} '{path}'; then --resume goes on"
                )
            if not announced:
                announced = True
                page = folder / (INSTRUMENTS if request.answers else BRIEFING)
                self._on_wait(f"'{page}' waits for '{path}'", request.round)
            before = text
            time.sleep(_POLL)

"""`ui`: the live page over a folder."""

from __future__ import annotations

import socket
from pathlib import Path

from tyro.conf import Positional

from swim2real.cli.options import word
from swim2real.cli.terminal import say, tell
from swim2real.settings import PHYSICS, VlmAccess
from swimbase.errors import MissingExtraError


def ui(
    folder: Positional[Path] = Path(), access: VlmAccess = VlmAccess(), *, advisor: str = PHYSICS, port: int = 0,  # noqa: B008
    no_browser: bool = False,
) -> int:  # fmt: skip
    """Open a page in the browser on which films become fits: points, tracks, sliders, searches, results.

    Shows the films, references, runs and robot files of a folder, and writes the files that the other commands write.
    Only this machine can reach it, and only who knows the page's address, which holds a secret. Ctrl-C ends it.

    Args:
        folder: Folder with films, or one that `demo` wrote; the page reads and writes nothing outside of it.
        access: Access to a VLM, for --advisor PROVIDER:MODEL.
        advisor: Who is asked by the page's button; physics: built in. google:MODEL, openai:MODEL, anthropic:MODEL: a
            VLM, as for calibrate.
        port: Port on 127.0.0.1; 0 is any that is free.
        no_browser: Print the page's address, for a tunnel, as is done where there is no browser.
    """
    import asyncio
    import contextlib

    try:
        from swim2real.ui.server import listening, open_browser, serve
    except ModuleNotFoundError as error:
        if error.name != "tornado":
            raise
        raise MissingExtraError("the page needs tornado; install it with: pip install 'swim2real[ui]'") from None
    from swim2real.processes import ProcessPool
    from swim2real.ui.project import Project

    project, sockets = Project(folder, advisor=advisor, access=access), listening(port)
    with contextlib.ExitStack() as stack:

        def opened(address: str) -> None:
            remove = None if no_browser else open_browser(address)
            if remove is not None:
                stack.callback(remove)
                say(f"{folder}: the page is open in your browser. Ctrl-C ends it; --no-browser prints its address.")
                return
            number = sockets[0].getsockname()[1]
            say(f"{word(folder)}: {address}")
            say(f"From another machine: ssh -L {number}:127.0.0.1:{number} {socket.gethostname()}, then that address.")

        pool = ProcessPool(1, tries=1)  # so that the page answers meanwhile
        stack.callback(pool.shutdown, False)
        pool.submit(_compile)
        with contextlib.suppress(KeyboardInterrupt):
            asyncio.run(serve(project, sockets, opened))
    job = project.jobs.last
    if job is not None and not job.done.is_set():
        project.jobs.stop()
        tell(f"ending '{job.now.title}'; what it has done is kept. Ctrl-C again doesn't wait")
        job.done.wait()
    return 0


def _compile() -> None:
    """Has trackers and simulator compiled, while a person clicks: up to two minutes on a new machine."""
    from dataclasses import replace

    from markertrack.film import HowToTrack, track_film
    from markertrack.span import Span
    from swim2real import api
    from swim2real.demo.example import FILMS
    from swim2real.robots import load_robot

    fish = load_robot("fish")
    for chain in (False, True):
        layout, how = replace(fish.layout, chain=chain), HowToTrack(span=Span(until=0.1))
        track_film(FILMS / "f0_50.mp4", FILMS / "f0_50.points.json", layout, how)
    api.simulate(fish.space.published, fish, [1.0], seconds=0.1, threads=1)

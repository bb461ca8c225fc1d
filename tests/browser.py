"""Opens pages in Chromium, without a screen and without a network."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

_OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--enable-logging=stderr",
)  # fmt: skip
_POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')


def browser() -> str:
    """Chromium; a test is skipped on a machine without it."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        pytest.skip("no Chromium on this machine; install chromium to see what it makes of a page")
    return found


def opened(page: Path, *options: str, milliseconds: int = 20000) -> tuple[str, str]:
    """What a page has become after some time of its own clock, and what the browser says of it.

    Args:
        page: The page, in a folder that the browser's profile goes to as well.
        options: More options of the browser.
        milliseconds: How far the page's clock goes [ms].
    """
    done = subprocess.run(
        [
            browser(), *_OPTIONS, f"--user-data-dir={page.parent / 'profile'}",
            f"--virtual-time-budget={milliseconds}", *options, "--dump-dom", page.as_uri(),
        ],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    return done.stdout, done.stderr


def open_to_scripts(page: str) -> str:
    """The page without the policy that lets only its own script run: a test puts one of its own into it."""
    assert len(_POLICY.findall(page)) == 1
    return _POLICY.sub("", page)

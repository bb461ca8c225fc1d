"""Opens pages in Chromium, without a screen and without a network."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any
from urllib.parse import unquote

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
    """What a page has become after some time of its own clock [ms], and what the browser says of it."""
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


# what came of a scenario: what was downloaded, what the hand said, and what went wrong on the page
_PLAYED = """
const said = [], downloads = [], names = [], wrong = [];
const keep = URL.createObjectURL;
URL.createObjectURL = blob => { downloads.push(blob); return keep.call(URL, blob); };
HTMLAnchorElement.prototype.click = function () { names.push(this.download); };
for (const kind of ["error", "unhandledrejection", "securitypolicyviolation"])
  addEventListener(kind, event => wrong.push(`${kind}: ${event.message ?? event.reason ?? event.blockedURI}`));
const key = (key, more = {}) =>
  document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true, ...more }));
const press = id => document.getElementById(id).click();
const alert_ = () => document.getElementById("alert").textContent;
HAND
addEventListener("load", async () => {
  let result;
  try {
    await (async () => { SCENARIO })();
    result = { files: await Promise.all(downloads.map(blob => blob.text())), names, said, wrong };
  } catch (error) { result = { error: String(error.stack) }; }
  const out = document.createElement("pre");
  out.id = "result";
  out.textContent = encodeURIComponent(JSON.stringify(result));
  document.body.append(out);
});
"""


def played(page: Path, place: Path, hand: str, scenario: str, window: str = "1400,860") -> dict[str, Any]:
    """Plays a scenario on a page and returns what came of it: its files, their names, and what it pushed to `said`.

    The page is put at `place`, with a script in it: the scenario calls `key`, `press`, `alert_` and those of `hand`.
    """
    script = _PLAYED.replace("HAND", hand).replace("SCENARIO", scenario)
    # without a screen there are no animation frames
    clock = "<script>window.requestAnimationFrame = step => setTimeout(step, 1);</script></head>"
    text = open_to_scripts(page.read_text(encoding="utf-8")).replace("</head>", clock)
    place.write_text(text.replace("</body>", f"<script>{script}</script></body>"), encoding="utf-8")
    shown, _ = opened(place, f"--window-size={window}", milliseconds=8000)
    found = re.search(r'<pre id="result">([^<]*)</pre>', shown)
    assert found, shown[-2000:]
    result = json.loads(unquote(found.group(1)))
    assert "error" not in result, result["error"]
    assert result["wrong"] == []
    return result

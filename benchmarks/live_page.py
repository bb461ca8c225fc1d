"""Times of the live page in headless Chromium: `python benchmarks/live_page.py FOLDER`.

FOLDER is one that `swim2real demo --out` wrote, or one with films alone, of which the first is sought in.
"""

import os
import random
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import psutil
from playwright.sync_api import Page, sync_playwright

STEP = """async i => {   // one step of a slider: until its answer has come, and until it is drawn
  const slider = document.querySelectorAll("#sliders input")[i % 3], begun = performance.now(), { fetch } = window;
  const answered = new Promise(done => window.fetch = async (...asked) => {
    const answer = await fetch(...asked);
    if (String(asked[0]).includes("simulate") && asked[1].body.includes('"trial"')) done(performance.now());
    return answer;
  });
  slider.value = +slider.value + (slider.value > 0.5 ? -0.01 : 0.01) * (1 + i % 5);
  for (const kind of ["input", "change"]) slider.dispatchEvent(new Event(kind));
  await answered;
  window.fetch = fetch;
  await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
  return performance.now() - begun;
}"""
DRAG = """async seconds => {   // pictures a second while a slider is dragged
  const slider = document.querySelector("#sliders input"), { fetch } = window, from = +slider.value;
  let answers = 0;
  window.fetch = async (...asked) => {
    const answer = await fetch(...asked);
    if (String(asked[0]).includes("simulate") && asked[1].body.includes('"trial"')) answers++;
    return answer;
  };
  const begun = performance.now();
  for (; performance.now() - begun < 1e3 * seconds; await new Promise(requestAnimationFrame)) {
    slider.value = from + 0.1 * Math.sin(performance.now() / 500);
    slider.dispatchEvent(new Event("input"));
  }
  window.fetch = fetch;
  slider.dispatchEvent(new Event("change"));
  return answers / seconds;
}"""
PLAY = """async seconds => {   // frames shown, and pictures of the screen, per second
  const at = document.querySelector("#at"), play = document.querySelector("#play"), seen = [];
  play.click();
  await new Promise(done => setTimeout(done, 500));
  let screens = 0;
  const begun = performance.now();
  for (; performance.now() - begun < 1e3 * seconds; screens++) {
    if (at.textContent !== seen.at(-1)) seen.push(at.textContent);
    await new Promise(requestAnimationFrame);
  }
  play.click();
  return [seen.length / seconds, screens / seconds];
}"""
SEEK = """async n => {   // until a picture near the frame is shown, and until it is the frame
  const slider = document.querySelector("#time"), at = document.querySelector("#at"), was = at.textContent;
  const begun = performance.now();
  let first = null;
  slider.value = n;
  slider.dispatchEvent(new Event("input"));
  while (!at.textContent.startsWith(`${n} `)) {
    if (at.textContent !== was) first ??= performance.now() - begun;
    await new Promise(done => setTimeout(done, 2));
  }
  return [first ?? performance.now() - begun, performance.now() - begun];
}"""


def spent(root: int) -> float:
    """Processor time of a process and those that it began [s]."""
    processes = [psutil.Process(root), *psutil.Process(root).children(recursive=True)]
    return sum(sum(process.cpu_times()[:2]) for process in processes if process.is_running())


def told(what: str, server: float, browser: float) -> None:
    print(f"{what}; processor time: server {server:.3f} s, browser {browser:.3f} s; load {os.getloadavg()[0]:.1f}")


def measure(page: Page, server: int) -> None:
    def both() -> tuple[float, float]:
        of_server = spent(server)
        return of_server, spent(os.getpid()) - of_server

    def played(where: str) -> None:
        before = both()
        frames, screens = page.evaluate(PLAY, 4)
        used = [(b - a) / 4.5 for a, b in zip(before, both(), strict=True)]
        told(f"{where}, played: {frames:.1f} frames a second, the screen {screens:.1f}", *used)

    if page.locator("#fitting").is_visible():
        page.locator("#trials output:has-text('mm')").first.wait_for()
        for k in range(page.locator("#trials button").count()):
            page.locator("#trials button").nth(k).click()
            time.sleep(3)
            before = both()
            steps = [page.evaluate(STEP, i) for i in range(20)]
            used = [(b - a) / 20 for a, b in zip(before, both(), strict=True)]
            told(f"trial {k}, a slider's step: median {statistics.median(steps):.0f} ms", *used)
            print(f"trial {k}, dragged: {page.evaluate(DRAG, 4):.1f} pictures a second")
            time.sleep(2)
            played(f"trial {k}")
        page.click("#tofilm")
        time.sleep(3)
    played("film")
    last = int(page.get_attribute("#time", "max") or 0)
    before, pairs = both(), [page.evaluate(SEEK, random.Random(k).randrange(last)) for k in range(20)]
    used = [(b - a) / 20 for a, b in zip(before, both(), strict=True)]
    first, exact = (statistics.median(times) for times in zip(*pairs, strict=True))
    told(f"film, any frame: near it {first:.0f} ms, itself {exact:.0f} ms", *used)


@contextmanager
def opened(folder: str, height: int = 900, script: str = "") -> Iterator[tuple[Page, int]]:
    """The page of a folder in Chromium, with a script of one's own, and the server's process."""
    command = [sys.executable, "-u", "-m", "swim2real", "ui", folder, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server, sync_playwright() as started:
        assert server.stdout is not None
        line = server.stdout.readline()
        chromium = started.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = chromium.new_page(viewport={"width": 1280, "height": height})
        page.set_default_timeout(180_000)
        page.add_init_script(script)
        page.goto(line[line.index("http://") :].strip())
        page.locator("#at:has-text('s')").wait_for()
        try:
            yield page, server.pid
        finally:
            chromium.close()
            server.terminate()


if __name__ == "__main__":
    with opened(sys.argv[1]) as (page, server):
        time.sleep(3)
        measure(page, server)

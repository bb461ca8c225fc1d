"""Every page with hostile text wherever text from outside comes to it: no script, element, address or turned text.

Text of a run folder is hostile in any way; the names that readers check (`swimbase.names`) are passed by the tests
unchecked, so the pages hold without that.
"""

import json
import re
import socket
import unicodedata
from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from made_pages import MARKERS, ROBOT, SPACE, Run, check_charts
from test_calls import VlmRun, film, notes, picture

from browser import open_to_scripts, opened
from made_results import MARKERS as COMPARED_MARKERS
from made_results import TRIALS, two_methods
from markertrack.pages import write_pick_page
from markertrack.quality import LostMarkers
from markertrack.track import MarkerTrack
from run_settings import record_of
from swim2real.calibration import RunFolder
from swim2real.calibration.run_folder import TRIALS as SAVED
from swim2real.parameters import ParameterSpace
from swim2real.report import write_quality_page, write_report
from swim2real.report.comparison_page import write_comparison_report
from swim2real.robots.fish import FISH
from swim2real.robots.robot import PolicySetup, Robot
from swim2real.trials import Trial
from swimbase.names import file_name_fault

OWN = "document.documentElement.setAttribute('data-pwned', 1)"
ELSEWHERE = "http://127.0.0.1:1/leak"  # a port where nobody listens; the tests with a browser put their own
ATTACKS = (
    f"<script>{OWN}</script>",
    f"</title></style></textarea></script><script>{OWN}</script>",
    f"<img src='{ELSEWHERE}.png' onerror=\"{OWN}\">",
    f'"><svg onload="{OWN}"><style>@import url({ELSEWHERE}.css);</style></svg>',
    f"' onmouseover='{OWN}' style='background: url({ELSEWHERE})' x='\" onfocus=\"{OWN}\" autofocus x=\"",
    f"<a href=\"javascript:{OWN}\">x</a><iframe src='{ELSEWHERE}'></iframe><link rel=stylesheet href='{ELSEWHERE}'>",
    f"<meta http-equiv=refresh content='0; url={ELSEWHERE}'><base href='{ELSEWHERE}'><form action='{ELSEWHERE}'>",
    f']]> --> ?> <!-- <![CDATA[ <title> xmlns=" d="1.23456 #c62828 transform="rotate(-0 {OWN}',
    "{{ 7 * 7 }} {% include 'run.html.j2' %} @@DATA@@ &lt;script&gt; &#60;b&#62; $\\notacommand{$ $\\frac{1}{2}$ _x",
    "a\u202eb\u2066c\u200bd\ufeffe\x1b[31mf\x0bg\x07h\x9bi\u2028j\r\nk",
)
ATTACK = " ".join(ATTACKS)
FOLDER = f"<img src=x onerror={OWN}>\u202e{{{{ 7 * 7 }}}}&lt;b&gt;".replace("/", "")  # of a run; as a system allows it
# what the program itself reads of these files, so that others would be another sentence
READ = {
    "format", "protocol", "scale", "media", "media_type", "sha256", "outcome", "loss_figure", "kind", "robot",
    "protocols", "turn",
}  # fmt: skip


def poisoned(content: Any, names: dict[str, str]) -> Any:
    """JSON in which every text but those that are read is hostile, and names are others, also as keys."""
    if isinstance(content, dict):
        return {
            names.get(key, key): value if key in READ and isinstance(value, str) else poisoned(value, names)
            for key, value in content.items()
        }
    if isinstance(content, list):
        return [poisoned(value, names) for value in content]
    return names.get(content, ATTACK) if isinstance(content, str) else content


def hostile(*names: str) -> dict[str, str]:
    """A hostile name for each name, about as long as one may be."""
    return {name: f"{ATTACKS[i % len(ATTACKS)]} {name}" for i, name in enumerate(names)}


def run_page(folder: Path) -> Path:
    return write_report(*hostile_run(folder))


def hostile_run(folder: Path) -> tuple[Path, Robot]:
    run = VlmRun(folder / FOLDER)
    run.advisor = f"openai:{ATTACK}"
    run.add(0.3, (0.5, 0.5, 0.5))
    run.ask(1, "used", picture("a"), film("a"), problem="p")
    run.tell(1, 0.2, **notes([1], clipped={"arm": 0.2}, ignored=["a"], missing=["b"], remarks=["c"], note="d"))
    steady = {"point": [0.1, 0.1, 0.9], "notes": {}}
    run.add(0.5, (0.1, 0.1, 0.9), "the simulation grew", round=2, step_size=1.0, proposal=steady)
    Run.conclude(run, 0.2)
    names = hostile("arm", "stiffness", "drag", "f0_50", "f1<b>00", "f1_75", *MARKERS)
    settings = json.loads((run.path / "settings.json").read_text("utf-8"))
    chosen = {key: settings[key] for key in ("method", "protocol", "start", "first", "scale", "briefing", "advisor")}
    (run.path / "settings.json").write_text(json.dumps(poisoned(settings, names) | chosen))
    for path in (run.path / "outcome.json", *run.transcript.glob("call_*.json")):
        path.write_text(json.dumps(poisoned(json.loads(path.read_text("utf-8")), names)))
    entries = record_of(run.folder)
    (run.path / "record.jsonl").unlink()
    again = RunFolder(run.path)
    for entry in entries:
        again.append(poisoned(entry, names))
    with np.load(run.path / SAVED) as saved:
        arrays = {key: np.array(names[str(a)]) if str(a) in names else a for key, a in saved.items()}
    np.savez(run.path / SAVED, **arrays)
    space = ParameterSpace(tuple(replace(p, name=names[p.name], unit=ATTACK, meaning=ATTACK) for p in SPACE))
    return run.path, replace(ROBOT, space=space, marker_names=tuple(names[m] for m in MARKERS))


def comparison_page(folder: Path) -> Path:
    names = hostile("good", "bad", "absent", *TRIALS, *COMPARED_MARKERS, "drag", "aligned/absent/seed-0")
    content = poisoned(json.loads(json.dumps(two_methods().as_dict())), names)
    content["protocols"] = ["aligned"]
    places = ("../../x", "//127.0.0.1/x", "javascript:alert(1)", "C:\\x", "runs/<b>", "runs/own")
    for run, place in zip(content["runs"], places, strict=False):
        run["folder"] = place
    place = folder / FOLDER
    (place / "runs" / "own").mkdir(parents=True)
    (place / "runs" / "own" / "report.html").write_text("own")
    (folder.parent / "x").mkdir(exist_ok=True)
    (folder.parent / "x" / "report.html").write_text("outside")
    (place / "results.json").write_text(json.dumps(content))
    (place / "figures").mkdir()
    (place / "figures" / f"{FOLDER}.pdf").write_text("")
    return write_comparison_report(place, {names[trial]: 0.1 for trial in TRIALS})


def quality_page(folder: Path) -> Path:
    positions = np.linspace(0, 1, 60).reshape(10, 3, 2)
    trial = Trial(ATTACK, MarkerTrack(np.arange(10) / 10, positions))
    lost = LostMarkers(np.arange(30).reshape(10, 3) % 4 == 0, np.zeros((6, 3), dtype=int))
    return write_quality_page([(trial, lost)] * 2, tuple(hostile("a", "b", "c").values()), folder / "quality.html")


def training_folder(folder: Path) -> Path:
    place = folder / FOLDER
    place.mkdir()
    settings = {
        "task": ATTACK, "robot": ATTACK, "seed": 1, "env_steps": 100, "exploration": 10, "reference": ATTACK,
        "parameters": [{ATTACK: 1.0}], "disturbances": {},
    }  # fmt: skip
    (place / "settings.json").write_text(json.dumps(settings))
    line = {"step": 10, "episode_return": 1.0, "distance": 0.1, ATTACK: ATTACK}
    (place / "episodes.jsonl").write_text(json.dumps(line) + "\n")
    (place / "evaluations.jsonl").write_text(json.dumps(line) + "\n")
    return place


def training_page(folder: Path) -> Path:
    pytest.importorskip("gymnasium")
    from swim2real.report.training_page import write_training_page
    from swim2real.rl.training_run import TrainingRun

    place = training_folder(folder)
    return write_training_page(TrainingRun.open(place), place)


def rollout_page(folder: Path) -> Path:
    pytest.importorskip("gymnasium")
    from swim2real.report.training_page import write_training_page
    from swim2real.rl.assessment import Assessment, LoopResult
    from swim2real.rl.rollout import Episode, EpisodeStatistics
    from swim2real.rl.training_run import TrainingRun

    assert FISH.policy is not None
    (limits,) = FISH.policy.actuators.values()
    driven = {f"_{ATTACK}": replace(limits, unit=ATTACK), ATTACK: limits}
    robot = replace(FISH, name=ATTACK, policy=PolicySetup(driven))

    class Run(TrainingRun):
        robot = property(lambda self: robot)  # a robot file can't say this

    place = training_folder(folder)
    (shot := place / "rollout.mp4").write_bytes(b"</video><script>" + OWN.encode())
    steps = np.zeros((5, 2))
    episode = Episode(
        1, 50.0, steps, steps, np.ones(5), np.zeros((6, 2)), np.zeros((5, 3, 2)), np.zeros(5), None, None, 0.1, True,
        ATTACK,
    )  # fmt: skip
    statistics = EpisodeStatistics.of([episode])
    assessment = Assessment(ATTACK, "best", [episode], statistics, {}, {"open": LoopResult(statistics, 0, 0, [])})
    return write_training_page(Run.open(place), place, assessment, shot)


def pick_page(folder: Path) -> Path:
    names = tuple(hostile("a", "b", "__proto__").values())
    frame = np.full((36, 64, 3), 90, dtype=np.uint8)
    return write_pick_page(frame, names, f"{ATTACK}.mp4", folder / "pick.html")


PAGES: dict[str, Callable[[Path], Path]] = {
    "run": run_page, "comparison": comparison_page, "quality": quality_page,
    "training": training_page, "rollout": rollout_page, "pick": pick_page,
}  # fmt: skip


class Audit(HTMLParser):
    """What a page consists of."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.wrong: list[str] = []
        self.scripts: list[str] = []
        self.text: list[str] = []
        self.links: list[str] = []
        self._within: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in ("iframe", "object", "embed", "base", "form", "link", "portal", "frame", "applet"):
            self.wrong.append(f"<{tag}>")
        for name, value in attrs:
            told = (value or "").strip()
            if name.startswith("on") or name == "data-pwned" or name == "srcdoc":
                self.wrong.append(f"{tag} {name}")
            if name in ("src", "href", "action", "xlink:href", "poster", "data", "srcset", "formaction"):
                if tag == "a":
                    self.links.append(told)
                elif not told.startswith(("data:", "#")):
                    self.wrong.append(f"{tag} {name}={told[:40]}")
            if name == "style" and re.search(r"url\(|expression|@import", told):
                self.wrong.append(f"{tag} {name}={told[:40]}")
            if name == "http-equiv" and told.lower() == "refresh":
                self.wrong.append("refresh") if ("content", "60") not in attrs else None
        if tag == "script":
            self.scripts.append("")
        self._within = [tag] if tag in ("script", "style") else []

    def handle_endtag(self, tag: str) -> None:
        self._within = []

    def handle_data(self, data: str) -> None:
        if self._within == ["script"]:
            self.scripts[-1] += data
        elif self._within != ["style"]:
            self.text.append(data)


def check(page: str, scripts: int) -> Audit:
    """A page is only its own elements, has hostile text as text, and no character that isn't seen."""
    found = Audit(page)
    assert found.wrong == []
    assert [script for script in found.scripts if OWN in script and "JSON.parse" in script] == []
    assert len(found.scripts) == scripts
    for link in found.links:
        assert link.startswith("#") or not any(file_name_fault(part) for part in re.split("[/#]", link)), link
    assert {c for c in page if unicodedata.category(c)[0] == "C" or unicodedata.category(c) in ("Zl", "Zp")} <= {
        "\n", "\t",
    }  # fmt: skip
    return found


SCRIPTS = {"run": 1, "comparison": 1, "quality": 0, "training": 1, "rollout": 1, "pick": 2}


DRAWN = ("quality", "training", "rollout")  # charts of the other pages take long; the browser sees them


@pytest.mark.parametrize("kind", PAGES)
def test_hostile_text_stays_text(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    """A page shows the attack as text, and lets its own script run alone."""
    if kind in DRAWN:
        request.getfixturevalue("drawn")
    page = PAGES[kind](tmp_path).read_text("utf-8")
    if kind in DRAWN:
        check_charts(page)
    found = check(page, SCRIPTS[kind])
    text = " ".join(" ".join(found.text).split())
    if kind != "pick":
        assert f"<script>{OWN}</script>" in text
        assert "{{ 7 * 7 }}" in text
    assert "a\\u202eb\\u2066c\\u200bd" in text
    assert not re.search(r"@import|url\(", "".join(re.findall(r"<style>(.*?)</style>", page, re.DOTALL)))
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert "default-src 'none'" in policy
    assert "script-src 'sha256-" in policy or kind == "quality"
    assert "unsafe-inline" not in policy.split("script-src")[1].split(";")[0]


@pytest.mark.parametrize("attack", ATTACKS[:7])
def test_the_audit_sees_what_would_be_an_attack(attack: str) -> None:
    found = Audit(f"<p title=\"{attack}\">{attack}</p><p title='{attack}'></p>")
    assert found.wrong or found.scripts


@pytest.fixture
def elsewhere() -> Generator[tuple[int, list[object]]]:
    """A port of this machine, and who has come to it."""
    came: list[object] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def listen() -> None:
            with suppress(OSError):
                while True:
                    connection, address = server.accept()
                    came.append(address)
                    connection.close()

        Thread(target=listen, daemon=True).start()
        yield server.getsockname()[1], came
        server.shutdown(socket.SHUT_RDWR)


OWN_WORK = {
    "run": '<div class="player">', "comparison": '<button type="button">', "pick": "<span>next</span>",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("guarded", [True, False], ids=["with its policy", "without a policy"])
@pytest.mark.parametrize("kind", PAGES)
def test_a_browser_runs_nothing_of_it(
    kind: str, guarded: bool, tmp_path: Path, drawn: None, elsewhere: tuple[int, list[object]]
) -> None:
    port, came = elsewhere
    page = PAGES[kind](tmp_path).read_text("utf-8").replace("127.0.0.1:1/", f"127.0.0.1:{port}/")
    (tmp_path / "opened").mkdir()
    place = tmp_path / "opened" / "page.html"
    place.write_text(page if guarded else open_to_scripts(page), encoding="utf-8")
    shown, told = opened(place)
    check(shown, SCRIPTS[kind])
    assert OWN_WORK.get(kind, "<h1") in shown
    assert "CONSOLE" not in told, told[-2000:]
    assert came == []

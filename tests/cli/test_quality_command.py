import json
from pathlib import Path

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from swim2real.cli import tables
from swim2real.cli.film import quality
from swim2real.robots import load_robot
from swim2real.robots.fish import FISH
from swim2real.trials import Signals, Trial, TrialSet, save_reference
from swimmers import Swimmer


@pytest.fixture
def reference(tmp_path):
    """Two swims; of the second M4 is lost in 10 % of frames and M7 in 20 %."""
    good = Swimmer().track(seed=0)
    positions = Swimmer(1.4).track(seed=1).positions.copy()
    positions[:30, 4] = np.nan
    positions[:60, 7] = np.nan
    trials = (Trial("good", good), Trial("bad", MarkerTrack(good.times, positions)))
    save_reference(TrialSet(trials, FISH.marker_names), tmp_path / "reference")
    return tmp_path / "reference"


def said(capsys) -> str:
    return " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(("allowed", "code"), [(0.0, 1), (0.19, 1), (0.2, 0)])
def test_told_so_it_takes_them(reference, allowed, code, capsys):
    assert quality(reference, allow_lost=allowed) == code
    text = said(capsys)
    assert ("Not to be used" in text) == bool(code)
    assert ("bad (M7 20 %)" in text) == (allowed == 0.19)
    assert "bad: M4 is lost in 10 % of frames" in text  # told anyway
    assert quality(reference, allow_lost=allowed, json=True) == code
    content = json.loads(capsys.readouterr().out)
    assert [content[name]["usable"] for name in ("good", "bad")] == [True, code == 0]


FINGER = Path(__file__).parents[2] / "examples" / "finger" / "finger.toml"


def test_recordings_are_checked_by_what_was_seen_and_what_was_recorded(tmp_path, capsys):
    robot, times = load_robot(FINGER), np.arange(20) / 60
    positions = robot.rest_markers + [-0.065, 0.0] + 1e-4 * np.arange(20)[:, None, None]
    positions[5:8, -1] = np.nan  # however far the finger bends, that alone is no reason
    wound, pulled = Signals(times, ["winch"], 0.01 * times[:, None]), Signals(times, ["pull"], times[:, None])
    whole = Trial("whole", MarkerTrack(times, positions), controls=wound, sensors=pulled)
    blind = Trial("blind", MarkerTrack(times, positions), controls=wound)
    save_reference(TrialSet((whole, blind), robot.marker_names), tmp_path)
    assert quality(tmp_path, robot=str(FINGER), allow_lost=0.2, plot=tmp_path / "lost.html") == 1
    text = said(capsys)
    assert "whole 0.32 20 – winch pull" in text
    assert "whole: tip is lost in 15 % of frames (missing 3)" in text
    assert "trial 'blind'" in text  # it has no sensors
    assert "left out" in (tmp_path / "lost.html").read_text(encoding="utf-8")
    assert quality(tmp_path, robot=str(FINGER), json=True) == 1
    content = json.loads(capsys.readouterr().out)
    assert not content["whole"]["usable"]
    assert "error" in content["blind"]


def test_controls_of_another_clock_are_refused_and_those_that_end_early_told(tmp_path, capsys):
    robot, times = load_robot(FINGER), np.arange(61) / 60
    track = MarkerTrack(times, robot.rest_markers + [-0.065, 0.0] + 1e-4 * np.arange(61)[:, None, None])
    pulled = Signals(times, ["pull"], times[:, None])
    trials = [
        Trial(name, track, controls=Signals(stamps, ["winch"], 0.01 * times[: len(stamps), None]), sensors=pulled)
        for name, stamps in (("epoch", 1.7e9 + times), ("short", times[:31]))
    ]
    save_reference(TrialSet(tuple(trials), robot.marker_names), tmp_path)
    assert quality(tmp_path, robot=str(FINGER)) == 1
    text = said(capsys)
    assert "trial 'epoch': its controls don't drive it: its rows are from 1700000000 s to 1700000001 s" in text
    assert "short: its controls end at 0.5 s, its frames at 1 s; the last value is held from there on" in text
    assert text.count("short: the track lasts 1 s, its controls 0.5 s: 2 times as long") == 1
    assert "rate that is off" not in text  # a factor of two is named as any other is


# robots of many markers

NAMES = tuple(f"row{row}_dot{dot}" for row in range(4) for dot in range(7))


def lost_in(shares: dict[str, float]) -> list[float]:
    return [shares.get(name, 0.0) for name in NAMES]


@pytest.mark.parametrize("width", ["60", "120"])
def test_a_table_of_many_markers_names_the_ten_worst_and_no_header_breaks(capsys, monkeypatch, width):
    monkeypatch.setattr(tables.console, "_width", int(width))
    shares = {name: 0.5 - 0.02 * i for i, name in enumerate(NAMES[:13])}
    rows = [(("one",), lost_in(shares), ("no",)), (("none",), lost_in({}), ("yes",))]
    tables.by_marker("Lost [%]", NAMES, ("trial",), ("usable as it is",), rows, tables.percent)
    out = capsys.readouterr().out
    text = " ".join(out.split())
    assert "Lost [%], the 10 worst of 28 (all of them with --json)" in text
    assert all(word in out for word in ("trial", "worst first", "usable"))
    assert [name for name in NAMES if name in text] == list(NAMES[:10])
    assert "and 3 more" in text
    assert max(map(len, out.splitlines())) <= int(width)
    tables.by_marker("Lost [%]", NAMES[:3], ("trial",), (), [(("one",), [0.0, 0.25, None], ())], tables.percent)
    assert "trial row0_dot0 row0_dot1 row0_dot2" in (few := said(capsys))  # few have a column each
    assert few.endswith("one – 25 –")

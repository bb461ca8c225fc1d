"""What the end of a run looks like at two widths, and no number that any table cuts."""

import io
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recorded import PENDULUM
from run_settings import run_settings
from swim2real.calibration import Outcome, Progress
from swim2real.calibration.file_models import RecordedEvaluation, Verdict
from swim2real.cli import calibrate, progress, tables
from swim2real.cli.tables import PlainConsole
from swim2real.identification.identifiability import Interval, Study
from swim2real.parameters.known import known
from swim2real.report.run import ReportedRun
from swim2real.robots import load_robot
from swim2real.robots.robot import Robot

PROJECT = Path(__file__).parents[2]
SNAPSHOTS = Path(__file__).parent / "endings"
VERDICTS = {
    "fish": Verdict(
        kind="not finished",
        sentence="the budget of 300 evaluations is spent; 0.94 % of the motion is unexplained (1.78 mm, 8.2 times the "
        "noise of the data), most in trial 'f1_00' by its shape (1.92 mm); --resume without --budget searches on, "
        "about 3 min more at this pace",
    ),
    "finger": Verdict(kind="good", sentence="0.8 % of the motion is unexplained (0.2 mm), which is near the noise"),
    "arm": Verdict(kind="good", sentence="1.1 % of the motion is unexplained (0.3 mm), which is near the noise"),
    "stranger": Verdict(kind="not usable", sentence="41 % of the motion is unexplained (51 mm)"),
}
ROBOTS = {"fish": "fish", **{name: str(PROJECT / f"examples/{name}/{name}.toml") for name in ("finger", "arm")}}


def robot_of(case: str) -> Robot:
    return PENDULUM if case == "stranger" else load_robot(ROBOTS[case])


def run_of(case: str, studied: bool) -> ReportedRun:
    """A run of a robot at its own values, with intervals that grow from parameter to parameter."""
    robot = robot_of(case)
    space = replace(robot.space, scale="log")
    at = np.clip(space.to_cube(space.published), 0, 1)
    widths = np.linspace(0.02, 0.9, len(at))
    low, high = (space.to_array(np.clip(at + side * widths, 0, 1)) for side in (-0.5, 0.5))
    ends = {name: (float(low[i]), float(high[i])) for i, name in enumerate(space.names)}
    figure = {"fish": "motion_error"}.get(case, "aligned_marker_error")
    fits = [
        {"loss": error, figure: error, "protocol": "motion" if case == "fish" else "playback"} for error in (0.3, 2e-3)
    ]
    entries = tuple(
        RecordedEvaluation.model_validate({
            "index": k, "loss": fit["loss"], "failed": False, "point": at.tolist(), "values": space.published,
            "note": {}, "evidence": {**fit, "trials": {"one": {"static_offset": 1e-3} if case == "fish" else {}}},
        })
        for k, fit in enumerate(fits)
    )  # fmt: skip
    outcome = Outcome(fit=entries[1].evidence, verdict=VERDICTS[case], evaluations=2, ranges={} if studied else ends)
    study = None
    if studied:
        intervals = {
            name: Interval(median=both[0], interval_50=both, interval_95=both, width=width, known=known(width))
            for (name, both), width in zip(ends.items(), widths, strict=True)
        }
        start = {"point": at.tolist(), "loss": 2e-3}
        study = Study.model_validate({
            "format": 3, "parameters": list(space.names), "complete": True, "evaluations": 9, "start": start,
            "lowest": start, "intervals": {name: one.model_dump() for name, one in intervals.items()},
        })  # fmt: skip
    settings = run_settings(robot=robot.name, protocol=fits[0]["protocol"])
    return ReportedRun("run", robot, settings, space, entries, outcome, True, (), None, "", study)


def shown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: int, run: ReportedRun, **more
) -> str:
    monkeypatch.setattr(tables.console, "_width", width)
    capsys.readouterr()
    calibrate.ending(run, Path("run/report.html"), "swim2real view run", **more)
    return capsys.readouterr().out


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize("case", VERDICTS)
def test_the_end_of_a_run_is_as_it_was_and_fits_a_screen(case, width, monkeypatch, capsys):
    text = shown(monkeypatch, capsys, width, run_of(case, studied=case != "stranger"))
    verdict, *others = text.splitlines()
    assert -(-len(verdict) // width) + len(others) <= 25
    assert max(map(len, others)) <= width
    path = SNAPSHOTS / f"{case}-{width}.txt"
    if "WRITE_SNAPSHOTS" in os.environ:
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8")


def test_the_end_of_a_demo_counts_the_hidden_values_that_lie_inside(monkeypatch, capsys):
    run = run_of("fish", studied=True)
    hidden = dict(run.best.values)
    hidden["fluid_blunt_drag"] *= 2
    text = shown(monkeypatch, capsys, 80, run, hidden=hidden)
    assert "15 of 16 hidden values lie inside." in text
    assert re.search(r"^fluid_blunt_drag .* no$", text, re.MULTILINE)
    assert max(map(len, text.splitlines()[1:])) <= 80


@pytest.mark.parametrize("width", range(60, 201, 4))
def test_no_table_cuts_a_number(width, monkeypatch):
    out = io.StringIO()
    monkeypatch.setattr(tables, "console", PlainConsole(file=out, width=width))
    rng = np.random.default_rng(width)
    for count in (3, 8, 14):
        columns = ["trial", *(f"number {k}" for k in range(count))]
        rows = [[f"trial_{i}", *(f"{one:.6g}" for one in rng.normal(scale=1e4, size=count))] for i in range(4)]
        out.truncate(0)
        tables.table("Numbers", columns, rows, spare=columns[-1:0:-1] if count == 8 else ())
        text = out.getvalue().lstrip("\0")
        left_out = re.findall(r"number \d+", " ".join(text.partition("Left out")[2].split()))
        kept = [k for k, column in enumerate(columns) if column not in left_out]
        assert all(
            re.search(rf"(^|[\s,]){re.escape(row[k])}([\s,:]|$)", text, re.MULTILINE) for row in rows for k in kept
        )
        assert max(map(len, text.splitlines())) <= width
        assert left_out == columns[len(columns) - len(left_out) :][::-1]
    words = "a finding that is much longer than any line of a narrow terminal may be, with 12345.678 in it " * 3
    out.truncate(0)
    tables.table("", ("trial", "finding"), [("one", words)])
    assert "12345.678" in out.getvalue()
    assert max(map(len, out.getvalue().lstrip("\0").splitlines())) <= width


@pytest.mark.parametrize("on_a_terminal", [False, True])
def test_a_line_of_progress_fits_80_columns(on_a_terminal, monkeypatch):
    out = io.StringIO()
    console = PlainConsole(file=out, width=80, force_terminal=on_a_terminal, color_system=None)
    monkeypatch.setattr(progress, "progress_console", lambda: console)
    with progress.run_shown(10_000, quiet=False) as callbacks:
        ends = (0.1,) * 123
        callbacks.progress(Progress(9999, 10_000, 12.3456, 12.3456, {}, True, 36_000.0, False, ends, 0.1, 12.3456))
    line = max(re.sub(r"\x1b\[[\d;?]*\w", "", out.getvalue()).replace("\r", "\n").splitlines(), key=len)
    assert "best 12345.6 mm, 123 of 123 starts agree, 10:00:00 left" in line
    assert len(line.rstrip()) <= 80

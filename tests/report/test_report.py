"""The page of a run: what it shows of a run that has ended, and what it says is missing."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_pages import (
    ROBOT,
    SPACE,
    Run,
    charts_of,
    check_charts,
    line,
    longer,
    missing,
    page_of,
    proposal,
    searched,
    seen_by,
    shown_of,
    swim,
    titles_of,
    visible,
)

from run_settings import record_of
from swim2real.calibration import SavedTrial
from swim2real.formatting import mm
from swim2real.parameters import ParameterSpace
from swim2real.report import write_report
from swim2real.report.errors import warnings
from swim2real.report.page import page_context
from swim2real.report.pages import inline_svg
from swim2real.report.run import read_run
from swim2real.report.style import COLORS
from swimbase.errors import ParameterError, RunError


@pytest.fixture
def run(tmp_path: Path) -> Run:
    found = searched(tmp_path / "run")
    found.conclude(0.1)
    return found


def test_a_finished_run_shows_everything(run: Run) -> None:
    page = page_of(run)
    loss, first = (record_of(run.folder)[i]["loss"] for i in (2, 0))
    words = (
        f"Aligned marker error {mm(loss)} mm first evaluation {mm(first)} mm held-out trials", "7 of 7 evaluations",
        "Seed 3", "+12.30", "Length of the arm.", "1 of 3 rounds were accepted", "Tail too soft.", "0.37740 ± 0.00020",
        "M2 is lost in 3 % of frames", "−0.95, 11.05, −4.2, … (4 numbers)", "d5756570ca64", "abc123-dirty",
    )  # fmt: skip
    assert missing(words, visible(page)) == []
    assert "has not ended" not in visible(page)
    assert page.count('<tr class="on-bound">') == 1
    arm, stiffness, drag = shown_of(run).parameters
    assert [(one.bound, one.position) for one in (arm, stiffness)] == [("upper", 1), ("", pytest.approx(0.35))]
    assert (arm.change("lower"), arm.change("upper")) == ("+12.30", "–")
    assert (drag.effect, drag.change("lower")) == (None, "")


def test_the_same_folder_gives_the_same_page(run: Run) -> None:
    assert page_of(run) == page_of(run)
    assert write_report(str(run.path), ROBOT) == run.path / "report.html"
    assert not list(run.path.glob("*.part"))


def test_rounds_tell_what_was_tried(run: Run) -> None:
    first, second, third = shown_of(run).rounds
    assert [one.status for one in (first, second, third)] == ["accepted", "rejected", "cut short"]
    assert [step.note.step_size for step in second.steps] == [1.0, 0.5, 0.25]
    assert second.change(second.steps[0]) is None
    assert first.accepted is second.before is first.steps[1]
    assert second.accepted is None
    assert first.change(first.steps[1]) < 0
    said = ("rejected", "100 %", "diverged", "50 %")
    assert missing(said, visible(page_of(run)).partition("Round 2")[2]) == []
    assert first.moves[0] == "arm 0.035 → 0.06 m"
    assert first.notes == (("trust", "0.3"),)


def unfinished(run: Run) -> None:
    (run.path / "outcome.json").unlink()


def gone_on(run: Run) -> None:
    run.add(0.01, (0.3, 0.3, 0.3), round=4, step_size=1.0, proposal=proposal("More."))


def without_swims(run: Run) -> None:
    (run.path / "trials.npz").unlink()


@pytest.mark.parametrize(("damage", "says"), [
    (unfinished, ("This run has not ended: 7 of 7 evaluations are on record", "--resume")),
    (gone_on, ("has found better parameters since",)),
    (without_swims, ("has no trials.npz",)),
])  # fmt: skip
def test_what_is_missing_is_said_and_the_rest_is_shown(run: Run, damage, says: tuple[str, ...]) -> None:
    damage(run)
    shown = visible(page_of(run))
    rest = ("Convergence", "Speed against frequency", "Parameters", "Tail too soft.", "Aligned error in numbers")
    assert missing((*says, *rest), shown) == []
    assert [word for word in ("Real and simulated real", "No trial was held out") if word in shown] == []


def test_the_verdict_is_first_on_the_page(run: Run) -> None:
    for miss, from_rest, kind, said in (
        (0.005, 0.1, "not-finished", "Not finished. The budget of 7 evaluations is spent"),
        (0.3, 0.1, "not-usable", "Not usable."),
        (0.005, -0.02, "not-usable", "Not usable. From rest, where a policy and the robot begin"),
    ):
        run.conclude(miss, from_rest=from_rest)
        page = page_of(run)
        assert f'<p class="notice verdict {kind}">' in page
        assert missing((said,), visible(page)) == []
    run.conclude(1.2)
    read = read_run(run.path, ROBOT)
    motion = replace(read, settings=replace(read.settings, protocol="motion"))
    assert "a trial goes tail first, so the loss, 607.7 mm, has 500 mm added" in warnings(motion)[-1]
    assert not any("tail first" in one for one in warnings(read))


def test_a_run_of_before_there_were_verdicts_gets_one(run: Run) -> None:
    run.conclude(0.3)
    outcome = json.loads((run.path / "outcome.json").read_text())
    expected = outcome.pop("verdict")
    run.folder.write_json("outcome.json", outcome)
    found = read_run(run.path, ROBOT).verdict
    assert (found.kind, found.unexplained) == (expected["kind"], pytest.approx(expected["unexplained"], rel=1e-5))
    unfinished(run)
    assert read_run(run.path, ROBOT).verdict.sentence.startswith("it has not ended; 7 evaluations are on record")


def test_a_random_run_has_no_rounds(tmp_path: Path) -> None:
    run = Run(tmp_path / "run", method="random", budget=3)
    for k in range(3):
        run.add(0.2 - 0.05 * k, (0.2, 0.3, 0.4 + 0.1 * k))
    run.conclude(0.1, held_out=None, sensitivity=False)
    shown = visible(page_of(run))
    assert missing(("No trial was held out", "How well the trials determine them: swim2real identify"), shown) == []
    assert "rounds" not in shown.lower().replace("the advisor's rounds", "")
    assert "with advisor" not in shown
    legend = charts_of(run)["convergence"]().axes[0].get_legend_handles_labels()[1]
    assert legend == ["evaluation", "best so far"]


def test_a_held_out_trial_that_diverged_and_failed_evaluations_are_shown(run: Run) -> None:
    axes = charts_of(run)["convergence"]().axes[0]
    failed = next(points for points in axes.collections if points.get_label().startswith("diverged"))
    (place,) = failed.get_offsets()
    top = axes.get_ylim()[1]
    assert place[0] == 4
    assert 0.9 * top < place[1] < top < 500  # m of a failure don't stretch the axis
    assert "grew without limit" in failed.get_urls()[0]
    best = next(drawn for drawn in axes.lines if drawn.get_label() == "best so far").get_ydata()
    assert (np.diff(best) <= 0).all()
    run.conclude(0.1, held_out=swim("f1_75", 1.3, 0.1, divergence="it grew without limit"))
    assert missing(("simulation diverged", "held-out trials diverged"), visible(page_of(run))) == []
    charts = charts_of(run)
    check_charts("".join(inline_svg(charts[name], name) for name in ("speeds", "paths-2", "tail-2")))


def test_markers_that_never_count(tmp_path: Path) -> None:
    run = searched(tmp_path / "run", lost=3)
    run.conclude(0.1)
    page_of(run)
    shown = shown_of(run)
    tails = {titles_of(shown.charts[f"tail-{i}"]())[1] for i in range(3)}
    assert tails == {"M2 sideways (mm)", "M3 sideways (mm)"}
    shape = next(one for one in shown.errors if one.key == "shape")
    row = shape.trials.index("f0_50")
    assert np.isnan(shape.values[row, 3])
    assert shape.shares[row, 3] == 0
    assert np.isfinite(shape.mean).all()


def test_charts_have_units_and_long_swims_are_thinned(run: Run) -> None:
    for draw in charts_of(run).values():
        for title in titles_of(draw()):
            assert re.search(r"\((mm|mm/s|s|Hz)\)$", title) or title in ("evaluation", "marker, head to tail"), title
    found = read_run(run.path, ROBOT)
    long = longer(found.saved[0].compared, 2_000, 240)
    saved = tuple(
        SavedTrial(False, replace(long, name=f"t{i}", beat=replace(long.beat, frequency=0.5 + i / 100)))
        for i in range(40)
    )
    shown = page_context(replace(found, saved=saved))
    assert len(shown.saved) == 24
    assert max(len(drawn.get_xdata()) for drawn in shown.charts["paths-23"]().axes[0].lines) <= 480


def test_paths_are_registered_and_leave_lost_frames_out(run: Run) -> None:
    figure = charts_of(run)["paths-0"]()
    assert len(line(figure, "lost by tracking, not counted").get_xdata()) == 4
    real = line(figure, "M2, real").get_xdata()
    assert np.flatnonzero(np.isnan(real)).tolist() == [5, 6, 7, 8]
    assert line(figure, "M2, simulated").get_xdata()[0] == pytest.approx(real[0] + 3.0)


def test_what_cant_be_reported_is_refused(run: Run, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no run folder"):
        write_report(tmp_path, ROBOT)
    with pytest.raises(RunError, match="nothing to report"):
        write_report(Run(tmp_path / "empty").path, ROBOT)
    with pytest.raises(ParameterError, match="unknown parameter 'drag'"):
        write_report(run.path, replace(ROBOT, space=ParameterSpace(SPACE.parameters[:2])))


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_browser_shows_every_chart(run: Run, drawn: None, tmp_path: Path, dark: bool) -> None:
    page = page_of(run)
    check_charts(page)
    assert len(page) < 5e5
    assert "<title>f1&lt;b&gt;00</title>" in page
    color, heights, needed, there = seen_by(
        page,
        tmp_path / "page.html",
        """const red = document.querySelector('svg path[style*="stroke: var(--real)"]');
        document.querySelectorAll("details").forEach((one) => one.open = true);
        return [getComputedStyle(red).stroke,
                [...document.querySelectorAll(".plot svg")].map((one) => one.clientHeight),
                document.documentElement.scrollWidth, innerWidth];""",
        f"--blink-settings=preferredColorScheme={0 if dark else 1}",
    )
    red, green, blue = (int(COLORS["real"][dark][i : i + 2], 16) for i in (1, 3, 5))
    assert color == f"rgb({red}, {green}, {blue})"
    assert len(heights) == len(charts_of(run))
    assert min(heights) > 100
    assert needed <= there

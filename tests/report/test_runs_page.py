"""The page of several runs side by side."""

from dataclasses import replace
from pathlib import Path

import pytest
from made_pages import ROBOT, SPACE, Run, missing, searched, visible

from run_settings import record_of
from swim2real.parameters import ParameterSpace
from swim2real.report import write_runs_page
from swim2real.report.run import read_run
from swim2real.report.runs_page import parameter_lines, runs_context
from swimbase.errors import RunError


@pytest.fixture
def two(tmp_path: Path) -> tuple[Run, Run]:
    """A line search, and a random run with another seed that hasn't ended."""
    first = searched(tmp_path / "first")
    first.conclude(0.1)
    second = Run(tmp_path / "second", method="random", budget=3)
    second.add(0.3, (0.5, 0.4, 0.7))
    second.add(0.25, (0.95, 0.3, 0.7))
    second.change_settings(seed=4)
    return first, second


def page_of(*runs: Run) -> str:
    path = write_runs_page([(run.path, ROBOT) for run in runs], runs[0].path.parent / "runs.html")
    return path.read_text(encoding="utf-8")


def test_two_runs_are_side_by_side(two: tuple[Run, Run]) -> None:
    shown = visible(page_of(*two))
    words = (
        "2 runs side by side", "A first : line-search with advisor physics, robot fish, seed 3, 7 of 7 evaluations",
        "B second : random, robot fish, seed 4, 2 of 3 evaluations", "B second : it has not ended",
        "Aligned marker error", "held out", "Settings that differ", "Method line-search random", "Seed 3 4",
        "on its upper bound",
    )  # fmt: skip
    assert missing(words, shown) == []
    assert "aren't of the same thing" not in shown
    assert "Begun" not in shown
    two[1].change_settings(protocol="paper", reference_fingerprint="other")
    said = "The runs differ in protocol and trials, so their figures aren't of the same thing."
    assert said in page_of(*two).replace("&#39;", "'")
    with pytest.raises(RunError, match="nothing to report"):
        page_of(two[0], Run(two[0].path.with_name("empty")))


def test_figures_are_those_of_the_runs_own_pages(two: tuple[Run, Run]) -> None:
    shown = runs_context([read_run(run.path, ROBOT) for run in two])
    figure, rows = next(line for line in shown.figures if line[0].name == "aligned_marker_error")
    losses = [min(entry["loss"] for entry in record_of(run.folder) if not entry["failed"]) for run in two]
    assert (figure.label, figure.is_sum) == ("Aligned marker error", True)
    assert [row.best for row in rows] == [f"{1e3 * loss:.1f} mm" for loss in losses]
    assert [bool(row.held_out) for row in rows] == [True, False]


def test_parameters_say_what_differs(two: tuple[Run, Run]) -> None:
    arm, stiffness, drag = parameter_lines([read_run(run.path, ROBOT) for run in two])
    assert (arm.name, arm.apart, arm.note) == ("arm", "5 %", "")
    assert [row.bound for row in arm.rows if row] == ["upper", ""]
    assert (stiffness.apart, drag.apart) == ("5 %", "0 %")
    moved = Run(two[0].path.with_name("third"), method="random")
    moved.add(0.1, (0.2, 0.35, 0.7))
    arm, *_ = parameter_lines([read_run(run.path, ROBOT) for run in (two[0], moved)])
    assert (arm.apart, arm.note) == ("80 %", "differs")


def test_other_bounds_and_other_parameters_are_not_compared(two: tuple[Run, Run]) -> None:
    wider = ParameterSpace((replace(SPACE.parameters[0], upper=0.09), *SPACE.parameters[1:]))
    first = read_run(two[0].path, ROBOT)
    arm, *_ = parameter_lines([first, replace(first, space=replace(wider, scale=first.space.scale))])
    assert (arm.apart, arm.note) == ("–", "other bounds")
    fewer = replace(ParameterSpace(SPACE.parameters[:2]), scale=first.space.scale)
    entries = tuple(
        entry.model_copy(update={"values": {name: value for name, value in entry.values.items() if name != "drag"}})
        for entry in first.entries
    )
    *_, drag = parameter_lines([first, replace(first, entries=entries, space=fewer)])
    assert drag.rows[1] is None
    assert (drag.apart, drag.note) == ("–", "")


def test_paths_are_shared_and_on_one_scale(two: tuple[Run, Run]) -> None:
    two[1].conclude(0.2)
    shown = runs_context([read_run(run.path, ROBOT) for run in two])
    assert len(shown.trials) == 3
    pairs = [[shown.charts[f"paths-{k}-{i}"]().axes[0].get_xlim() for i in (0, 1)] for k in range(3)]
    assert all(a == b for a, b in pairs)

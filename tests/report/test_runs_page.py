"""The page of several runs side by side."""

from dataclasses import replace
from pathlib import Path

import pytest
from made_pages import ROBOT, SPACE, Run, missing, searched, visible

from swim2real.parameters import ParameterSpace
from swim2real.report import write_runs_page
from swim2real.report.run import read_run
from swim2real.report.runs_page import parameter_lines
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
    words = ("seed 3, 7 of 7 evaluations", "seed 4, 2 of 3 evaluations", "B second : it has not ended", "Seed 3 4")
    shown = visible(page_of(*two))
    assert missing(words, shown) == []
    assert "aren't of the same thing" not in shown
    two[1].change_settings(protocol="paper", reference_fingerprint="other")
    assert "The runs differ in protocol and trials" in page_of(*two)
    with pytest.raises(RunError, match="nothing to report"):
        page_of(two[0], Run(two[0].path.with_name("empty")))


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

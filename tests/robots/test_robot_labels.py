"""Names in a robot file or a model that aren't seen are refused in a sentence; others are taken as they are."""

import pytest

from swim2real.pipeline.drafting import draft_robot
from swim2real.robots.schema import RobotTable
from swimbase.checking import check
from swimbase.errors import RobotError
from swimbase.names import quoted

HOSTILE = ("a\nb", "a\x1b[31m", "a\u202eb", "a\u200bb", "x" * 201)


def content(label: str) -> dict[str, object]:
    """A robot file in which every name and unit is the same text."""
    parameter = {
        "name": label, "unit": label, "lower": 0.0, "upper": 1.0, "meaning": "any\ntext", "targets": "joint x damping",
    }  # fmt: skip
    return {
        "format": 1, "name": label, "description": "any\n<b>text</b>", "model": "arm.xml", "markers": [label],
        "recordings": {"sensors": {label: {"unit": label, "meters_per_unit": 1.0}}, "controls": {label: "table"}},
        "policy": {"actuators": {label: {"lower": -1.0, "upper": 1.0, "rate": 1.0, "unit": label}}, "sites": [label]},
    } | {"parameters": [parameter]}  # fmt: skip


@pytest.mark.parametrize("label", ["M0", "walker/foot[0]", "N·m·s/rad", "Übung 1", "<b>&$x$"])
def test_signs_and_spaces_are_allowed(label: str) -> None:
    assert check(RobotTable, content(label), "robot file", RobotError).name == label


@pytest.mark.parametrize("label", HOSTILE)
@pytest.mark.parametrize("place", [("name",), ("markers", 0), ("recordings", "sensors"), ("policy", "actuators")])
def test_a_name_that_isnt_seen_is_refused(label: str, place: tuple[str | int, ...]) -> None:
    given, bad = content("M0"), content(label)
    owner, wrong = given, bad
    for key in place[:-1]:
        owner, wrong = owner[key], wrong[key]
    owner[place[-1]] = wrong[place[-1]]
    with pytest.raises(RobotError) as refused:
        check(RobotTable, given, "robot file", RobotError)
    assert quoted(label) in str(refused.value)
    assert "must" in str(refused.value)


@pytest.mark.parametrize("name", ['x"]&#10;[swims]&#10;a = ["', "a&#x202E;b"])
def test_a_name_in_a_model_cant_write_lines_of_the_robot_file(tmp_path, name: str) -> None:
    (tmp_path / "m.xml").write_text(
        "<mujoco><worldbody><body><joint name='j' axis='0 1 0'/><geom size='0.1'/>"
        f"<site name='{name}'/></body></worldbody></mujoco>"
    )
    with pytest.raises(RobotError, match="isn't seen"):
        draft_robot(tmp_path / "m.xml")

import textwrap

import pytest

from made_robots import ARM, DAMPING, RECORDINGS, ROBOT, made, made_of_files
from swim2real.robots import load_robot
from swim2real.robots.fingerprint import fingerprint

WHOLE = (ROBOT, RECORDINGS, DAMPING)


@pytest.fixture
def place(tmp_path):
    return made_of_files(tmp_path, *WHOLE)


@pytest.mark.parametrize(("file", "old", "new"), [
    ("arm.toml", "upper = 1.0", "upper = 1.1"),
    ("arm.toml", '["base", "elbow", "tip"]', '["base", "tip", "elbow"]'),
    ("arm.xml", 'kp="5"', 'kp="5.00000001"'),
    ("rest.xml", '<body name="fin">', '<body name="fin" pos="0 0 1e-9">'),
    ("parts/fin.obj", "v 1 0 0", "v 1.00000001 0 0"),
])  # fmt: skip
def test_a_change_of_a_file_or_of_what_it_names_is_seen(place, file, old, new):
    before = fingerprint(place)
    path = place.parent / file
    path.write_text(path.read_text().replace(old, new))
    assert fingerprint(place) != before


def test_what_changes_nothing_is_not_seen(place, tmp_path, monkeypatch):
    before = fingerprint(place)
    place.write_text("# mine\n" + place.read_text())
    model = place.with_name("arm.xml")
    model.write_text(model.read_text().replace("<worldbody>", "<!-- all -->\n\n  <worldbody>"))
    assert fingerprint(place) == before
    monkeypatch.chdir(tmp_path)
    assert fingerprint("arm.toml") == before


def test_a_change_of_a_file_that_is_extended_is_seen(tmp_path):
    base = made(tmp_path / "base", *WHOLE)
    place = tmp_path / "more.toml"
    place.write_text('extends = "base/arm.toml"\nname = "more"\n')
    marks = {fingerprint(place), fingerprint(base)}
    base.write_text(base.read_text().replace("upper = 1.0", "upper = 1.1"))
    marks.add(fingerprint(place))
    (tmp_path / "base" / "arm.xml").write_text(ARM.replace('kp="5"', 'kp="6"'))
    marks.add(fingerprint(place))
    assert len(marks) == 4


def test_a_change_of_a_models_function_is_seen(tmp_path):
    code = """
    import mujoco
    from pathlib import Path
    def model():
        spec = mujoco.MjSpec.from_string(Path(__file__).with_name("arm.xml").read_text())
        spec.body("lower").mass = 0.25
        return spec
    """
    place = made(tmp_path, ROBOT.replace("arm.xml", "python:arm.py:model"), RECORDINGS, DAMPING)
    file = tmp_path / "arm.py"
    file.write_text(textwrap.dedent(code))
    load_robot(place, allow_code=True)
    marks = {fingerprint(place)}
    assert fingerprint(place) in marks
    file.write_text(textwrap.dedent(code).replace("0.25", "0.2500000001"))
    load_robot(place, allow_code=True)
    marks.add(fingerprint(place))
    (tmp_path / "arm.xml").write_text(ARM.replace('kp="5"', 'kp="5.00000001"'))  # which the file alone doesn't show
    marks.add(fingerprint(place))
    assert len(marks) == 3

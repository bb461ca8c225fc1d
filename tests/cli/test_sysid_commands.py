"""`export-sysid` and `import-sysid`."""

import json

import pytest
from mujoco import sysid

from swim2real.parameters import read_parameters
from swim2real.robots.fish import FISH


def identified(folder, **values):
    """A file as the toolbox writes it."""
    found = sysid.ParameterDict()
    for name, value in values.items():
        found.add(sysid.Parameter(name, value, 0.0, 10.0))
    found.save_to_disk(folder / "params_x_hat.yaml")
    return folder


def test_identified_values_become_a_parameters_file(program, tmp_path):
    folder = identified(tmp_path, fluid_blunt_drag=0.7, hinge_damping_2=0.01)
    out = tmp_path / "found.json"
    program("import-sysid", folder, "--like", "published", "--out", out).done()
    assert program.text.split(": ")[1].startswith("2 of 16 parameters differ from published")
    expected = {**FISH.space.published, "fluid_blunt_drag": 0.7, "hinge_damping_2": 0.01}
    assert read_parameters(out, "fish", FISH.space).values == expected
    assert json.loads(out.read_text())["engine"].startswith("mujoco ")
    program("import-sysid", identified(tmp_path, hinge_damping_2=0.02), "--like", out, "--out", out).done()
    again = read_parameters(out, "fish", FISH.space).values
    assert again == {**expected, "hinge_damping_2": 0.02}


def test_a_value_out_of_bounds_is_refused(program, tmp_path):
    folder = identified(tmp_path, motor_arm_length=0.07)
    sentence = program("import-sysid", folder, "--like", "published", "--out", tmp_path / "found.json").sentence(2)
    place = folder / "params_x_hat.yaml"
    assert sentence == f"parameter 'motor_arm_length' in '{place}' is 0.07, out of bounds; allowed is 0.01 to 0.06 m"
    assert not (tmp_path / "found.json").exists()


@pytest.mark.slow
def test_a_problem_goes_out_and_its_values_come_back(program, tmp_path, pool_folder):
    out = tmp_path / "out"
    program("export-sysid", "published", "--reference", pool_folder, "--out", out, "--horizon", "1").done()
    assert program.text.split(": ")[1].startswith("16 parameters, 2 trials")
    assert sorted(path.name for path in out.iterdir()) == ["f1_20.npz", "f1_60.npz", "fish.xml", "params_x_0.yaml"]
    program(
        "import-sysid", out / "params_x_0.yaml", "--like", "published", "--out", tmp_path / "same.json"
    ).done()  # fmt: skip
    assert program.text.split(": ")[1].startswith("0 of 16 parameters differ")
    assert read_parameters(tmp_path / "same.json", "fish", FISH.space).values == FISH.space.published
    sentence = program("export-sysid", "published", "--reference", pool_folder, "--out", out).sentence(2)
    assert sentence == f"'{out}' isn't empty; name a new folder"

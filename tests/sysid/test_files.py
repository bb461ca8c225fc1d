"""The toolbox's own files, there and back."""

import io

import numpy as np
import pytest
from mujoco import sysid

import recorded
from swim2real.calibration import Problem
from swim2real.errors import ArgumentError, ParameterError
from swim2real.sysid import SysidProblem, load, read_values, save, to_sysid

SPACE = recorded.PENDULUM.space


@pytest.fixture(scope="module")
def problem() -> SysidProblem:
    reference = recorded.pendulum_reference()
    return to_sysid(Problem(recorded.PENDULUM, reference, horizon=0.5, threads=2), SPACE.published)


def residual(problem: SysidProblem) -> np.ndarray:
    return np.concatenate(problem.residual(problem.parameters.as_vector(), problem.parameters)[0])


def parameters_file(folder, **values):
    found = sysid.ParameterDict()
    for name, value in values.items():
        found.add(sysid.Parameter(name, value, -1.0, 1.0))
    found.save_to_disk(folder / "found.yaml")
    return folder / "found.yaml"


def test_what_was_saved_is_loaded_to_the_last_digit(problem, tmp_path):
    save(problem, tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "a.npz", "b.npz", "params_x_0.yaml", "pendulum.xml"
    ]  # fmt: skip
    again = load(tmp_path / "out", recorded.PENDULUM)
    np.testing.assert_array_equal(residual(again), residual(problem))
    assert again.parameters.get_bounds()[1].tolist() == [one.upper for one in SPACE]


def test_results_of_the_toolbox_come_back_as_values(problem, tmp_path):
    best, result = sysid.optimize(
        problem.parameters, problem.residual, verbose=False, output=io.StringIO(), max_iters=2
    )  # fmt: skip
    sysid.save_results(tmp_path, problem.sequences, problem.parameters, best, result, problem.residual)
    values = read_values(tmp_path, SPACE, SPACE.published)
    assert list(values.values()) == best.as_vector().tolist()
    assert values != SPACE.published


@pytest.mark.slow
def test_the_toolboxs_own_report_can_be_made(problem, tmp_path):
    best, result = sysid.optimize(
        problem.parameters, problem.residual, verbose=False, output=io.StringIO(), max_iters=2
    )  # fmt: skip
    sysid.default_report(
        problem.sequences, problem.parameters, best, problem.residual, result, save_path=tmp_path,
        build_model=problem.build_model, generate_videos=False,
    )  # fmt: skip
    page = (tmp_path / "report.html").read_text()
    assert all(name in page for name in ("middle x", "end z", "gyro[1]", *SPACE.names))


def test_parameters_that_the_toolbox_did_not_have_keep_their_values(tmp_path):
    values = read_values(parameters_file(tmp_path, lower_mass=0.1), SPACE, SPACE.published)
    assert values == {**SPACE.published, "lower_mass": 0.1}


def test_a_folder_with_something_in_it_is_left_alone(problem, tmp_path):
    (tmp_path / "mine").write_text("")
    with pytest.raises(ArgumentError) as caught:
        save(problem, tmp_path)
    assert str(caught.value) == f"'{tmp_path}' isn't empty; name a new folder"


def test_trajectories_of_another_robot_are_refused(problem, tmp_path):
    save(problem, tmp_path / "out")
    (tmp_path / "out" / "c.npz").write_bytes(b"")
    with pytest.raises(ArgumentError, match=r"c.npz' is no trajectory of robot 'pendulum': "):
        load(tmp_path / "out", recorded.PENDULUM)
    for path in (tmp_path / "out").glob("*.npz"):
        path.unlink()
    with pytest.raises(ArgumentError, match=r"^'.*out' has no trajectories; name a folder that `swim2real export-s"):
        load(tmp_path / "out", recorded.PENDULUM)
    with pytest.raises(ParameterError, match=r"^unknown parameter 'elbow_damping'"):
        load(tmp_path / "out", recorded.FLOATER)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"mass": 0.1}, "unknown parameter 'mass'; known are shoulder_damping, elbow_damping, lower_mass in '{}'"),
        (
            {"lower_mass": 0.3},
            "parameter 'lower_mass' in '{}' is 0.3, out of bounds; allowed is 0.03 to 0.2 kg",
        ),
        ({"lower_mass": [0.1, 0.1]}, "parameter 'lower_mass' in '{}' has 2 numbers; it must have one"),
        ({"lower_mass": float("nan")}, "parameter 'lower_mass' in '{}' is nan; it must be finite, allowed is 0.03 to"),
    ],
)
def test_values_that_are_not_allowed_are_named(values, says, tmp_path):
    place = parameters_file(tmp_path, **values)
    with pytest.raises(ParameterError) as caught:
        read_values(place, SPACE, SPACE.published)
    assert str(caught.value).startswith(says.format(place))


def test_a_file_that_is_not_the_toolboxs_is_named(tmp_path):
    with pytest.raises(ParameterError, match=r"^parameters of the toolbox '.*params_x_hat.yaml' are not there$"):
        read_values(tmp_path, SPACE, SPACE.published)
    for text in ("lower_mass: 0.1", "lower_mass: {value: 1}", "- 1", "{", "\x00"):
        (tmp_path / "other.yaml").write_text(text)
        with pytest.raises(ParameterError, match=r"other.yaml' can't be read as parameters of the toolbox: "):
            read_values(tmp_path / "other.yaml", SPACE, SPACE.published)

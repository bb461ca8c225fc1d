import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swim2real.errors import ParameterError
from swim2real.parameters import Parameter, ParameterSpace

DRAG = Parameter("drag", "-", 0.0, 10.0, "Slows.", 0.4, log_offset=0.1)
ARM = Parameter("arm_length", "m", 0.01, 0.06, "Pulls.", 0.0395)
STIFFNESS = Parameter("stiffness", "N·m/rad", 0.1, 5.0, "Bends.", 0.65, log_offset=0.02)
SPACE = ParameterSpace((DRAG, ARM, STIFFNESS))
LINEAR = ParameterSpace(SPACE.parameters, "linear")
GOOD = {"drag": 0.4, "arm_length": 0.0395, "stiffness": 0.65}

unit = st.floats(0.0, 1.0, allow_subnormal=False)


@st.composite
def spaces(draw) -> ParameterSpace:
    parameters = []
    for i in range(draw(st.integers(1, 5))):
        lower = draw(st.floats(-100, 100))
        width = draw(st.floats(1e-3, 1e3))
        offset = draw(st.none() | st.floats(1e-3, 10).map(lambda extra, low=lower: extra * max(1.0, abs(low)) - low))
        parameters.append(Parameter(f"p{i}", "-", lower, lower + width, "", lower, offset))
    return ParameterSpace(tuple(parameters), draw(st.sampled_from(["log", "linear"])))


@pytest.mark.slow
@given(spaces(), st.data())
def test_a_point_of_the_cube_survives_the_way_to_values_and_back(space, data):
    point = np.array(data.draw(st.lists(unit, min_size=len(space), max_size=len(space))))
    np.testing.assert_allclose(space.to_cube(space.to_values(point)), point, atol=1e-6)


@pytest.mark.slow
@given(spaces(), st.data())
def test_values_survive_the_way_to_the_cube_and_back(space, data):
    values = {p.name: data.draw(st.floats(p.lower, p.upper)) for p in space}
    back = space.to_values(space.to_cube(values))
    for p in space:
        assert back[p.name] == pytest.approx(values[p.name], abs=1e-9 * max(1.0, abs(p.lower), abs(p.upper)))


@pytest.mark.slow
@given(spaces(), st.data())
def test_every_point_of_the_cube_gives_values_within_bounds(space, data):
    point = data.draw(st.lists(unit, min_size=len(space), max_size=len(space)))
    values = space.to_values(point)
    assert space.check(values) == values


@pytest.mark.slow
@given(spaces())
def test_corners_of_the_cube_are_the_bounds(space):
    low, high = space.to_values(np.zeros(len(space))), space.to_values(np.ones(len(space)))
    for p in space:
        assert low[p.name] == pytest.approx(p.lower, abs=1e-9 * max(1.0, abs(p.lower)))
        assert high[p.name] == pytest.approx(p.upper, rel=1e-9, abs=1e-9)


@given(st.lists(unit, min_size=2, max_size=2, unique=True))
def test_values_rise_with_the_coordinate_on_both_scales(pair):
    low, high = (np.full(3, x) for x in sorted(pair))
    for space in (SPACE, LINEAR):
        before, after = space.to_values(low), space.to_values(high)
        assert all(before[name] <= after[name] for name in space.names)


def test_the_linear_scale_is_the_papers_box():
    assert LINEAR.to_values([0.5, 0.5, 0.5]) == pytest.approx({"drag": 5.0, "arm_length": 0.035, "stiffness": 2.55})


def test_the_log_scale_spreads_out_the_low_end():
    middle = SPACE.to_values([0.5, 0.5, 0.5])
    assert middle["drag"] == pytest.approx(np.sqrt(0.1 * 10.1) - 0.1)
    assert middle["arm_length"] == pytest.approx(0.035)  # has no log offset, so it stays linear
    assert middle["stiffness"] == pytest.approx(np.sqrt(0.12 * 5.02) - 0.02)


def test_names_and_published_values_keep_the_order():
    assert SPACE.names == ("drag", "arm_length", "stiffness")
    assert list(SPACE.published.items()) == [("drag", 0.4), ("arm_length", 0.0395), ("stiffness", 0.65)]
    assert list(SPACE.check(dict(reversed(GOOD.items())))) == list(SPACE.names)
    assert len(SPACE) == 3
    assert SPACE["arm_length"] is ARM


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({**GOOD, "drgg": 1.0}, "unknown parameter 'drgg'; did you mean 'drag'?"),
        ({**GOOD, "xyz": 1.0}, "unknown parameter 'xyz'; known are drag, arm_length, stiffness"),
        ({"drag": 0.4, "stiffness": 0.65}, "missing parameter: arm_length"),
        ({"drag": 0.4}, "missing parameters: arm_length, stiffness"),
        ({**GOOD, "drag": float("nan")}, "parameter 'drag' is nan; it must be finite, allowed is 0 to 10"),
        ({**GOOD, "drag": float("inf")}, "parameter 'drag' is inf; it must be finite, allowed is 0 to 10"),
        ({**GOOD, "drag": 10**400}, "parameter 'drag' is inf; it must be finite, allowed is 0 to 10"),
        ({**GOOD, "arm_length": 0.5}, "parameter 'arm_length' is 0.5, out of bounds; allowed is 0.01 to 0.06 m"),
        ({**GOOD, "drag": -1}, "parameter 'drag' is -1, out of bounds; allowed is 0 to 10"),
        ({**GOOD, "drag": True}, "parameter 'drag' is True, not a number; allowed is 0 to 10"),
        ({**GOOD, "drag": "0.4"}, "parameter 'drag' is '0.4', not a number; allowed is 0 to 10"),
        ({**GOOD, "drag": None}, "parameter 'drag' is None, not a number; allowed is 0 to 10"),
        ({**GOOD, "drag": [1.0]}, "parameter 'drag' is [1.0], not a number; allowed is 0 to 10"),
        (
            {**GOOD, "stiffness": 6},
            "parameter 'stiffness' is 6, out of bounds; allowed is 0.1 to 5 N·m/rad",
        ),
    ],
)
def test_bad_values_are_refused_in_exact_words(values, message):
    with pytest.raises(ParameterError) as caught:
        SPACE.check(values)
    assert str(caught.value) == message
    assert caught.value.exit_code == 2


def test_messages_name_where_a_value_comes_from():
    with pytest.raises(
        ParameterError, match=r"^parameter 'drag' in best\.json is 11, out of bounds; allowed is 0 to 10$"
    ):
        SPACE.check({**GOOD, "drag": 11}, "best.json")
    with pytest.raises(ParameterError, match=r"^missing parameter in best\.json: drag$"):
        SPACE.check({"arm_length": 0.03, "stiffness": 1.0}, "best.json")
    with pytest.raises(ParameterError, match=r"^unknown parameter 'dragg'; did you mean 'drag'\? in best\.json$"):
        SPACE.check({**GOOD, "dragg": 1}, "best.json")


def test_whole_numbers_and_numpy_numbers_are_numbers():
    checked = SPACE.check({"drag": 1, "arm_length": np.float32(0.03), "stiffness": np.int64(2)})
    assert checked == pytest.approx({"drag": 1.0, "arm_length": 0.03, "stiffness": 2.0}, rel=1e-6)
    assert {type(value) for value in checked.values()} == {float}


def test_bounds_themselves_are_allowed():
    assert SPACE.check({"drag": 0, "arm_length": 0.06, "stiffness": 5})["arm_length"] == 0.06


def test_an_unknown_name_is_refused_on_look_up():
    with pytest.raises(ParameterError, match=re.escape("unknown parameter 'stifness'; did you mean 'stiffness'?")):
        SPACE["stifness"]


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ([0.5, 0.5], "a point of this space has 3 coordinates, got shape (2,)"),
        ([[0.5, 0.5, 0.5]], "a point of this space has 3 coordinates, got shape (1, 3)"),
        ([0.5, 0.5, 1.5], "a point of the unit cube must lie within 0 and 1, got 0.5 to 1.5"),
        ([-0.1, 0.5, 0.5], "a point of the unit cube must lie within 0 and 1, got -0.1 to 0.5"),
        ([np.nan, 0.5, 0.5], "a point of the unit cube must lie within 0 and 1, got nan to nan"),
    ],
)
def test_points_outside_the_cube_are_refused(point, message):
    with pytest.raises(ParameterError) as caught:
        SPACE.to_values(point)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("bounds", "says"),
    [
        ((1.0, 1.0), "lower bound 1 is the upper bound, too; give a range, or leave the parameter out"),
        ((750.0, 30.0), "lower bound 750 is above upper bound 30; swap them"),
        ((0.0, np.inf), "lower bound 0 and upper bound inf must be finite numbers"),
        ((np.nan, 1.0), "lower bound nan and upper bound 1 must be finite numbers"),
    ],
)
def test_bounds_that_dont_rise_are_refused(bounds, says):
    with pytest.raises(ParameterError) as caught:
        Parameter("p", "-", *bounds, "", 0.0)
    assert str(caught.value) == f"parameter 'p': {says}"


def test_a_log_scale_that_would_leave_the_positive_numbers_is_refused():
    with pytest.raises(ParameterError, match=r"lower bound -1\.0 plus log offset 1\.0 must be above 0"):
        Parameter("p", "-", -1.0, 1.0, "", 0.0, log_offset=1.0)


def test_two_parameters_of_one_name_and_unknown_scales_are_refused():
    with pytest.raises(ParameterError, match="parameter names must differ: drag, drag"):
        ParameterSpace((DRAG, DRAG))
    with pytest.raises(ParameterError, match="scale is 'cubic'; allowed are 'log' and 'linear'"):
        ParameterSpace((DRAG,), "cubic")

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refused import refusal, says
from swim2real.parameters import Parameter, ParameterSpace
from swimbase.errors import ParameterError

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


@given(spaces(), st.data())
def test_points_and_values_survive_the_way_there_and_back(space, data):
    point = np.array(data.draw(st.lists(unit, min_size=len(space), max_size=len(space))))
    values = space.to_values(point)
    assert space.check(values) == values  # within bounds
    np.testing.assert_allclose(space.to_cube(values), point, atol=1e-6)
    drawn = {p.name: data.draw(st.floats(p.lower, p.upper)) for p in space}
    back = space.to_values(space.to_cube(drawn))
    low, high = space.to_values(np.zeros(len(space))), space.to_values(np.ones(len(space)))
    for p in space:
        assert back[p.name] == pytest.approx(drawn[p.name], abs=1e-9 * max(1.0, abs(p.lower), abs(p.upper)))
        assert (low[p.name], high[p.name]) == (p.lower, p.upper)


@given(st.lists(unit, min_size=2, max_size=2, unique=True))
def test_values_rise_with_the_coordinate_on_both_scales(pair):
    low, high = (np.full(3, x) for x in sorted(pair))
    for space in (SPACE, LINEAR):
        before, after = space.to_values(low), space.to_values(high)
        assert all(before[name] <= after[name] for name in space.names)


def test_the_scales_are_the_papers_and_checked_values_floats_in_order():
    assert LINEAR.to_values([0.5, 0.5, 0.5]) == pytest.approx({"drag": 5.0, "arm_length": 0.035, "stiffness": 2.55})
    middle = SPACE.to_values([0.5, 0.5, 0.5])
    assert middle["drag"] == pytest.approx(np.sqrt(0.1 * 10.1) - 0.1)
    assert middle["arm_length"] == pytest.approx(0.035)  # has no log offset, so it stays linear
    assert middle["stiffness"] == pytest.approx(np.sqrt(0.12 * 5.02) - 0.02)
    assert list(SPACE.check(dict(reversed(GOOD.items())))) == list(SPACE.names) == ["drag", "arm_length", "stiffness"]
    checked = SPACE.check({"drag": 0, "arm_length": np.float32(0.03), "stiffness": np.int64(5)})  # bounds are allowed
    assert checked == pytest.approx({"drag": 0.0, "arm_length": 0.03, "stiffness": 5.0}, rel=1e-6)
    assert {type(value) for value in checked.values()} == {float}
    assert SPACE["arm_length"] is ARM


@pytest.mark.parametrize(("values", "parts"), [
    ({**GOOD, "drgg": 1.0}, ("'drgg'", "did you mean 'drag'", "in best.json")),
    ({"drag": 0.4, "stiffness": 0.65}, ("missing parameter in best.json: arm_length",)),
    ({**GOOD, "drag": float("nan")}, ("'drag'", "nan", "finite", "0 to 10")),
    ({**GOOD, "drag": 10**400}, ("'drag'", "inf", "finite", "0 to 10")),
    ({**GOOD, "arm_length": 0.5}, ("'arm_length' in best.json is 0.5", "out of bounds", "0.01 to 0.06 m")),
    ({**GOOD, "drag": True}, ("'drag'", "true, not a number", "0 to 10")),
    ({**GOOD, "drag": None}, ("'drag'", "null, not a number")),
])  # fmt: skip
def test_bad_values_are_refused(values, parts):
    assert says(refusal(ParameterError, SPACE.check, values, "best.json"), *parts)


@pytest.mark.parametrize(("point", "parts"), [
    ([0.5, 0.5], ("3 coordinates", "(2,)")),
    ([0.5, 0.5, 1.5], ("within 0 and 1", "0.5 to 1.5")),
    ([np.nan, 0.5, 0.5], ("within 0 and 1", "nan")),
])  # fmt: skip
def test_points_outside_the_cube_are_refused(point, parts):
    assert says(refusal(ParameterError, SPACE.to_values, point), *parts)


@pytest.mark.parametrize(("bounds", "offset", "parts"), [
    ((1.0, 1.0), None, ("'p'", "1 is the upper bound", "give a range")),
    ((750.0, 30.0), None, ("'p'", "750 is above upper bound 30", "swap")),
    ((np.nan, 1.0), None, ("'p'", "nan", "finite")),
    ((-1.0, 1.0), 1.0, ("-1.0 plus log offset 1.0", "above 0")),
])  # fmt: skip
def test_bounds_that_arent_a_range_are_refused(bounds, offset, parts):
    assert says(refusal(ParameterError, Parameter, "p", "-", *bounds, "", 0.0, offset), *parts)


def test_spaces_and_names_that_arent_there_are_refused():
    assert says(refusal(ParameterError, SPACE.__getitem__, "stifness"), "'stifness'", "did you mean 'stiffness'")
    assert len(refusal(ParameterError, SPACE.__getitem__, "x" * 20_000)) < 300
    assert len(refusal(ParameterError, SPACE.check, {**GOOD, "drag": "x" * 20_000})) < 300
    assert says(refusal(ParameterError, ParameterSpace, (DRAG, DRAG)), "names must differ", "drag, drag")
    assert says(refusal(ParameterError, ParameterSpace, (DRAG,), "cubic"), "'cubic'", "'log' and 'linear'")

import mujoco
import numpy as np
import pytest

from made_robots import ARM
from refused import refusal, says
from swim2real.robots.compiled import same
from swim2real.robots.targets import Target, attribute, attribute_names
from swimbase.errors import RobotError


@pytest.fixture
def spec():
    return mujoco.MjSpec.from_string(ARM)


def applied(spec, target, value):
    copy = spec.copy()
    target.setter(copy)(value)
    return copy.compile()


LINES = [
    "option density", "option gravity[2]", "option timestep", 'joint "link0" damping', 'joint "link0" stiffness',
    'joint "link0" range[1]', 'joint "link1" springref', 'joint "link1" armature', 'joint "link0" frictionloss',
    'geom "rod0" mass', 'geom "rod0" size[1]', 'geom "rod1" fluidcoef[4]', 'geom class "wet" fluidcoef[0]',
    'body "lower" mass', 'body "lower" diaginertia[2]', 'body "lower" ipos[0]', 'body "lower" pos[2]',
    'site "tip" pos[0]', 'tendon "cable" stiffness', 'tendon "cable" frictionloss', 'tendon class "soft" damping',
    'actuator "servo" kp', 'actuator "servo" kv', 'actuator "motor" kv', 'actuator "torque" gear[0]',
    'actuator "law" gainprm[0]', 'actuator "servo" forcerange[1]', 'equality "gear" polycoef[1]',
]  # fmt: skip


@pytest.mark.parametrize("line", LINES)
def test_a_model_gets_back_what_was_read_from_it_and_changes_with_another_value(spec, line):
    target = Target(line)
    own = target.current(spec)[0]
    before = spec.copy().compile()
    assert same(applied(spec, target, own), before)
    changed = applied(spec, target, own * 0.9 + 1e-5)
    assert not same(changed, before)
    copy = spec.copy()
    target.setter(copy)(own * 0.9 + 1e-5)
    assert set(target.current(copy)) == {own * 0.9 + 1e-5}


@pytest.mark.parametrize(("line", "joints"), [
    ('joint "link0" damping', ["link0"]),
    ('joint "link*" damping', ["link0", "link1"]),
    ('joint "link[1-9]" damping', ["link1"]),
    ('joint "link1", "link0" damping', ["link0", "link1"]),
    ('joint "link1" , "link*" damping[0]', ["link0", "link1"]),
    ('  joint  class  "soft"  damping ', ["link0"]),
    ('joint class "main", "soft" damping', ["link0", "link1"]),
])  # fmt: skip
def test_a_line_stands_for_the_elements_that_it_names(spec, line, joints):
    model = applied(spec, Target(line), 0.5)
    damping = {model.joint(j).name: float(model.joint(j).damping.ravel()[0]) for j in range(model.njnt)}
    assert damping == {name: 0.5 if name in joints else 0.02 for name in ("link0", "link1")}


def test_factor_offset_and_a_relative_value_make_the_number_of_the_value(spec):
    target = Target('site "tip" pos[0]', factor=2.0, offset=-0.3)
    assert applied(spec, target, 0.25).site("tip").pos[0] == pytest.approx(0.2)
    assert target.current(spec) == [pytest.approx(0.2)]
    spec.joint("link1").damping = 0.1 if np.ndim(spec.joint("link1").damping) == 0 else [0.1, 0, 0]
    target = Target('joint "link0", "link*" damping', relative=True)
    assert target.current(spec) == [1.0]
    model = applied(spec, target, 3.0)
    np.testing.assert_allclose(model.dof_damping.reshape(2, -1)[:, 0], [0.06, 0.3])
    scaled = Target('joint "link0" damping', factor=2.0, offset=-1.0, relative=True)
    assert scaled.current(spec) == [1.0]
    assert applied(spec, scaled, 2.0).dof_damping.ravel()[0] == pytest.approx(0.06)


def test_an_angle_is_in_the_unit_of_its_file(spec):
    limits = Target('joint "link0" range[1]')
    assert limits.current(spec) == [60.0]
    assert applied(spec, limits, 45.0).jnt_range[0, 1] == pytest.approx(np.pi / 4)
    radian = mujoco.MjSpec.from_string(ARM.replace("<option", '<compiler angle="radian"/><option'))
    assert applied(radian, limits, 0.5).jnt_range[0, 1] == 0.5


@pytest.mark.parametrize(("line", "parts"), [
    ('joint hip damping', ("'joint hip damping'", 'joint "hip" damping', "option density")),
    ('join "link0" damping', ("'join'", "did you mean 'joint'?", "option, body")),
    ('option "water" density', ("'option \"water\" density'", "option takes no name")),
    ("joint damping", ("'joint damping'", "joint needs a name")),
    ('joint "link2" damping', ("no joint 'link2'", "did you mean 'link1'?", "link0, link1")),
    ('geom "rod2" mass', ("no geom 'rod2'", "rod0, rod1 (1 of kind geom have no name")),
    ('mesh "fin" scale[0]', ("no mesh 'fin'", "there are none")),
    ('geom class "dry" mass', ("no geom of class 'dry'", "main, wet")),
    ("option wetness", ("option has no number 'wetness'", "there are ")),
    ('joint "link0" dampin', ("'link0' has no number 'dampin'", "did you mean 'damping'?", "armature, axis,")),
    ('actuator "torque" kp', ("'torque' has no number 'kp'",)),
    ('geom "rod0" fluidcoef', ("fluidcoef of geom 'rod0' has 5 values", "fluidcoef[0] to fluidcoef[4]")),
    ('geom "rod0" fluidcoef[5]', ("fluidcoef of geom 'rod0' has 5 values", "no [5]")),
    ('joint "link0" damping[1]', ("'link0' has one damping", "leave out [1]")),
])  # fmt: skip
def test_a_line_that_leads_nowhere_is_named(spec, line, parts):
    assert says(refusal(RobotError, Target(line).setter, spec), *parts)


def test_a_negative_number_has_no_sense_everywhere(spec):
    said = refusal(RobotError, Target('joint "link0" damping', factor=-1.0).check_bound, spec, 2.0)
    assert says(said, '2 would write -2 to joint "link0" damping', "can't be negative", "change the bound")
    said = refusal(RobotError, Target('body "lower" pos[2]', relative=True).check_bound, spec, -0.5)
    assert says(said, "-0.5 would write -0.5 times its own to body")
    Target('body "lower" pos[2]').check_bound(spec, -0.5)
    Target('joint "link0" damping', offset=3.0).check_bound(spec, -2.0)


# numbers of elements

KINDS = ("bodies", "joints", "geoms", "sites", "tendons", "actuators", "equalities")


def number(element, name, index=0):
    found = attribute(element, name)
    assert found is not None
    return found.read(index)


def put(element, name, value, index=0):
    found = attribute(element, name)
    assert found is not None
    found.write(index, value)


@pytest.mark.parametrize("kind", KINDS)
def test_every_name_that_is_listed_can_be_read_and_written(spec, kind):
    element = getattr(spec, kind)[-1]
    names = attribute_names(element)
    assert names
    for name in names:
        found = attribute(element, name)
        last = (found.size or 1) - 1
        found.write(last, 0.5)
        assert found.read(last) == 0.5, name
    joint = spec.joint("link0")
    for name in ("name", "axes", "user", "__class__"):  # no number
        assert attribute(joint, name) is None
    sizes = [attribute(joint, name).size for name in ("armature", "damping", "stiffness", "range")]
    assert sizes == [None, None, None, 2]  # whether or not the engine has polynomials


def test_gains_of_servos_go_to_both_places_of_their_law(spec):
    servo, motor, damped = (spec.actuator(name) for name in ("servo", "motor", "damped"))
    assert (number(servo, "kp"), number(servo, "kv")) == (5.0, 0.3)
    assert attribute(motor, "kp") is None
    assert number(motor, "kv") == 0.7
    assert np.isnan(number(damped, "kv"))  # a damping ratio is no kv
    for element, name, value in ((servo, "kp", 8.0), (servo, "kv", 0.4), (motor, "kv", 0.9), (damped, "kv", 0.2)):
        put(element, name, value)
    model = spec.compile()
    np.testing.assert_array_equal(model.actuator("servo").gainprm[:3], [8.0, 0, 0])
    np.testing.assert_array_equal(model.actuator("servo").biasprm[:3], [0, -8.0, -0.4])
    assert model.actuator("motor").gainprm[0] == 0.9
    np.testing.assert_array_equal(model.actuator("motor").biasprm[:3], [0, 0, -0.9])
    assert model.actuator("damped").biasprm[2] == -0.2
    servo.biasprm[2] = 0.0
    assert str(number(servo, "kv")) == "0.0"

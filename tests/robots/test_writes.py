import mujoco
import numpy as np
import pytest

from made_robots import ARM
from swim2real.errors import RobotError
from swim2real.robots.compiled import compiled, numbers, same
from swim2real.robots.writes import Write


@pytest.fixture
def spec():
    return mujoco.MjSpec.from_string(ARM)


def applied(spec, write, value):
    copy = spec.copy()
    write.into(copy)(value)
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
    write = Write(line)
    own = write.current(spec)[0]
    before = spec.copy().compile()
    assert same(applied(spec, write, own), before)
    changed = applied(spec, write, own * 0.9 + 1e-5)
    assert not same(changed, before)
    copy = spec.copy()
    write.into(copy)(own * 0.9 + 1e-5)
    assert set(write.current(copy)) == {own * 0.9 + 1e-5}


@pytest.mark.parametrize(
    ("line", "joints"),
    [
        ('joint "link0" damping', ["link0"]),
        ('joint "link*" damping', ["link0", "link1"]),
        ('joint "link[1-9]" damping', ["link1"]),
        ('joint "link1", "link0" damping', ["link0", "link1"]),
        ('joint "link1" , "link*" damping[0]', ["link0", "link1"]),
        ('  joint  class  "soft"  damping ', ["link0"]),
        ('joint class "main", "soft" damping', ["link0", "link1"]),
    ],
)
def test_a_line_stands_for_the_elements_that_it_names(spec, line, joints):
    model = applied(spec, Write(line), 0.5)
    damping = {model.joint(j).name: float(model.joint(j).damping.ravel()[0]) for j in range(model.njnt)}
    assert damping == {name: 0.5 if name in joints else 0.02 for name in ("link0", "link1")}


def test_an_element_with_a_bracket_in_its_name_is_found():
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body><joint name="j[0]"/><geom size="1"/></body></worldbody></mujoco>'
    )
    assert applied(spec, Write('joint "j[0]" armature'), 2.0).dof_armature[0] == 2.0


def test_factor_and_offset_make_the_number_of_the_value(spec):
    write = Write('site "tip" pos[0]', factor=2.0, offset=-0.3)
    assert applied(spec, write, 0.25).site("tip").pos[0] == pytest.approx(0.2)
    assert write.current(spec) == [pytest.approx(0.2)]


def test_a_relative_value_multiplies_each_number_once(spec):
    spec.joint("link1").damping = 0.1 if np.ndim(spec.joint("link1").damping) == 0 else [0.1, 0, 0]
    write = Write('joint "link0", "link*" damping', relative=True)
    assert write.current(spec) == [1.0]
    model = applied(spec, write, 3.0)
    np.testing.assert_allclose(model.dof_damping.reshape(2, -1)[:, 0], [0.06, 0.3])
    scaled = Write('joint "link0" damping', factor=2.0, offset=-1.0, relative=True)
    assert scaled.current(spec) == [1.0]
    assert applied(spec, scaled, 2.0).dof_damping.ravel()[0] == pytest.approx(0.06)


def test_numbers_that_a_model_does_not_set_are_nan(spec):
    assert np.isnan(Write('geom "rod1" mass').current(spec)[0])
    assert np.isnan(Write('actuator "damped" kv').current(spec)[0])


def test_an_angle_is_in_the_unit_of_its_file(spec):
    limits = Write('joint "link0" range[1]')
    assert limits.current(spec) == [60.0]
    assert applied(spec, limits, 45.0).jnt_range[0, 1] == pytest.approx(np.pi / 4)
    radian = mujoco.MjSpec.from_string(ARM.replace("<option", '<compiler angle="radian"/><option'))
    assert applied(radian, limits, 0.5).jnt_range[0, 1] == 0.5


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (
            'joint hip damping',
            "'joint hip damping' can't be read as a place in the model; write it as in: joint \"hip\" damping, "
            'geom "fin" fluidcoef[2], geom class "wet" fluidcoef[0], option density',
        ),
        ('join "link0" damping', "there is no kind of element 'join'; did you mean 'joint'? there are option, body, "
         "joint, geom, site, tendon, actuator, equality, mesh"),
        ('option "water" density', "'option \"water\" density': option takes no name"),
        ("joint damping", "'joint damping': joint needs a name, such as \"hip\""),
        ('joint "link2" damping', "the model has no joint 'link2'; did you mean 'link1'? there are link0, link1"),
        ('geom "rod2" mass', "the model has no geom 'rod2'; did you mean 'rod1'? there are rod0, rod1 (1 of kind geom "
         "have no name; give them one in the MJCF file)"),
        ('mesh "fin" scale[0]', "the model has no mesh 'fin'; there are none"),
        ('geom class "dry" mass', "the model has no geom of class 'dry'; there are main, wet"),
        ('tendon "cables" damping', "the model has no tendon 'cables'; did you mean 'cable'? there is cable"),
        ("option wetness", "option has no number 'wetness'; there are "),
        ('joint "link0" dampin', "joint 'link0' has no number 'dampin'; did you mean 'damping'? there are actfrcrange, "
         "armature, axis, damping,"),
        ('actuator "torque" kp', "actuator 'torque' has no number 'kp'; there are "),
        ('geom "rod0" fluidcoef', "fluidcoef of geom 'rod0' has 5 values; say which one: fluidcoef[0] to fluidcoef[4]"),
        ('geom "rod0" fluidcoef[5]', "fluidcoef of geom 'rod0' has 5 values, from [0]; there is no [5]"),
        ('joint "link0" damping[1]', "joint 'link0' has one damping; leave out [1]"),
    ],
)  # fmt: skip
def test_a_line_that_leads_nowhere_is_named(spec, line, says):
    with pytest.raises(RobotError) as caught:
        Write(line).into(spec)
    assert str(caught.value) == says or (says.endswith((" ", ",")) and str(caught.value).startswith(says))


def test_a_negative_number_has_no_sense_everywhere(spec):
    with pytest.raises(RobotError) as caught:
        Write('joint "link0" damping', factor=-1.0).check_sense(spec, 2.0)
    assert str(caught.value) == (
        '2 would write -2 to joint "link0" damping, which can\'t be negative; change the bound, or the factor and '
        "offset"
    )
    with pytest.raises(RobotError) as caught:
        Write('body "lower" pos[2]', relative=True).check_sense(spec, -0.5)
    assert str(caught.value).startswith("-0.5 would write -0.5 times its own to body")
    Write('body "lower" pos[2]').check_sense(spec, -0.5)
    Write('joint "link0" damping', offset=3.0).check_sense(spec, -2.0)


def test_models_are_the_same_only_with_the_same_numbers(spec):
    first = spec.copy().compile()
    assert same(first, spec.copy().compile())
    spec.option.timestep = 0.001
    assert not same(first, spec.copy().compile())
    names = [name for name, _ in numbers(first)]
    assert {"dof_damping", "geom_fluid", "opt.timestep", "opt.gravity", "body_mass"} <= set(names)


def test_a_model_that_does_not_compile_is_told_in_one_line(spec):
    spec.joint("link0").range = [2.0, 1.0]
    with pytest.raises(RobotError) as caught:
        compiled(spec, "robot file 'arm.toml'")
    assert str(caught.value).startswith("robot file 'arm.toml': the model doesn't compile: Error: range[0] should be")
    assert "\n" not in str(caught.value)

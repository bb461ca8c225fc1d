import mujoco
import numpy as np
import pytest

from made_robots import ARM
from swim2real.robots.attributes import attribute, attribute_names, class_name

KINDS = ("bodies", "joints", "geoms", "sites", "tendons", "actuators", "equalities")


@pytest.fixture
def spec():
    return mujoco.MjSpec.from_string(ARM)


def number(element, name, index=0):
    found = attribute(element, name)
    assert found is not None
    return found.read(index)


def put(element, name, value, index=0):
    found = attribute(element, name)
    assert found is not None
    found.write(index, value)


def test_names_are_those_of_the_mjcf_file(spec):
    assert number(spec.geom("rod1"), "fluidcoef", 2) == 1.5
    assert number(spec.geom("rod0"), "mass") == 0.1
    assert number(spec.body("lower"), "mass") == 0.2
    assert number(spec.body("lower"), "diaginertia", 1) == 2e-4
    assert number(spec.equality("gear"), "polycoef", 1) == 1.0
    assert number(spec.joint("link0"), "solreflimit") == 0.02
    assert number(spec.option, "density") == 1000.0


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


def test_what_is_no_number_has_no_attribute(spec):
    for element, name in ((spec.joint("link0"), "name"), (spec.joint("link0"), "axes"), (spec.geom("rod0"), "rgba")):
        assert attribute(element, name) is None
    assert attribute(spec.joint("link0"), "user") is None  # the model gives them none
    assert attribute(spec.joint("link0"), "__class__") is None


def test_one_number_needs_no_index_and_several_know_how_many_they_are(spec):
    assert attribute(spec.joint("link0"), "armature").size is None
    assert attribute(spec.joint("link0"), "range").size == 2
    assert attribute(spec.geom("rod0"), "fluidcoef").size == 5
    for name in ("damping", "stiffness"):  # whether or not the engine has polynomials
        assert attribute(spec.joint("link0"), name).size is None


def test_gains_of_servos_go_to_both_places_of_their_law(spec):
    servo = spec.actuator("servo")
    assert (number(servo, "kp"), number(servo, "kv")) == (5.0, 0.3)
    put(servo, "kp", 8.0)
    put(servo, "kv", 0.4)
    model = spec.compile()
    np.testing.assert_array_equal(model.actuator("servo").gainprm[:3], [8.0, 0, 0])
    np.testing.assert_array_equal(model.actuator("servo").biasprm[:3], [0, -8.0, -0.4])


def test_the_gain_of_a_velocity_servo_is_kv(spec):
    motor = spec.actuator("motor")
    assert attribute(motor, "kp") is None
    assert number(motor, "kv") == 0.7
    put(motor, "kv", 0.9)
    model = spec.compile()
    assert model.actuator("motor").gainprm[0] == 0.9
    np.testing.assert_array_equal(model.actuator("motor").biasprm[:3], [0, 0, -0.9])


def test_a_damping_ratio_is_no_kv_until_one_is_written(spec):
    damped = spec.actuator("damped")
    assert np.isnan(number(damped, "kv"))
    put(damped, "kv", 0.2)
    assert spec.compile().actuator("damped").biasprm[2] == -0.2


def test_a_position_servo_without_kv_has_one_of_0(spec):
    servo = spec.actuator("servo")
    servo.biasprm[2] = 0.0
    assert str(number(servo, "kv")) == "0.0"


def test_other_actuators_have_no_servo_gains(spec):
    for name in ("torque", "law"):  # the bias of `law` isn't in use, since its biastype is none
        assert attribute(spec.actuator(name), "kp") is None
        assert attribute(spec.actuator(name), "kv") is None
        assert "kp" not in attribute_names(spec.actuator(name))
    assert number(spec.actuator("torque"), "gear") == 2.0


def test_the_default_class_of_every_kind_of_element(spec):
    assert class_name(spec.geom("rod1")) == "wet"
    assert class_name(spec.joint("link0")) == "soft"
    assert class_name(spec.joint("link1")) == "main"
    assert class_name(spec.tendon("cable")) == "soft"
    assert class_name(spec.actuator("servo")) == "main"

"""Motors files: what they say, and which are refused with which sentence."""

import math
import re
from pathlib import Path

import pytest

from motorline import read_motors
from motorline.sending import check_time
from swimbase.errors import ArgumentError

COLUMNS = ("tail_rad", "wheel_rad_s")
TAIL = "[tail]\nid = 3\nlowest = -1\nhighest = 0.5\n"
WHEEL = "[wheel]\nid = 4\n"


@pytest.fixture
def read(tmp_path):
    def read(text, columns=COLUMNS):
        path = tmp_path / "motors.toml"
        path.write_text(text, encoding="utf-8")
        return read_motors(path, columns)

    return read


def test_what_a_file_says_and_what_it_leaves_out(read):
    tail, wheel = read(
        WHEEL + 'model = "XM430-W350"\nspeed = 2\nacceleration = 30\ndirection = -1\n' + TAIL + "zero = 1.5\n"
    )
    assert (tail.column, tail.id, tail.direction, tail.zero, tail.model.name) == ("tail_rad", 3, 1, 1.5, "XW540-T140-R")
    assert (tail.limits.lowest, tail.limits.highest) == (-1.0, 0.5)
    assert (wheel.id, wheel.direction, wheel.model.number) == (4, -1, 1020)
    assert (wheel.limits.speed, wheel.limits.acceleration) == (2.0, 30.0)
    assert str(tail) == "motor tail (id 3)"
    tail, wheel = read(TAIL + WHEEL + 'model = "XL430-W250"')
    assert (tail.zero, wheel.limits.acceleration) == (math.pi, 100.0)
    assert wheel.limits.speed == pytest.approx(265 * 0.229 * 2 * math.pi / 60)


@pytest.mark.parametrize(("text", "sentence"), [
    ("[tail", "motors.toml' is not TOML"),
    ("tail = 3\n" + WHEEL, "motors.toml, motor tail is 3; it must be a table, [tail] with id"),
    (WHEEL, "motors.toml: the column tail_rad has no motor; add [tail] with its id"),
    (TAIL + WHEEL + "[fin]\nid = 5", "motors.toml: motor fin has no column in the table, which has tail_rad"),
    (TAIL + "[wheel]", "motors.toml, motor wheel: id is missing"),
    ("[tail]\nid = 3\nlowest = 0\n" + WHEEL, "motor tail: highest is missing; a motor that follows an angle needs"),
    (TAIL + "[wheel]\nid = 253", "motors.toml, motor wheel: id is 253; ids are 0 to 252"),
    (TAIL + "[wheel]\nid = 1.0", "motor wheel: id is 1.0; it must be a whole number"),
    (TAIL + "[wheel]\nid = true", "motor wheel: id is True; it must be a whole number"),
    (TAIL + "[wheel]\nid = 3", "motors.toml: motors tail and wheel both have id 3; each needs its own"),
    (TAIL + WHEEL + "ID = 4", "motor wheel: there is no key ID; known are id, model, direction"),
    (TAIL + WHEEL + 'model = "AX-12A"', "model is 'AX-12A'; it must be one of XW540-T140-R, XL430-W250"),
    (TAIL + WHEEL + "direction = 2", "motor wheel: direction is 2; it must be 1 or -1"),
    (TAIL + WHEEL + "speed = 0", "motor wheel: the limit of the speed is 0; it must be finite and above 0"),
    (TAIL + WHEEL + 'speed = "fast"', "motor wheel: speed is 'fast'; it must be a finite number"),
    (TAIL + WHEEL + "acceleration = inf", "motor wheel: acceleration is inf; it must be a finite number"),
    (TAIL + WHEEL + "lowest = 0", "motor wheel: lowest is for an angle, and the column wheel_rad_s is a speed"),
    (TAIL + "zero = 0\n" + WHEEL, "lowest is -1 rad, where the motor would be at -1 rad; its angles go"),
    ("[tail]\nid = 3\nlowest = 1\nhighest = 0\n" + WHEEL, "motor tail: the lowest angle is 1 and the highest 0"),
])  # fmt: skip
def test_a_wrong_file_is_refused_with_motor_key_and_value(read, text, sentence):
    with pytest.raises(ArgumentError, match=re.escape(sentence)):
        read(text)


def test_columns_that_motors_cant_follow_and_a_file_that_isnt_there(read, tmp_path):
    with pytest.raises(ArgumentError, match=r"the column winch_m is in m; a motor takes speeds in rad/s \(NAME_rad_s"):
        read(TAIL, ("tail_rad", "winch_m"))
    with pytest.raises(ArgumentError, match="the columns tail_rad and tail_rad_s are of one motor"):
        read(TAIL, ("tail_rad", "tail_rad_s"))
    with pytest.raises(ArgumentError, match=r"motors file .*none\.toml' can't be read: No such file"):
        read_motors(tmp_path / "none.toml", COLUMNS)


def test_the_example_of_the_page_is_right(read):
    page = (Path(__file__).parents[2] / "docs" / "deployment.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    motors = read(example, [f"servo{k}_rad" for k in (1, 2, 3, 4)])
    check_time(motors, 57_600)

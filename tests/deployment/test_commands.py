"""Tables of commands: their file, limits, clipping, ramps."""

import math
import re
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swim2real.deployment import FISH, RATE, XW540_T140, CommandTable, Limits, read_table, write_table
from swim2real.errors import ArgumentError

speeds = st.lists(st.floats(-30, 30), min_size=1, max_size=60)


@pytest.fixture
def file(tmp_path):
    def write(text: str, name: str = "commands.csv"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def refusal(path) -> str:
    with pytest.raises(ArgumentError) as refused:
        read_table(path)
    return str(refused.value)


def fish(velocities) -> CommandTable:
    return CommandTable.of({FISH: velocities})


@settings(max_examples=25)
@given(speeds, st.floats(-3, 3))
def test_what_is_written_is_read(tmp_path_factory, velocities, angle):
    path = tmp_path_factory.mktemp("table") / "commands.csv"
    table = CommandTable.of({FISH: velocities, "servo1_rad": [angle] * len(velocities), "winch_m": velocities})
    write_table(path, table)
    assert read_table(path) == table
    assert table.column("servo1_rad") == (angle,) * len(velocities)
    assert table.times == tuple(k / RATE for k in range(len(velocities)))


def test_the_file_is_as_the_interface_says(tmp_path):
    write_table(tmp_path / "c.csv", fish([0.0, 1.5, -2.25]))
    assert (tmp_path / "c.csv").read_text() == "time_s,velocity_rad_s\n0.00,0.0\n0.02,1.5\n0.04,-2.25\n"
    write_table(tmp_path / "c.csv", CommandTable.of({"tail_rad": [0, 1], "wheel_rad_s": [2, -3]}))
    assert (tmp_path / "c.csv").read_text() == "time_s,tail_rad,wheel_rad_s\n0.00,0.0,2.0\n0.02,1.0,-3.0\n"


def test_a_table_of_another_program_is_read(file):
    table = read_table(file("\ufefftime_s, velocity_rad_s\r\n0,1e0\r\n0.0200001, 2\r\n\r\n"))
    assert table == fish([1.0, 2.0])
    assert table.times == (0.0, 0.02)
    assert table.duration == 0.04


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "commands.csv line 1: the header is ''; it must be time_s and a column an actuator"),
        ("t,v\n0,1\n", "line 1: the header is 't,v'; it must be time_s and a column an actuator, as 'time_s,velocity_"),
        ("time_s,fast\n0,1\n", "line 1: the header is 'time_s,fast'; 'fast' isn't a name and a unit, as servo1_rad is"),
        ("time_s,_rad\n0,1\n", "'_rad' isn't a name and a unit"),
        ("time_s,a_rad,a_rad\n0,1,1\n", "the column a_rad is there twice"),
        ("time_s,a_rad,b_m\n0,1,nan\n", "line 2, column b_m: the value is nan; it must be finite, in m"),
        ("time_s,velocity_rad_s\n", "commands.csv: there are no commands below the header"),
        ("time_s,velocity_rad_s\n0,1\n0.02,fast\n", "line 3, column velocity_rad_s: 'fast' is not a number"),
        ("time_s,velocity_rad_s\n0,1\n0.02,nan\n", "line 3, column velocity_rad_s: the value is nan; it must be"),
        ("time_s,velocity_rad_s\n0,1\n0.02,inf\n", "line 3, column velocity_rad_s: the value is inf"),
        ("time_s,velocity_rad_s\n0.02,1\n", "line 2, column time_s: the time is 0.02 s; it must be 0"),
        ("time_s,velocity_rad_s\n0,1\n0.04,1\n", "line 3, column time_s: the time is 0.04 s; it must be 0.02"),
        ("time_s,velocity_rad_s\n0,1\nnan,1\n", "line 3, column time_s: the time is nan s"),
        ("time_s,velocity_rad_s\n0,1,2\n", "line 2: there are 3 columns; there must be 2"),
        ("time_s,velocity_rad_s\n0,1\n\n0.04,1\n", "line 3: there are 0 columns"),
    ],
)
def test_a_wrong_file_is_refused_with_line_and_column(file, text, sentence):
    assert sentence in refusal(file(text))


def test_files_that_cant_be_read_or_written(tmp_path, file):
    assert f"command table '{tmp_path / 'none.csv'}' can't be read: No such file" in refusal(tmp_path / "none.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x01")
    assert "is not a CSV text file" in refusal(tmp_path / "binary.csv")
    with pytest.raises(ArgumentError, match="can't be written: No such file"):
        write_table(tmp_path / "none" / "c.csv", fish([0.0]))


@pytest.mark.parametrize(
    ("columns", "sentence"),
    [
        ({}, "can't have these columns: it must be time_s and a column"),
        ({"a_rad": [1.0], "b_rad": [1.0, 2.0]}, "differ in length (a_rad 1, b_rad 2)"),
        ({FISH: []}, "no rows"),
        ({FISH: [0.0, math.nan]}, "command 1, column velocity_rad_s: the value is nan; it must be finite, in rad/s"),
        ({"a,b_rad": [1.0]}, "'a,b_rad' isn't a name and a unit"),
    ],
)
def test_what_is_no_table(columns, sentence):
    with pytest.raises(ArgumentError, match=re.escape(sentence)):
        CommandTable.of(columns)


def test_a_column_that_isnt_there():
    with pytest.raises(ArgumentError, match="there is no column tail_rad in the table; it has velocity_rad_s"):
        fish([0.0]).within({"tail_rad": XW540_T140})


def test_the_motors_limits_are_those_of_its_manual():
    assert XW540_T140.speed == pytest.approx(304 * 0.229 * 2 * math.pi / 60)
    assert XW540_T140.speed == pytest.approx(7.29, abs=0.005)


def test_a_table_beyond_the_limits_is_refused_with_time_and_value():
    limits = {FISH: Limits(5.0, 50.0)}
    assert fish([5.0, 4.0, 5.0]).within(limits).speed(FISH) == 5.0
    with pytest.raises(ArgumentError, match=r"the command at 0\.04 s is -5\.1 rad/s; the limit is 5 rad/s either way"):
        fish([-4.9, -5.0, -5.1]).within(limits)
    with pytest.raises(
        ArgumentError, match=r"at 0\.02 s goes from 1 to -0\.5 rad/s, 75 rad/s²; the limit is 50 rad/s²"
    ):
        fish([1.0, -0.5]).within(limits)


def test_the_limits_of_angles():
    limits = {"a_rad": Limits(2.0, 50.0, -1.0, 1.5)}
    table = CommandTable.of({"a_rad": [1.5, 1.46, 1.5], FISH: [0, 99, 0]}).within(limits)
    assert table.speed("a_rad") == pytest.approx(2.0)
    with pytest.raises(ArgumentError, match=r"a_rad: the command at 0\.02 s is -1\.1 rad; the limits are -1 to 1\.5"):
        CommandTable.of({"a_rad": [-1.0, -1.1]}).within(limits)
    with pytest.raises(ArgumentError, match=r"a_rad: .* from 0 to 0\.05 rad, 2\.5 rad/s; the limit is 2 rad/s"):
        CommandTable.of({"a_rad": [0.0, 0.05]}).within(limits)


@pytest.mark.parametrize(("speed", "acceleration", "name"), [(0, 1, "speed"), (1, math.inf, "acceleration")])
def test_limits_must_be_limits(speed, acceleration, name):
    with pytest.raises(ArgumentError, match=f"the limit of the {name} is"):
        Limits(speed, acceleration)
    with pytest.raises(ArgumentError, match="the lowest angle is 1 and the highest 0"):
        Limits(1, 1, 1, 0)


@settings(max_examples=25)
@given(speeds, st.floats(0.5, 10), st.floats(10, 500), st.sampled_from([FISH, "a_rad"]))
def test_clipping_gives_what_can_be_followed_and_leaves_the_rest_alone(values, speed, acceleration, column):
    limits = {column: Limits(speed, acceleration, -1.0, 2.0)}
    table = CommandTable.of({column: values, "winch_m": values})
    clipped = table.clipped(limits)
    assert clipped.column("winch_m") == table.column("winch_m")
    assert clipped.within(limits).clipped(limits) == clipped


@settings(max_examples=25)
@given(speeds, st.floats(1, 500))
def test_ramps_go_from_and_to_rest_around_the_same_commands(velocities, acceleration):
    table = fish(velocities)
    ramped = table.ramped(acceleration)
    start = math.ceil(abs(velocities[0]) * RATE / acceleration - 1e-9)
    assert ramped.rows[start : start + len(velocities)] == table.rows
    ramped = ramped.column(FISH)
    assert ramped[0] == 0 or start == 0
    assert ramped[-1] == 0 or abs(velocities[-1]) < 1e-9
    steps = [abs(b - a) * RATE for a, b in pairwise(ramped)]
    assert all(s <= acceleration * (1 + 1e-6) for s in [*steps[:start], *steps[start + len(velocities) - 1 :]])


def test_speeds_ramp_together_and_angles_hold():
    table = CommandTable.of({"a_rad_s": [2.0, 4.0], "b_rad_s": [-1.0, 1.0], "c_rad": [0.3, 0.4]}).ramped(50.0)
    assert table.column("a_rad_s") == pytest.approx([0, 1, 2, 4, 3, 2, 1, 0])
    assert table.column("b_rad_s") == pytest.approx([0, -0.5, -1, 1, 0.75, 0.5, 0.25, 0])
    assert table.column("c_rad") == pytest.approx([0.3] * 3 + [0.4] * 5)


def test_angles_are_approached_together_while_speeds_rest():
    table = CommandTable.of({"a_rad": [1.0, 1.1], "b_rad": [0.5, 0.5], "c_rad_s": [0.0, 3.0]})
    longer = table.approached({"a_rad": 1.1, "b_rad": 0.3}, 2.5)
    assert longer.column("a_rad") == pytest.approx([1.1, 1.075, 1.05, 1.025, 1.0, 1.1])
    assert longer.column("b_rad") == pytest.approx([0.3, 0.35, 0.4, 0.45, 0.5, 0.5])
    assert longer.column("c_rad_s") == (0, 0, 0, 0, 0, 3)
    assert table.approached({"a_rad": 1.0, "b_rad": 0.5}, 1.0) == table


def test_ramps_need_an_acceleration():
    with pytest.raises(ArgumentError, match="the ramps' acceleration is 0"):
        fish([1.0]).ramped(0.0)
    with pytest.raises(ArgumentError, match="the speed of the approach is 0"):
        CommandTable.of({"a_rad": [0.0]}).approached({"a_rad": 1.0}, 0.0)


def test_repeating():
    assert fish([1.0, 2.0]).repeated(2) == fish([1.0, 2.0, 1.0, 2.0])
    with pytest.raises(ArgumentError, match="can't be repeated 0 times"):
        fish([1.0]).repeated(0)

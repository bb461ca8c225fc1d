"""Tables of commands: their file, limits, clipping, ramps."""

import math
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swim2real.deployment import RATE, XW540_T140, CommandTable, Limits, read_table, write_table
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


@settings(max_examples=25)
@given(speeds)
def test_what_is_written_is_read(tmp_path_factory, velocities):
    path = tmp_path_factory.mktemp("table") / "commands.csv"
    written = write_table(path, [k / RATE for k in range(len(velocities))], velocities)
    assert read_table(path) == written == CommandTable.of(velocities)


def test_the_file_is_as_the_interface_says(tmp_path):
    write_table(tmp_path / "c.csv", [0.0, 0.02, 0.04], [0.0, 1.5, -2.25])
    assert (tmp_path / "c.csv").read_text() == "time_s,velocity_rad_s\n0.00,0.0\n0.02,1.5\n0.04,-2.25\n"


def test_a_table_of_another_program_is_read(file):
    table = read_table(file("\ufefftime_s, velocity_rad_s\r\n0,1e0\r\n0.0200001, 2\r\n\r\n"))
    assert table.velocities == (1.0, 2.0)
    assert table.times == (0.0, 0.02)
    assert table.duration == 0.04


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "commands.csv line 1: the header is ''; it must be 'time_s,velocity_rad_s'"),
        ("t,v\n0,1\n", "commands.csv line 1: the header is 't,v'; it must be 'time_s,velocity_rad_s'"),
        ("time_s,velocity_rad_s\n", "commands.csv: there are no commands below the header"),
        ("time_s,velocity_rad_s\n0,1\n0.02,fast\n", "line 3, column velocity_rad_s: 'fast' is not a number"),
        ("time_s,velocity_rad_s\n0,1\n0.02,nan\n", "line 3, column velocity_rad_s: the velocity is nan; it must be"),
        ("time_s,velocity_rad_s\n0,1\n0.02,inf\n", "line 3, column velocity_rad_s: the velocity is inf"),
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
        write_table(tmp_path / "none" / "c.csv", [0.0], [0.0])


@pytest.mark.parametrize(
    ("times", "velocities", "sentence"),
    [
        ([0.0], [1.0, 2.0], "1 times and 2 velocities"),
        ([], [], "no rows"),
        ([0.0, 0.03], [1.0, 1.0], "command 1: the time is 0.03 s; it must be 0.02"),
        ([0.0], [math.nan], "command 0: the velocity is nan"),
    ],
)
def test_what_is_no_table_isnt_written(tmp_path, times, velocities, sentence):
    with pytest.raises(ArgumentError, match=re.escape(sentence)):
        write_table(tmp_path / "c.csv", times, velocities)
    assert not (tmp_path / "c.csv").exists()


def test_the_motors_limits_are_those_of_its_manual():
    assert XW540_T140.speed == pytest.approx(304 * 0.229 * 2 * math.pi / 60)
    assert XW540_T140.speed == pytest.approx(7.29, abs=0.005)


def test_a_table_beyond_the_limits_is_refused_with_time_and_value():
    limits = Limits(5.0, 50.0)
    assert CommandTable.of([5.0, 4.0, 5.0]).within(limits).speed == 5.0
    with pytest.raises(ArgumentError, match=r"the command at 0\.04 s is -5\.1 rad/s; the limit is 5 rad/s either way"):
        CommandTable.of([-4.9, -5.0, -5.1]).within(limits)
    with pytest.raises(
        ArgumentError, match=r"at 0\.02 s goes from 1 to -0\.5 rad/s, 75 rad/s²; the limit is 50 rad/s²"
    ):
        CommandTable.of([1.0, -0.5]).within(limits)


@pytest.mark.parametrize(("speed", "acceleration", "name"), [(0, 1, "speed"), (1, math.inf, "acceleration")])
def test_limits_must_be_limits(speed, acceleration, name):
    with pytest.raises(ArgumentError, match=f"the limit of the {name} is"):
        Limits(speed, acceleration)


@settings(max_examples=25)
@given(speeds, st.floats(0.5, 10), st.floats(10, 500))
def test_clipping_gives_what_can_be_followed_and_leaves_the_rest_alone(velocities, speed, acceleration):
    limits = Limits(speed, acceleration)
    clipped = CommandTable.of(velocities).clipped(limits)
    assert len(clipped.times) == len(velocities)
    assert clipped.within(limits).clipped(limits) == clipped


@settings(max_examples=25)
@given(speeds, st.floats(1, 500))
def test_ramps_go_from_and_to_rest_around_the_same_commands(velocities, acceleration):
    table = CommandTable.of(velocities)
    ramped = table.ramped(acceleration)
    start = math.ceil(abs(velocities[0]) * RATE / acceleration - 1e-9)
    assert ramped.velocities[start : start + len(velocities)] == table.velocities
    assert ramped.velocities[0] == 0 or start == 0
    assert ramped.velocities[-1] == 0 or abs(velocities[-1]) < 1e-9
    steps = [abs(b - a) * RATE for a, b in zip(ramped.velocities, ramped.velocities[1:], strict=False)]
    assert all(s <= acceleration * (1 + 1e-6) for s in [*steps[:start], *steps[start + len(velocities) - 1 :]])


def test_ramps_need_an_acceleration():
    with pytest.raises(ArgumentError, match="the ramps' acceleration is 0"):
        CommandTable.of([1.0]).ramped(0.0)


def test_repeating():
    assert CommandTable.of([1.0, 2.0]).repeated(2) == CommandTable.of([1.0, 2.0, 1.0, 2.0])
    with pytest.raises(ArgumentError, match="can't be repeated 0 times"):
        CommandTable.of([1.0]).repeated(0)

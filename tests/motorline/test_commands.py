"""Tables of commands: their file, limits, clipping, ramps."""

import math
import re
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motorline import FISH, RATE, XW540_T140, CommandTable, MotorLimits, read_table, write_table
from swimbase.errors import ArgumentError

speeds = st.lists(st.floats(-30, 30), min_size=1, max_size=60)
of = CommandTable.of


def fish(velocities) -> CommandTable:
    return of({FISH: velocities})


@settings(max_examples=25)
@given(speeds, st.floats(-3, 3))
def test_what_is_written_is_read(tmp_path_factory, velocities, angle):
    path = tmp_path_factory.mktemp("table") / "commands.csv"
    table = of({FISH: velocities, "servo1_rad": [angle] * len(velocities), "winch_m": velocities})
    write_table(path, table)
    assert read_table(path) == table
    assert table.column("servo1_rad") == (angle,) * len(velocities)


def test_files_of_this_and_of_other_programs(tmp_path):
    write_table(tmp_path / "c.csv", of({"tail_rad": [0, 1], "wheel_rad_s": [2, -3]}))
    assert (tmp_path / "c.csv").read_text() == "time_s,tail_rad,wheel_rad_s\n0.00,0.0,2.0\n0.02,1.0,-3.0\n"
    (tmp_path / "c.csv").write_text("\ufefftime_s, velocity_rad_s\r\n0,1e0\r\n0.0200001, 2\r\n\r\n")
    table = read_table(tmp_path / "c.csv")
    assert (table, table.duration) == (fish([1.0, 2.0]), 0.04)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "commands.csv line 1: the header is ''; it must be time_s and a column an actuator"),
        ("t,v\n0,1\n", "line 1: the header is 't,v'; it must be time_s and a column an actuator, as 'time_s,velocity_"),
        ("time_s,fast\n0,1\n", "line 1: the header is 'time_s,fast'; 'fast' isn't a name and a unit, as servo1_rad is"),
        ("time_s,_rad\n0,1\n", "'_rad' isn't a name and a unit"),
        ("time_s,a_rad,a_rad\n0,1,1\n", "the column a_rad is there twice"),
        ("time_s,a_rad,b_m\n0,1,nan\n", "line 2, column b_m: 'nan' is not a finite number"),
        ("time_s,velocity_rad_s\n", "commands.csv: there are no commands below the header"),
        *(
            (f"time_s,a_rad\n0,{cell}\n", f"line 2, column a_rad: '{cell}' is not a finite number; write it with the")
            for cell in ("0_1", "٣", "\uff11.5", "1\u00a0")
        ),
        ("time_s,velocity_rad_s\n0,1\n0.02,fast\n", "line 3, column velocity_rad_s: 'fast' is not a finite number"),
        ("time_s,velocity_rad_s\n0,1\n0.02,inf\n", "line 3, column velocity_rad_s: 'inf' is not a fin"),
        ("time_s,velocity_rad_s\n0.02,1\n", "line 2, column time_s: the time is 0.02 s; it must be 0"),
        ("time_s,velocity_rad_s\n0,1\n0.04,1\n", "line 3, column time_s: the time is 0.04 s; it must be 0.02"),
        ("time_s,velocity_rad_s\n0,1\nnan,1\n", "line 3, column time_s: 'nan' is not a finite number"),
        ("time_s,velocity_rad_s\n0,1,2\n", "line 2: there are 3 columns; there must be 2"),
        ("time_s,velocity_rad_s\n0,1\n\n0.04,1\n", "line 3: there are 0 columns"),
        (b"\xff\xfe\x00\x01", "is not a CSV text file"),
        (None, "commands.csv' can't be read: No such file"),
    ],
)
def test_a_wrong_file_is_refused_with_line_and_column(tmp_path, text, sentence):
    path = tmp_path / "commands.csv"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ArgumentError, match=re.escape(sentence)):
        read_table(path)


LIMITS = {FISH: MotorLimits(5.0, 50.0)}
ANGLES = {"a_rad": MotorLimits(2.0, 50.0, -1.0, 1.5)}


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (lambda: of({}), "can't have these columns: it must be time_s and a column"),
        (lambda: of({"a_rad": [1.0], "b_rad": [1.0, 2.0]}), "differ in length ({'a_rad': 1, 'b_rad': 2})"),
        (lambda: of({FISH: []}), "no rows"),
        (
            lambda: of({FISH: [0, math.nan]}),
            "command 1 is (nan,); it needs a finite number for each of ('velocity_rad_s',)",
        ),
        (lambda: of({"a,b_rad": [1.0]}), "'a,b_rad' isn't a name and a unit"),
        (lambda: fish([0]).within({"b_rad": XW540_T140}), "there is no column b_rad in the table; it has velocity_rad"),
        (
            lambda: fish([-5.0, -5.1]).within(LIMITS),
            "the command at 0.02 s is -5.1 rad/s; the limits are -5 to 5 rad/s",
        ),
        (lambda: fish([1.0, -0.5]).within(LIMITS), "at 0.02 s goes from 1 to -0.5 rad/s, 75 rad/s²; the limit is 50 r"),
        (lambda: of({"a_rad": [-1.0, -1.1]}).within(ANGLES), "at 0.02 s is -1.1 rad; the limits are -1 to 1.5"),
        (lambda: of({"a_rad": [0, 0.05]}).within(ANGLES), "from 0 to 0.05 rad, 2.5 rad/s; the limit is 2 rad/s"),
        (lambda: MotorLimits(0, 1), "the limit of the speed is 0"),
        (lambda: MotorLimits(1, math.inf), "the limit of the acceleration is inf"),
        (lambda: MotorLimits(1, 1, 1, 0), "the lowest angle is 1 and the highest 0"),
        (lambda: fish([1.0]).ramped(0.0), "the ramps' acceleration is 0"),
        *(
            (lambda end=end, a=a: fish([0, end]).ramped(a), f"from rest to {abs(end):g} at {a:g} rad/s² would take")
            for end, a in ((1e300, 20.0), (-1e308, 20.0), (1.0, 1e-9))
        ),
        (lambda: of({"a_rad": [0.0]}).approached({"a_rad": 1.0}, 1e-9), "5e+10 commands; at most 1000000 are made"),
        (lambda: of({"a_rad": [0.0]}).approached({"a_rad": 1.0}, 0.0), "the speed of the approach is 0"),
        (lambda: write_table("/none/c.csv", fish([0.0])), "can't write command table '/none/c.csv': No such file"),
    ],
)
def test_what_is_refused(wrong, sentence):
    with pytest.raises(ArgumentError, match=re.escape(sentence)):
        wrong()


def test_tables_within_limits():
    assert XW540_T140.speed == pytest.approx(304 * 0.229 * 2 * math.pi / 60)
    assert fish([5.0, 4.0, 5.0]).within(LIMITS).speed(FISH) == 5.0
    table = of({"a_rad": [1.5, 1.46, 1.5], FISH: [0, 99, 0]}).within(ANGLES)
    assert table.speed("a_rad") == pytest.approx(2.0)


@settings(max_examples=25)
@given(speeds, st.floats(0.5, 10), st.floats(10, 500), st.sampled_from([FISH, "a_rad"]))
def test_clipping_gives_what_can_be_followed_and_leaves_the_rest_alone(values, speed, acceleration, column):
    limits = {column: MotorLimits(speed, acceleration, -1.0, 2.0)}
    table = of({column: values, "winch_m": values})
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


def test_speeds_ramp_together_while_angles_hold_and_angles_are_approached_while_speeds_rest():
    table = of({"a_rad_s": [2.0, 4.0], "b_rad_s": [-1.0, 1.0], "c_rad": [0.3, 0.4]}).ramped(50.0)
    assert table.column("a_rad_s") == pytest.approx([0, 1, 2, 4, 3, 2, 1, 0])
    assert table.column("b_rad_s") == pytest.approx([0, -0.5, -1, 1, 0.75, 0.5, 0.25, 0])
    assert table.column("c_rad") == pytest.approx([0.3] * 3 + [0.4] * 5)
    table = of({"a_rad": [1.0, 1.1], "b_rad": [0.5, 0.5], "c_rad_s": [0.0, 3.0]})
    longer = table.approached({"a_rad": 1.1, "b_rad": 0.3}, 2.5)
    assert longer.column("a_rad") == pytest.approx([1.1, 1.075, 1.05, 1.025, 1.0, 1.1])
    assert longer.column("b_rad") == pytest.approx([0.3, 0.35, 0.4, 0.45, 0.5, 0.5])
    assert longer.column("c_rad_s") == (0, 0, 0, 0, 0, 3)
    assert table.approached({"a_rad": 1.0, "b_rad": 0.5}, 1.0) == table

"""Delays of controls, sensors and trials as parameters of recordings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from made_robots import DAMPING, RECORDINGS, ROBOT, made
from recorded import PENDULUM, PENDULUM_HIDDEN, blank, build_pendulum, recorded, telling, torque_table
from refused import refusal, says
from swim2real.calibration import Problem
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.robots import load_robot
from swim2real.robots.targets import Delay, Delays
from swim2real.simulation import PlaybackSimulator
from swim2real.trials import Signals
from swimbase.errors import RobotError

LATE = Parameter("late", "s", -0.05, 0.1, "How late.", 0.0)


def late(line: str, start: str = "rest"):
    """The pendulum with a delay."""
    space = ParameterSpace((*PENDULUM.space, LATE))

    def build(values):
        return build_pendulum({name: values[name] for name in PENDULUM.space.names})

    delay = Delay.parse(line)
    assert delay is not None
    return replace(telling(PENDULUM, start=start), space=space, build=build, delays={"late": (delay,)})


def played(robot, trial, seconds):
    player = PlaybackSimulator(robot, 1)
    return player.simulate({**PENDULUM_HIDDEN, "late": seconds}, [player.request(trial)]).trials[0]


def trial_of(begin=0.0):
    table = torque_table(1.0)
    return blank(PENDULUM, "a", 1.0, 500, controls=Signals(table.times + begin, table.names, table.values))


def test_a_late_control_is_a_table_of_later_rows():
    now, found = (played(late('control "torque" delay'), trial_of(), x).track.positions for x in (0.0, 0.03))
    expected = played(late('control "torque" delay'), trial_of(0.03), 0.0)
    assert np.abs(found - expected.track.positions).max() < 1e-9
    assert np.abs(found - now).max() > 1e-3
    plain = PlaybackSimulator(telling(PENDULUM, start="rest"), 1)
    undelayed = plain.simulate(PENDULUM_HIDDEN, [plain.request(trial_of())]).trials[0]
    assert np.allclose(now, undelayed.track.positions, atol=1e-9)


def test_a_late_sensor_shows_what_was_and_so_does_a_trial_whose_tables_are_behind():
    now, before = (played(late('sensor "gyro*" delay'), trial_of(), x) for x in (0.0, 0.02))
    assert np.array_equal(now.track.positions, before.track.positions)
    assert np.allclose(before.sensors.values[10:], now.sensors.values[:-10], atol=1e-9)
    """Commands come later on the film's clock, and a reading shows what happens later."""
    found = played(late('trial "a" delay'), trial_of(), 0.03)
    controls = played(late('control "*" delay'), trial_of(), 0.03)
    assert np.array_equal(found.track.positions, controls.track.positions)
    assert np.allclose(found.sensors.values[:-15], controls.sensors.values[15:], atol=1e-9)
    other = played(late('trial "b*" delay'), trial_of(), 0.03)
    assert not np.allclose(found.track.positions, other.track.positions)


@pytest.mark.parametrize("line", ['control "torque" delay', 'sensor "gyro*" delay'])
@pytest.mark.parametrize("start", ["rest", "fitted"])
def test_the_hidden_delay_explains_a_recording(line, start):
    robot = late(line, start)
    hidden = {**PENDULUM_HIDDEN, "late": 0.024}
    blanks = [blank(PENDULUM, name, 2.0, 100, controls=torque_table(2.0, seed)) for seed, name in enumerate("ab")]
    problem = Problem(robot, recorded(robot, hidden, blanks), threads=1)
    at, off = problem.evaluate_many([hidden, {**hidden, "late": 0.03}])
    assert at.loss < 1e-4
    assert off.loss > 3 * at.loss


def test_delays_add_up():
    delays = {"a": (Delay("", "control", ("w*",), 2.0, 0.01),), "b": (Delay("", "trial", ("one",)),)}
    found = Delays(delays, {"a": 0.1, "b": 0.02})
    assert found.control("winch", "one") == pytest.approx(0.23)
    assert found.control("winch", "two") == pytest.approx(0.21)
    assert found.control("servo", "two") is None
    assert found.sensor("pull", "one") == pytest.approx(-0.02)
    assert str(Delay('control "w*" delay', "control", ("w*",), 2.0, 0.01)) == 'control "w*" delay = 2 x +0.01'


def file_with(folder, target, **more):
    options = "".join(f"{key} = {value}\n" for key, value in more.items())
    return made(
        folder, ROBOT, RECORDINGS + "[recordings.controls]\nservo = 'table'\n", DAMPING,
        f"[[parameters]]\nname = 'late'\nlower = 0.0\nupper = 0.1\nmeaning = 'm'\ntargets = {target}\n{options}",
    )  # fmt: skip


@pytest.mark.parametrize(("target", "parts"), [
    ("'control \"lfit\" delay'", ['"lfit" delay', "no control 'lfit'; there are servo"]),
    ("'sensor \"pull\" delay'", ["no sensor 'pull'"]),
    ("'control \"*\" gain'", ["a control has a delay and nothing else"]),
    ("{to = 'control \"*\" delay', relative = true}", ["in seconds", "can't be relative"]),
])  # fmt: skip
def test_a_file_says_what_is_late_if_it_can_be(tmp_path, target, parts):
    robot = load_robot(file_with(tmp_path, "'control \"*\" delay'"))
    assert robot.delays_of({**robot.space.published, "late": 0.05}).control("servo", "any") == 0.05
    said = refusal(RobotError, load_robot, file_with(tmp_path, target))
    assert says(said, "parameter 'late'", *parts)


NUMBERS = st.floats(-1e3, 1e3, allow_nan=False)
COLUMN = st.lists(st.tuples(st.floats(1e-2, 5.0), NUMBERS), min_size=1, max_size=12)


@given(column=COLUMN, interpolated=st.booleans(), begin=st.floats(-10.0, 60.0), over=st.floats(1e-3, 5.0))
def test_means_of_commands_are_means_of_their_values(column, interpolated, begin, over):
    """Between rows a command holds, or goes on a straight line; beyond them it stays."""
    times = np.cumsum([gap for gap, _ in column])
    table = Signals(times, ["u"], [[value] for _, value in column])
    inner = times[(times > begin) & (times < begin + over)]
    knots = np.array([begin, *inner, begin + over])
    values = table.at("u", (knots[:-1] + knots[1:]) / 2, interpolated=interpolated)  # of each piece its middle
    expected = values @ np.diff(knots) / over
    assert table.at("u", np.array([begin]), over, interpolated=interpolated) == pytest.approx([expected], abs=1e-6)
    at_rows = table.at("u", times, interpolated=interpolated)
    np.testing.assert_allclose(at_rows, table.column("u"), atol=1e-6)

"""Robots of other files: what policies command and see of them, tasks of one's own, and what is refused."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import swim2real.rl as rl
from swim2real.rl.assessment import Wave, scan_waves
from swim2real.rl.body import Bodies
from swim2real.rl.state import Robots
from swim2real.rl.tasks import TASKS, find_task
from swim2real.robots import load_robot
from swim2real.robots.robot import PolicySetup
from swim2real.robots.targets import Delay
from swimbase.errors import ArgumentError, RobotError

EXAMPLES = Path(__file__).parents[2] / "examples"
REACH = f"python:{EXAMPLES / 'finger/reach.py'}:Reach"


@pytest.fixture(scope="module")
def snake():
    return load_robot(EXAMPLES / "snake/snake.toml")


@pytest.fixture(scope="module")
def finger():
    return load_robot(EXAMPLES / "finger/finger.toml")


def test_four_servos_follow_their_commands_and_a_wave_swims_head_first(snake):
    wave = Wave(amplitude=0.7, frequency=1.0, lag=1.1)
    scan = scan_waves([wave, Wave(0.7, 1.0, -1.1)], "forward", snake.space.published, snake, [0.0], 2.0)
    assert scan.distances[0] > 0.1  # a wave from head to tail
    assert scan.distances[1] < 0  # and from tail to head
    env = rl.make_env("forward", robot=snake)
    names = env.environments.names
    assert [name for name, part in names.items() if part.stop > part.start] == [
        "position", "heading", "velocity", "heading_rate", "joint_angles", "joint_rates", "commands",
    ]  # fmt: skip
    env.reset(seed=0)
    for _ in range(10):
        seen, *_, info = env.step(np.array([1.0, -1.0, 0.5, 0.0]))
    assert info["commands"] == pytest.approx((1.0, -1.0, 0.5, 0.0))
    np.testing.assert_allclose(seen[names["commands"]], info["commands"], rtol=1e-6)
    bends = seen[names["joint_angles"]]
    assert bends[0] > 0.3
    assert bends[1] < -0.3


def test_a_robot_may_point_anywhere_at_its_start(snake):
    def turned(values):
        spec = snake.build(values)
        spec.body("head").quat = [np.cos(0.6), 0.0, 0.0, np.sin(0.6)]
        spec.body("head").pos = [0.3, -0.2, 0.0]
        return spec

    turned_snake = dataclasses.replace(snake, build=turned)
    envs = [rl.make_env("target", robot=robot) for robot in (snake, turned_snake)]
    seen = [env.reset(seed=0)[0] for env in envs]
    np.testing.assert_allclose(*seen, atol=1e-6)
    for _ in range(30):
        seen = [env.step(np.array([1.0, 0.2, -0.5, 0.3]))[0] for env in envs]
    np.testing.assert_allclose(*seen, atol=1e-3)


def late(robot, line, seconds):
    """Two of a robot, started: as it is, and with something late."""
    delayed = dataclasses.replace(robot, delays={next(iter(robot.space.published)): (Delay.parse(line, 0.0, seconds),)})
    pair = [Robots(Bodies(each, each.space.published), 1) for each in (robot, delayed)]
    for robots in pair:
        robots.start(0, 0, 0.0)
        robots.read(np.zeros(1, int))
    return pair


def test_servos_that_a_calibration_found_to_be_late_follow_late(snake):
    actions = np.random.default_rng(0).uniform(-1, 1, (20, 1, 4))
    on_time, two_late = late(snake, 'control "*" delay', 0.04)
    _, half_late = late(snake, 'control "servo1" delay', 0.05)
    bends = []
    for action in actions:
        for robots in (on_time, two_late, half_late):
            robots.advance(action)
        bends.append([robots.state.joint_angles[0].copy() for robots in (on_time, two_late, half_late)])
        np.testing.assert_array_equal(two_late.state.commands, on_time.state.commands)
    bends = np.array(bends)
    np.testing.assert_array_equal(bends[2:, 1], bends[:-2, 0])
    np.testing.assert_array_equal(bends[:2, 1], 0)
    assert bends[1, 2, 0] == pytest.approx(0, abs=0.02)  # the others push against it
    assert 0 < abs(bends[2, 2, 0]) < abs(bends[2, 1, 0])  # for half of the third interval


def test_sensors_that_are_late_show_what_was(finger):
    on_time, delayed = late(finger, 'sensor "*" delay', 0.03)
    readings = []
    for _ in range(12):
        for robots in (on_time, delayed):
            robots.advance(np.full((1, 1), 0.3))
        readings.append([robots.state.sensors[0, 0] for robots in (on_time, delayed)])
    true, seen = np.array(readings).T
    np.testing.assert_allclose(seen[2:], (true[:-2] + true[1:-1]) / 2, rtol=1e-12)
    assert np.ptp(true) > 0.3  # N


def test_a_task_of_ones_own_for_a_robot_that_goes_nowhere(finger):
    with pytest.raises(ArgumentError, match="task 'forward' needs a robot that points somewhere; name the two markers"):
        rl.make_env("forward", robot=finger)
    env = rl.make_env(REACH, robot=finger)
    names = env.environments.names
    assert list(names) == ["joint_angles", "joint_rates", "sensors", "commands", "to_goal"]
    env.reset(seed=0, options={"bend": 0.8})
    best = np.inf
    for _ in range(140):
        seen, reward, *_, info = env.step(np.array([0.2]))  # slowly, so that it passes by every goal
        best = min(best, info["goal_distance"])
        assert reward == pytest.approx(-100 * info["goal_distance"])
        assert np.linalg.norm(seen[names["to_goal"]]) == pytest.approx(info["goal_distance"], rel=1e-5)
    assert best < 0.01
    assert seen[names["sensors"]] > 5  # N, the cable pulls


@pytest.fixture
def package(monkeypatch, tmp_path):
    """Installs a package that offers tasks, as `name = module:Class`, with modules."""
    monkeypatch.syspath_prepend(tmp_path)

    def install(name: str, offers: str, **modules: str) -> None:
        folder = tmp_path / f"{name}-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (folder / "entry_points.txt").write_text(f"[swim2real.tasks]\n{offers}\n")
        for module, text in modules.items():
            (tmp_path / f"{module}.py").write_text(text)

    return install


def test_a_package_offers_a_task_by_an_entry_point(finger, package):
    package("mine", "reach = my_tasks:Reach", my_tasks=(EXAMPLES / "finger/reach.py").read_text())
    seen, _ = rl.make_env("reach", robot=finger).reset(seed=0)
    assert seen.shape == (8,)
    with pytest.raises(ArgumentError, match="there is no task 'grasp'; there are forward, target, paper-target, reach"):
        rl.make_env("grasp", robot=finger)


@pytest.mark.parametrize(("offers", "code", "sentence"), [
    ("odd = gone_module:Task", "", "of package 'strange' as 'gone_module:Task' can't be imported: Modul"),
    ("odd = 3:::4", "", "as '3:::4' can't be imported: "),
    ("odd = odd_code:Task", "raise OSError('x' * 10_000)", "can't be imported: OSError: xxx"),
    ("odd = odd_code:Task", "import sys; sys.exit(0)", "can't be imported: SystemExit: 0"),
    ("odd = odd_code:Task", "class Task: observes = ()", "it lacks adds, needs_frame, stages, begin"),
    ("odd = odd_code:Task", "Task = 3", "must be a class"),
    ("odd = a:B\nodd = c:D", "", "'odd' is offered by package 'strange' as 'a:B' and package 'strange' as 'c:D'"),
    ("odd\u202e = a:B", "", r"'odd\\u202e' .* has the character U\+202E"),
    ("no entry point", "", "the entry points of package 'strange-1.0' can't be read"),
])  # fmt: skip
def test_what_is_wrong_with_a_packages_task_is_told_when_it_is_asked_for(offers, code, sentence, package):
    package("mine", "reach = reaching_tasks:Reach", reaching_tasks=(EXAMPLES / "finger/reach.py").read_text())
    package("strange", f"{offers}\nforward = odd_code:Forward", odd_code=code)
    sys.modules.pop("odd_code", None)
    assert find_task("reach").__name__ == "Reach"
    assert find_task("forward") is TASKS["forward"]
    assert "odd_code" not in sys.modules
    with pytest.raises(ArgumentError, match=sentence) as caught:
        find_task("odd\u202e" if "\u202e" in offers else "odd")
    assert len(str(caught.value)) < 700
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("offers", "code", "told"),
    [
        ("[pydantic]\nodd = odd_code", "raise OSError", ""),  # other libraries' plugins
        ("no entry point", "", "the entry points of the installed package 'strange-1.0' can't be read, by which libra"),
    ],
)
def test_commands_go_on_or_name_a_broken_package(offers, code, told, package, tmp_path):
    package("strange", offers, odd_code=code)
    path = os.pathsep.join([str(EXAMPLES.parent / "src"), str(tmp_path)])
    words = [sys.executable, "-m", "swim2real", "export-model", "published", "--out", "fish.xml"]
    env = {**os.environ, "PYTHONPATH": path}
    ended = subprocess.run(words, capture_output=True, text=True, env=env, cwd=tmp_path, check=False)
    assert ended.returncode == bool(told), ended.stderr
    assert told in ended.stderr


def test_a_tracked_robot_with_servos_is_seen_with_noise(snake):
    env = rl.make_env("target", robot=snake, disturbances=rl.Disturbances(estimate=rl.StateEstimate(0.0005, 0)))
    names = env.environments.names
    env.reset(seed=0)
    for _ in range(40):
        seen, *_ = env.step(np.array([0.5, -0.3, 0.4, -0.6]))
    state = env.environments.state
    np.testing.assert_allclose(seen[names["joint_angles"]], state.joint_angles[0], atol=0.05)
    assert (seen[names["joint_angles"]] != state.joint_angles[0].astype(np.float32)).any()


def test_a_robot_file_must_say_what_is_commanded(snake, tmp_path):
    silent = dataclasses.replace(snake, policy=None)
    with pytest.raises(ArgumentError, match=r"robot 'snake' has no \[policy\] .* of servo1, servo2, servo3, servo4"):
        rl.make_env("forward", robot=silent)
    blind = dataclasses.replace(snake, policy=PolicySetup(snake.policy.actuators, observe={"forward": ("sight",)}))
    with pytest.raises(ArgumentError, match="robot 'snake', task 'forward', observes 'sight'; it must be one of mark"):
        rl.make_env("forward", robot=blind)
    with pytest.raises(ArgumentError, match="robot 'snake' names no 'rubbing_tendon'"):
        rl.make_env("forward", robot=snake, disturbances=rl.Disturbances(tendon_friction=0.3))
    with pytest.raises(ArgumentError, match="a start phase is given, but robot 'snake' has no motor_joint"):
        rl.make_env("forward", robot=snake, disturbances=rl.Disturbances((0.0, 1.0)))
    (tmp_path / "snake.xml").write_text((EXAMPLES / "snake/snake.xml").read_text())
    text = (EXAMPLES / "snake/snake.toml").read_text()
    for wrong, sentence in (
        (text.replace("servo1 = {lower", "servo9 = {lower"), "'actuators' is 'servo9'; it must be an actuator"),
        (text.replace("lower = -1.0", "lower = 2.0", 1), "'lower' is 2 and 'upper' 1; the first must be below the s"),
        (text.replace("lower = -1.0", "lower = 0.5", 1), "0, the command at rest, must be within"),
    ):
        (tmp_path / "wrong.toml").write_text(wrong)
        with pytest.raises(RobotError, match=sentence):
            load_robot(tmp_path / "wrong.toml")

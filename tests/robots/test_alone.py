"""Models that crash MuJoCo, never compile or want all memory: `init` and `check` say so, and live on."""

import random
import struct
import sys

import pytest

from made_robots import ARM, DAMPING, RECORDINGS, ROBOT, made
from swim2real.pipeline.drafting import draft_robot
from swim2real.robots import alone
from swim2real.robots.alone import compile_alone
from swim2real.robots.file import open_robot_file, read_mjcf
from swimbase.errors import RobotError

BODY = '<body><freejoint/><geom size="1"/></body>'
LONG, LARGE, CRASH = "takes MuJoCo more than 3 s", "takes MuJoCo more than 4 GiB of memory", "crashes MuJoCo (SIGSEGV)"
MUSCLE = """<mujoco><compiler><lengthrange mode="all" inttotal="1e12" interval="1" timestep="1e-6"/></compiler>
<worldbody><body><joint name="j" axis="0 1 0" damping="1"/><geom size="1"/></body></worldbody>
<actuator><muscle name="m" joint="j"/></actuator></mujoco>"""
CABLE = """<composite type="cable" prefix="c" count="100000000 1 1" size="1" curve="s"><joint kind="main"/>
<geom type="capsule" size="0.1"/></composite>"""


def world(content: str = BODY, before: str = "") -> str:
    return f"<mujoco>{before}<worldbody>{content}</worldbody></mujoco>"


def asset(content: str) -> str:
    return world(BODY, f"<asset>{content}</asset>")


HOSTILE = {
    "attaches itself": (
        '<mujoco><asset><model name="a" file="model.xml"/></asset><worldbody><body name="b"><geom size="1"/></body>'
        '<attach model="a" body="b" prefix="p"/></worldbody></mujoco>', CRASH),
    "texture": (asset('<texture name="t" type="2d" builtin="checker" width="200000" height="200000"/>'), LARGE),
}  # fmt: skip
SLOW = {
    "muscle": (MUSCLE, LONG),
    "nested replicate": (world('<replicate count="2000">' * 3 + BODY + "</replicate>" * 3), LONG),
    "memory": (world(before='<size memory="900G"/>'), LARGE),
    "user data": (world(before='<size nuserdata="2000000000"/>'), LARGE),
    "height field": (asset('<hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/>'), LARGE),
    "flex": (world('<flexcomp name="f" type="grid" dim="3" count="120 120 120" spacing="1 1 1"/>'), LONG),
    "composite": (world(CABLE), LONG),
}
ORDERLY = {
    "deep bodies": world('<body><geom size="1"/>' * 100_000 + "</body>" * 100_000),
    "odd numbers": world(before='<compiler angle="x" boundmass="nan" boundinertia="inf" settotalmass="1e308"/>'),
    "includes itself": '<mujoco><include file="model.xml"/></mujoco>',
    **{name: asset(f'<mesh file="{name}"/>') for name in ("huge.stl", "huge.msh", "far.obj", "random.msh")},
    "huge height field": asset('<hfield file="huge.bin" size="1 1 1 1"/>'),
}


@pytest.fixture
def place(tmp_path):
    """Where a model is written, with files beside it whose headers lie."""
    for name, content in {
        "huge.stl": bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(100),
        "huge.msh": struct.pack("<4i", 2_000_000_000, 0, 0, 2_000_000_000) + bytes(100),
        "huge.bin": struct.pack("<2i", 2_000_000_000, 2_000_000_000) + bytes(100),
        "far.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 2000000000\nf 1 2 -9\n",
        "random.msh": random.Random(0).randbytes(5000),
    }.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path / "model.xml"


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits memory, and names its signals so")
@pytest.mark.parametrize("name", [*HOSTILE, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_a_model_that_would_end_or_fill_this_process_is_a_sentence(place, name, monkeypatch):
    text, why = {**HOSTILE, **SLOW}[name]
    if why == LONG:
        monkeypatch.setattr(alone, "SECONDS", 3)
    place.write_text(text)
    with pytest.raises(RobotError) as caught:
        read_mjcf(place, "robot file 'r.toml': ", alone=True)
    assert str(caught.value).startswith(f"robot file 'r.toml': model '{place}' {why}"), caught.value
    assert "make it smaller, or look for what is wrong in it" in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("name", ORDERLY)
def test_what_mujoco_refuses_or_reads_in_good_order_goes_on(place, name):
    place.write_text(ORDERLY[name])
    compile_alone(place)


@pytest.mark.skipif(sys.platform != "linux", reason="Linux's signals")
def test_a_draft_and_a_check_compile_a_model_alone_first(place, monkeypatch):
    place.write_text(HOSTILE["attaches itself"][0])
    with pytest.raises(RobotError, match="crashes MuJoCo"):
        draft_robot(place)
    robot = made(place.parent, ROBOT.replace("arm.xml", "model.xml"), RECORDINGS, DAMPING)
    with pytest.raises(RobotError, match=r"^robot file '.*arm\.toml': model '.*model\.xml' crashes MuJoCo"):
        open_robot_file(robot, alone=True)
    place.write_text(ARM)
    assert read_mjcf(place, alone=True).compile().nu == 5
    monkeypatch.setattr(alone, "_PROGRAM", "gone")
    with pytest.raises(RobotError, match=r"crashes MuJoCo \(exit code 1: .*gone"):
        compile_alone(place)


@pytest.mark.parametrize("step", ["1e-7", "1e-300"])
def test_a_time_step_with_which_no_simulation_ends_is_refused(place, step):
    text = ARM.replace('timestep="0.002"', f'timestep="{step}"')
    robot = made(place.parent, ROBOT, RECORDINGS, DAMPING, model=text)
    with pytest.raises(RobotError, match=rf"the model's timestep is {float(step):g} s; it must be at least 1e-06 s"):
        open_robot_file(robot) and draft_robot(robot.with_suffix(".xml"))

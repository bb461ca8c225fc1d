"""The fish that floats and rolls: `fish-rolling`."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from swim2real.objective.head import head_motion
from swim2real.robots.fish import FISH, FISH_ROLLING
from swim2real.simulation import Simulator, Swim
from swim2real.trials import Actuation

PUBLISHED = FISH_ROLLING.space.published
STIFF = {**PUBLISHED, "roll_stiffness": 0.08, "roll_damping": 0.004}
SLOW = Swim("slow", Actuation(0.45, 0.0, 0.1), 5.0)


def let_go(values, seconds=3.0):
    """Roll of the hull that was let go at 0.1 rad without water [rad], and the times [s]."""
    model = FISH_ROLLING.build(values).compile()
    model.opt.density = model.opt.viscosity = 0.0
    data = mujoco.MjData(model)
    data.joint("hinge_x").qpos[0] = 0.1
    roll = np.empty(int(seconds / model.opt.timestep))
    for step in range(len(roll)):
        mujoco.mj_step(model, data)
        roll[step] = data.joint("hinge_x").qpos[0]
    return model.opt.timestep * np.arange(1, len(roll) + 1), roll


def test_its_response_is_the_fishs_at_the_same_values():
    ours, theirs = (replace(robot.space, scale="log") for robot in (FISH_ROLLING, FISH))
    point, driven = np.linspace(0.1, 0.9, len(ours)), np.array([0.5, 1.0])
    values = ours.to_values(point)
    same = theirs.to_cube({name: values[name] for name in theirs.names})
    own, plain = FISH_ROLLING.swims.response, FISH.swims.response
    np.testing.assert_allclose(own.speeds(point[None], driven), plain.speeds(same[None], driven))
    np.testing.assert_allclose(own.beats(point[None], driven, True), plain.beats(same[None], driven, True))
    assert own.lengths.shape == (len(ours),)


def test_it_is_the_fish_with_roll():
    narrower = {"fluid_slender_drag": {"upper": 0.2, "published": 0.01}, "fluid_magnus_lift": {"upper": 0.3}}
    taken_over = [replace(one, **narrower.get(one.name, {})) for one in FISH.space.parameters]
    assert list(FISH_ROLLING.space.parameters[:16]) == taken_over
    model = FISH_ROLLING.build(PUBLISHED).compile()
    turning = [model.joint(i).name for i in range(model.njnt) if model.joint(i).name.startswith("hinge")]
    assert turning == ["hinge_z", "hinge_y", "hinge_x"]
    model = FISH_ROLLING.build({**PUBLISHED, "fluid_angular_drag": 2.5, "tail_angular_drag": 1.5}).compile()
    wet = {
        (model.geom(i).name.startswith("wet_tail"), float(model.geom_fluid[i][3]))
        for i in np.flatnonzero(model.geom_fluid[:, 0])
    }
    assert wet == {(True, 1.5), (False, 2.5)}
    assert model.site("M0").pos[2] == model.site("M1").pos[2] == PUBLISHED["head_marker_height"]
    assert model.site("M8").pos[0] == PUBLISHED["fin_marker_x"]


def test_stiffness_and_inertia_set_the_frequency_of_the_roll():
    free = {**PUBLISHED, "roll_damping": 0.0, "roll_stiffness": 0.04}
    halves = []
    for values in (free, {**free, "roll_stiffness": 2 * 0.04}):
        times, roll = let_go(values)
        crossings = times[np.flatnonzero(np.diff(np.sign(roll)))]
        halves.append(crossings[1] - crossings[0])
    assert halves[0] == pytest.approx(np.sqrt(2) * halves[1], rel=0.05)
    assert np.abs(let_go(STIFF, 4.0)[1][-500:]).max() < 0.02  # damped


def test_only_a_roll_shows_the_height_of_the_heads_markers_in_its_sway():
    def locked(values):
        spec = FISH_ROLLING.build(values)
        spec.delete(spec.joint("hinge_x"))
        return spec

    def shown(robot, values):
        sway = []
        for height in (0.08, 0.12):
            (trial,) = Simulator(robot, threads=1).simulate({**values, "head_marker_height": height}, [SLOW])
            beat = head_motion(trial.track.times, trial.track.positions, 0.45).sway_beat
            sway.append(beat.amplitude * np.exp(1j * beat.phase))
        return abs(sway[1] - sway[0])

    thin = {"fluid_slender_drag": 0.0, "fluid_angular_drag": 0.5, "tail_angular_drag": 0.5}  # no more damping
    soft = {**PUBLISHED, **thin, "roll_stiffness": 0.05, "roll_damping": 0.0}
    moved = shown(FISH_ROLLING, soft)
    assert moved > 3e-3
    assert moved > 1.5 * shown(FISH_ROLLING, {**STIFF, **thin})  # whose roll follows its moment
    assert moved > 50 * shown(replace(FISH_ROLLING, build=locked), soft)

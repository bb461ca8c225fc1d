import mujoco
import numpy as np
import pytest

from swim2real.robots.fish import FISH
from swim2real.robots.fish.model import extrude, mirrored, outline_of
from swim2real.robots.fish.stages import beat_distance
from swim2real.simulation.stepper import Stepper

PUBLISHED = FISH.space.published
FLUID = ("blunt_drag", "slender_drag", "angular_drag", "kutta_lift", "magnus_lift")


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return FISH.build(PUBLISHED).compile()


def compiled(**changes: float) -> mujoco.MjModel:
    return FISH.build({**PUBLISHED, **changes}).compile()


def test_there_are_sixteen_parameters_in_the_papers_order():
    assert FISH.space.names == (
        *(f"fluid_{name}" for name in FLUID),
        "motor_arm_length",
        *(f"hinge_stiffness_{i}" for i in range(5)),
        *(f"hinge_damping_{i}" for i in range(5)),
    )
    assert list(PUBLISHED.values()) == [0.4, 7.79, 2.81, 3.84, 0.27, 0.0395, *[0.65] * 5, *[0.0] * 5]
    bounds = [(parameter.lower, parameter.upper) for parameter in FISH.space]
    assert bounds == [*[(0, 10)] * 5, (0.01, 0.06), *[(0.1, 5)] * 5, *[(0, 2)] * 5]


def test_the_markers_rest_where_they_are_mounted(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    markers = data.sensordata.reshape(9, 3)
    np.testing.assert_allclose(markers[:, :2] - markers[0, :2], FISH.rest_markers, atol=1e-12)
    above = markers[:, 2] - data.body("fish").xpos[2]
    np.testing.assert_allclose(above, FISH.marker_heights, atol=1e-12)
    expected = [0.0, 0.142, 0.357, 0.3765, 0.4065, 0.4385, 0.4675, 0.4885, 0.551]
    np.testing.assert_allclose(FISH.rest_markers[:, 0], expected)
    np.testing.assert_allclose(markers[:, 2], [0.05, 0.05, 0.1, *[0.05] * 5, 0.1])
    assert FISH.rest_markers[1, 0] == pytest.approx(0.142)


def test_the_model_is_the_published_one(model):
    assert [model.sensor(i).name for i in range(model.nsensor)] == [f"M{i}" for i in range(9)]
    assert model.body_mass.sum() == pytest.approx(1.4807, abs=5e-5)
    assert model.opt.timestep == 0.001
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICIT
    assert (model.opt.density, model.opt.viscosity) == (1000.0, 0.0013)
    np.testing.assert_array_equal(model.opt.gravity, 0.0)
    assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    fluid = model.geom_fluid[model.geom_fluid[:, 0] > 0]
    np.testing.assert_allclose(fluid[:, 1:6], [[PUBLISHED[f"fluid_{name}"] for name in FLUID]] * 33)
    assert not model.actuator_forcelimited[0]
    np.testing.assert_allclose(model.actuator_ctrlrange[0], [-10 * np.pi, 10 * np.pi])
    fin = model.geom("tail_fin")
    np.testing.assert_allclose(np.sort(fin.size), [0.0010, 0.0327, 0.1015], atol=5e-5)
    np.testing.assert_allclose(fin.pos, [0.0542, 0.0, 0.0], atol=5e-5)
    longer = compiled(motor_arm_length=0.05)  # moves the tendons' anchors
    np.testing.assert_allclose(longer.site("motor_left").pos, [0, -0.055, -0.045])
    np.testing.assert_allclose(longer.site("motor_right").pos, [0, 0.055, 0.045])


def test_every_parameter_changes_the_swim(model):
    before = Stepper(model, FISH, 0.1, 9.0, 0.0).run(300).markers
    for one in FISH.space:
        changed = compiled(**{one.name: PUBLISHED[one.name] + 0.1 * (one.upper - one.lower)})
        after = Stepper(changed, FISH, 0.1, 9.0, 0.0).run(300).markers
        assert np.linalg.norm(after - before, axis=2).max() > 1e-5, one.name


@pytest.mark.parametrize("i", range(5))
def test_stiffness_and_damping_go_to_their_joint_alone(model, i):
    changed = compiled(**{f"hinge_stiffness_{i}": 1.5, f"hinge_damping_{i}": 0.07})
    joint = changed.joint(f"tail{i}")
    assert joint.stiffness.ravel()[0] == 1.5
    assert joint.damping.ravel()[0] == 0.07
    others = [j for j in range(model.njnt) if j != joint.id]
    np.testing.assert_array_equal(changed.jnt_stiffness[others], model.jnt_stiffness[others])
    np.testing.assert_array_equal(
        np.delete(changed.dof_damping, joint.dofadr, axis=0), np.delete(model.dof_damping, joint.dofadr, axis=0)
    )


@pytest.mark.parametrize(("outline", "thickness", "area_mm2"), [
    (mirrored(outline_of("tail_fin")), 0.002, 7542),
    (outline_of("dorsal_fin"), 0.003, 4564),
])  # fmt: skip
def test_fins_are_closed_plates_of_their_area(outline, thickness, area_mm2):
    vertices, faces = extrude(outline, thickness)
    edges = [(int(face[i]), int(face[(i + 1) % 3])) for face in faces for i in range(3)]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)  # each edge is walked once in each direction
    corners = vertices[faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert 1e6 * volume / thickness == pytest.approx(area_mm2, rel=2e-3)  # above 0: the normals point outward
    assert np.ptp(vertices[:, 1]) == pytest.approx(thickness)


def test_half_a_turn_of_the_motor_mirrors_the_swim():
    values = {**PUBLISHED, "hinge_stiffness_3": 1.3, "fluid_magnus_lift": 1.0}
    model = FISH.build(values).compile()
    one, other = (Stepper(model, FISH, 0.05, 2 * np.pi, angle).run(1000).markers for angle in (0.0, np.pi))
    assert np.ptp(one[:, 8, 1]) > 0.02
    np.testing.assert_allclose(other, one * [1, -1], atol=1e-9)


WAVE = 0.05 * np.exp(1j * np.linspace(0, 2, 9))


def listed(wave):
    return {
        "amplitude": [None if np.isnan(z) else abs(z) for z in wave],
        "phase": [None if np.isnan(z) else float(np.angle(z)) for z in wave],
    }


def evidence_of(*pairs):
    """Evidence of trials with these simulated and real fundamentals."""
    beats = [{"beat_simulated": listed(simulated), "beat_real": listed(real)} for simulated, real in pairs]
    return {"trials": {f"swim{i}": trial for i, trial in enumerate(beats)}}


def test_amplitude_and_phase_along_the_body_make_the_distance():
    assert beat_distance(evidence_of((WAVE, WAVE), (0.5 * WAVE, 0.5 * WAVE))) == pytest.approx(0.0, abs=1e-12)
    assert beat_distance(evidence_of((WAVE * np.exp(1.3j), WAVE))) == pytest.approx(0.0, abs=1e-12)
    assert beat_distance(evidence_of((1.2 * WAVE, WAVE))) == pytest.approx(0.01)
    assert beat_distance(evidence_of((np.conj(WAVE), WAVE))) > 0.03  # the wave runs the other way
    assert beat_distance(evidence_of((WAVE, WAVE), (1.2 * WAVE, WAVE))) == pytest.approx(0.005)

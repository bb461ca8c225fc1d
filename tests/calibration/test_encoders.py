"""A robot with encoders and without a camera: its sensors alone pose the problem, and start its trials."""

from dataclasses import replace

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from recorded import (
    PENDULUM,
    PENDULUM_HIDDEN,
    PENDULUM_SPACE,
    PENDULUM_XML,
    blank,
    recorded,
    torque_table,
    with_markers,
)
from refused import says
from swim2real.calibration import Problem
from swim2real.identification.finished_run import reopen
from swim2real.identification.identifiability import identify
from swim2real.objective import evidence
from swim2real.pipeline import calibrate
from swim2real.report import write_report
from swim2real.robots.drives import TABLE
from swim2real.robots.robot import Sensor, Trials
from swim2real.settings import CalibrationSettings, IdentifiabilitySettings
from swim2real.simulation.start import Reading, Stretch, sensed_start
from swim2real.trials import TrialSet

XML = PENDULUM_XML.replace("</sensor>", '<jointpos name="bend" joint="elbow"/></sensor>')
SENSORS = (Sensor("encoder", "rad", 0.3), Sensor("bend", "rad", 0.15))


def build(values):
    return with_markers(XML.format(**PENDULUM_SPACE.check(values)), ())


ROBOT = replace(
    PENDULUM, build=build, marker_names=(), rest_markers=np.zeros((0, 2)), marker_heights=np.zeros(0), links=(),
    trials=Trials({"torque": TABLE}, SENSORS, "fitted"),
)  # fmt: skip


@pytest.fixture(scope="module")
def reference():
    """Two recordings that begin in motion, read 100 times per second with the steps of an encoder."""
    blanks = [blank(ROBOT, name, 2.5, 100.0, controls=torque_table(3.0, seed)) for seed, name in enumerate("ab")]
    cut = []
    for trial in recorded(ROBOT, PENDULUM_HIDDEN, blanks):
        table = trial.sensors.between(0.9, 2.5)
        counted = replace(table, times=table.times, names=table.names, values=np.round(table.values, 3))
        track = MarkerTrack(table.times, np.zeros((len(table.times), 0, 2)))
        cut.append(replace(trial, track=track, sensors=counted))
    return TrialSet(tuple(cut), ())


@pytest.fixture(scope="module")
def problem(reference):
    return Problem(ROBOT, reference, threads=2)


def test_the_loss_is_what_the_sensors_errors_count_as(problem):
    hidden, other = problem.evaluate_many([PENDULUM_HIDDEN, ROBOT.space.published])
    assert hidden.loss < 3e-4
    assert other.loss > 5 * hidden.loss
    figures = other.figures()
    errors = figures["sensor_errors"]
    assert other.loss == pytest.approx(0.3 * errors["encoder"] + 0.15 * errors["bend"])
    assert not {"aligned_marker_error", "left_out_share"} & figures.keys()
    assert evidence(other)["loss"] == pytest.approx(other.loss)
    vector = other.residual_vector()
    assert vector.size == sum(rows * columns for rows, columns in problem.blocks())
    assert np.isfinite(vector).all()


def test_joint_sensors_tell_where_a_fit_of_the_start_begins():
    model = build(ROBOT.space.published).compile()
    times = np.arange(20) / 100
    encoder = Sensor("encoder", "deg", 1.0, 180 / np.pi, 360.0)
    turned = np.rad2deg(0.3 + 2 * times) + 720  # of readings that begin anew, the turn in which the model is
    readings = (Reading(encoder, times, turned, 360.0), Reading(Sensor("gyro[1]", "rad/s", 1.0), times, times))
    stretch = Stretch(times, np.zeros((20, 0, 2)), np.zeros((20, 0)), readings)
    qpos, qvel, _ = sensed_start(model, (np.array([0.0, 0.7]), np.zeros(2), np.zeros(0)), stretch)
    assert qpos == pytest.approx([0.3, 0.7])
    assert qvel == pytest.approx([2.0, 0.0])


def test_a_fit_far_above_the_noise_of_the_readings_isnt_usable(reference, tmp_path):
    quick = CalibrationSettings(method="random", budget=1, horizon=1.0, threads=2, first="model")
    found = calibrate(reference, ROBOT, quick, tmp_path / "run", on_warning=None)
    assert found.noise < 5e-4
    assert found.verdict.kind == "not usable"
    assert says(found.verdict.sentence, "% of the motion is unexplained", "times the noise of the data")


@pytest.mark.slow
def test_it_is_calibrated_reported_and_identified(reference, tmp_path):
    settings = CalibrationSettings(method="least-squares", budget=6, horizon=0.6, threads=2)
    outcome = calibrate(reference, ROBOT, settings, tmp_path / "run").to_json()
    assert outcome["fit"]["loss"] < outcome["fit"]["trials"]["a"]["sensor_errors"]["encoder"]
    page = write_report(tmp_path / "run", ROBOT).read_text(encoding="utf-8")
    assert "encoder" in page
    assert "Paths, the first chart" not in page
    run = reopen(tmp_path / "run", reference, ROBOT, 2)
    found = identify(run, IdentifiabilitySettings(rounds=2))
    assert found.intervals["lower_mass"].known == "roughly"
    assert found.intervals["lower_mass"].width < 0.25
    assert says(found.doubt, "followed 0 of its starts to the end")

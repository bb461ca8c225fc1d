"""A trial is the same in whatever way a program writes its log."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markertrack.span import WHOLE, Span
from markertrack.track import MarkerTrack
from recorded import PENDULUM
from refused import refusal, says
from swim2real.pipeline.recording import Wanted, recorded
from swim2real.trials import Trial
from swim2real.trials.log_table import read_log
from swim2real.trials.timebase import Timebase
from swimbase.errors import ArgumentError

TIMES = np.arange(40) / 50
ANGLES = np.stack([np.sin(3 * TIMES + i) for i in range(8)])
COLUMNS = {"torque": "N·m", "gyro[1]": "rad/s"} | {
    f"{marker} {axis}": "m" for marker in PENDULUM.marker_names for axis in "xz"
}
UNITS = {
    "N·m": {"N·m": 1, "Nm": 1, "mNm": 1e3, "N·mm": 1e3},
    "rad/s": {"rad/s": 1, "°/s": 180 / np.pi, "dps": 180 / np.pi, "rpm": 30 / np.pi},
    "m": {"m": 1, "mm": 1e3, "cm": 1e2, "µm": 1e6, "Meters": 1},
}
EPOCH = 1_718_703_600
ORIGINS = {
    "t": lambda t: repr(t), "Time [s]": lambda t: repr(t + 100), "t_ms": lambda t: repr(1e3 * t + 5),
    "timestamp": lambda t: f"{EPOCH + t:.6f}", "stamp": lambda t: str(round(1e3 * (EPOCH + t))),
    "__time": lambda t: str(10**6 * EPOCH + round(1e6 * t)), "%time": lambda t: str(10**9 * EPOCH + round(1e9 * t)),
    "Time": lambda t: (datetime.fromtimestamp(EPOCH, UTC) + timedelta(seconds=t)).isoformat(),
    "rec.stamp": lambda t: (datetime(2024, 6, 18, 9, 40) + timedelta(seconds=t)).strftime("%Y-%m-%d %H:%M:%S.%f"),
}  # fmt: skip
FORMS = [(",", "."), (";", ","), (";", "."), ("\t", "."), ("\t", ","), (" ", "."), ("|", ".")]


@st.composite
def written(draw):
    """A log as some program would write it, in bytes."""
    separator, mark = draw(st.sampled_from(FORMS))
    time = draw(st.sampled_from(sorted(ORIGINS)))
    if separator == " ":
        time = draw(st.sampled_from(["t", "t_ms", "%time"]))
    where = draw(st.sampled_from(["header", "row"]))
    names, units, cells = [time], ["s" if time == "t" else ""], [[ORIGINS[time](t) for t in TIMES.tolist()]]
    for (name, unit), values in zip(COLUMNS.items(), ANGLES, strict=True):
        chosen = draw(st.sampled_from(sorted(UNITS[unit])))
        name = name.replace(
            " ", draw(st.sampled_from("_.") if separator == " " else st.sampled_from([" ", "_", ".", " : "]))
        )
        named = f"{draw(st.sampled_from(['', 'field.', '/arm/']))}{name}"
        names.append(f"{named}{'' if separator == ' ' else ' '}[{chosen}]" if where == "header" else named)
        units.append(chosen)
        cells.append([repr(value) for value in (UNITS[unit][chosen] * values).tolist()])
    order = draw(st.permutations(range(len(names))))
    rows = [[cells[k][row].replace(".", mark) for k in order] for row in range(len(TIMES))]
    lines = ["Logger;TL-200", "Serial: 0042", ""] if draw(st.booleans()) else []
    lines.append(draw(st.sampled_from(["", "# "])) + separator.join(names[k] for k in order))
    if where == "row":
        lines.append(separator.join(units[k] or "-" for k in order))
    lines += [separator.join(row) for row in rows]
    lines += draw(st.sampled_from([[], ["# stopped by operator"], ["", ""]]))
    end = draw(st.sampled_from(["\n", "\r\n"]))
    return (end.join(lines) + end).encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"])))


def made(path, content="", *, time=(), markers=(), controls=(), sensors=(), span=WHOLE, **options):
    if content:
        path.write_text(content, encoding="utf-8")
    wanted = Wanted.of(PENDULUM, time, controls, sensors, markers)
    return recorded("a", read_log(path), PENDULUM, wanted, span=span, from_first_row=False, **options)


@given(written())
def test_nothing_changes_with_units_encoding_separator_clock_and_order(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "run.csv"
    path.write_bytes(content)
    trial = made(path).trial
    np.testing.assert_allclose(trial.track.times, TIMES, atol=1e-6)
    np.testing.assert_allclose(trial.controls.values[:, 0], ANGLES[0], atol=1e-12)
    np.testing.assert_allclose(trial.sensors.values[:, 0], ANGLES[1], atol=1e-12)
    np.testing.assert_allclose(trial.track.positions, ANGLES[2:].T.reshape(-1, 3, 2), atol=1e-12)
    assert set(trial.timebases) == {"track", "controls", "sensors"}
    assert str(trial.timebases["track"]) == "50 Hz by its time stamps, from the first row of run.csv"


def table(time="t", stamps=TIMES, names=tuple(COLUMNS), *, values=ANGLES):
    rows = zip(stamps, *values, strict=True)
    return "\n".join([",".join([time, *names]), *(",".join(map(str, row)) for row in rows)]) + "\n"


def test_tables_of_two_programs_on_one_clock_share_a_zero(tmp_path):
    later = [10**9 * EPOCH + round(1e9 * time) for time in TIMES + 0.125]
    (tmp_path / "commands.csv").write_text(table("sent", later, ("torque",), values=ANGLES[:1]))
    log = tmp_path / "run.csv"
    log.write_text(table("Time", [f"{EPOCH + time:.6f}" for time in TIMES]))
    commands = read_log(tmp_path / "commands.csv")
    found = made(log, time=("sent",), commands=commands).trial
    np.testing.assert_allclose(found.controls.times, TIMES + 0.125, atol=1e-6)
    np.testing.assert_allclose(found.sensors.times, TIMES, atol=1e-6)
    again = made(log, time=("sent", "Time"), commands=commands).trial
    assert np.array_equal(again.controls.times, found.controls.times)
    said = refusal(ArgumentError, made, log, time=("sent_at",), commands=commands)
    assert says(said, "no column 'sent_at'", "--time COLUMN:UNIT", "'Time'")


def test_commands_that_are_missing_and_lines_that_are_left_out_are_told(tmp_path):
    values = np.array(ANGLES)
    values[0, 5:8] = np.nan
    lines = table(values=values).splitlines()
    found = made(tmp_path / "run.csv", "\n".join([*lines[:9], "sensor timeout", *lines[9:]]) + "\n")
    assert says(found.notes[0], "1 lines", "line 10, 'sensor timeout'")
    assert says(found.notes[1], "3 of 40 rows have no value of actuator 'torque'", "holds")


def test_a_column_is_turned_round_or_counted_by_a_factor(tmp_path):
    text = table(names=("torque", "gyro y", *list(COLUMNS)[2:]))
    trial = made(
        tmp_path / "run.csv", text, controls=("torque=torque:-1",), sensors=("gyro[1]=gyro y:0.0879deg/s",)
    ).trial
    np.testing.assert_allclose(trial.controls.values[:, 0], -ANGLES[0])
    np.testing.assert_allclose(trial.sensors.values[:, 0], np.deg2rad(0.0879 * ANGLES[1]))
    plane = ("pivot=pivot x,pivot z:mm", "middle=middle x:-1,middle z", "end=x:mm,end z")
    said = refusal(ArgumentError, made, tmp_path / "run.csv", markers=plane, sensors=("gyro[1]=gyro y",))
    assert says(said, "no column 'x:mm' for x of marker 'end'")
    trial = made(tmp_path / "run.csv", markers=(*plane[:2], "end=end_x,end_z"), sensors=("gyro[1]=gyro y",)).trial
    np.testing.assert_allclose(trial.track.positions[:, 0], ANGLES[2:4].T / 1e3)
    np.testing.assert_allclose(trial.track.positions[:, 1, 0], -ANGLES[4])


def test_clocks_say_where_a_stretch_and_a_film_begin(tmp_path):
    cut = made(tmp_path / "run.csv", table(), span=Span(0.2)).trial
    assert {clock.origin for clock in cut.timebases.values()} == {"first row of run.csv plus 0.2 s"}
    film = Timebase("first frame of a.mp4", 60.0, "container")
    tracked = Trial("a", MarkerTrack(TIMES, np.zeros((40, 3, 2))), timebases={"track": film})
    (tmp_path / "beside.csv").write_text(table(names=("torque", "gyro[1]"), values=ANGLES[:2]))
    found = made(tmp_path / "beside.csv", tracked=tracked).trial
    assert (found.timebases["track"], found.timebases["controls"].origin) == (film, "time 0 of beside.csv")


@pytest.mark.parametrize(
    ("behind", "part"), [('# "gyro[0]" = {unit', "behind #: remove"), ("", "did you mean 'gyro[1]'?")]
)
def test_a_sensor_that_the_robot_file_has_behind_a_sign_is_named(tmp_path, behind, part):
    (tmp_path / "arm.toml").write_text(f"# [recordings.sensors]\n{behind}\n")
    robot = replace(PENDULUM, source=tmp_path / "arm.toml")
    said = refusal(ArgumentError, Wanted.of, robot, (), (), ("gyro[0]=g",), ())
    assert says(said, "'gyro[0]' is no sensor", part)

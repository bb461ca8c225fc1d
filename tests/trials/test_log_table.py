"""Tables of other programs: which column, which unit, which line is wrong."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refused import refusal, says
from swim2real.trials.log_table import choices, read_log
from swim2real.trials.units import UNITS, factor, unit_of_header, without_unit
from swimbase.errors import ArgumentError, TrialError


@pytest.fixture
def log(tmp_path):
    """Writes and reads a log."""

    def made(text):
        path = tmp_path / "log.csv"
        path.write_text(text, encoding="utf-8")
        return read_log(path)

    return made


@pytest.mark.parametrize(
    ("text", "said", "values"),
    [
        ("hip [deg]", "'hip [deg]' in deg", [np.pi / 2, np.nan, -np.pi / 4]),
        ("HIP", "'hip [deg]' in deg", [np.pi / 2, np.nan, -np.pi / 4]),  # without its unit
        ("hip:rad", "'hip [deg]' in rad", [90, np.nan, -45]),
        ("hip:-1", "'hip [deg]' in deg times -1", [-np.pi / 2, np.nan, np.pi / 4]),
        ("count:0.5deg", "'arm/count' in deg times 0.5", [np.pi / 360, np.pi / 180, np.pi / 120]),
        ("arm/count:2", "'arm/count' times 2", [2, 4, 6]),
    ],
)
def test_columns_are_taken_by_name_with_or_without_their_unit_and_a_factor(log, text, said, values):
    table = log("t_ms, hip [deg],state,arm/count\n100,90,on,1\n110.5,,on,2\n\n120,-45,off,3\n")
    np.testing.assert_allclose(table.times().since(0), [0.1, 0.1105, 0.12])
    assert table.times().words == "'t_ms' in ms"
    words, found = table.column(text, "it", "rad")
    assert (table.has(text), words) == (True, said)
    np.testing.assert_allclose(found, values)


EPOCH = "1718703600"  # s, of 2024-06-18T09:40:00 in UTC


@pytest.mark.parametrize(("column", "stamps", "words"), [
    ("t", [EPOCH + part for part in (".25", ".26", ".28")], "'t' in s since 1970"),
    ("t", [EPOCH + part for part in ("250", "260", "280")], "'t' in ms since 1970"),
    ("t", [EPOCH + part for part in ("250000", "260000", "280000")], "'t' in us since 1970"),
    ("__time", [EPOCH + part for part in ("250000000", "260000000", "280000000")], "'__time' in ns since 1970"),
    ("t_ns", [EPOCH + part for part in ("250000000", "260000000", "280000000")], "'t_ns' in ns"),
    ("%time", ["2024-06-18T09:40:00.25", "2024-06-18T09:40:00.260", "2024-06-18T09:40:00.28"], None),
    ("when", ["2024-06-18 11:40:00.25+02:00", "2024-06-18 11:40:00.26+02:00", "2024-06-18 11:40:00.28+02:00"], None),
    ("Zeit", ["18.06.2024 09:40:00.25", "18.06.2024 09:40:00.26", "18.06.2024 09:40:00.28"], None),
])  # fmt: skip
def test_stamps_since_1970_and_dates_are_on_one_clock(log, column, stamps, words):
    found = log(f"{column},q\n" + "".join(f"{stamp},1\n" for stamp in stamps)).times()
    assert found.words == (words or f"'{column.strip('%')}', dates or times of day")
    assert found.first == pytest.approx(1_718_703_600_250_000_000, abs=200)
    np.testing.assert_allclose(found.values, [0, 0.01, 0.03], atol=3e-7)


def test_nanoseconds_keep_their_last_digit(log):
    begin = 1_718_700_000_000_000_137
    times = log("t_ns,q\n" + "".join(f"{begin + row},1\n" for row in range(5))).times()
    assert times.first == begin
    np.testing.assert_allclose(times.values, 1e-9 * np.arange(5), rtol=1e-12)


@pytest.mark.parametrize("stamps", [
    ["09:40:00.25", "09:40:00.5"], ["40:00.25", "40:00.5"], ["0:40:00.250", "0:40:00.500"],
    ["09:40:00:250", "09:40:00:500"],
])  # fmt: skip
def test_times_of_day_are_times(log, stamps):
    assert np.diff(log("t,q\n" + "".join(f"{stamp},1\n" for stamp in stamps)).times().values) == pytest.approx(0.25)


@given(st.integers(10, 200), st.floats(0.003, 0.05), st.floats(0.5, 8), st.floats(0, 1))
def test_rows_on_a_coarse_clock_are_at_most_a_tick_off(tmp_path_factory, count, step, ratio, phase):
    true, tick = step * (np.arange(count) + phase), step * ratio
    stamps = np.round(np.floor(true / tick) * tick, 9)
    path = tmp_path_factory.getbasetemp() / "coarse.csv"
    path.write_text("t,q\n" + "".join(f"{stamp!r},1\n" for stamp in stamps.tolist()))
    if len(np.unique(stamps)) < 3:
        return
    times = read_log(path).times()
    assert np.abs(times.since(0) - stamps).max() <= tick + step
    assert np.diff(times.values).min() > 0
    assert bool(times.notes) == bool((np.diff(stamps) == 0).any())
    if times.notes:
        assert "ticks every" in times.notes[0]
        assert np.diff(times.values) == pytest.approx(step, rel=3 * ratio / count + 1e-6)


@pytest.mark.parametrize(("text", "parts"), [
    ("t,q\n0,1\n0,2\n", ("line 3", "0 s is the time of the row above", "must rise")),
    ("t,q\n1,1\n0,2\n", ("line 3", "0 s is before the row above (1 s)", "must rise")),
    ("t,q\n0,1\n,2\n", ("line 3", "no time in column 't'")),
    ("t,q\n0,1\nnoon,2\n", ("line 3, column 1", "'noon'", "not a number")),
    ("t,q\n0,1\n1,2,3\n", ("line 3", "3 columns", "2", "leave it out")),
    ("t,q\n0,1\n", ("1 rows", "at least 2")),
    ("0,1\n1,2\n", ("line 1", "must name the columns")),
    ("", ("the table is empty",)),
])  # fmt: skip
def test_what_is_wrong_in_a_table_is_reported_with_its_line(log, text, parts):
    assert says(refusal(TrialError, lambda: log(text).times()), *parts)


def test_rows_that_are_missing_or_unlike_the_others_are_told(log):
    assert says(refusal(TrialError, log("t,q\n0,init\n\n1,2\n2,3\n").column, "q", "it"), "line 2, column 2", "'init'")
    times = [0.0, 0.1, 0.2, 1.2, 1.3, 1.4, 1.5]
    (note,) = log("t,q\n" + "".join(f"{time},1\n" for time in times)).times().notes
    assert says(note, "rows are missing for 1 s from 0.200 s on;")


@pytest.mark.parametrize(("table", "column", "into", "parts"), [
    ("t,hip", "hop", "", ("no column 'hop' for it", "did you mean 'hip'?", "'t' and 'hip'")),
    ("a/x,b/x", "x", "", ("'x' for it may be 'a/x', 'b/x'", "whole name")),
    ("t,q", "hip:deg", "", ("no column 'hip:deg' for it", "'t' and 'q'")),
    ("t,q", "q:degg", "rad", ("'q' for it", "no unit 'degg'", "did you mean 'deg'?")),
    ("t,q", "q:deg", "N", ("'q' for it", "'deg' is a unit of angle", "'N' one of force")),
    ("q,q", "q", "", ("several columns are named 'q'",)),
])  # fmt: skip
def test_a_column_or_a_unit_that_isnt_there_is_reported(log, table, column, into, parts):
    assert says(refusal(ArgumentError, log(f"{table}\n0,1\n1,2\n").column, column, "it", into), *parts)


def test_names_stand_for_columns_and_units_are_converted():
    assert factor("deg", "rad") == pytest.approx(np.pi / 180)
    assert factor("rpm") == pytest.approx(2 * np.pi / 60)
    assert factor("mm", "cm") == pytest.approx(0.1)
    assert factor("counts", "counts") == 1
    assert factor("g") == pytest.approx(9.80665)
    assert factor("dps", "rad/s") == factor("degrees", "rad")
    assert all(factor(unit, unit) == 1 and factor(unit) > 0 for unit in UNITS)
    known = ("hip", "gyro[1]")
    assert choices("sensors", ["hip=q1:deg", "gyro[1]"], known, "sensor") == {"hip": "q1:deg", "gyro[1]": "gyro[1]"}
    assert choices("sensors", ["hip:deg"], known, "sensor") == {"hip": "hip:deg"}
    for texts, parts in (
        (["hop=q1"], ("'hop'", "no sensor", "did you mean 'hip'?")),
        (["hip=a", "hip=b"], ("'hip' twice",)),
        (["hip="], ("hip=COLUMN",)),
    ):
        assert says(refusal(ArgumentError, choices, "sensors", texts, known, "sensor"), *parts)


@pytest.mark.parametrize(("header", "unit", "name"), [
    ("hip_deg", "deg", "hip"), ("load [mN]", "mN", "load"), ("t (ms)", "ms", "t"), ("time_s", None, "time"),
    ("Time (Seconds)", "s", "Time"), ("hip", None, "hip"), ("q_min", None, "q_min"), ("deg", None, "deg"),
    ("x [left]", None, "x [left]"), ("gyro[1]", None, "gyro[1]"),
])  # fmt: skip
def test_a_name_may_end_in_a_unit(header, unit, name):
    assert (unit_of_header(header), without_unit(header)) == (unit, name)

"""Tables of other programs: which column, which unit, which line is wrong."""

import numpy as np
import pytest

from refused import refusal, says
from swim2real.errors import ArgumentError, TrialError
from swim2real.trials.log_table import choices, gaps, read_log
from swim2real.trials.units import UNITS, factor, unit_of_header, without_unit


@pytest.fixture
def log(tmp_path):
    """Writes and reads a log."""

    def made(text):
        path = tmp_path / "log.csv"
        path.write_text(text, encoding="utf-8")
        return read_log(path)

    return made


@pytest.mark.parametrize(("separator", "point"), [(",", "."), (";", ","), ("\t", ","), ("\t", ".")])
def test_columns_are_taken_by_name_from_tables_of_every_kind(log, separator, point):
    rows = [["t_ms", " hip [deg]", "state"], ["100", "90", "on"], ["110.5", "", "on"], [], ["120", "-45", "off"]]
    table = log("\n".join(separator.join(row).replace(".", point) for row in rows))
    np.testing.assert_allclose(table.times().values, [0.1, 0.1105, 0.12])
    np.testing.assert_allclose(table.column("hip [deg]", "it", "rad").values, [np.pi / 2, np.nan, -np.pi / 4])
    np.testing.assert_allclose(table.column("hip [deg]:rad", "it").values, [90, np.nan, -45])
    assert str(table.times()) == "'t_ms' in ms"


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("t,q\n0,1\n0,2\n", ("line 3", "0 s is the time of the row above", "must rise")),
        ("t,q\n1,1\n0,2\n", ("line 3", "0 s is before the row above (1 s)", "must rise")),
        ("t,q\n0,1\n,2\n", ("line 3", "no time in column 't'")),
        ("t,q\n0,1\nnoon,2\n", ("line 3, column 1", "'noon'", "not a number")),
        ("t,q\n0,1\n1,2,3\n", ("line 3", "3 columns", "2")),
        ("t,q\n0,1\n", ("1 rows", "at least 2")),
        ("0,1\n1,2\n", ("line 1", "must name the columns")),
        ("", ("must name the columns",)),
    ],
)
def test_what_is_wrong_in_a_table_is_reported_with_its_line(log, text, parts):
    assert says(refusal(TrialError, lambda: log(text).times()), *parts)


@pytest.mark.parametrize(
    ("table", "column", "into", "parts"),
    [
        ("t,q", "Q", "", ("no column 'Q' for it", "did you mean 'q'?", "'t', 'q'")),
        ("t,q", "hip:deg", "", ("no column 'hip:deg' for it", "'t', 'q'")),
        ("t,q", "q:degg", "rad", ("'q' for it", "no unit 'degg'", "did you mean 'deg'?")),
        ("t,q", "q:deg", "N", ("'q' for it", "'deg' is a unit of angle", "'N' one of force")),
        ("q,q", "q", "", ("several columns are named 'q'",)),
    ],
)
def test_a_column_or_a_unit_that_isnt_there_is_reported(log, table, column, into, parts):
    assert says(refusal(ArgumentError, log(f"{table}\n0,1\n1,2\n").column, column, "it", into), *parts)


def test_units_are_converted():
    assert factor("deg", "rad") == pytest.approx(np.pi / 180)
    assert factor("rpm") == pytest.approx(2 * np.pi / 60)
    assert factor("mm", "cm") == pytest.approx(0.1)
    assert factor("counts", "counts") == 1
    assert all(factor(unit, unit) == 1 and factor(unit) > 0 for unit in UNITS)


@pytest.mark.parametrize(
    ("header", "unit", "name"),
    [
        ("hip_deg", "deg", "hip"), ("load [mN]", "mN", "load"), ("t (ms)", "ms", "t"), ("time_s", None, "time"),
        ("hip", None, "hip"), ("q_min", None, "q_min"), ("deg", None, "deg"), ("x [left]", None, "x [left]"),
        ("gyro[1]", None, "gyro[1]"),
    ],
)  # fmt: skip
def test_a_name_may_end_in_a_unit(header, unit, name):
    assert (unit_of_header(header), without_unit(header)) == (unit, name)


def test_names_stand_for_columns_and_gaps_are_where_rows_are_missing():
    known = ("hip", "gyro[1]")
    assert choices("sensors", ["hip=q1:deg", "gyro[1]"], known, "sensor") == {"hip": "q1:deg", "gyro[1]": "gyro[1]"}
    assert choices("sensors", ["hip:deg"], known, "sensor") == {"hip": "hip:deg"}
    for texts, parts in (
        (["hop=q1"], ("'hop'", "no sensor", "did you mean 'hip'?")),
        (["hip=a", "hip=b"], ("'hip' twice",)),
        (["hip="], ("hip=COLUMN",)),
    ):
        assert says(refusal(ArgumentError, choices, "sensors", texts, known, "sensor"), *parts)
    assert gaps(np.array([0.0, 0.1, 0.2, 1.2, 1.3, 1.4, 1.5])) == [(pytest.approx(0.2), pytest.approx(1.0))]

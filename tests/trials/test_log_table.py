"""Tables of other programs: which column, which unit, which line is wrong."""

import numpy as np
import pytest

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
    ("text", "says"),
    [
        ("t,q\n0,1\n0,2\n", "line 3: 0 s is the time of the row above (0 s); times must rise"),
        ("t,q\n1,1\n0,2\n", "line 3: 0 s is before the row above (1 s); times must rise"),
        ("t,q\n0,1\n,2\n", "line 3: no time in column 't'"),
        ("t,q\n0,1\nnoon,2\n", "line 3, column 1: 'noon' is not a number"),
        ("t,q\n0,1\n1,2,3\n", "line 3: 3 columns; the header has 2"),
        ("t,q\n0,1\n", "1 rows of numbers; a trial needs at least 2"),
        ("0,1\n1,2\n", "line 1: it must name the columns"),
        ("", "it must name the columns"),
    ],
)
def test_what_is_wrong_in_a_table_is_told_with_its_line(log, text, says):
    with pytest.raises(TrialError) as told:
        log(text).times()
    assert says in str(told.value)


@pytest.mark.parametrize(
    ("column", "into", "says"),
    [
        ("Q", "", "has no column 'Q' for it; did you mean 'q'? Its columns are 't', 'q'"),
        ("hip:deg", "", "has no column 'hip:deg' for it; its columns are 't', 'q'"),
        ("q:degg", "rad", "column 'q' for it: there is no unit 'degg'; did you mean 'deg'?"),
        ("q:deg", "N", "column 'q' for it: 'deg' is a unit of angle, and 'N' one of force"),
    ],
)
def test_a_column_or_a_unit_that_isnt_there_is_told(log, column, into, says):
    with pytest.raises(ArgumentError) as told:
        log("t,q\n0,1\n1,2\n").column(column, "it", into)
    assert says in str(told.value)


def test_a_column_that_is_there_twice_is_refused(log):
    with pytest.raises(ArgumentError, match="several columns are named 'q'"):
        log("t,q,q\n0,1,2\n1,2,3\n").column("q", "it")


def test_units_go_there_and_back():
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


def test_names_stand_for_columns():
    known = ("hip", "gyro[1]")
    assert choices("sensors", ["hip=q1:deg", "gyro[1]"], known, "sensor") == {"hip": "q1:deg", "gyro[1]": "gyro[1]"}
    assert choices("sensors", ["hip:deg"], known, "sensor") == {"hip": "hip:deg"}
    for texts, says in (
        (["hop=q1"], "and 'hop' is no sensor; did you mean 'hip'?"),
        (["hip=a", "hip=b"], "has 'hip' twice"),
        (["hip="], "say hip=COLUMN"),
    ):
        with pytest.raises(ArgumentError) as told:
            choices("sensors", texts, known, "sensor")
        assert says in str(told.value)


def test_gaps_are_where_rows_are_missing():
    ((at, length),) = gaps(np.array([0.0, 0.1, 0.2, 1.2, 1.3, 1.4, 1.5]))
    assert (at, length) == (pytest.approx(0.2), pytest.approx(1.0))

"""Text tables as instruments and programs write them: what is a header, what a row, what neither."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refused import refusal, says
from swim2real.trials.text_table import read_table
from swimbase.errors import TrialError

ROWS = [(0.01 * i, 0.3 + 0.01 * i, -0.48 + 0.02 * i) for i in range(12)]
NAMES = ("time", "cmd", "q")


def rows(separator=",", mark=".", end="\n", form="{:.3f}", more=""):
    lines = (separator.join(form.format(value).replace(".", mark) for value in row) + more for row in ROWS)
    return end.join(lines) + end


def headed(*lines):
    return "\n".join(lines) + "\n"


LABVIEW = headed(
    "LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab", "Date\t2024/06/18", "Time\t14:11:37.2154541015625",
    "***End_of_Header***\t", "\t", "Channels\t2\t\t\t", "Samples\t10\t10\t\t", "X0\t0.0E+0\t0.0E+0\t\t",
    "***End_of_Header***\t\t\t\t", "time\tcmd\tq\tComment",
)  # fmt: skip
OPENSIM = headed("Coordinates", "version=1", "nRows=12", "inDegrees=yes", "", "Units are S.I. units", "", "endheader")
ESP32 = headed("ets Jun  8 2016 00:22:57", "rst:0x1 (POWERON_RESET),boot:0x13", "45,0.3", "time,cmd,q")
CAMPBELL = headed(
    '"TOA5","CR1000","CR1000","1234","OS"', '"time","cmd","q"', '"TS","rad","rad"', '"","Smp","Avg"'
)  # fmt: skip


@pytest.mark.parametrize("text", [
    headed("time,cmd,q") + rows(),
    headed("time;cmd;q") + rows(";", ","),
    headed("time\tcmd\tq") + rows("\t", ",", "\r\n"),
    headed(" time  cmd   q") + rows("   ", form="{:9.4f}"),
    headed("time cmd q") + rows(" ", ","),
    headed("time | cmd | q", "-----|-----|----") + rows(" | "),
    headed('"time","cmd","q"') + '"' + rows('","', ",", '"\n"')[:-1],
    headed("sep=;", "time;cmd;q") + rows(";"),
    headed("# by a program, in June", "# time, cmd, q") + rows(", "),
    headed("% time,cmd,q", "%") + rows(),
    headed("Logger,TL-200", "Serial,0042", "Rate,100 Hz", "", "time,cmd,q", "s,rad,rad") + rows(),
    headed("My experiment,,", "run 3,2024-06-18,", "time,cmd,q") + rows(),
    headed("time,cmd,q,") + rows(more=","),
    headed("time,cmd,q") + rows() + "# stopped by operator\n",
    headed("time,cmd,q") + rows() + "\n,,\n",
    LABVIEW + rows("\t"),
    OPENSIM + headed("time\tcmd\tq") + rows("\t", form="{:16.8f}"),
    CAMPBELL + rows(),
    '"time\n[s]","cmd\n[deg]",q\n' + rows(),
])  # fmt: skip
def test_a_table_is_the_same_in_whatever_form_it_is_written(tmp_path, text):
    (tmp_path / "log.csv").write_text(text, encoding="utf-8", newline="")
    table = read_table(tmp_path / "log.csv")
    assert tuple(name.split("[")[0] for name in table.names) == NAMES
    assert not table.left_out
    np.testing.assert_allclose([table.numbers(k) for k in range(3)], np.array(ROWS).T, atol=1e-9)


MOTIVE = headed(
    "Format Version,1.23,Take Name,T,Length Units,Millimeters", "", "Type,,Marker,Marker,Marker,Marker,Marker,Marker",
    "Name,,A:tip,A:tip,A:tip,A:end,A:end,A:end", "ID,,1,1,1,2,2,2", ",,Position,Position,Position,Position,Position,"
    "Position", "Frame,Time (Seconds),X,Y,Z,X,Y,Z",
)  # fmt: skip
VICON = headed("Trajectories", "100", ",,A:tip,,,A:end,,", "Frame,Time (Seconds),X,Y,Z,X,Y,Z", ",,mm,mm,mm,mm,mm,mm")
TRC = headed(
    "PathFileType\t4\t(X/Y/Z)\tfile.trc", "DataRate\tNumMarkers\tUnits", "100.0\t2\tmm",
    "Frame\tTime (Seconds)\tA:tip\t\t\tA:end\t\t", "\t\tX1\tY1\tZ1\tX2\tY2\tZ2", "",
)  # fmt: skip
QUALISYS = headed(
    "NO_OF_FRAMES\t9", "FREQUENCY\t100", "Units: mm", "MARKER_NAMES\tA:tip\tA:end",
    "Frame\tTime (Seconds)\tA:tip X\tA:tip Y\tA:tip Z\tA:end X\tA:end Y\tA:end Z",
)  # fmt: skip


@pytest.mark.parametrize(
    ("head", "separator"), [(MOTIVE, ","), (VICON, ","), (VICON.replace("A:end,,", "A:end"), ","), (TRC, "\t"),
                            (QUALISYS, "\t")],
)  # fmt: skip
def test_rows_of_a_header_name_a_column_together(tmp_path, head, separator):
    cells = np.column_stack([np.arange(9), np.arange(9) / 100, np.arange(54).reshape(9, 6) + 0.5])
    (tmp_path / "take.csv").write_text(head + "\n".join(separator.join(map(repr, row)) for row in cells.tolist()))
    table = read_table(tmp_path / "take.csv")
    axes = [f"A:{marker} {axis}" for marker in ("tip", "end") for axis in "XYZ"]
    assert table.names == ("Frame", "Time (Seconds)", *axes)
    assert table.stated == {"length": "mm"} or table.units[2:] == ["mm"] * 6
    np.testing.assert_array_equal(table.numbers(7), cells[:, 7])


def test_rotations_and_positions_of_a_body_are_told_apart(tmp_path):
    text = headed(
        ",,Arm,Arm,Arm,Arm,Leg,Leg,Leg,Leg",
        ",,Rotation,Rotation,Position,Position,Rotation,Rotation,Position,Position",
        "Frame,Time,X,Y,X,Y,X,Y,X,Y", "0,0.0,1,2,3,4,5,6,7,8", "1,0.1,1,2,3,4,5,6,7,9",
    )  # fmt: skip
    (tmp_path / "take.csv").write_text(text)
    assert read_table(tmp_path / "take.csv").names[2:6] == (
        "Rotation Arm X", "Rotation Arm Y", "Position Arm X", "Position Arm Y"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("encoding", "names"),
    [
        ("utf-8", ("Zeit [s]", "Größe [°]", "Kraft µN")), ("utf-8-sig", ("Zeit", "Größe", "°")),
        ("utf-16", ("Zeit", "q [°]", "p")), ("utf-16-le", ("Zeit", "q", "p")), ("utf-16-be", ("Zeit", "q [°]", "p")),
        ("cp1252", ("Zeit [s]", "Größe [°]", "Kraft µN")), ("cp1252", ("t", "q [°]", "p")),
        ("latin-1", ("Temps", "épaule (°)", "mesuré")), ("cp932", ("時間[s]", "角度[°]", "トルク")),
        ("cp1251", ("Время", "Угол", "Момент")),
    ],
)  # fmt: skip
def test_the_encoding_is_found(tmp_path, encoding, names):
    (tmp_path / "log.csv").write_bytes((";".join(names) + "\r\n" + rows(";", ",", "\r\n")).encode(encoding))
    table = read_table(tmp_path / "log.csv")
    assert table.names == names
    np.testing.assert_allclose(table.numbers(2), np.array(ROWS)[:, 2])


def test_signs_of_nothing_are_no_numbers_and_no_faults(tmp_path):
    signs = ["#N/A", "NaN", "nan", "NAN", "-", "--", "NULL", "#NV", "#DIV/0!", "", "inf", "-1.#IND", "1.#QNAN", "None"]
    (tmp_path / "log.csv").write_text("t,q\n" + "".join(f"{i},{s}\n" for i, s in enumerate(signs)))
    assert np.isnan(read_table(tmp_path / "log.csv").numbers(1)).all()
    (tmp_path / "log.csv").write_text("q,t\n" + "".join(f"{sign},{i}\n" for i, sign in enumerate(signs)))
    table = read_table(tmp_path / "log.csv")
    assert len(table.lines) == len(signs)
    assert np.isnan(table.numbers(0)).all()


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False).filter(lambda x: abs(x) <= 1e12), min_size=2))
def test_numbers_are_read_to_the_last_digit(tmp_path_factory, values):
    path = tmp_path_factory.getbasetemp() / "exact.csv"
    path.write_text("i,x\n" + "".join(f"{i},{value!r}\n" for i, value in enumerate(values)))
    assert read_table(path).numbers(1).tolist() == values


def test_lines_of_noise_are_left_out_with_a_word_and_a_row_that_is_damaged_is_not(tmp_path):
    path, lines = tmp_path / "serial.csv", rows().splitlines()
    path.write_text(ESP32 + "\n".join([*lines[:5], "E: sensor timeout", *lines[5:], "0.12,0."]))
    table = read_table(path)
    assert (table.names, len(table.lines), table.lines[-1]) == (NAMES, 12, 17)
    assert table.left_out == "2 lines that are no rows are left out, first line 10, 'E: sensor timeout'"
    path.write_text(ESP32 + "\n".join([*lines[:5], "0.05,0.30.4,1,2", *lines[5:]]) + "\n")
    assert says(refusal(TrialError, read_table, path), path, "line 10: 4 columns", "have 3", "leave it out")
    path.write_text(headed("cmd q") + rows(" "))  # as R writes names of rows
    assert says(refusal(TrialError, read_table, path), "line 2: 3 columns", "the header names 2")


@pytest.mark.parametrize(("cell", "parts"), [
    ("oops", "'oops' is not a number; where none is known, leave the cell empty"),
    ("1_0", "'1_0'"), ("٣", "'٣'"), ("1,234.5", "'1,234.5'"), ("2e12", "1e+12"),
])  # fmt: skip
def test_a_cell_that_is_no_number_is_named_with_its_place(tmp_path, cell, parts):
    (tmp_path / "log.csv").write_text(headed("time;cmd;q") + rows(";") + f"0.12;0.5;{cell}\n", encoding="utf-8")
    table = read_table(tmp_path / "log.csv")
    assert says(refusal(TrialError, table.numbers, 2), "log.csv, line 14, column 3", parts)


@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n\xff\xfe\x00", b"PK\x03\x04\x14\0\x06\0" + bytes(range(256))])
def test_what_is_no_text_is_refused(tmp_path, content):
    (tmp_path / "log.xlsx").write_bytes(content)
    assert says(refusal(TrialError, read_table, tmp_path / "log.xlsx"), "log.xlsx: not readable as text", "CSV")

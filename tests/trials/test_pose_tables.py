import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from swim2real.errors import TrialError
from swim2real.trials import MarkerTrack
from swim2real.trials.pose_tables import read_dlc, write_dlc

HEADER = "scorer,net,net,net,net,net,net\nbodyparts,M0,M0,M0,M1,M1,M1\ncoords,x,y,likelihood,x,y,likelihood\n"
ROWS = "0,1.5,2.5,0.9,3,4,1\n1,1.6,2.6,0.8,3.1,4.1,0.5\n"


def refusal(call, *arguments, **options) -> str:
    with pytest.raises(TrialError) as caught:
        call(*arguments, **options)
    return str(caught.value)


def table(tmp_path, text):
    path = tmp_path / "swimDLC_net.csv"
    path.write_text(text, encoding="utf-8")
    return path


@given(
    arrays(float, (4, 3, 2), elements=st.floats(-1e5, 1e5) | st.just(float("nan"))),
    arrays(float, (4, 3), elements=st.floats(0, 1)),
    st.sampled_from([25.0, 29.97, 60.0, 240.0]),
)
def test_what_was_written_is_read_again_to_the_last_digit(tmp_path_factory, positions, confidence, fps):
    path = tmp_path_factory.getbasetemp() / "swim.csv"
    track = MarkerTrack(np.arange(4) / fps, positions, confidence)
    write_dlc(track, ("head", "middle, of all", "tail"), path)
    again, names = read_dlc(path, fps)
    assert names == ("head", "middle, of all", "tail")
    np.testing.assert_array_equal(again.times, track.times)
    np.testing.assert_array_equal(again.positions, track.positions)
    np.testing.assert_array_equal(again.confidence, track.confidence)


def test_the_table_is_as_deeplabcut_writes_it(tmp_path):
    positions = np.array([[[1.5, 2.0], [3.0, 4.0]], [[1.25, np.nan], [3.0, 4.5]]])
    write_dlc(MarkerTrack([0, 0.1], positions, [[1, 0.5], [1, 1]]), ("M0", "M1"), tmp_path / "swim.csv", "somebody")
    assert (tmp_path / "swim.csv").read_bytes() == (
        b"scorer,somebody,somebody,somebody,somebody,somebody,somebody\n"
        b"bodyparts,M0,M0,M0,M1,M1,M1\n"
        b"coords,x,y,likelihood,x,y,likelihood\n"
        b"0,1.5,2.0,1.0,3.0,4.0,0.5\n"
        b"1,1.25,,0.0,3.0,4.5,1.0\n"
    )
    assert [file.name for file in tmp_path.iterdir()] == ["swim.csv"]


def test_pixels_stay_pixels_with_y_down(tmp_path):
    track, names = read_dlc(table(tmp_path, HEADER + ROWS), 50)
    assert names == ("M0", "M1")
    np.testing.assert_array_equal(track.positions, [[[1.5, 2.5], [3, 4]], [[1.6, 2.6], [3.1, 4.1]]])
    np.testing.assert_array_equal(track.confidence, [[0.9, 1], [0.8, 0.5]])
    np.testing.assert_allclose(track.times, [0, 0.02])


def test_missing_values_are_markers_that_werent_seen(tmp_path):
    text = HEADER + "0,,,,3,4,1\n1,nan,2.6,0.8,3.1,4.1,\n2,1,2,0.7,inf,4,1\n"
    track, _ = read_dlc(table(tmp_path, text), 60)
    np.testing.assert_array_equal(track.confidence, [[0, 1], [0, 0], [0.7, 0]])
    np.testing.assert_array_equal(np.isnan(track.positions).any(axis=2), [[True, False], [True, False], [False, True]])


def test_dropped_frames_leave_a_gap_in_time(tmp_path):
    text = HEADER + "100,1,2,1,3,4,1\n101,1,2,1,3,4,1\n105,1,2,1,3,4,1\n"
    np.testing.assert_allclose(read_dlc(table(tmp_path, text), 10)[0].times, [0, 0.1, 0.5])


def test_byte_order_marks_windows_line_ends_and_blank_lines_do_no_harm(tmp_path):
    text = "\ufeff" + (HEADER + "\n" + ROWS).replace("\n", "\r\n") + "\r\n"
    path = tmp_path / "swim.csv"
    path.write_bytes(text.encode())
    np.testing.assert_array_equal(
        read_dlc(path, 60)[0].positions, read_dlc(table(tmp_path, HEADER + ROWS), 60)[0].positions
    )


def test_a_likelihood_that_was_rounded_is_taken(tmp_path):
    text = HEADER + "0,1,2,1.0000001,3,4,-1e-9\n1,1,2,1,3,4,1\n"
    assert read_dlc(table(tmp_path, text), 60)[0].confidence[0].tolist() == [1, 0]


def individuals(*animals):
    lines = HEADER.splitlines()
    return "\n".join([lines[0], ",".join(["individuals", *animals]), *lines[1:]]) + "\n"


def test_a_table_of_one_animal_among_possible_many_is_read(tmp_path):
    track, names = read_dlc(table(tmp_path, individuals(*["fish"] * 6) + ROWS), 60)
    assert names == ("M0", "M1")
    assert track.frame_count == 2


def test_a_table_of_several_animals_is_refused(tmp_path):
    path = table(tmp_path, individuals(*["fish"] * 3, *["carp"] * 3) + ROWS)
    assert refusal(read_dlc, path, 60) == (
        f"{path}, line 2: 2 animals (fish, carp); one swimmer is needed, so export it by itself"
    )


LINES = HEADER.splitlines()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ": no DeepLabCut table; it needs rows scorer, bodyparts, coords and then one a frame"),
        (LINES[0] + "\n", ": no DeepLabCut table; it needs rows scorer, bodyparts, coords and then one a frame"),
        (
            "0,1,2,3\n1,2,3,4\n2,3,4,5\n",
            ", line 1: begins with '0'; a DeepLabCut table begins with rows scorer, bodyparts, coords",
        ),
        (
            "\n".join([LINES[0], LINES[2], LINES[1]]) + "\n" + ROWS,
            ", line 2: begins with 'coords'; a DeepLabCut table begins with rows scorer, bodyparts, coords",
        ),
        (HEADER.replace("likelihood", "p") + ROWS,
         ", line 3: coords must be x, y, likelihood for each marker above them"),
        (HEADER.replace("M1,M1,M1", "M1,M1,M2") + ROWS,
         ", line 2: each marker's name must stand above its three columns"),
        (HEADER.replace("M1", "M0") + ROWS, ", line 2: a marker's name comes twice in M0, M0"),
        (HEADER + "0,1,2,1,3,4\n", ", line 4: 6 columns; the header has 7"),
        (HEADER + "0,1,2,1,3,4,1\n1,1,b,1,3,4,1\n", ", line 5, column 3: 'b' is not a number"),
        (HEADER + "0,1,2,1,3,4,1.5\n", ", line 4, column 7: likelihood 1.5 must lie within 0 and 1"),
        (HEADER + "0,1,2,inf,3,4,1\n", ", line 4, column 4: likelihood inf must lie within 0 and 1"),
        (HEADER + "\n1,1,2,1,3,4,1\n1,1,2,1,3,4,1\n", ", line 6: frame 1 comes after frame 1; they must rise"),
        (HEADER + "labeled-data/img001.png,1,2,1,3,4,1\n",
         ", line 4, column 1: 'labeled-data/img001.png' is no frame number; tables of single labeled pictures are no "
         "track, analyze the video instead"),
        (HEADER + "0,1,2,1,3,4,1\n", ": 1 frames; a track needs at least 2"),
        (HEADER, ": 0 frames; a track needs at least 2"),
    ],
)  # fmt: skip
def test_tables_that_are_none_are_refused(tmp_path, text, message):
    path = table(tmp_path, text)
    assert refusal(read_dlc, path, 60) == f"{path}{message}"


def test_files_that_cant_be_read_or_written_are_told(tmp_path):
    assert refusal(read_dlc, tmp_path / "no.csv", 60).startswith(f"{tmp_path / 'no.csv'}: not readable as a table (")
    path = tmp_path / "binary.csv"
    path.write_bytes(b"\x89\xff\xfe\x00")
    assert refusal(read_dlc, path, 60).startswith(f"{path}: not readable as a table (")
    track = MarkerTrack([0, 1], np.zeros((2, 2, 2)))
    nowhere = tmp_path / "nowhere" / "swim.csv"
    assert refusal(write_dlc, track, ("a", "b"), nowhere) == f"can't write '{nowhere}': No such file or directory"


@pytest.mark.parametrize("fps", [0.0, -60.0, np.nan, np.inf])
def test_a_table_needs_a_frame_rate(tmp_path, fps):
    path = table(tmp_path, HEADER + ROWS)
    assert refusal(read_dlc, path, fps) == f"{path}: fps is {fps}; it must be finite and above 0"


@pytest.mark.parametrize("names", [("a",), ("a", "a")])
def test_each_marker_needs_a_name_of_its_own(tmp_path, names):
    message = refusal(write_dlc, MarkerTrack([0, 1], np.zeros((2, 2, 2))), names, tmp_path / "swim.csv")
    assert message == f"{len(names)} names ({', '.join(names)}) for 2 markers; each needs its own"

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from markertrack.track import MarkerTrack
from refused import refusal, says
from swim2real.trials.pose_tables import read_dlc, read_poses, write_dlc
from swimbase.errors import TrialError

HEADER = "scorer,net,net,net,net,net,net\nbodyparts,M0,M0,M0,M1,M1,M1\ncoords,x,y,likelihood,x,y,likelihood\n"
LINES = HEADER.splitlines()
ROWS = "0,1.5,2.5,0.9,3,4,1\n1,1.6,2.6,0.8,3.1,4.1,0.5\n"


def table(tmp_path, text):
    path = tmp_path / "swimDLC_net.csv"
    path.write_bytes(text.encode())
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
    write_dlc(MarkerTrack([0, 0.1], positions, [[1, 0.5], [1, 1]]), ("M0", "M1"), tmp_path / "swim.csv", "net")
    assert (tmp_path / "swim.csv").read_text() == HEADER + "0,1.5,2.0,1.0,3.0,4.0,0.5\n1,1.25,,0.0,3.0,4.5,1.0\n"
    assert [file.name for file in tmp_path.iterdir()] == ["swim.csv"]


def individuals(*animals):
    return "\n".join([LINES[0], ",".join(["individuals", *animals]), *LINES[1:]]) + "\n"


@pytest.mark.parametrize("text", [
    HEADER + ROWS,
    "\ufeff" + (HEADER + "\n" + ROWS).replace("\n", "\r\n") + "\r\n",
    individuals(*["fish"] * 6) + ROWS,
], ids=["plain", "windows", "one animal"])  # fmt: skip
def test_pixels_stay_pixels_with_y_down(tmp_path, text):
    track, names = read_dlc(table(tmp_path, text), 50)
    assert names == ("M0", "M1")
    np.testing.assert_array_equal(track.positions, [[[1.5, 2.5], [3, 4]], [[1.6, 2.6], [3.1, 4.1]]])
    np.testing.assert_array_equal(track.confidence, [[0.9, 1], [0.8, 0.5]])
    np.testing.assert_allclose(track.times, [0, 0.02])


def test_missing_values_are_markers_that_werent_seen_and_missing_rows_a_gap_in_time(tmp_path):
    text = HEADER + "100,,,,3,4,1.0000001\n101,nan,2.6,0.8,3.1,4.1,\n105,1,2,0.7,inf,4,-1e-9\n"
    track, _ = read_dlc(table(tmp_path, text), 10)
    np.testing.assert_array_equal(track.confidence, [[0, 1], [0, 1], [0.7, 0]])  # what isn't known isn't lost
    np.testing.assert_array_equal(np.isnan(track.positions).any(axis=2), [[True, False], [True, False], [False, True]])
    np.testing.assert_allclose(track.times, [10, 10.1, 10.5])  # the film began before the table


@pytest.mark.parametrize(("text", "parts"), [
    ("", ("the table is empty",)),
    (LINES[0] + "\n", ("the table is empty",)),
    ("0,1,2,3\n1,2,3,4\n2,3,4,5\n", ("no pose table", "NAME.x and NAME.y")),
    (HEADER.replace("M1", "M0") + ROWS, ("'M0' comes twice",)),
    (HEADER + ROWS + "2,1,2,1,3,4\n", ("line 6", "6 columns", "7")),
    (HEADER + "0,1,2,1,3,4,1\n1,1,b,1,3,4,1\n", ("line 5, column 3", "'b'")),
    (HEADER + ROWS + "2,1,2e19,1,3,4,1\n", ("line 6, column 3", "2e+19", "1e+12")),
    (HEADER + ROWS + "lost the animal\n", ("left out", "line 6, 'lost the animal'", "a row per frame")),
    (HEADER + "0.5,1,2,1,3,4,1\n1,1,2,1,3,4,1\n", ("line 4, column 1", "0.5 is no frame number")),
    (HEADER + "\n1,1,2,1,3,4,1\n1,1,2,1,3,4,1\n", ("line 6", "frame 1 comes after frame 1")),
    (HEADER + "labeled-data/img001.png,1,2,1,3,4,1\n" * 2, ("line 4, column 1", "img001.png", "video")),
    (HEADER + "0,1,2,1,3,4,1\n", ("1 frames", "at least 2")),
    (individuals(*["fish"] * 3, *["carp"] * 3) + ROWS, ("2 animals (fish, carp)", "by itself")),
])  # fmt: skip
def test_tables_that_are_none_are_refused(tmp_path, text, parts):
    path = table(tmp_path, text)
    assert says(refusal(TrialError, read_dlc, path, 60), path, *parts)


def test_files_rates_and_names_that_wont_do_are_refused(tmp_path):
    assert says(refusal(TrialError, read_dlc, tmp_path / "no.csv", 60), tmp_path / "no.csv", "not readable")
    path = tmp_path / "binary.csv"
    path.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe\x00")
    assert says(refusal(TrialError, read_dlc, path, 60), path, "not readable")
    for fps in (0.0, -60.0, np.nan, np.inf):
        assert says(refusal(TrialError, read_dlc, path, fps), path, f"fps is {fps}", "finite and above 0")
    track = MarkerTrack([0, 1], np.zeros((2, 2, 2)))
    nowhere = tmp_path / "nowhere" / "swim.csv"
    assert says(refusal(TrialError, write_dlc, track, ("a", "b"), nowhere), nowhere, "No such file or directory")
    for names in (("a",), ("a", "a")):
        assert says(refusal(TrialError, write_dlc, track, names, path), f"{len(names)} names", "2 markers", "its own")


SLEAP = "track,frame_idx,instance.score,M0.x,M0.y,M0.score,M1.x,M1.y,M1.score\n"


@pytest.mark.parametrize(
    ("text", "confidence", "notes"),
    [
        (HEADER + "3,1,2,2.5,3,4,0.5\n4,1,2,-4,3,5,1\n", [[1, 0.5], [0, 1]], ["2 likelihoods lie outside 0 and 1"]),
        (HEADER + "3,1,2,,3,4,\n4,1,2,,3,5,\n", [[1, 1], [1, 1]], ["4 positions have no likelihood"]),
        (SLEAP + "track_0,3,0.9,1,2,1,3,4,0.5\ntrack_1,4,0.9,1,2,1,3,5,1.0\n", [[1, 0.5], [1, 1]], []),
        ("frame;M1_y;M1_x;M0_x;M0_y\n3;4;3;1;2\n4;5;3;1;2\n", [[1, 1], [1, 1]], ["no likelihood"]),
        (
            "scorer,n,n,n,n,n,n,n,n\nindividuals,a,a,a,a,a,a,single,single\nbodyparts,M1,M1,M1,M0,M0,M0,ruler,ruler\n"
            "coords,x,y,likelihood,x,y,likelihood,x,y\n3,3,4,0.5,1,2,1,7,8\n4,3,5,1,1,2,1,7,8\n",
            [[1, 0.5], [1, 1]], ["isn't taken: ruler"],
        ),
        (
            "scorer,n,n,n,n,n,n,n,n\nbodyparts,M0,M0,M0,M0,M1,M1,M1,M1\ncoords,x,y,x_ens_median,likelihood,x,y,likelihood,"
            "x_ens_var\n3,1,2,9,1,3,4,0.5,9\n4,1,2,9,1,3,5,1,9\n",
            [[1, 0.5], [1, 1]], [],
        ),
        (HEADER.replace("M0", "a").replace("M1", "b") + "3,1,2,1,3,4,0.5\n4,1,2,1,3,5,1\n", [[1, 0.5], [1, 1]],
         ["M0 is a, M1 is b"]),
    ],
    ids=["beyond 1", "without", "SLEAP", "coordinates alone", "unique part", "smoother", "other names"],
)  # fmt: skip
def test_the_markers_of_a_robot_are_found_in_tables_of_every_program(tmp_path, text, confidence, notes):
    track, found = read_poses(table(tmp_path, text), 10, ("M0", "M1"))
    np.testing.assert_array_equal(track.positions, [[[1, 2], [3, 4]], [[1, 2], [3, 5]]])
    np.testing.assert_array_equal(track.confidence, confidence)
    np.testing.assert_allclose(track.times, [0.3, 0.4])
    assert len(found) == len(notes)
    assert all(note in line for note, line in zip(notes, found, strict=True))

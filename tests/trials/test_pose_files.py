"""Files of SLEAP and movement: what is written is read again, and as their own libraries write it."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from markertrack.track import MarkerTrack
from refused import refusal, says
from swim2real.pipeline import export_tracks, import_tracks
from swim2real.robots.fish import FISH
from swim2real.trials import Trial, TrialSet, load_reference, save_reference
from swim2real.trials.pose_tables import read_dlc, read_poses, write_poses
from swimbase.errors import TrialError
from swimmers import Swimmer

h5py = pytest.importorskip("h5py", reason="the extra poses isn't installed")
pytest.importorskip("xarray", reason="the extra poses isn't installed")
h5netcdf = pytest.importorskip("h5netcdf", reason="the extra poses isn't installed")
NAMES = ("head", "middle, of all", "tail")


@settings(max_examples=25)
@given(
    arrays(float, (4, 3, 2), elements=st.floats(-1e5, 1e5) | st.just(float("nan"))),
    arrays(float, (4, 3), elements=st.floats(0, 1)),
    st.sampled_from([25.0, 29.97, 60.0, 240.0]),
    st.sampled_from([[0, 1, 2, 3], [100, 101, 105, 106]]),
    st.sampled_from(["swim.h5", "swim.nc"]),
)
def test_what_was_written_is_read_again_to_the_last_digit(tmp_path_factory, positions, confidence, fps, frames, name):
    path = tmp_path_factory.getbasetemp() / name
    track = MarkerTrack(np.array(frames) / fps, positions, confidence)
    write_poses(track, NAMES, path, fps)
    again, names = read_dlc(path, fps)
    assert names == NAMES
    for part in ("times", "positions", "confidence"):
        np.testing.assert_array_equal(getattr(again, part), getattr(track, part))


@pytest.mark.parametrize("kind", ["deeplabcut", "sleap", "movement"])
def test_a_reference_is_exported_and_imported_again(tmp_path, kind):
    swim = Trial("f1_50", Swimmer(duration=1.0).track(noise=0, by_hand=False), 1.5, 5e-4)
    save_reference(TrialSet((swim,), FISH.marker_names), tmp_path / "real")
    ((path, rate),) = export_tracks(tmp_path / "real", tmp_path / "out", kind)
    assert rate == pytest.approx(swim.fps)
    pixels, _ = read_poses(path, rate, FISH.marker_names)
    kept = load_reference(tmp_path / "real")["f1_50"].track
    np.testing.assert_allclose(pixels.positions * (5e-4, -5e-4), kept.positions, atol=1e-12)
    np.testing.assert_array_equal(pixels.confidence, kept.confidence)
    import_tracks([path], FISH, tmp_path / "again", fps=rate)
    again = load_reference(tmp_path / "again")["f1_50"]
    np.testing.assert_allclose(again.track.times, kept.times, atol=1e-9)
    # the scale is found anew by the body's lengths
    np.testing.assert_allclose(again.track.body * 5e-4 / again.meters_per_pixel, kept.body, atol=1e-5)
    seen = MarkerTrack(pixels.times, pixels.positions + 7, pixels.confidence)
    (tmp_path / "real" / "tracks").mkdir()
    write_poses(seen, FISH.marker_names, tmp_path / "real" / "tracks" / "f1_50.pixels.csv", rate)
    ((path, _),) = export_tracks(tmp_path / "real", tmp_path / "out", kind, ["f1_50"])
    np.testing.assert_array_equal(read_poses(path, rate, FISH.marker_names)[0].positions, seen.positions)


def test_analyses_in_any_order_of_axes_and_without_scores_are_read(tmp_path):
    track = MarkerTrack([0, 0.1], [[[1.0, 2.0], [3.0, 4.0]], [[1.5, 2.5], [np.nan, np.nan]]])
    path = tmp_path / "swim.h5"
    with h5py.File(path, "w") as file:  # as SLEAP for Python writes it
        file["tracks"] = track.positions.transpose(0, 1, 2)[:, None]
        file["tracks"].attrs["dims"] = json.dumps(["frame", "track", "node", "xy"])
        file["node_names"] = [b"a", b"b"]
        file["track_names"] = np.zeros(0)
    read, names = read_dlc(path, 10)
    assert names == ("a", "b")
    np.testing.assert_array_equal(read.positions, track.positions)
    np.testing.assert_array_equal(read.confidence, [[1, 1], [1, 0]])


def test_other_files_of_these_endings_are_refused(tmp_path):
    for name in ("swim.h5", "swim.nc"):
        path = tmp_path / name
        assert says(refusal(TrialError, read_dlc, path, 60), path, "not readable")
        with h5py.File(path, "w") as file:
            file.create_group("df_with_missing")  # DeepLabCut's
        assert says(refusal(TrialError, read_dlc, path, 60), path, "analysis of SLEAP", "DeepLabCut's tables as .csv")
        path.write_bytes(b"nothing of the kind")
        assert says(refusal(TrialError, read_dlc, path, 60), path, "not readable")


def test_a_small_file_that_would_fill_the_memory_is_refused(tmp_path):
    path = tmp_path / "swim.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("tracks", (1, 2, 1000, 10**9), "f4", chunks=(1, 2, 10, 1000), compression="gzip")
    assert path.stat().st_size < 1e5
    assert says(refusal(TrialError, read_dlc, path, 60), path, "8000000 MB; at most 537 MB are read")
    path = tmp_path / "swim.nc"
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"time": 1 << 28, "space": 2}
        file.create_variable("position", ("time", "space"), "f4", chunks=(1000, 2), compression="gzip")
    assert says(refusal(TrialError, read_dlc, path, 60), path, "2147 MB; at most 537 MB are read")

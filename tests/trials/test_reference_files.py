import csv
import json
import multiprocessing
import unicodedata
from dataclasses import replace

import numpy as np
import pytest

from markertrack.track import MarkerTrack
from refused import refusal, says
from swim2real.trials import Signals, Trial, TrialSet, load_reference, save_reference
from swim2real.trials.published import read_published
from swim2real.trials.reference import add_trial
from swim2real.trials.signals import write_signals
from swim2real.trials.trial import Perspective
from swimbase.errors import TrialError
from swimbase.names import quoted
from swimmers import REST, Swimmer

SCALE = 0.142 / 180.0  # m per pixel
NAMES = tuple(f"P{i}" for i in range(9))


def refused(call, *arguments, **options) -> str:
    return refusal(TrialError, call, *arguments, **options)


def pixels(frames=30):
    """A published table: pixels with y down, a head of 180 px, everything shifting to the left and up."""
    shape = REST / SCALE * [1.0, -1.0] + [600.0, 400.0]
    drift = np.arange(frames)[:, None, None] * np.array([-2.0, -1.0])
    return (shape + drift).reshape(frames, 18)


def write_rows(path, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    return path


def test_a_published_table_becomes_metres_with_y_up(tmp_path):
    rows = pixels()
    trial = read_published(write_rows(tmp_path / "markers_f1_50.csv", rows))
    assert (trial.name, trial.nominal_frequency) == ("f1_50", 1.5)
    assert trial.meters_per_pixel == pytest.approx(SCALE)
    assert trial.fps == pytest.approx(60.0)
    positions = trial.track.positions
    np.testing.assert_allclose(np.linalg.norm(positions[:, 1] - positions[:, 0], axis=1), 0.142)
    np.testing.assert_allclose(positions[0], REST + np.array([600.0, -400.0]) * SCALE, atol=1e-12)
    np.testing.assert_allclose(positions[1] - positions[0], np.broadcast_to([-2 * SCALE, SCALE], (9, 2)), atol=1e-12)
    rows[:5, :2] += 500  # a few frames don't change the scale
    other = read_published(write_rows(tmp_path / "swim.csv", rows), fps=120)
    assert other.meters_per_pixel == pytest.approx(SCALE)
    assert (other.name, other.nominal_frequency, other.track.duration) == ("swim", None, pytest.approx(29 / 120))


def test_a_folder_of_published_tables_is_a_reference_of_any_size(tmp_path):
    for name in ("f0_75", "f2_25", "f0_50"):
        write_rows(tmp_path / f"markers_{name}.csv", pixels())
    (tmp_path / "notes.txt").write_text("no table")
    reference = load_reference(tmp_path)
    assert reference.names == ("f0_50", "f0_75", "f2_25")
    assert [trial.nominal_frequency for trial in reference] == [0.5, 0.75, 2.25]
    write_rows(tmp_path / "f0_50.csv", pixels())
    assert says(refused(load_reference, tmp_path), "two trials", "'f0_50'")


def test_empty_cells_are_markers_that_were_not_seen(tmp_path):
    rows = [[f"{x:.3f}" for x in row] for row in pixels()]
    for row in rows:
        row[14] = row[15] = ""  # one is never seen
    rows[4][6], rows[5][8], rows[6][10] = "", "nan", "inf"
    table = write_rows(tmp_path / "swim.csv", rows)
    track = read_published(table).track
    assert np.argwhere(track.confidence[:, :7] == 0).tolist() == [[4, 3], [5, 4], [6, 5]]
    assert not track.confidence[:, 7].any()
    table.write_bytes(b"\xef\xbb\xbf" + table.read_bytes().replace(b"\r\n", b"\n\n") + b"\n")
    np.testing.assert_array_equal(read_published(table).track.positions, track.positions)


STILL = "\n".join([",".join(map(str, pixels(1)[0]))] * 20)
HEADLESS = "\n".join([",".join(map(str, [*row[:2], *row[:2], *row[4:]])) for row in pixels()])


@pytest.mark.parametrize(("text", "parts"), [
    ("", ("the table is empty",)), ("\n\n", ("the table is empty",)),
    ("1,2,3\n4,5,6\n", ("3 columns", "18 numbers per row")),
    ("frame,x\n3,4\n", ("line 1", "'frame'", "import-recording", "import-tracks")),
    (",".join(map(str, pixels(1)[0])), ("one frame", "at least 2")),
    (STILL, ("no marker moves",)),
    (HEADLESS, ("first two markers", "no scale")),
])  # fmt: skip
def test_tables_that_are_no_tracks_are_refused(tmp_path, text, parts):
    table = tmp_path / "swim.csv"
    table.write_text(text)
    for said in (refused(read_published, table), refused(load_reference, tmp_path)):
        assert says(said, "swim.csv", *parts)


@pytest.mark.parametrize("fps", [-60.0, 0.0, np.nan, np.inf])
def test_a_frame_rate_that_no_camera_has_is_refused(tmp_path, fps):
    table = write_rows(tmp_path / "swim.csv", pixels())
    assert says(refused(read_published, table, fps=fps), f"fps is {fps}", "finite and above 0")


@pytest.mark.parametrize(("name", "content", "parts"), [
    ("nowhere", None, ("not there", "give a folder")),
    ("file", b"", ("a file, not a folder",)),
    ("empty", {}, ("neither reference.json nor any .csv", "swim2real track", "swim2real fetch")),
    ("swim.mp4", b"", ("a film", "swim2real pick", "swim2real track")),
    ("films", {"a.mp4": b"", "b.mov": b""}, ("films ('a.mp4', …)", "swim2real pick", "a.points.json")),
])  # fmt: skip
def test_what_is_no_reference_is_refused(tmp_path, name, content, parts):
    place = tmp_path / name
    if isinstance(content, dict):
        place.mkdir()
        for file, text in content.items():
            (place / file).write_bytes(text)
    elif content is not None:
        place.write_bytes(content)
    assert says(refused(load_reference, place), f"'{place}'", *parts)


SPEEDS = {"f0_50": 21.3, "f1_00": 75.9, "f1_25": 100.1, "f1_50": 126.5, "f1_75": 157.1, "f2_00": 200.2}


def test_the_published_tracks_have_their_known_scale_and_speeds(tracks):
    for trial in tracks:
        assert trial.fps == pytest.approx(60.0)
        assert trial.nominal_frequency is not None
        head = np.linalg.norm(trial.track.positions[:, 1] - trial.track.positions[:, 0], axis=1)
        assert np.median(head) == pytest.approx(0.142)
        if trial.name in SPEEDS:
            assert 1e3 * trial.track.speed == pytest.approx(SPEEDS[trial.name], abs=1.3)


def test_without_the_cameras_perspective_markers_of_the_published_tracks_keep_their_distances(tracks):
    for trial in tracks:
        change = []
        for one in (trial, trial.seen_from_afar()):
            # high before low ones, and low before high ones: the first grows and the second shrinks across the picture
            spread = np.linalg.norm(np.diff(one.track.positions[:, [2, 3, 7, 8]], axis=1), axis=2)[:, ::2]
            beat = round(trial.fps / (0.75 * trial.nominal_frequency))
            change.append(1e3 * (spread[-beat:].mean(axis=0) - spread[:beat].mean(axis=0)))
        if trial.name in ("f0_50", "f1_00", "f1_25", "f1_75"):  # the markers of the others were lost
            assert change[0][0] > 5
            assert change[0][1] < -5
        if trial.name in ("f1_00", "f1_25", "f1_75"):
            assert np.abs(change[1]).max() < 3.5


@pytest.fixture
def trials():
    first = Swimmer(duration=0.5).track(seed=1)
    positions = first.positions.copy()
    positions[3, 5] = np.nan
    positions[4:9, 2, 0] = np.nan
    confidence = np.full(positions.shape[:2], 0.75)
    confidence[2, 1] = 0.0
    return TrialSet(
        (
            Trial("slow", MarkerTrack(first.times, positions, confidence), 0.5, 7.5e-4, "pool, camera 2"),
            Trial("fast", Swimmer(2.0, duration=0.5).track(seed=2), perspective=Perspective((1.0, -0.5), (0.1,) * 9)),
        ),
        NAMES,
    )


@pytest.fixture
def folder(tmp_path, trials):
    save_reference(trials, tmp_path / "reference")
    return tmp_path / "reference"


def edit_index(folder, change):
    index = json.loads((folder / "reference.json").read_text())
    change(index)
    (folder / "reference.json").write_text(json.dumps(index))


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if not path.name.startswith(".")}


def test_what_was_saved_is_loaded_again_and_saved_alike(folder, trials, tmp_path):
    write_rows(folder / "markers_f1_00.csv", pixels())  # another table is left alone
    loaded = load_reference(folder)
    assert (loaded.names, loaded.marker_names) == (("slow", "fast"), NAMES)
    for was, now in zip(trials, loaded, strict=True):
        np.testing.assert_array_equal(now.track.times, was.track.times)
        seen = np.isfinite(was.track.positions)
        np.testing.assert_array_equal(np.isfinite(now.track.positions), seen)
        np.testing.assert_array_equal(now.track.positions[seen], was.track.positions[seen])
        np.testing.assert_array_equal(now.track.confidence, was.track.confidence)
        assert (now.nominal_frequency, now.meters_per_pixel) == (was.nominal_frequency, was.meters_per_pixel)
        assert (now.provenance, now.perspective) == (was.provenance, was.perspective)
    save_reference(loaded, tmp_path / "again")
    again = files(tmp_path / "again")
    assert sorted(again) == ["fast.csv", "reference.json", "slow.csv"]
    assert again.items() <= files(folder).items()
    assert again["slow.csv"].startswith(b"time_s,P0_x_m,P0_y_m,P0_confidence,P1_x_m,")


def test_a_trial_knows_its_video_also_after_both_were_moved(tmp_path, trials):
    filmed = replace(trials["slow"], video=tmp_path / "there" / "films" / "slow.mp4")
    save_reference(TrialSet((filmed, trials["fast"])), tmp_path / "there" / "reference")
    (tmp_path / "there").rename(tmp_path / "here")
    loaded = load_reference(tmp_path / "here" / "reference")
    assert loaded["slow"].video.resolve() == (tmp_path / "here" / "films" / "slow.mp4").resolve()
    assert loaded["fast"].video is None


@pytest.mark.parametrize("name", ["../outside", "/outside", "a/b", "nul", "a\x1b[2J", "a\u202eb", "a\uff0fb"])
def test_a_trial_whose_name_is_no_file_name_is_neither_made_nor_read(folder, name):
    said = refused(TrialSet, (Trial(name, Swimmer(duration=0.5).track()),))
    assert says(said, f"trial name {quoted(name)} can't be the name of a file")
    edit_index(folder, lambda index: index["trials"][0].update(name=name, table="slow.csv"))
    assert says(refused(load_reference, folder), "reference.json", "'trials[0].name'", quoted(name))


@pytest.mark.parametrize("name", ["M\n0", "M\u200b0", "x" * 201, " "])
def test_a_marker_or_column_whose_name_isnt_seen_is_refused(folder, trials, name):
    others = trials.marker_names[1:]
    assert says(refused(TrialSet, trials.trials, (name, *others)), f"marker name {quoted(name)}")
    assert says(refused(Signals, [0.0], [name], [[1.0]]), f"column {quoted(name)}")
    edit_index(folder, lambda index: index.update(markers=[name, *others]))
    assert "'markers[0]'" in refused(load_reference, folder)


@pytest.mark.parametrize("form", ["NFC", "NFD"])
@pytest.mark.parametrize("name", ["slow 1.5 Hz", "Flösselhecht (Übung)", "-5°, v1.2", "été & $x$"])
def test_ordinary_names_are_read_in_either_form_and_found_by_the_other(tmp_path, trials, name, form):
    name = unicodedata.normalize(form, name)
    save_reference(TrialSet((replace(trials.trials[0], name=name),)), tmp_path)
    assert load_reference(tmp_path).names == (name,)
    assert load_reference(tmp_path)[unicodedata.normalize("NFC", name)].name == name
    again = replace(trials.trials[1], name=unicodedata.normalize("NFC", name))
    add_trial(tmp_path, again, load_reference(tmp_path).marker_names)
    assert load_reference(tmp_path).names == (again.name,)


@pytest.mark.parametrize(("change", "parts"), [
    (lambda i: i.update(format=2), ("'format' is 2", "1")),
    (lambda i: i.pop("format"), ("'format' is missing",)),
    (lambda i: i.update(trials=[]), ("'trials' is []", "at least 1")),
    (lambda i: i.pop("markers"), ("'markers' is missing",)),
    (lambda i: i["trials"].append("more"), ("'trials[2]'", '"more"')),
    (lambda i: i["trials"].append(i["trials"][0]), ("two trials", "'slow'")),
    (lambda i: i["trials"][0].update(video=3), ("'trials[0].video' is 3", "text")),
    (lambda i: i["trials"][0].update(name=3), ("'trials[0].name' is 3", "text")),
    (lambda i: i["trials"][0].update(fps=-60), ("'trials[0].fps' is -60", "above 0")),
    (lambda i: i["trials"][0].update(fps=True), ("'trials[0].fps' is true", "number")),
    (lambda i: i["trials"][0].update(nominal_frequency_hz="fast"), ("nominal_frequency_hz'", '"fast"', "number")),
    (lambda i: i["trials"][0].update(meters_per_pixel=float("nan")), ("meters_per_pixel'", "NaN", "finite")),
    (lambda i: i["trials"][0].update(table="none.csv"), ("reference.json", "'none.csv' of trial 'slow'", "not in")),
    (lambda i: i["trials"][0].update(fps=30), ("'fps' of trial 'slow' is 30", "slow.csv", "60 frames per second")),
    (lambda i: i["trials"][0].update(video_begin=1.0), ("no 'video_begin'", "did you mean 'video_begin_s'")),
    (lambda i: i["trials"][1]["perspective"].update(nearness=[0.6]), ("nearness[0]' is 0.6", "at most 0.5")),
    (lambda i: i.update(marker=[]), ("there is no 'marker'", "did you mean 'markers'")),
])  # fmt: skip
def test_a_damaged_index_is_refused(folder, change, parts):
    edit_index(folder, change)
    assert says(refused(load_reference, folder), *parts)


@pytest.mark.parametrize("text", ["", "{", "[]", "3"])
def test_an_index_that_is_no_object_is_refused(folder, text):
    (folder / "reference.json").write_text(text)
    assert str(folder / "reference.json") in refused(load_reference, folder)


@pytest.mark.parametrize("table", ["../secret.csv", "sub/../../secret.csv", "{absolute}", "sub/slow.csv", "."])
def test_a_table_outside_the_folder_is_not_read(folder, tmp_path, table):
    secret = tmp_path / "secret.csv"
    secret.write_bytes((folder / "slow.csv").read_bytes())
    (folder / "sub").mkdir()
    (folder / "sub" / "slow.csv").write_bytes(secret.read_bytes())
    name = table.format(absolute=secret)
    edit_index(folder, lambda i: i["trials"][0].update(table=name))
    assert says(refused(load_reference, folder), f"'{name}' of trial 'slow'", f"not in {folder}")


def with_cell(lines, line, column, text):
    cells = lines[line - 1].split(",")
    cells[column - 1] = text
    return [*lines[: line - 1], ",".join(cells), *lines[line:]]


HEADER = ("line 1", "time_s,P0_x_m,P0_y_m,P0_confidence", "28 columns")


@pytest.mark.parametrize(("change", "parts"), [
    (lambda x: x[1:], HEADER),
    (lambda x: with_cell(x, 1, 2, "x"), HEADER),
    (lambda x: with_cell(x, 7, 5, "abc"), ("line 7, column 5", "'abc'")),
    (lambda x: x[:2], ("one frame", "at least 2")),
    (lambda x: with_cell(x, 9, 1, "0"), ("finite and rise",)),
    (lambda x: with_cell(x, 9, 1, ""), ("finite and rise",)),
    (lambda x: with_cell(x, 9, 4, "1.5"), ("confidence", "0 and 1")),
    (lambda x: with_cell(x, len(x), 1, "1e6"), ("31 rows in 1e+06 s", "1e-06 to 10 s")),
    (lambda x: [x[0], x[1], with_cell(x, 2, 1, "1")[1]], ("no marker moves",)),
])  # fmt: skip
def test_a_damaged_table_is_refused_by_line_and_column(folder, change, parts):
    table = folder / "fast.csv"
    table.write_text("\n".join(change(table.read_text().splitlines())) + "\n")
    assert says(refused(load_reference, folder), table, *parts)


def trial(name, seed=0, duration=0.5):
    return Trial(name, Swimmer(duration=duration).track(seed=seed), 1.0, 7e-4, "pool")


def test_trials_that_were_added_are_a_reference_as_if_saved_at_once(tmp_path):
    one, other = trial("one", 1), trial("other", 2)
    add_trial(tmp_path / "deep" / "added", one, NAMES)
    add_trial(tmp_path / "deep" / "added", other, NAMES)
    save_reference(TrialSet((one, other), NAMES), tmp_path / "saved")
    assert files(tmp_path / "deep" / "added") == files(tmp_path / "saved")


def test_a_trial_of_the_same_name_is_replaced_in_its_place(tmp_path):
    save_reference(TrialSet((trial("a"), trial("b"), trial("c")), NAMES), tmp_path)
    edit_index(tmp_path, lambda index: index["trials"][2].update(note="mine"))
    before = files(tmp_path)
    add_trial(tmp_path, Trial("b", Swimmer(duration=0.7).track(seed=9)), NAMES)
    loaded, after = load_reference(tmp_path), files(tmp_path)
    assert loaded.names == ("a", "b", "c")
    assert (loaded["b"].track.duration, loaded["b"].nominal_frequency) == (pytest.approx(0.7), None)
    assert [after[f"{name}.csv"] == before[f"{name}.csv"] for name in "abc"] == [True, False, True]
    assert json.loads(after["reference.json"])["trials"][2]["note"] == "mine"


def test_what_cant_be_added_leaves_the_folder_as_it_was(tmp_path):
    still = Trial("still", MarkerTrack(np.arange(10) / 60, np.repeat(REST[None], 10, axis=0)))
    folder = tmp_path / "reference"
    assert says(refused(add_trial, folder, still, NAMES), folder / "still.csv", "no marker moves")
    assert says(refused(add_trial, folder, trial("a/b"), NAMES), "'a/b'", "the character /")
    assert says(refused(add_trial, folder, trial("a"), ("M0",)), "1 marker names for 9")
    assert not folder.exists()
    add_trial(folder, trial("a"), NAMES)
    edit_index(folder, lambda index: index["trials"][0].update(name="slow"))
    before = files(folder)
    others = tuple(f"Q{i}" for i in range(9))
    assert says(refused(add_trial, folder, trial("b"), others), f"'{folder}'", "P0", "Q0", "another folder")
    assert says(refused(add_trial, folder, trial("a"), NAMES), "'a.csv'", "trial 'slow'", "another name")
    assert files(folder) == before
    (folder / "reference.json").unlink()
    assert says(refused(add_trial, folder, trial("b"), NAMES), f"'{folder}' holds a.csv but no reference.json")
    for write in ((add_trial, folder / "a.csv" / "b", trial("a"), NAMES),
                  (save_reference, TrialSet((trial("a"),)), folder / "a.csv" / "b")):  # fmt: skip
        assert "can't write reference folder" in refused(*write)


def _add_some(folder, start):
    for i in range(start, start + 4):
        add_trial(folder, trial(f"t{i}", i), NAMES)


def test_processes_that_add_trials_at_the_same_time_lose_none(tmp_path):
    context = multiprocessing.get_context("fork")
    processes = [context.Process(target=_add_some, args=(tmp_path, 4 * i)) for i in range(4)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    loaded = load_reference(tmp_path)
    assert sorted(loaded.names) == sorted(f"t{i}" for i in range(16))
    for one in loaded:
        expected = trial(one.name, int(one.name[1:])).track.positions
        np.testing.assert_allclose(one.track.positions, expected, atol=1e-6)


# robots that weren't filmed: tables of sensors and controls alone

TIMES = np.arange(50) / 100


@pytest.mark.parametrize("controls", [True, False])
def test_tables_alone_are_trials_and_are_read_back(tmp_path, controls):
    for name in ("a", "b"):
        write_signals(Signals(TIMES, ["angle"], np.sin(TIMES)[:, None]), tmp_path / f"{name}.sensors.csv")
        if controls:
            write_signals(Signals([0.0], ["motor"], [[0.5]]), tmp_path / f"{name}.controls.csv")
    found = load_reference(tmp_path)
    assert (found.names, found.marker_names) == (("a", "b"), ())
    assert found["a"].track.positions.shape == (50, 0, 2)
    assert np.array_equal(found["a"].track.times, TIMES)
    assert (found["a"].controls is not None) == controls
    assert found["a"].cut(0.2).track.frame_count == 21
    again = tmp_path / "again"
    save_reference(found, again)
    assert {name: text for name, text in files(again).items() if name != "reference.json"} == {
        path.name: path.read_bytes() for path in tmp_path.glob("*.csv")
    }
    assert json.loads((again / "reference.json").read_text())["markers"] == []
    assert np.array_equal(load_reference(again)["a"].sensors.values, found["a"].sensors.values)


def test_what_cant_be_a_trial_is_named(tmp_path):
    still = Trial("a", MarkerTrack(TIMES, np.zeros((50, 0, 2))), sensors=Signals(TIMES, ["angle"], np.ones((50, 1))))
    save_reference(TrialSet((still,)), tmp_path)
    assert says(refused(load_reference, tmp_path), "a.sensors.csv", "no reading changes")
    edit_index(tmp_path, lambda index: index.update(trials=[{"name": "b"}]))
    assert says(refused(load_reference, tmp_path), "'b.sensors.csv' of trial 'b' is not in")

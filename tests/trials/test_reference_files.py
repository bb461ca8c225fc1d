import csv
import json
import unicodedata
from dataclasses import replace

import numpy as np
import pytest

from swim2real.errors import TrialError
from swim2real.names import quoted
from swim2real.trials import MarkerTrack, Trial, TrialSet, load_reference, save_reference
from swim2real.trials.reference import add_trial, read_published
from swim2real.trials.signals import Signals
from swimmers import REST, Swimmer

SCALE = 0.142 / 180.0  # m per pixel


def pixels(frames=30):
    """A published table: pixels with y down, a head of 180 px, everything shifting to the left and up."""
    shape = REST / SCALE * [1.0, -1.0] + [600.0, 400.0]
    drift = np.arange(frames)[:, None, None] * np.array([-2.0, -1.0])
    return (shape + drift).reshape(frames, 18)


def write_rows(path, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    return path


def refusal(call, *arguments, **options) -> str:
    with pytest.raises(TrialError) as caught:
        call(*arguments, **options)
    assert caught.value.exit_code == 1
    return str(caught.value)


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
            Trial("fast", Swimmer(2.0, duration=0.5).track(seed=2)),
        ),
        tuple(f"P{i}" for i in range(9)),
    )


@pytest.fixture
def folder(tmp_path, trials):
    save_reference(trials, tmp_path / "reference")
    return tmp_path / "reference"


def edit_index(folder, change):
    index = json.loads((folder / "reference.json").read_text())
    change(index)
    (folder / "reference.json").write_text(json.dumps(index))


# published tables


def test_a_published_table_becomes_metres_with_y_up(tmp_path):
    trial = read_published(write_rows(tmp_path / "markers_f1_50.csv", pixels()))
    assert (trial.name, trial.nominal_frequency) == ("f1_50", 1.5)
    assert trial.meters_per_pixel == pytest.approx(SCALE)
    assert trial.fps == pytest.approx(60.0)
    positions = trial.track.positions
    np.testing.assert_allclose(np.linalg.norm(positions[:, 1] - positions[:, 0], axis=1), 0.142)
    np.testing.assert_allclose(positions[0], REST + np.array([600.0, -400.0]) * SCALE, atol=1e-12)
    np.testing.assert_allclose(positions[1] - positions[0], np.broadcast_to([-2 * SCALE, SCALE], (9, 2)), atol=1e-12)


def test_a_scale_is_not_thrown_off_by_a_few_frames(tmp_path):
    rows = pixels()
    rows[:5, :2] += 500
    trial = read_published(write_rows(tmp_path / "swim.csv", rows))
    assert trial.meters_per_pixel == pytest.approx(SCALE)
    assert (trial.name, trial.nominal_frequency) == ("swim", None)


def test_another_frame_rate_can_be_given(tmp_path):
    table = write_rows(tmp_path / "swim.csv", pixels())
    assert read_published(table, fps=120).track.duration == pytest.approx(29 / 120)
    for fps in (-60.0, 0.0, np.nan, np.inf):
        assert refusal(read_published, table, fps=fps) == f"swim.csv: fps is {fps}; it must be finite and above 0"


def test_a_folder_of_published_tables_is_a_reference_of_any_size(tmp_path):
    for name in ("f0_75", "f2_25", "f0_50"):
        write_rows(tmp_path / f"markers_{name}.csv", pixels())
    (tmp_path / "notes.txt").write_text("no table")
    reference = load_reference(tmp_path)
    assert reference.names == ("f0_50", "f0_75", "f2_25")
    assert [trial.nominal_frequency for trial in reference] == [0.5, 0.75, 2.25]


def test_empty_cells_are_markers_that_were_not_seen(tmp_path):
    rows = [[f"{x:.3f}" for x in row] for row in pixels()]
    rows[4][6] = rows[4][7] = ""
    rows[5][8] = "nan"
    rows[6][10] = "inf"
    track = read_published(write_rows(tmp_path / "swim.csv", rows)).track
    assert np.isnan(track.positions[4, 3]).all()
    assert np.flatnonzero(track.confidence[4] == 0).tolist() == [3]
    assert track.confidence[5, 4] == track.confidence[6, 5] == 0


def test_a_marker_that_is_never_seen_is_legal(tmp_path):
    rows = [[f"{x:.3f}" for x in row] for row in pixels()]
    for row in rows:
        row[10] = row[11] = ""
    track = read_published(write_rows(tmp_path / "swim.csv", rows)).track
    assert np.all(track.confidence[:, 5] == 0)
    assert np.all(np.delete(track.confidence, 5, axis=1) == 1)


def test_a_byte_order_mark_and_blank_lines_do_no_harm(tmp_path):
    plain = write_rows(tmp_path / "swim.csv", pixels())
    marked = tmp_path / "marked.csv"
    marked.write_bytes(b"\xef\xbb\xbf" + plain.read_bytes().replace(b"\r\n", b"\n\n") + b"\n")
    np.testing.assert_array_equal(read_published(marked).track.positions, read_published(plain).track.positions)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "{table}: the table is empty; expected 18 numbers a row (x and y of 9 markers)"),
        ("\n\n", "{table}: the table is empty; expected 18 numbers a row (x and y of 9 markers)"),
        ("1,2,3\n4,5,6\n", "{table}: 3 columns; expected 18 numbers a row (x and y of 9 markers)"),
        ("1,2,3\n4,5\n", "{table}, line 2: 2 columns, the rows above have 3"),
        ("1,2\n3,4\n5,oops\n", "{table}, line 3, column 2: 'oops' is not a number"),
        ("frame,x\n3,4\n", "{table}, line 1: it names columns ('frame'), and the published tables have none; of logs "
         "`swim2real import-recording` makes a reference, of DeepLabCut's tables `swim2real import-tracks`"),
    ],
)  # fmt: skip
def test_tables_that_are_no_tracks_are_refused(tmp_path, text, message):
    table = tmp_path / "swim.csv"
    table.write_text(text)
    assert refusal(read_published, table) == message.format(table=table)
    assert refusal(load_reference, tmp_path) == message.format(table=table)


def test_a_table_that_is_no_text_is_refused(tmp_path):
    table = tmp_path / "swim.csv"
    table.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe\x00")
    assert refusal(load_reference, tmp_path).startswith(f"{table}: not readable as text")


def test_one_frame_is_no_trial(tmp_path):
    table = write_rows(tmp_path / "swim.csv", pixels(1))
    assert refusal(read_published, table) == f"{table}: one frame only; a trial needs at least 2"


def test_a_table_without_motion_is_refused(tmp_path):
    table = write_rows(tmp_path / "swim.csv", np.repeat(pixels(1), 20, axis=0))
    assert refusal(read_published, table) == f"{table}: no marker moves; is this the right file?"


def test_a_table_without_a_head_has_no_scale(tmp_path):
    rows = pixels()
    rows[:, 2:4] = rows[:, 0:2]
    table = write_rows(tmp_path / "swim.csv", rows)
    message = "swim.csv: the first two markers coincide or are never seen, so there is no scale"
    assert refusal(read_published, table) == message
    rows[:, 2:4] = np.nan
    assert refusal(read_published, write_rows(table, rows)) == message


def test_two_tables_of_one_name_are_refused(tmp_path):
    write_rows(tmp_path / "markers_f1_00.csv", pixels())
    write_rows(tmp_path / "f1_00.csv", pixels())
    assert refusal(load_reference, tmp_path) == "two trials are named 'f1_00'; give each its own name"


def test_a_reference_that_is_not_there_is_refused(tmp_path):
    nowhere = tmp_path / "nowhere"
    assert refusal(load_reference, nowhere).startswith(f"reference '{nowhere}' is not there; give a folder")
    file = tmp_path / "file"
    file.write_text("")
    assert refusal(load_reference, file).startswith(f"reference '{file}' is a file, not a folder")
    empty = tmp_path / "empty"
    empty.mkdir()
    assert refusal(load_reference, empty).startswith(f"reference '{empty}' holds neither reference.json nor any .csv")


def test_the_published_tracks_are_read(tracks):
    for trial in tracks:
        assert trial.fps == pytest.approx(60.0)
        assert trial.nominal_frequency is not None
        assert 0.02 < trial.track.speed < 0.3
        head = np.linalg.norm(trial.track.positions[:, 1] - trial.track.positions[:, 0], axis=1)
        assert np.median(head) == pytest.approx(0.142)


SPEEDS = {"f0_50": 21.3, "f1_00": 75.9, "f1_25": 100.1, "f1_50": 126.5, "f1_75": 157.1, "f2_00": 200.2}


@pytest.mark.parametrize("name", SPEEDS)
def test_the_published_swims_have_their_known_speeds(tracks, name):
    if name not in tracks.names:
        pytest.skip(f"{name} isn't among the published tracks that are there")
    assert 1e3 * tracks[name].track.speed == pytest.approx(SPEEDS[name], abs=1.3)


# reference folders


def test_what_was_saved_is_loaded_again(folder, trials):
    loaded = load_reference(folder)
    assert loaded.names == ("slow", "fast")
    assert loaded.marker_names == trials.marker_names
    for was, now in zip(trials, loaded, strict=True):
        np.testing.assert_array_equal(now.track.times, was.track.times)
        seen = np.isfinite(was.track.positions)
        np.testing.assert_array_equal(np.isfinite(now.track.positions), seen)
        np.testing.assert_array_equal(now.track.positions[seen], was.track.positions[seen])
        np.testing.assert_array_equal(now.track.confidence, was.track.confidence)
        assert (now.nominal_frequency, now.meters_per_pixel) == (was.nominal_frequency, was.meters_per_pixel)
        assert now.provenance == was.provenance


def test_a_trial_knows_its_video_also_after_both_were_moved(tmp_path, trials):
    filmed = replace(trials["slow"], video=tmp_path / "there" / "films" / "slow.mp4")
    save_reference(TrialSet((filmed, trials["fast"])), tmp_path / "there" / "reference")
    assert load_reference(tmp_path / "there" / "reference")["slow"].video.resolve() == filmed.video.resolve()
    (tmp_path / "there").rename(tmp_path / "here")
    loaded = load_reference(tmp_path / "here" / "reference")
    assert loaded["slow"].video.resolve() == (tmp_path / "here" / "films" / "slow.mp4").resolve()
    assert loaded["fast"].video is None


def test_saving_what_was_loaded_changes_no_table(folder, tmp_path):
    save_reference(load_reference(folder), tmp_path / "again")
    for file in folder.glob("*.csv"):
        assert (tmp_path / "again" / file.name).read_bytes() == file.read_bytes()


def test_the_tables_are_as_documented(folder):
    header = (folder / "slow.csv").read_text().splitlines()[0]
    assert header.startswith("time_s,P0_x_m,P0_y_m,P0_confidence,P1_x_m,")
    assert sorted(path.name for path in folder.iterdir()) == ["fast.csv", "reference.json", "slow.csv"]


def test_other_tables_in_a_reference_folder_are_left_alone(folder):
    write_rows(folder / "markers_f1_00.csv", pixels())
    assert load_reference(folder).names == ("slow", "fast")


@pytest.mark.parametrize("name", ["../outside", "/outside", "a/b", "nul", "a\x1b[2J", "a\u202eb", "a\uff0fb"])
def test_a_trial_whose_name_is_no_file_name_is_neither_made_nor_read(folder, name):
    said = refusal(TrialSet, (Trial(name, Swimmer(duration=0.5).track()),))
    assert f"trial name {quoted(name)} can't be the name of a file" in said
    edit_index(folder, lambda index: index["trials"][0].update(name=name, table="slow.csv"))
    said = refusal(load_reference, folder)
    assert "reference.json" in said
    assert "'trials[0].name'" in said
    assert quoted(name) in said


@pytest.mark.parametrize("name", ["M\n0", "M\u200b0", "x" * 201, " "])
def test_a_marker_or_column_whose_name_isnt_seen_is_refused(folder, trials, name):
    others = trials.marker_names[1:]
    assert refusal(TrialSet, trials.trials, (name, *others)).startswith(f"marker name {quoted(name)}")
    assert refusal(Signals, [0.0], [name], [[1.0]]).startswith(f"column {quoted(name)}")
    edit_index(folder, lambda index: index.update(markers=[name, *others]))
    assert "'markers[0]'" in refusal(load_reference, folder)


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


def test_two_trials_whose_names_are_one_to_some_system_arent_written(tmp_path, trials):
    upper = replace(trials.trials[0], name="SLOW")
    assert "choose another name" in refusal(save_reference, TrialSet((*trials.trials, upper)), tmp_path)
    twice = (replace(upper, name="\xfc"), replace(upper, name="u\u0308"))
    assert "two trials are named" in refusal(TrialSet, twice)


def test_a_folder_that_cant_be_made_is_refused(tmp_path, trials):
    (tmp_path / "file").write_text("")
    assert refusal(save_reference, trials, tmp_path / "file" / "below").startswith("can't write reference folder")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda i: i.update(format=2), "'format' is 2; it must be 1"),
        (lambda i: i.pop("format"), "'format' is missing"),
        (lambda i: i.update(trials=[]), "'trials' is []; it must have at least 1"),
        (lambda i: i.pop("markers"), "'markers' is missing"),
        (lambda i: i["trials"].append("more"), "'trials[2]' is \"more\""),
        (lambda i: i["trials"][0].update(video=3), "'trials[0].video' is 3; it must be a text"),
        (lambda i: i["trials"][0].update(name=3), "'trials[0].name' is 3; it must be a text"),
        (lambda i: i["trials"][0].update(fps=-60), "'trials[0].fps' is -60; it must be above 0"),
        (lambda i: i["trials"][0].update(fps=True), "'trials[0].fps' is true; it must be a number"),
        (
            lambda i: i["trials"][0].update(nominal_frequency_hz="fast"),
            "'trials[0].nominal_frequency_hz' is \"fast\"; it must be a number",
        ),
        (
            lambda i: i["trials"][0].update(meters_per_pixel=float("nan")),
            "'trials[0].meters_per_pixel' is NaN; it must be finite",
        ),
    ],
)
def test_a_damaged_index_is_refused(folder, change, message):
    edit_index(folder, change)
    text = refusal(load_reference, folder)
    assert str(folder / "reference.json") in text
    assert message in text


def test_an_index_with_one_trial_twice_is_refused(folder):
    edit_index(folder, lambda i: i["trials"].append(i["trials"][0]))
    assert refusal(load_reference, folder) == "two trials are named 'slow'; give each its own name"


@pytest.mark.parametrize("text", ["", "{", "[]", "3"])
def test_an_index_that_is_no_object_is_refused(folder, text):
    (folder / "reference.json").write_text(text)
    assert str(folder / "reference.json") in refusal(load_reference, folder)


def test_a_missing_table_is_named(folder):
    (folder / "fast.csv").unlink()
    assert refusal(load_reference, folder) == (
        f"{folder / 'reference.json'}: table 'fast.csv' of trial 'fast' is not in {folder}"
    )


@pytest.mark.parametrize("table", ["../secret.csv", "sub/../../secret.csv", "{absolute}", "sub/slow.csv", "."])
def test_a_table_outside_the_folder_is_not_read(folder, tmp_path, table):
    secret = tmp_path / "secret.csv"
    secret.write_bytes((folder / "slow.csv").read_bytes())
    (folder / "sub").mkdir()
    (folder / "sub" / "slow.csv").write_bytes(secret.read_bytes())
    name = table.format(absolute=secret)
    edit_index(folder, lambda i: i["trials"][0].update(table=name))
    assert refusal(load_reference, folder).endswith(f"table '{name}' of trial 'slow' is not in {folder}")


def edit_table(folder, change):
    table = folder / "fast.csv"
    lines = table.read_text().splitlines()
    table.write_text("\n".join(change(lines)) + "\n")
    return table


def with_cell(lines, line, column, text):
    cells = lines[line - 1].split(",")
    cells[column - 1] = text
    return [*lines[: line - 1], ",".join(cells), *lines[line:]]


HEADER = ", line 1: the header must be time_s,P0_x_m,P0_y_m,P0_confidence,… (28 columns)"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x: x[1:], HEADER),
        (lambda x: with_cell(x, 1, 2, "x"), HEADER),
        (lambda x: with_cell(x, 7, 5, "abc"), ", line 7, column 5: 'abc' is not a number"),
        (lambda x: [*x, "1,2,3"], ", line 33: 3 columns, the rows above have 28"),
        (lambda x: x[:1], ": the table is empty; expected 28 columns, as the header"),
        (lambda x: x[:2], ": one frame only; a trial needs at least 2"),
        (lambda x: with_cell(x, 9, 1, "0"), ": time stamps must be finite and rise from frame to frame"),
        (lambda x: with_cell(x, 9, 1, ""), ": time stamps must be finite and rise from frame to frame"),
        (lambda x: with_cell(x, 9, 4, "1.5"), ": confidence must lie within 0 and 1"),
    ],
)  # fmt: skip
def test_a_damaged_table_is_refused_by_line_and_column(folder, change, message):
    table = edit_table(folder, change)
    assert refusal(load_reference, folder) == f"{table}{message}"


def test_a_reference_without_motion_is_refused(tmp_path):
    still = MarkerTrack(np.arange(5) / 60, np.repeat(REST[None], 5, axis=0))
    save_reference(TrialSet((Trial("still", still),)), tmp_path)
    assert refusal(load_reference, tmp_path) == f"{tmp_path / 'still.csv'}: no marker moves; is this the right file?"

"""Videos in, a reference folder out, as the program does it: `track`, and `pick` and `import-tracks` around it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from program import CTRL_C, interrupted

from drawn_swimmers import Swimmer, film
from films import Shot, contents, named, parts, slowed, tables
from markertrack.camera_file import CameraFile, write_camera
from markertrack.points import save_points
from markertrack.video import VideoReader, VideoWriter, film_title
from swim2real.robots.fish import FISH
from swim2real.trials import load_reference

NAMES = FISH.marker_names


def words(*shots: Shot, to: Path) -> list[object]:
    """`track` with the points and the camera of some films."""
    points = [shot.points for shot in shots]
    return ["track", *(s.video for s in shots), "--to", to, "--markers", *points, "--camera", shots[0].camera]


def test_a_video_becomes_a_reference_with_an_overlay(program, clip, tmp_path):
    to = tmp_path / "reference"
    program(*words(clip, to=to)).done()
    assert "Frames for which each marker is lost [%]" in program.text
    assert re.search(r"f1_25 7 1\.5\d{3} (– ){9}yes", program.text)
    assert f"Reference: {to} Overlays: {to / 'tracks'} Next: swim2real calibrate {to} --out RUN" in program.text
    assert "What to know" not in program.text
    assert re.fullmatch(
        r"f1_25: frame 1 of 7, 0 markers lost\nf1_25: 7 frames in \d+\.\d s\n", program.err
    )  # plain lines, when piped
    assert {"f1_25.json", "f1_25.mp4", "f1_25.pixels.csv"} == {path.name for path in (to / "tracks").iterdir()}
    (trial,) = load_reference(to)
    assert clip.errors(trial).max() < 2e-3
    assert trial.nominal_frequency == 1.25


def test_quietly_it_prints_the_result_alone_and_says_so_when_it_is_done_before(program, clip, tmp_path):
    to = tmp_path / "reference"
    command = [*words(clip, to=to), "--no-overlay"]
    program(*command, "--quiet").done()
    assert program.err == ""
    assert f"Reference: {to} " in program.out
    assert not (to / "tracks" / "f1_25.mp4").exists()
    before = contents(to)
    program(*command).done()
    assert program.err == "f1_25: done before\n"
    assert re.search(r"f1_25 7 1\.5\d{3} (– ){9}yes", program.text)
    assert contents(to) == before


def test_json_is_json_alone(program, clip, tmp_path):
    program(*words(clip, to=tmp_path), "--no-overlay", "--json", "--frequency", 1.2, "--smooth").done()
    assert program.err == ""
    content = program.json
    assert list(content) == ["f1_25"]
    assert content["f1_25"] == json.loads((tmp_path / "tracks" / "f1_25.json").read_text())
    assert content["f1_25"]["frames"] == 7
    assert load_reference(tmp_path)["f1_25"].nominal_frequency == 1.2


@pytest.mark.slow
def test_without_points_and_camera_markers_are_found_and_findings_are_told(program, clip, tmp_path, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")  # as on a terminal
    monkeypatch.setenv("COLUMNS", "120")
    program("track", clip.video, "--to", tmp_path, "--markers", "auto", "--no-overlay").done()
    assert "━" in program.err
    assert program.err.index("reading f1_25.mp4") < program.err.index("━")  # before what takes a second to load
    assert "f1_25: 7 frames in " in re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", program.err)
    monkeypatch.delenv("FORCE_COLOR")
    program("track", clip.video, "--to", tmp_path, "--markers", "auto", "--no-overlay").done()  # done before
    assert "What to know" in program.text
    assert "M2 and M8 stand up to 50 mm nearer to the camera than M0" in program.text
    assert load_reference(tmp_path).names == ("f1_25",)


def test_a_stretch_of_a_film_becomes_a_trial_from_time_0(program, clip, tmp_path):
    table = tmp_path / "driven.csv"
    table.write_text("time_s,motor\n0,1\n0.05,2\n0.15,3\n", encoding="utf-8")
    places = clip.filmed.truth.positions[3]
    points = tmp_path / "there.json"
    about = {"format": 1, "width": 640, "height": 360, "frame": 3}
    points.write_text(json.dumps({**about, "markers": dict(zip(NAMES, places.tolist(), strict=True))}))
    command = [
        "track", clip.video, "--markers", points, "--camera", clip.camera, "--to", tmp_path / "reference",
        "--from", 0.1, "--until", 0.17, "--controls", table,
    ]  # fmt: skip
    program(*command).done()
    assert "frame 1 of 3" in program.err
    (trial,) = load_reference(tmp_path / "reference")
    np.testing.assert_allclose(trial.track.times, np.arange(3) / 30, atol=1e-9)
    off = trial.track.positions / trial.meters_per_pixel * [1, -1] - clip.filmed.truth.positions[3:6]
    assert np.ptp(off[:, 0], axis=0).max() < 1  # it moves as it does from 0.1 s on, the camera's height aside
    assert (trial.video_begin, trial.provenance[:35]) == (0.1, "video f1_25.mp4, from 0.1 s to 0.17")
    np.testing.assert_allclose(trial.controls.times, [-0.1, -0.05, 0.05])
    np.testing.assert_array_equal(trial.controls.values[:, 0], [1, 2, 3])
    assert program(*command).done().err == "f1_25: done before\n"
    program(*command[:-2], "--until", 0.2).done()
    assert load_reference(tmp_path / "reference")["f1_25"].track.frame_count == 4
    late = program(*command[:8], "--from", 0.14)
    assert "were picked in frame 3 of the video; tracking begins with frame 5" in late.err


def test_a_film_of_any_speed_and_its_single_pictures_are_the_same_trial(program, clip, tmp_path):
    """Each by the rate at which the camera took the frames; corrections and overlay need none of their own."""
    slow, pictures = slowed(clip.video, tmp_path / "slow.mp4", 8), tmp_path / "pictures"
    pictures.mkdir()
    with VideoReader(clip.video) as reader:
        for frame in reader:
            Image.fromarray(frame.image).save(pictures / f"{frame.index}.png")
    to = tmp_path / "reference"
    for video in (clip.video, slow, pictures):
        program(*words(replace(clip, video=video), to=to), "--fps", 30).done()
    normal, *others = load_reference(to)["f1_25"], load_reference(to)["slow"], load_reference(to)["pictures"]
    for trial in others:
        np.testing.assert_allclose(trial.track.times, normal.track.times, atol=1e-9)
        np.testing.assert_array_equal(trial.track.positions, normal.track.positions)
        clock = trial.timebases["track"]
        assert (clock.rate, clock.known_by, clock.origin) == (30, "given", f"first frame of {film_title(trial.video)}")
        assert (to / "tracks" / f"{trial.name}.mp4").is_file()
    program("track", slow, *words(clip, to=to)[2:], "--from", 0.1, "--fps", 30)
    assert "were picked in frame 0 of the video; tracking begins with frame 3" in program.err
    program("pick", slow, "--from", 0.1, "--fps", 30).done()
    assert '"number": 3' in (tmp_path / "slow.pick.html").read_text(encoding="utf-8")
    assert program.out.endswith("--to REFERENCE --from 0.1 --fps 30\n")
    program("pick", pictures).done()
    assert program.out.endswith("--markers pictures.points.json --to REFERENCE --fps RATE\n")


def test_a_rate_that_isnt_known_is_asked_for_before_anything_is_written(program, clip, tmp_path):
    pictures, to = tmp_path / "pictures", tmp_path / "reference"
    pictures.mkdir()
    for k in range(3):
        Image.new("RGB", (640, 360)).save(pictures / f"{k}.png")
    program(*words(replace(clip, video=pictures), to=to), "--quiet")
    assert "states how many frames per second the camera took; give them with --fps RATE" in program.err
    assert not to.exists()
    assert "--fps has 2 values for 1 videos" in program(*words(clip, to=to), "--fps", 30, 60).sentence(2)
    assert "--fps is 0 frames per second" in program(*words(clip, to=to), "--fps", 0).sentence(2)


def test_points_of_a_later_frame_are_followed_in_both_directions(program, clip, tmp_path):
    points, corrections = tmp_path / "there.json", tmp_path / "f1_25.corrections.json"
    truth = clip.filmed.truth.positions
    markers = dict(zip(NAMES, truth[3].tolist(), strict=True))
    points.write_text(json.dumps({"format": 1, "width": 640, "height": 360, "frame": 3, "markers": markers}))
    command = ["track", clip.video, "--markers", points, "--camera", clip.camera, "--to", tmp_path / "reference"]
    program(*command).done()
    (trial,) = load_reference(tmp_path / "reference")
    assert trial.track.frame_count == len(truth)
    assert (trial.track.confidence > 0.5).all()
    # a click elsewhere counts, and a frame that isn't there is refused
    said = [{"frame": 5, "markers": {"M4": (truth[5, 4] + [0, 8]).tolist(), "M5": None}}]
    about = {"format": 1, "video": clip.video.name, "width": 640, "height": 360}
    corrections.write_text(json.dumps({**about, "frames": said}))
    program(*command, "--corrections", corrections).done()
    table = np.genfromtxt(tmp_path / "reference/tracks/f1_25.pixels.csv", delimiter=",", skip_header=3)
    np.testing.assert_allclose(table[5, 13:15], truth[5, 4] + [0, 8], atol=0.01)
    assert not np.isfinite(table[5, 16])
    corrections.write_text(json.dumps({**about, "frames": [{"frame": 99, "markers": {"M4": [5, 5]}}]}))
    assert "a marker was picked in frame 99 of video" in program(*command, "--corrections", corrections).err


def test_cut_makes_shorter_trials_in_another_reference(program, pendulum_folder, tmp_path):
    tracks = pendulum_folder / "tracks"
    program("cut", tracks, "--to", tmp_path / "short", "--from", 3, "--until", 3.5, "--trials", "b").done()
    whole, (short,) = load_reference(tracks)["b"], load_reference(tmp_path / "short")
    there = (whole.track.times >= 3 - 1e-3) & (whole.track.times <= 3.5 + 1e-3)
    np.testing.assert_array_equal(short.track.positions, whole.track.positions[there])
    np.testing.assert_array_equal(
        short.controls.at("torque", short.track.times), whole.controls.at("torque", whole.track.times[there])
    )
    assert program.out == f"b: {there.sum()} of {whole.track.frame_count} frames, {short.track.duration:.3f} s\n"
    program("quality", tmp_path / "short", "--robot", pendulum_folder / "pendulum.toml").done()


def test_a_bad_video_leaves_the_others_alone_and_leaves_with_1(program, clip, tmp_path):
    bad = tmp_path / "bad.mp4"
    bad.write_text("these are words\n" * 40)
    to = tmp_path / "reference"
    program("track", bad, clip.video, "--to", to, "--markers", "auto", clip.points, "--workers", 1, "--no-overlay")
    assert program.code == 1
    *lines, last = program.err.splitlines()
    assert lines[0] == "bad: failed"
    assert last.startswith(f"swim2real: '{bad}' is not a video that FFmpeg can read (")
    assert "f1_25 7 " in program.text
    assert load_reference(to).names == ("f1_25",)


@pytest.mark.slow
@CTRL_C
def test_an_interruption_leaves_no_half_files_and_the_same_command_goes_on(program, shot, clip, tmp_path):
    one, other = named(shot, tmp_path, "one"), named(shot, tmp_path, "other")
    to = tmp_path / "reference"
    program(*words(clip, to=to)).done()
    command = [*words(one, other, to=to), "--workers", 2]
    *lines, last = interrupted(command, lambda: len(parts(to)) >= 2, workers=2)
    assert last == "swim2real: interrupted; the same command goes on with the videos that aren't done"
    assert all(re.match(r"(one|other): (frame \d+ of 37, 0 markers lost|37 frames in )", line) for line in lines)
    assert parts(to) == []
    assert set(load_reference(to).names) < {"f1_25", "one", "other"}
    program(*command[:-1], 1).done()
    assert set(load_reference(to).names) == {"f1_25", "one", "other"}
    assert parts(to) == []
    assert tables(to)["one.csv"] == tables(to)["other.csv"]


@pytest.mark.slow
def test_a_track_in_pixels_can_be_imported_again(program, clip, tmp_path):
    """What `track` writes for other programs is what `import-tracks` reads, and makes the same trial."""
    height = 2.45
    write_camera(tmp_path / "camera.json", CameraFile(height, principal_point=np.array([319.5, 179.5])))
    command = words(clip, to=tmp_path / "one")
    command[-1] = tmp_path / "camera.json"
    program(*command, "--no-overlay").done()
    table = tmp_path / "f1_25.csv"
    table.write_bytes((tmp_path / "one" / "tracks" / "f1_25.pixels.csv").read_bytes())
    camera = ["--camera", tmp_path / "camera.json", "--frequency", 1.25]
    program("import-tracks", table, "--to", tmp_path / "other", "--fps", 30, *camera).done()
    assert "f1_25: 7 frames, 0.20 s, 1.5" in program.text
    assert tables(tmp_path / "other")["f1_25.csv"] == tables(tmp_path / "one")["f1_25.csv"]
    one, other = (load_reference(tmp_path / folder)["f1_25"] for folder in ("one", "other"))
    assert one.meters_per_pixel == other.meters_per_pixel
    assert one.nominal_frequency == other.nominal_frequency == 1.25


@pytest.mark.parametrize("ending", ["png", "mp4"])
def test_a_chessboard_makes_a_camera_file(program, tmp_path, ending):
    picture = np.full((360, 480, 3), 255, np.uint8)
    for i in range(6):
        for j in range(9):
            if (i + j) % 2 == 0:
                picture[60 + 40 * i : 100 + 40 * i, 60 + 40 * j : 100 + 40 * j] = 0
    path, camera = tmp_path / f"board.{ending}", tmp_path / "camera.json"
    if ending == "png":
        Image.fromarray(picture).save(path)
    else:
        with VideoWriter(path, 480, 360, 30) as writer:
            writer.write(np.full_like(picture, 255), 0.0)
            writer.write(picture, 0.1)
    write_camera(camera, CameraFile(camera_height=2.0))
    command = ["board", path, "--squares", "9x6", "--square-size", 0.02, "--to", camera]
    program(*command, *([] if ending == "png" else ["--from", 0.1])).done()
    assert re.search(r"40 corners, 0\.50\d\d mm per pixel at the board, off a plane by 0\.\d\d mm", program.out)
    content = json.loads(camera.read_text())
    assert (len(content["points"]), content["camera_height"]) == (40, 2.0)


def test_pick_writes_a_page_beside_the_video_and_says_what_to_do(program, clip, tmp_path):
    video, other = (named(clip, tmp_path, name).video for name in ("swim", "other"))
    program("pick", video, other).done()
    assert (tmp_path / "other.pick.html").is_file()
    assert f"swim2real track {video} {other} --markers swim.points.json other.points.json" in program.text
    page = (tmp_path / "swim.pick.html").read_text(encoding="utf-8")
    assert '"width": 640, "height": 360' in page
    assert '"video": "swim.mp4"' in page
    assert not re.search(r"<(script|link|img|iframe)[^>]*\s(src|href)\s*=\s*[\"']?(https?:)?//", page)


def test_a_swimmer_without_markers_is_followed_from_two_clicks(program, tmp_path):
    swimmer, to = Swimmer(length=200.0, speed=0.4, frequency=2.0), tmp_path / "reference"
    video = film(tmp_path / "f2_00.mp4", [swimmer], count=60)
    program("pick", video, "--midline").done()
    assert "click M0 to M8" in program.text
    assert program.text.rstrip().endswith("--to REFERENCE --midline")
    ends = swimmer.midline(0)[[0, -1]]
    save_points(tmp_path / "f2_00.points.json", ends, ("M0", "M8"), "f2_00.mp4", 480, 320)
    program("track", video, "--midline", "--markers", tmp_path / "f2_00.points.json", "--to", to).done()
    assert re.search(r"f2_00 60 2\.7\d{3} (– ){9}yes", program.text)
    assert {"f2_00.json", "f2_00.mp4", "f2_00.pixels.csv"} == {path.name for path in (to / "tracks").iterdir()}
    assert json.loads((to / "tracks" / "f2_00.json").read_text())["tracker"] == "midline"
    (trial,) = load_reference(to)
    assert trial.midline
    true = np.array([swimmer.midline(time) for time in trial.track.times])
    lengths = np.array([0, 142, 357, 376.5, 406.5, 438.5, 467.5, 488.5, 551]) / 551
    places = np.stack([[np.interp(lengths, np.linspace(0, 1, 201), one[:, k]) for one in true] for k in (0, 1)], axis=2)
    scale = trial.meters_per_pixel
    errors = np.linalg.norm(trial.track.positions * [1, -1] - scale * places, axis=2)
    assert errors.max() < 0.02 * scale * swimmer.length
    table = tmp_path / "swimming.csv"
    program("quality", to, "--kinematics", table, "--plot", tmp_path / "page.html").done()
    assert re.search("f2_00,beat frequency,Hz,(2.0|1.99)", table.read_text())
    assert "Strouhal" in (tmp_path / "page.html").read_text()


def test_a_midline_takes_two_clicks_and_no_tags(program, clip, tmp_path):
    command = [*words(clip, to=tmp_path / "new"), "--midline", "--quiet"]
    assert "unknown marker" in program(*command).sentence(1)
    assert "leave out --tracker aruco" in program(*command, "--tracker", "aruco").sentence(2)
    assert "two clicks, head and tail" in program(*command, "--markers", "auto").sentence(1)

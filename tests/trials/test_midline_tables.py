"""Midlines as other programs write them: sites are put where they are along the body."""

from pathlib import Path

import numpy as np
import pytest

from drawn_swimmers import Swimmer
from swim2real.trials.midline_tables import read_midlines
from swimbase.errors import TrialError

FPS, SWIMMER, COUNT = 50.0, Swimmer(), 20
PLACES = np.array([0.0, 0.3, 0.55, 1.0])


def midline(k: int, count: int = COUNT) -> np.ndarray:
    """Points at distances that grow from head to tail [px]. Shape (count, 2)."""
    at = np.round(1000 * np.linspace(0, 1, count) ** 1.3).astype(int)
    return SWIMMER.midline(k / FPS, 1001)[at]


def true() -> np.ndarray:
    return np.array([SWIMMER.midline(k / FPS, 1001)[np.round(1000 * PLACES).astype(int)] for k in range(3)])


def trackter(path: Path) -> Path:
    """`write.csv(kin$midline)`, after `kin <- kin.search(...)`: R names the rows, and beats stand beside points."""
    rows = [
        f'"{k * COUNT + n + 1}",{k},"a",{n + 1},{x},{y + 9},{x},{y},{y - 160},{y - 160},{0.05 * n}'
        for k in range(3) for n, (x, y) in enumerate(midline(k).tolist())
    ]  # fmt: skip
    names = '"","frame","roi","n","x","y","x.sm","y.sm","mid.pred","wave.y","per.bl"'
    return written(path / "trout.csv", [names, *rows])


def fishmechr(path: Path) -> Path:
    """`write.csv(lampreydata, row.names = FALSE)`: frames from 1 on, the first of them not known, rows in any order."""
    rows = [f"{k / FPS},{k},{n + 1},{x},{y}" for k in range(3) for n, (x, y) in enumerate(midline(k).tolist())]
    unknown = [f"{3 / FPS},3,{n + 1},NA,NA" for n in range(COUNT)]
    return written(path / "lamprey.csv", ['"t","frame","point","mxmm","mymm"', *unknown, *rows[::-1]])


def wormtracer(path: Path) -> Path:
    """`np.savetxt(..., delimiter=',')`, x and y each."""
    for k, name in enumerate("xy"):
        np.savetxt(path / f"worm_{name}.csv", [midline(t)[:, k] for t in range(3)], delimiter=",")
    return path / "worm_x.csv"


def trex(path: Path, counts: tuple[int, ...] = (COUNT,) * 3) -> Path:
    """With `output_posture_data`: midlines of one length are stacked, others stand one after the other."""
    points = [midline(k, count) for k, count in enumerate(counts)]
    stacked = np.stack(points) if len(set(counts)) == 1 else np.concatenate(points)
    np.savez(
        path / "film_posture_fish0.npz", frames=np.arange(3.0), midline_lengths=np.array(counts, dtype=np.uint64),
        midline_points=stacked.astype(np.float32), offset=np.zeros((3, 2)),
    )  # fmt: skip
    return path / "film_posture_fish0.npz"


def written(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("write", [trackter, fishmechr, wormtracer, trex, lambda path: trex(path, (20, 18, 25))])
def test_sites_are_where_they_are_along_the_body(write, tmp_path):
    track, _ = read_midlines(write(tmp_path), FPS, PLACES)
    np.testing.assert_allclose(track.times[:3], np.arange(3) / FPS)
    np.testing.assert_allclose(track.positions[:3], true(), atol=0.01 * SWIMMER.length)
    assert (track.confidence[:3] == 1).all()
    assert not track.confidence[3:].any()


def test_smoothed_points_are_taken_and_said(tmp_path):
    assert read_midlines(trackter(tmp_path), FPS, PLACES)[1] == ["points are at 'x.sm' and 'y.sm', not at x, y"]


def test_a_tail_that_isnt_seen_is_lost_and_nothing_shifts(tmp_path):
    file = fishmechr(tmp_path)
    lines = file.read_text().splitlines()
    gone = [
        ",".join([*line.split(",")[:3], "NA", "NA"]) if ",2,19," in line or ",2,20," in line else line for line in lines
    ]
    track, _ = read_midlines(written(file, gone), FPS, PLACES)
    assert np.isnan(track.positions[2, -1]).all()
    np.testing.assert_allclose(track.positions[2, :3], true()[2, :3], atol=0.01 * SWIMMER.length)


def test_a_frame_whose_head_isnt_seen_is_lost(tmp_path):
    file = fishmechr(tmp_path)
    lines = [line for line in file.read_text().splitlines() if ",2,1," not in line]
    assert np.isnan(read_midlines(written(file, lines), FPS, PLACES)[0].positions[2]).all()


def test_midlines_from_the_tail_on_are_reported(tmp_path):
    rows = [f"{k},{n},{x},{y}" for k in range(60) for n, (x, y) in enumerate(midline(k)[::-1].tolist())]
    notes = read_midlines(written(tmp_path / "eel.csv", ["frame,point,x,y", *rows]), FPS, PLACES)[1]
    assert "tail first" in " ".join(notes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("frame,nose.x,nose.y\n0,1,2\n1,1,2\n", "columns are frame, nose.x, nose.y, and expected are columns frame"),
        ("frame,n,x,y\n" + "0,1,2,3\n0,1,3,4\n" * 2, "a 'n' comes twice in a 'frame'"),
        ("frame,n,x,y\n0,1,2,3\n0,2,3,4\n", "0 frames have a midline of 4 points"),
    ],
)
def test_what_has_no_midlines_is_refused(text, message, tmp_path):
    with pytest.raises(TrialError, match=message):
        read_midlines(written(tmp_path / "t.csv", [text]), FPS, PLACES)


def test_an_npz_of_something_else_is_refused(tmp_path):
    np.savez(tmp_path / "fish0.npz", frames=np.arange(3))
    with pytest.raises(TrialError, match="array 'midline_points' isn't there"):
        read_midlines(tmp_path / "fish0.npz", FPS, PLACES)

"""Tables that are too large, or in another unit: a sentence at once, and time that grows with rows alone."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from markertrack.cleaning import beat_window
from markertrack.quality import check_track
from markertrack.track import MarkerTrack
from refused import refusal, says
from swim2real.trials import Trial, TrialSet, load_reference, save_reference
from swim2real.trials.beat import identify_beat
from swim2real.trials.signals import read_signals
from swimbase import store
from swimbase.errors import TrialError

SECONDS = 20.0
REST = np.column_stack([np.linspace(0, 0.5, 5), np.zeros(5)])


def swim(times, scale=1.0) -> MarkerTrack:
    """Five markers of a body that beats at 1 Hz and swims toward -x."""
    wave = 0.05 * np.linspace(0, 1, 5) ** 2 * np.sin(2 * np.pi * (times[:, None] - np.linspace(0, 0.7, 5)))
    along = np.linspace(0, 0.5, 5) - 0.1 * times[:, None]
    return MarkerTrack(times, scale * np.stack([along, wave], axis=2))


def frames(count: int, rate: float = 60.0):
    return np.arange(count) / rate


def noisy():
    """In mm nothing fits the robot: every marker of every frame has to go."""
    track = swim(frames(600))
    return 1e9 * (track.positions + np.random.default_rng(0).normal(0, 0.05, track.positions.shape))


def collapsed():
    """Pairs that collapse while everything else is far too near: the worst of those that are left goes."""
    rng = np.random.default_rng(3)
    return np.where(rng.random((500, 5, 1)) < 0.3, 0.0, rng.normal(0, 1e3, (500, 5, 2)))


@pytest.mark.parametrize(("make", "scale"), [(noisy, 1.0), (collapsed, 1e6)])
def test_markers_that_fit_nothing_are_judged_as_fast(make, scale):
    positions, began = make(), time.monotonic()
    assert check_track(MarkerTrack(frames(len(positions)), positions), scale * REST).lost.mean() > 0.1
    assert time.monotonic() - began < SECONDS


@pytest.mark.parametrize("leap", [0.0, 1e8])
def test_the_beat_of_a_long_trial_is_found_and_a_gap_of_years_costs_nothing(leap):
    times = frames(1800, 5.0)  # six minutes
    times[900:] += leap
    track, began = swim(times), time.monotonic()
    beat = identify_beat(track, (3, 4), check_track(track, REST))
    assert leap or beat.frequency == pytest.approx(1.0, abs=1e-4)
    assert all(5 <= beat_window(fps) <= 501 for fps in (1e3, 1e6, 1e9))
    assert time.monotonic() - began < SECONDS


@pytest.mark.parametrize("scale", [1e3, 1e-6])
def test_time_stamps_in_another_unit_are_refused(tmp_path, scale):
    """What would be simulated is as long as the stamps say, so their mean step has limits."""
    save_reference(TrialSet((Trial("swim", swim(frames(60))),), tuple("ABCDE")), tmp_path)
    table = tmp_path / "swim.csv"
    head, *rows = table.read_text().splitlines()
    changed = [f"{float(row.partition(',')[0]) * scale!r},{row.partition(',')[2]}" for row in rows]
    table.write_text("\n".join([head, *changed]) + "\n")
    with pytest.raises(TrialError, match="s from one to the next; allowed are 1e-06 to 10 s"):
        load_reference(tmp_path)


def large(path: Path, size: int, head: bytes = b"time_s,a\n0,1\n") -> Path:
    """A file of a size that takes no place on the disk."""
    path.write_bytes(head)
    os.truncate(path, size)
    return path


@pytest.mark.parametrize(("words", "parts"), [
    (["quality", "large", "--robot", "fish"], "reference.json' can't be read as JSON: it has 1000.0 MB; at most"),
    (["check", "large/robot.toml"], "it has 1000.0 MB; at most 4 MB are read"),
    (["import-tracks", "large/swim.csv", "--to", "out", "--fps", "60"], "it has 1000.0 MB; at most 64 MB are read"),
    (["deploy", "large/swim.csv", "--dry-run"], "it has 1000.0 MB; at most 64 MB are read"),
    (["evaluate", "large/best.json", "--reference", "large"], "it has 1000.0 MB; at most 32 MB are read"),
])  # fmt: skip
def test_each_file_has_a_limit(program, tmp_path, monkeypatch, words, parts):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "large").mkdir()
    for name in ("reference.json", "robot.toml", "swim.csv", "best.json"):
        large(tmp_path / "large" / name, 10**9, b"{}")
    assert program(*words).code in (1, 2)
    assert parts in program.err
    assert len(program.err.splitlines()) == 1


def test_arrays_are_no_larger_than_their_file(tmp_path):
    """A header may promise anything; a file may unpack to a thousand times its size."""
    np.savez_compressed(tmp_path / "zeros.npz", a=np.zeros(10_000_000))
    with pytest.raises(ValueError, match="its arrays have 80 MB; at most 10 MB are read"):
        store.read_arrays(tmp_path / "zeros.npz", most=10_000_000)
    np.savez(tmp_path / "small.npz", a=np.zeros(1000))
    data = (tmp_path / "small.npz").read_bytes()
    (tmp_path / "small.npz").write_bytes(data.replace(b"(1000,)", b"(9e9,) "))
    with pytest.raises(ValueError, match=r"."):
        store.read_arrays(tmp_path / "small.npz")
    (tmp_path / "small.npz").write_bytes(data.replace(b"(1000,), }  ", b"(99000,), } "))
    with pytest.raises(ValueError, match="doesn't fit"):
        store.read_arrays(tmp_path / "small.npz")


def test_what_is_no_file_or_has_too_many_rows_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    for name in ("pipe", "zero"):
        for read in (store.read_json, store.read_arrays, store.read_text):
            with pytest.raises(OSError, match="a device, a pipe or a socket, not a file"):
                read(tmp_path / name)
    table = tmp_path / "long.csv"
    table.write_bytes(b"time_s,a\n" + b"0,1\n" * 1_000_001)
    assert says(refusal(TrialError, read_signals, table), "more than 1000000 rows", "cut it into shorter trials")

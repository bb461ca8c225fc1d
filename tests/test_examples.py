"""The examples run."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from run_settings import record_of
from swim2real import pipeline
from swim2real.calibration import RunFolder
from swim2real.robots import load_robot
from swim2real.settings import CalibrationSettings
from swim2real.trials import load_reference
from swim2real.trials.fetch import fetch

PROJECT = Path(__file__).resolve().parents[1]
EXAMPLE = PROJECT / "examples" / "calibrate.py"
TRACKING = PROJECT / "examples" / "track.py"
VLM_RUNS = PROJECT / "examples" / "vlm-runs"


@pytest.mark.slow
def test_the_example_calibrates_and_goes_on(tmp_path):
    out = tmp_path / "run"
    for budget in (2, 3):
        done = subprocess.run(
            [sys.executable, str(EXAMPLE), str(out), str(budget)], capture_output=True, text=True, timeout=240
        )
        assert done.returncode == 0, done.stderr
        assert "aligned marker error" in done.stdout
    record = [json.loads(line) for line in (out / "record.jsonl").read_text().splitlines()]
    assert len(record) == 3
    assert json.loads((out / "best.json").read_text())["loss"] == min(entry["loss"] for entry in record)


@pytest.mark.slow
def test_the_example_tracks_films(tmp_path):
    done = subprocess.run([sys.executable, str(TRACKING), str(tmp_path)], capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    lost = {line.split()[1] for line in done.stdout.splitlines() if "is lost" in line and line.startswith("f1_50")}
    assert {"M4", "M5"} <= lost  # below the glare
    assert load_reference(tmp_path / "reference").names == ("f1_00", "f1_50")
    assert (tmp_path / "reference" / "tracks" / "f1_50.mp4").is_file()


def replayed(run: Path, shared: Path, tmp_path: Path, **more) -> tuple[list[dict], list[dict]]:
    """The records of a shipped run and of its replay on fetched tracks, as far as the replay goes."""
    tracks = fetch(tmp_path / "tracks", shared / "data" / "fishsim-markers")
    settings = pipeline.as_replayed(CalibrationSettings(advisor=f"replay:{run}", **more))
    pipeline.calibrate(tracks, load_robot(RunFolder(run).settings().robot), settings, tmp_path / "run")
    again = record_of(tmp_path / "run")
    return record_of(run)[: len(again)], again


def check_same(shipped: list[dict], again: list[dict]) -> None:
    """The same steps, and the same losses but for what versions of the steady cycle and processors differ in."""
    assert [entry["point"] for entry in again] == [entry["point"] for entry in shipped]
    assert [entry["loss"] for entry in again] == pytest.approx([entry["loss"] for entry in shipped], rel=1e-2)
    told = [[entry["note"].get(key) for key in ("round", "step_size", "proposal")] for entry in again]
    assert told == [[entry["note"].get(key) for key in ("round", "step_size", "proposal")] for entry in shipped]


@pytest.mark.slow
@pytest.mark.parametrize("run", sorted(path.parent.name for path in VLM_RUNS.glob("*/record.jsonl")))
def test_the_shipped_vlm_runs_replay_to_the_end(shared, tmp_path, run):
    shipped, again = replayed(VLM_RUNS / run, shared, tmp_path)
    assert len(again) == 40
    assert any(entry["note"]["source"] == "measurement" for entry in again)
    check_same(shipped, again)

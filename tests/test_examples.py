"""The examples run."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from swim2real.trials import load_reference

PROJECT = Path(__file__).resolve().parents[1]
EXAMPLE = PROJECT / "examples" / "calibrate.py"
TRACKING = PROJECT / "examples" / "track.py"


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

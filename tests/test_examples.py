"""The examples run, and the README shows them as they are."""

import json
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
EXAMPLE = PROJECT / "examples" / "calibrate.py"


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


def test_the_readme_shows_the_example():
    code = EXAMPLE.read_text(encoding="utf-8")
    shown = code[code.index("import sys") :].strip()
    assert f"```python\n{shown}\n```" in (PROJECT / "README.md").read_text(encoding="utf-8")

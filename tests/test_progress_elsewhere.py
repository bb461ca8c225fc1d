"""The docs' callbacks for programs that watch runs: they run as they stand there, and what they wrote is read back."""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "python.md"
EXAMPLES = dict(re.findall(r'```python title="([^"]+)"\n(.*?)```', PAGE.read_text("utf-8"), flags=re.DOTALL))
BEGIN = """
import sys
sys.path.insert(0, sys.argv[1])
from recorded import PENDULUM as robot, pendulum_reference
import swim2real
if __name__ == "__main__":
    reference, settings = pendulum_reference(1e-3), swim2real.CalibrationSettings(method="random", budget=3, threads=1)
"""
READ = {
    "TensorBoard": """
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
log = EventAccumulator("logs").Reload()
steps = [(event.step, event.value) for event in log.Scalars("best loss [m]")]
assert [step for step, _ in steps] == [1, 2, 3] and abs(steps[-1][1] / outcome.fit.loss - 1) < 1e-6, steps
assert {f"parameters/{name}" for name in outcome.values} < set(log.Tags()["scalars"])
""",
    "MLflow": """
(row,) = mlflow.search_runs(output_format="list")
assert abs(row.data.metrics["best_loss_m"] / outcome.fit.loss - 1) < 1e-6
assert all(row.data.metrics[name] == value for name, value in outcome.values.items())
assert row.data.tags["verdict"] == outcome.verdict.kind and row.data.params["robot"] == "pendulum"
""",
}


@pytest.mark.parametrize(("name", "needs"), [("TensorBoard", ("torch", "tensorboard")), ("MLflow", ("mlflow",))])
def test_an_example_runs_as_it_stands_there(name, needs, tmp_path):
    missing = [package for package in needs if find_spec(package) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)} isn't installed")
    example = "".join(f"    {line}" for line in EXAMPLES[name].splitlines(keepends=True))
    read = "".join(f"    {line}" for line in READ[name].strip().splitlines(keepends=True))
    script = tmp_path / "example.py"
    script.write_text(f"{BEGIN}{example}\n{read}\n")
    store = {"MLFLOW_TRACKING_URI": f"sqlite:///{tmp_path / 'mlflow.db'}"}
    done = subprocess.run(
        [sys.executable, script, Path(__file__).parent], cwd=tmp_path, env={**os.environ, **store}, capture_output=True,
        text=True, timeout=250,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_every_example_is_as_short_as_is_said():
    assert set(EXAMPLES) == {"TensorBoard", "MLflow", "Weights & Biases"}
    for name, example in EXAMPLES.items():
        compile(example, name, "exec")
        assert len([line for line in example.splitlines() if line]) <= 10, name

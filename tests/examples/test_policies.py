"""The trained policies of `examples/policies`: they swim as they did where they were trained."""

import json
from pathlib import Path

import pytest

from swim2real.cli import main

POLICIES = Path(__file__).resolve().parents[2] / "examples" / "policies"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "options", "distance"),
    [("forward", ["--episodes", "4"], 0.2303), ("target", ["--goals", "4", "--stage", "2"], 1.0911)],
)
def test_a_policy_swims_as_it_did_where_it_was_trained(task, options, distance, tmp_path, capsys, new_fluid_law):
    if new_fluid_law:
        pytest.skip("with the newer lift force the fish swims another way")
    with pytest.raises(SystemExit, match="0"):
        main(["rollout", str(POLICIES / task), "--out", str(tmp_path), "--no-film", "--json", *options])
    figures = json.loads(capsys.readouterr().out)["policy"]
    assert figures["distance"] == pytest.approx(distance, rel=0.01)
    assert figures["success"] == (task == "target")

"""What a script gets of a training in a calibrated simulator: the same checks and records as the command."""

import json

import pytest

pytest.importorskip("stable_baselines3")

import swim2real
from swim2real.errors import ArgumentError
from swim2real.robots.fish import FISH
from swim2real.settings import TrainingSettings

SHORT = TrainingSettings("forward", 200, exploration=100, updates=1, batch=8, layers=(8,), environments=8)
BACKWARD = {**FISH.space.published, "motor_arm_length": 0.01}


def test_a_simulator_that_swims_tail_first_is_refused_and_else_where_it_is_from_is_recorded(tmp_path, caplog):
    out = tmp_path / "policy"
    with pytest.raises(ArgumentError, match=r"'my.json': unusable: .* tail first .*; --anyway trains all the same"):
        swim2real.train(SHORT, [BACKWARD], FISH, out, reference="my.json")
    assert not out.exists()
    swim2real.train(SHORT, [BACKWARD], FISH, out, reference="my.json", anyway=True, stop=lambda: True)
    assert "tail first" in caplog.text
    settings = json.loads((out / "settings.json").read_text())
    assert {"mujoco", "stable-baselines3", "torch", "swim2real"} <= set(settings["versions"])
    assert settings["reference"].endswith("my.json")

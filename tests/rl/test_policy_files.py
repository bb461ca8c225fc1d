"""Files of policies: no pickle in them runs, and whatever is wrong with one is a sentence."""

import json
import random
import re
import subprocess
import sys
from contextlib import nullcontext

import numpy as np
import pytest

pytest.importorskip("torch")

from mutations import bytes_changed
from swim2real.rl.actor import Actor, Linear
from swim2real.rl.environment import make_environments
from swim2real.rl.rollout import load_policy
from swim2real.rl.training_run import TrainingRun
from swim2real.robots.fish import FISH
from swimbase.errors import RunError
from swimbase.store import write_arrays


class Trap:
    """What runs when it is unpickled: it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


@pytest.fixture
def folder(tmp_path):
    """A training folder with a policy."""
    run = tmp_path / "run"
    run.mkdir()
    settings = {
        "kind": "training", "robot": "fish", "task": "forward", "seed": 0, "env_steps": 400, "exploration": 200,
        "parameters": [dict(FISH.space.published)], "disturbances": {},
    }  # fmt: skip
    (run / "settings.json").write_text(json.dumps(settings))
    rng = np.random.default_rng(0)

    def layer(*shape):
        return Linear(rng.standard_normal(shape, np.float32), rng.standard_normal(shape[1], np.float32))

    Actor((layer(52, 8),), layer(8, 1), layer(8, 1)).save(run / "best.npz", {"task": "forward"})
    return run


def test_no_pickle_runs(folder, tmp_path):
    np.savez(folder / "best.npz", **{"mean.weight": np.array([Trap(tmp_path / "it-ran")], object)})
    with pytest.raises(RunError, match=r"best\.npz' is damaged: it holds a pickle, which could run code"):
        load_policy(TrainingRun.open(folder))
    assert not (tmp_path / "it-ran").exists()


@pytest.mark.parametrize(("change", "said"), [
    (lambda a: a.pop("mean.bias"), "its array 'mean.bias' is missing"),
    (lambda a: a.update({"mean.bias": a["mean.bias"].astype(float)}), "must have finite numbers of type float32"),
    (lambda a: a["mean.weight"].fill(np.nan), "must have finite numbers of type float32"),
    (lambda a: a.update({"mean.bias": np.zeros(2, np.float32)}), "'mean' has the shapes (8, 1) and (2,)"),
    (lambda a: a.update({"hidden0.weight": np.zeros((52, 7), np.float32)}), "'hidden0' has the shapes"),
    (lambda a: a.update({"log_std.weight": np.zeros((7, 1), np.float32)}), "don't fit one another"),
])  # fmt: skip
def test_an_array_that_is_wrong_is_named(folder, change, said):
    with np.load(folder / "best.npz") as stored:
        arrays = dict(stored)
    change(arrays)
    write_arrays(folder / "best.npz", arrays)
    with pytest.raises(RunError, match=r"best\.npz' is damaged: .*" + re.escape(said) + ".*train anew"):
        load_policy(TrainingRun.open(folder))


def test_a_policy_of_other_observations_or_actuators_of_as_many_numbers_is_refused(folder):
    run = TrainingRun.open(folder)
    environments = make_environments("forward", run.settings.parameters, 1, robot=FISH)
    interface = environments.interface
    for about, says in (
        ({"task": "forward", **interface}, None),
        (interface | {"actions": ["tail"]}, r"doesn't fit robot 'fish': .* commands tail, the robot has "),
        (interface | {"observation": {"goal": [0, 52]}}, r"goal.* of what it observes differ; it observes goal and"),
        ([], r"is damaged: "),
    ):
        with np.load(folder / "best.npz") as stored:
            arrays = dict(stored) | {"about": np.array(json.dumps(about))}
        write_arrays(folder / "best.npz", arrays)
        with nullcontext() if says is None else pytest.raises(RunError, match=says):
            run.check_fits(load_policy(run), environments)


@pytest.mark.slow
def test_a_policy_and_its_pages_need_no_torch():
    code = """
import sys
class Absent:  # as if they weren't installed
    def find_spec(self, name, path=None, target=None):
        if name in ("torch", "stable_baselines3"):
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)
sys.meta_path.insert(0, Absent())
import swim2real.rl.assessment, swim2real.rl.film, swim2real.report.training_page
from swimbase.errors import MissingExtraError
try:
    import swim2real.rl.training
except MissingExtraError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "training needs torch; install it with: pip install 'swim2real[rl]'" in done.stdout


@pytest.mark.parametrize("count", [100, pytest.param(5000, marks=pytest.mark.slow)])
def test_any_damage_of_a_policy_is_a_sentence(folder, count):
    path, rng = folder / "best.npz", random.Random(count)
    compressed = path.read_bytes()
    with np.load(path) as stored:
        np.savez(path, **stored)
    contents, refused = (compressed, path.read_bytes()), 0
    for i in range(count):
        path.write_bytes(bytes_changed(contents[i % 2], rng))
        try:
            load_policy(TrainingRun.open(folder))
        except RunError as error:
            refused += "is damaged" in str(error)
    assert refused > 0.8 * count  # the checksums find nearly all; some bytes of a .zip mean nothing

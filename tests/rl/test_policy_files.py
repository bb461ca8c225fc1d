"""Policies and checkpoints: old ones hold pickles and need consent; foreign and damaged ones are a sentence."""

import io
import json
import random
import re
import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3 import SAC

from swim2real.errors import ConsentError, RunError
from swim2real.rl.actor import Actor, Linear
from swim2real.rl.environment import make_environments
from swim2real.rl.policies import load_policy
from swim2real.rl.training import train
from swim2real.rl.training_run import TrainingRun
from swim2real.rl.vector import RobotVecEnv
from swim2real.robots.fish import FISH
from swim2real.settings import TrainingSettings
from swim2real.store import read_arrays, write_arrays

SHORT = TrainingSettings("forward", 800, exploration=200, updates=1, batch=32, layers=(16,), environments=8)
VALUES = [FISH.space.published]


class Told:
    """What runs when it is unpickled: it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


@pytest.fixture
def folder(tmp_path):
    """A training folder without a policy."""
    run = tmp_path / "run"
    run.mkdir()
    settings = {
        "kind": "training", "robot": "fish", "task": "forward", "seed": 0, "env_steps": 400, "exploration": 200,
        "parameters": [dict(VALUES[0])], "disturbances": {},
    }  # fmt: skip
    (run / "settings.json").write_text(json.dumps(settings))
    return run


def small_actor(rng=None, sizes=(52, 8, 1)):
    rng = rng or np.random.default_rng(0)

    def layer(inputs, outputs):
        return Linear(rng.standard_normal((inputs, outputs), np.float32), rng.standard_normal(outputs, np.float32))

    return Actor((layer(*sizes[:2]),), layer(*sizes[1:]), layer(*sizes[1:]))


@pytest.mark.slow
@pytest.mark.parametrize(("task", "order"), [("forward", range(52)), ("target", [*range(16), 21, *range(16, 21)])])
def test_a_policy_of_0_1_is_read_with_consent_only(folder, task, order):
    settings = (folder / "settings.json").read_text()
    (folder / "settings.json").write_text(settings.replace('"forward"', f'"{task}"'))
    environments = make_environments(task, None, 2)
    learner = SAC("MlpPolicy", RobotVecEnv(environments), policy_kwargs={"net_arch": [16, 16]}, buffer_size=10, seed=0)
    learner.save(folder / "best.zip")  # as 0.1 did
    environments.close()
    with pytest.raises(ConsentError, match=r"best\.zip' is a policy of version 0\.1 and holds a pickle.*--allow-code"):
        load_policy(TrainingRun.open(folder))
    load_policy(TrainingRun.open(folder, allow_code=True))
    policy = load_policy(TrainingRun.open(folder))  # it is remembered
    old = np.random.default_rng(0).standard_normal((20, policy.actor.inputs)).astype(np.float32)
    new = old[:, list(order)]  # the same observations in the order of now
    np.testing.assert_allclose(policy.actor.best(new), learner.predict(old, deterministic=True)[0], atol=1e-6)


def test_no_pickle_runs_whatever_file_it_is_in(folder, tmp_path):
    trace = tmp_path / "it-ran"
    run = TrainingRun.open(folder, allow_code=True)
    with zipfile.ZipFile(folder / "best.zip", "w") as archive:
        content = io.BytesIO()
        torch.save({"actor.mu.weight": Told(trace)}, content)
        archive.writestr("policy.pth", content.getvalue())
    with pytest.raises(RunError, match=r"best\.zip' is damaged: torch can't read its weights"):
        load_policy(run)
    np.savez(folder / "best.npz", **{"mean.weight": np.array([Told(trace)], object)})
    with pytest.raises(RunError, match=r"best\.npz' is damaged: it holds a pickle, which could run code"):
        load_policy(run)
    assert not trace.exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda a: a.pop("mean.bias"), "its array 'mean.bias' is missing"),
        (lambda a: a.update({"mean.bias": a["mean.bias"].astype(float)}), "must have finite numbers of type float32"),
        (lambda a: a["mean.weight"].fill(np.nan), "must have finite numbers of type float32"),
        (lambda a: a.update({"mean.bias": np.zeros(2, np.float32)}), "'mean' has the shapes (8, 1) and (2,)"),
        (lambda a: a.update({"hidden0.weight": np.zeros((52, 7), np.float32)}), "'hidden0' has the shapes"),
        (lambda a: a.update({"log_std.weight": np.zeros((7, 1), np.float32)}), "don't fit one another"),
    ],
)
def test_an_array_that_is_wrong_is_named(folder, change, said):
    small_actor().save(folder / "best.npz", {})
    with np.load(folder / "best.npz") as stored:
        arrays = dict(stored)
    change(arrays)
    write_arrays(folder / "best.npz", arrays)
    with pytest.raises(RunError, match=r"best\.npz' is damaged: .*" + re.escape(said) + ".*train anew"):
        load_policy(TrainingRun.open(folder))


def test_arrays_that_unpack_to_too_much_are_refused_before(tmp_path):
    path = tmp_path / "arrays.npz"
    np.savez_compressed(path, zeros=np.zeros(1_000_000))
    assert path.stat().st_size < 20_000
    with pytest.raises(ValueError, match="its arrays have 8 MB; at most 4 MB are read"):
        read_arrays(path, 4_000_000)
    assert read_arrays(path)["zeros"].shape == (1_000_000,)


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
from swim2real.errors import MissingExtraError
try:
    import swim2real.rl.training
except MissingExtraError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "training needs torch; install it with: pip install 'swim2real[rl]'" in done.stdout


def mutated(content, rng):
    """Content with some bytes changed, left out or doubled."""
    content = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(content))
        match rng.randrange(4):
            case 0:
                content[at] = rng.randrange(256)
            case 1:
                content[at] ^= 1 << rng.randrange(8)
            case 2:
                del content[at : at + rng.randint(1, 40)]
            case 3:
                content[at:at] = content[at : at + rng.randint(1, 40)]
    return bytes(content)


@pytest.mark.parametrize("count", [100, pytest.param(5000, marks=pytest.mark.slow)])
def test_any_damage_of_a_policy_is_a_sentence(folder, count):
    path, rng = folder / "best.npz", random.Random(count)
    small_actor().save(path, {"task": "forward"})
    compressed = path.read_bytes()
    with np.load(path) as stored:
        np.savez(path, **stored)
    contents, refused = (compressed, path.read_bytes()), 0
    for i in range(count):
        path.write_bytes(mutated(contents[i % 2], rng))
        try:
            load_policy(TrainingRun.open(folder))
        except RunError as error:
            refused += "is damaged" in str(error)
    assert refused > 0.8 * count  # the checksums find nearly all; some bytes of a .zip mean nothing


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A short run that had learned once at its checkpoint, and the same one at its end. Don't write into them."""
    base = tmp_path_factory.mktemp("checkpoints")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swim2real.rl.training.EVALUATION_EPISODES", 1)
        stops = iter((False, False, True))
        train(SHORT, VALUES, FISH, base / "stopped", stop=lambda: next(stops))
        train(SHORT, VALUES, FISH, base / "whole")
    return base / "stopped", base / "whole"


@pytest.fixture
def resumed(stopped, tmp_path, monkeypatch):
    """A copy of the stopped run, its checkpoint, and what resumes it."""
    monkeypatch.setattr("swim2real.rl.training.EVALUATION_EPISODES", 1)
    run = tmp_path / "run"
    shutil.copytree(stopped[0], run)
    return run, run / "checkpoints/step-000000600", lambda **also: train(SHORT, VALUES, FISH, run, resume=True, **also)


@pytest.mark.slow
def test_a_checkpoint_with_a_pickle_is_gone_on_with_by_consent(stopped, resumed):
    run, checkpoint, resume = resumed
    with np.load(checkpoint / "networks.npz") as stored:
        tensors = {name: torch.from_numpy(array) for name, array in stored.items()}
    nested = {name: value for name, value in tensors.items() if "/" not in name}
    for name, value in tensors.items():
        part, _, key = name.partition("/")
        if part.endswith("_optimizer"):
            number, _, key = key.partition("/")
            state = nested.setdefault(part, {"state": {}, "param_groups": []})["state"]
            state.setdefault(int(number), {})[key] = value
        elif key:
            nested.setdefault(part, {})[key] = value
    assert nested["actor_optimizer"]["state"][0]["step"] == 1
    torch.save(nested, checkpoint / "networks.pt")
    (checkpoint / "networks.npz").unlink()
    with pytest.raises(ConsentError, match=r"networks\.pt' is of an earlier version and holds a pickle.*--allow-code"):
        resume()
    assert resume(allow_code=True).complete
    ours, theirs = (Actor.load(path / "policy.npz") for path in (run, stopped[1]))
    np.testing.assert_array_equal(ours.mean.weight, theirs.mean.weight)
    np.testing.assert_array_equal(ours.hidden[0].weight, theirs.hidden[0].weight)
    assert (run / "episodes.jsonl").read_text() == (stopped[1] / "episodes.jsonl").read_text()


def test_a_checkpoint_of_0_1_is_refused(resumed):
    _, checkpoint, resume = resumed
    (checkpoint / "state.json").rename(checkpoint / "state.pickle")
    with pytest.raises(RunError, match=r"state\.pickle' is a pickle of version 0\.1.*begin a new run"):
        resume()


def changed(path, name, value):
    with np.load(path) as stored:
        arrays = dict(stored)
    arrays[name] = value(arrays[name])
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("file", "change"),
    [
        ("networks.npz", lambda path: changed(path, "actor/mu.bias", lambda a: a[:0])),
        ("networks.npz", lambda path: changed(path, "random", lambda a: a[:10])),
        ("networks.npz", lambda path: np.savez(path, **{"actor/mu.bias": np.zeros(1, np.float32)})),
        ("replay.npz", lambda path: changed(path, "actions", lambda a: a[:, :1])),
        ("replay.npz", lambda path: changed(path, "pos", lambda a: np.array(10**9))),
        ("episodes.npz", lambda path: changed(path, "physics", lambda a: a[:, :3])),
        ("episodes.npz", lambda path: changed(path, "members", lambda a: a + 5)),
        ("state.json", lambda path: path.write_text("[]")),
        ("state.json", lambda path: path.write_text(path.read_text().replace('"step": 600', '"step": 200'))),
        ("state.json", lambda path: path.write_text(path.read_text().replace('"PCG64"', '"MT19937"'))),
        ("state.json", lambda path: path.write_text(path.read_text().replace('"recent": []', '"recent": [{}]'))),
    ],
)
def test_a_foreign_checkpoint_is_a_sentence(resumed, file, change):
    _, checkpoint, resume = resumed
    change(checkpoint / file)
    with pytest.raises(RunError, match=r"step-000000600' is damaged: .*; remove it to go on from an older one"):
        resume()

"""Policies in the files of other programs: they act alike there, and learn on."""

import json

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from stable_baselines3 import SAC

from refused import refusal, says
from swim2real.cli import main
from swim2real.rl.actor import Actor
from swim2real.rl.export import export_policy
from swim2real.rl.learner import make_vector_env
from swim2real.rl.training import train
from swim2real.robots.fish import FISH
from swim2real.settings import TrainingSettings
from swimbase.errors import ArgumentError, RunError

SHORT = TrainingSettings("forward", 600, exploration=200, updates=2, batch=32, layers=(16, 24), environments=8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A short training. Don't write into it."""
    out = tmp_path_factory.mktemp("training") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swim2real.rl.training.EVALUATION_EPISODES", 1)
        train(SHORT, [FISH.space.published], FISH, out)
    return out


def observations(environments, count=50):
    rng = np.random.default_rng(0)
    return rng.normal(size=(count, environments.observation_space.shape[0])).astype(np.float32)


def test_onnx_acts_as_numpy_does(folder, tmp_path, capsys):
    onnxruntime = pytest.importorskip("onnxruntime", reason="onnxruntime isn't installed (dependency group dev)")
    pytest.importorskip("onnx", reason="the extra onnx isn't installed")
    path = tmp_path / "policy.onnx"
    with pytest.raises(SystemExit, match="0"):
        main(["export-policy", str(folder), "--out", str(path)])
    assert "onnxruntime.InferenceSession reads it" in capsys.readouterr().out
    session = onnxruntime.InferenceSession(path)
    actor = Actor.load(folder / "best.npz")
    given = np.random.default_rng(0).normal(size=(200, len(actor.hidden[0].weight))).astype(np.float32)
    (actions,) = session.run(["actions"], {"observations": given})
    np.testing.assert_allclose(actions, actor.best(given), rtol=0, atol=1e-6)
    about = session.get_modelmeta().custom_metadata_map
    assert {key: json.loads(value) for key, value in about.items()} == actor.about.model_dump()
    assert session.get_outputs()[0].shape == ["N", 1]


def test_stable_baselines3_acts_alike_and_trains_on(folder, tmp_path):
    path = export_policy(folder, tmp_path / "policy.zip")
    environments = make_vector_env("forward", None, SHORT.environments, seed=0)
    model = SAC.load(path, environments)
    given = observations(environments)
    theirs, _ = model.predict(given, deterministic=True)
    np.testing.assert_allclose(theirs, Actor.load(folder / "policy.npz").best(given), rtol=0, atol=1e-6)
    with np.load(max(folder.glob("checkpoints/*/networks.npz"))) as arrays:
        kept = dict(arrays)
    for part in ("actor", "critic", "critic_target"):
        for name, tensor in getattr(model, part).state_dict().items():
            np.testing.assert_array_equal(tensor.numpy(), kept[f"{part}/{name}"])
    np.testing.assert_array_equal(model.log_ent_coef.detach().numpy(), kept["log_ent_coef"])
    moments = model.critic.optimizer.state_dict()["state"][0]["exp_avg"].numpy()
    np.testing.assert_array_equal(moments, kept["critic_optimizer/0/exp_avg"])
    assert moments.any()
    assert (model.num_timesteps, model._n_updates, model.gradient_steps, model.train_freq.frequency) == (600, 4, 2, 25)
    model.learn(400, reset_num_timesteps=False)
    assert (model.num_timesteps, model._n_updates) == (1000, 8)
    assert not np.array_equal(model.predict(given, deterministic=True)[0], theirs)


def test_what_cant_be_exported_is_refused(folder, tmp_path):
    said = refusal(ArgumentError, export_policy, folder, tmp_path / "policy.pt")
    assert says(said, "policy.pt", "must end in .onnx", ".zip for Stable-Baselines3")
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("settings.json", "best.npz"):
        (copy / name).write_bytes((folder / name).read_bytes())
    assert says(refusal(RunError, export_policy, copy, tmp_path / "policy.zip"), f"'{copy}' has no checkpoint")
    assert not (tmp_path / "policy.zip").exists()

"""Training: what it writes, that a resumed run is the run that wasn't interrupted, and what it refuses."""

import errno
import json
import math
import re
import shutil
from contextlib import closing
from dataclasses import replace

import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("torch")

import numpy as np
import torch

from swim2real.rl.actor import Actor
from swim2real.rl.conditions import Disturbances
from swim2real.rl.environment import make_environments
from swim2real.rl.learner import Learner, RobotVecEnv, list_checkpoints, write_checkpoint
from swim2real.rl.tasks import Curriculum
from swim2real.rl.training import Trainer, train
from swim2real.rl.training_run import EPISODES, EVALUATIONS, SETTINGS, TrainingRun, locked_folder, read_record
from swim2real.robots.fish import FISH
from swim2real.settings import TrainingSettings
from swimbase.errors import ArgumentError, RunError
from swimbase.store import LOCK

SHORT = TrainingSettings(
    "forward", 800, exploration=200, checkpoint_every=400, updates=1, batch=32, layers=(16, 16), environments=8,
    noise_time=0.1,
)  # fmt: skip
ANY_PHASE = Disturbances(start_phase=(-math.pi, math.pi))
VALUES = [FISH.space.published]


def trained(out, settings=SHORT, stop_after=0, **options):
    """Trains, and stops after so many rounds."""
    rounds = iter(range(1, 1000))
    options = {"disturbances": ANY_PHASE, "stop": lambda: next(rounds) == stop_after, **options}
    return train(settings, VALUES, FISH, out, **options)


def assert_same_run(ours, theirs):
    first, second = (Actor.load(folder / "policy.npz") for folder in (ours, theirs))
    for one, other in zip((*first.hidden, first.mean, first.log_std), (*second.hidden, second.mean, second.log_std),
                          strict=True):  # fmt: skip
        np.testing.assert_array_equal(one.weight, other.weight)
        np.testing.assert_array_equal(one.bias, other.bias)
    for name in (EPISODES, EVALUATIONS):
        assert read_record(ours / name) == read_record(theirs / name)


@pytest.fixture(autouse=True, scope="module")
def short_evaluations():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swim2real.rl.training.EVALUATION_EPISODES", 1)
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A short run that was left alone. Don't write into it."""
    out, progress = tmp_path_factory.mktemp("training") / "run", []
    return out, trained(out, on_progress=progress.append), progress


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """The same run, stopped in the middle of episodes, when it had learned once. Don't write into it."""
    out = tmp_path_factory.mktemp("stopped") / "run"
    outcome = trained(out, stop_after=3)
    assert (outcome.complete, outcome.step) == (False, 600)
    return out


@pytest.fixture
def checkpoint(stopped, tmp_path):
    """The last checkpoint of a copy of the stopped run."""
    shutil.copytree(stopped, tmp_path / "run")
    return tmp_path / "run/checkpoints/step-000000600"


def test_a_run_is_on_record(finished):
    out, outcome, progress = finished
    assert (outcome.complete, outcome.step) == (True, 800)
    assert outcome.gradient_steps == 3  # for each 200 transitions but the first, which explore
    assert 0 < outcome.learner_share < 1
    run = TrainingRun.open(out)
    assert run.outcome == outcome
    assert run.robot is FISH
    assert [(line["step"], line["length"]) for line in run.episodes] == [(800, 100)] * 8
    assert [line["step"] for line in run.evaluations] == [400, 800]
    assert [(one.step, one.resumable) for one in list_checkpoints(out)] == [(400, False), (800, True)]
    assert list((out / "tensorboard").iterdir())
    assert progress[-1].step == progress[-1].total == 800
    settings = json.loads((out / SETTINGS).read_text())
    assert settings["parameters"] == [dict(FISH.space.published)]
    assert settings["updates"] == 1
    for path in out.rglob("*.npz"):  # no file of a run holds a pickle
        with np.load(path, allow_pickle=False) as arrays:
            assert all(arrays[name].dtype != object for name in arrays)
    files = [path for path in out.rglob("*") if path.is_file() and "tfevents" not in path.name and path.name != LOCK]
    assert {path.suffix for path in files} == {".json", ".jsonl", ".npz"}


def test_a_resumed_run_is_the_run_that_was_left_alone(finished, checkpoint, tmp_path):
    ended = trained(tmp_path / "run", resume=True)
    assert (ended.complete, ended.gradient_steps) == (True, 3)
    assert_same_run(tmp_path / "run", finished[0])


def test_a_run_that_is_killed_after_its_last_checkpoint_has_its_last_policy(
    finished, checkpoint, tmp_path, monkeypatch
):  # fmt: skip
    class Killed(BaseException):
        pass

    def killed(*content):
        write_checkpoint(*content)
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr("swim2real.rl.learner.write_checkpoint", killed)
        with pytest.raises(Killed):
            trained(tmp_path / "run", resume=True)
    assert trained(tmp_path / "run", resume=True).complete
    assert_same_run(tmp_path / "run", finished[0])


@pytest.mark.slow
def test_a_target_run_resumes_within_its_long_episodes(tmp_path):
    settings = replace(SHORT, task="target", env_steps=600, checkpoint_every=None, environments=4)
    trained(tmp_path / "whole", settings)
    trained(tmp_path / "parts", settings, stop_after=1)
    trained(tmp_path / "parts", settings, resume=True)
    assert_same_run(tmp_path / "parts", tmp_path / "whole")


def test_it_refuses_to_mix_runs(finished):
    out = finished[0]
    with pytest.raises(RunError, match="already holds a run; go on with --resume, or choose another folder"):
        trained(out)
    with pytest.raises(RunError, match="was begun with another seed: 0, now 1; resume with the same"):
        trained(out, replace(SHORT, seed=1), resume=True)
    with pytest.raises(RunError, match=r"is no training run: it has no settings\.json"):
        trained(out.parent / "nowhere", resume=True)
    assert not (out.parent / "nowhere").exists()


def changed(name, value):
    def change(path):
        with np.load(path) as stored:
            arrays = dict(stored)
        arrays[name] = value(arrays[name])
        np.savez(path, **arrays)

    return change


def replaced(old, new):
    return lambda path: path.write_text(path.read_text().replace(old, new))


def halved(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize(("file", "change"), [
    *((name, halved) for name in ("replay.npz", "networks.npz", "episodes.npz", "state.json")),
    ("networks.npz", changed("actor/mu.bias", lambda a: a[:0])),
    ("networks.npz", changed("actor_optimizer/0/exp_avg", lambda a: a[:0])),
    ("networks.npz", changed("random", lambda a: a[:10])),
    ("networks.npz", lambda path: np.savez(path, **{"actor/mu.bias": np.zeros(1, np.float32)})),
    ("replay.npz", changed("actions", lambda a: a[:, :1])),
    ("replay.npz", changed("pos", lambda a: np.array(10**9))),
    ("episodes.npz", changed("physics", lambda a: a[:, :3])),
    ("episodes.npz", changed("members", lambda a: a + 5)),
    ("state.json", lambda path: path.write_text("[]")),
    ("state.json", lambda path: path.write_bytes(path.read_bytes() + b"\xff")),
    ("state.json", replaced('"step": 600', '"step": 200')),
    ("state.json", replaced('"PCG64"', '"MT19937"')),
    ("state.json", replaced('"recent": []', '"recent": [{}]')),
])  # fmt: skip
def test_a_damaged_or_foreign_checkpoint_is_a_sentence(checkpoint, tmp_path, file, change):
    change(checkpoint / file)
    with pytest.raises(RunError, match=r"step-000000600' is damaged: .{2,100}; remove it to go on from an older one"):
        trained(tmp_path / "run", resume=True)


@pytest.mark.parametrize("line", ["3", "{}", '{"step": 1, "distance": "far"}', '{"step": 1, "success": NaN}'])
def test_a_damaged_line_of_a_record_is_a_sentence(tmp_path, line):
    (tmp_path / EPISODES).write_text(f'{{"step": 200}}\n{line}\n')
    with pytest.raises(RunError, match=r"episodes\.jsonl'.* (line 2: |is damaged: )"):
        read_record(tmp_path / EPISODES)


def test_without_any_checkpoint_it_is_begun_anew(checkpoint, tmp_path):
    shutil.rmtree(checkpoint.parent)
    again = trained(tmp_path / "run", resume=True, stop_after=1)
    assert (again.step, again.complete) == (200, False)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [({"environments": 3}, "environments is 3"), ({"env_steps": 100}, "env_steps is 100"),
     ({"near_goals": 1.0}, "near_goals is 1"), ({"turn_reward": -0.2}, r"turn_reward is -0\.2 m"),
     ({"noise_time": -1.0}, "noise_time is -1 s"), ({"env_steps": 300, "exploration": 300}, "exploration is 300")],
)  # fmt: skip
def test_settings_out_of_range_are_refused(wrong, sentence):
    with pytest.raises(ArgumentError, match=sentence):
        TrainingSettings("forward", **wrong)


def test_noise_may_stay_alike_for_a_while_and_is_as_strong(tmp_path):
    def actions(noise_time, out):
        out.mkdir()
        settings = replace(SHORT, env_steps=4000, exploration=3999, noise_time=noise_time)
        with closing(Trainer(settings, VALUES, FISH, out, ANY_PHASE, 1)) as trainer:
            trainer.begin({}, resume=False)
            made = [trainer._step().actions[:, 0] for _ in range(200)]
        return np.array(made)

    fresh, alike = actions(0.0, tmp_path / "fresh"), actions(0.1, tmp_path / "alike")
    for series in (fresh, alike):  # uniform between -1 and 1
        assert series.std() == pytest.approx(3**-0.5, abs=0.06)
    same = [np.corrcoef(series[:-1].ravel(), series[1:].ravel())[0, 1] for series in (fresh, alike)]
    assert same == pytest.approx([0.0, math.exp(-0.2)], abs=0.08)
    for name, task in (("near_goals", "forward"), ("turn_reward", "forward"), ("turn_reward", "paper-target")):
        with pytest.raises(ArgumentError, match=rf"{name} is 0\.2, which isn't for task '{task}': leave it out"):
            trained(tmp_path / "no", replace(SHORT, task=task, **{name: 0.2}))


def test_the_curriculum_goes_on_when_a_stage_is_learned():
    curriculum = Curriculum((1, 2, 3))
    for i in range(50):
        assert not curriculum.advance()
        curriculum.note(i % 10 < 7, 1)
    assert curriculum.advance()
    assert curriculum.stage == 2
    for _ in range(60):
        curriculum.note(True, 1)  # begun in the stage before: doesn't count
    assert not curriculum.advance()


def test_a_policy_is_the_network_that_learned():
    learner = Learner(SHORT, RobotVecEnv(make_environments("forward", None, 8)), 0.99)
    actor, seen = learner.actor, np.random.default_rng(0).standard_normal((5, 52)).astype(np.float32)
    np.testing.assert_allclose(actor.best(seen), learner._sac.predict(seen, deterministic=True)[0], atol=1e-6)
    samples = np.array([actor.sample(seen, np.random.default_rng(i).standard_normal((5, 1))) for i in range(2000)])
    with torch.no_grad():
        mean, log_std, _ = learner._sac.actor.get_action_dist_params(torch.from_numpy(seen))
    before_tanh = np.arctanh(np.clip(samples, -1 + 1e-9, 1 - 1e-9))
    np.testing.assert_allclose(before_tanh.mean(axis=0), mean.numpy(), atol=0.1)
    np.testing.assert_allclose(before_tanh.std(axis=0), np.exp(log_std.numpy()), rtol=0.1)


def test_one_process_at_a_time_trains_into_a_folder_and_half_a_checkpoint_is_removed(tmp_path):
    half = tmp_path / "checkpoints/step-000000400.part/replay.npz"
    half.parent.mkdir(parents=True)
    half.write_bytes(b"x")
    (tmp_path / "checkpoints/step-000000200").mkdir()
    (tmp_path / "best.npz.part").write_bytes(b"x")
    with locked_folder(tmp_path):
        assert [path.name for path in (tmp_path / "checkpoints").iterdir()] == ["step-000000200"]
        assert not (tmp_path / "best.npz.part").exists()
        with (
            pytest.raises(RunError, match=r"another process is training into '.*'; wait for it or choose another"),
            locked_folder(tmp_path),
        ):
            pass


def test_a_full_disk_is_a_sentence(tmp_path):
    says = rf"can't write '{tmp_path}': No space left on device \(.* free in .*; make room\); --resume goes on"
    with pytest.raises(RunError) as refused, locked_folder(tmp_path):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert re.match(says, str(refused.value))

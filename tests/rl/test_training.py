"""Training: what it writes, that a resumed run is the run that wasn't interrupted, and what it refuses."""

import json
import math
import shutil

import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("torch")

import numpy as np

from swim2real.errors import ArgumentError, RunError
from swim2real.rl.conditions import Disturbances
from swim2real.rl.learner import list_checkpoints
from swim2real.rl.policies import load_policy
from swim2real.rl.tasks import Curriculum
from swim2real.rl.training import train
from swim2real.rl.training_run import EPISODES, EVALUATIONS, SETTINGS, TrainingRun, read_record
from swim2real.robots.fish import FISH
from swim2real.settings import TrainingSettings
from swim2real.store import LOCK

SHORT = TrainingSettings(
    "forward", 800, exploration=200, checkpoint_every=400, updates=1, batch=32, layers=(16, 16), environments=8
)
ANY_PHASE = Disturbances(start_phase=(-math.pi, math.pi))


def assert_same_policy(ours, theirs):
    first, second = (load_policy(TrainingRun.open(folder), "last").actor for folder in (ours, theirs))
    for one, other in zip((*first.hidden, first.mean, first.log_std), (*second.hidden, second.mean, second.log_std),
                          strict=True):  # fmt: skip
        np.testing.assert_array_equal(one.weight, other.weight)
        np.testing.assert_array_equal(one.bias, other.bias)


def stop_after(blocks):
    calls = 0

    def stop():
        nonlocal calls
        calls += 1
        return calls == blocks

    return stop


@pytest.fixture(autouse=True, scope="module")
def short_evaluations():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swim2real.rl.training.EVALUATION_EPISODES", 1)
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A short run that was left alone. Don't write into it."""
    out = tmp_path_factory.mktemp("training") / "run"
    progress = []
    outcome = train(SHORT, [FISH.space.published], FISH, out, disturbances=ANY_PHASE, on_progress=progress.append)
    return out, outcome, progress


def test_a_run_is_on_record(finished):
    out, outcome, progress = finished
    assert outcome.complete
    assert outcome.step == 800
    assert outcome.gradient_steps == 3  # for each 200 transitions but the first, which explore
    assert 0 < outcome.learner_share < 1
    run = TrainingRun.open(out)
    assert run.outcome == outcome
    assert run.robot is FISH
    episodes = run.episodes
    assert [line["step"] for line in episodes] == [800] * 8
    assert all(line["length"] == 100 for line in episodes)
    assert [line["step"] for line in run.evaluations] == [400, 800]
    assert [checkpoint.step for checkpoint in list_checkpoints(out)] == [400, 800]
    assert [checkpoint.resumable for checkpoint in list_checkpoints(out)] == [False, True]
    assert list((out / "tensorboard").iterdir())
    assert progress[-1].step == progress[-1].total == 800
    settings = json.loads((out / SETTINGS).read_text())
    assert settings["parameters"] == [dict(FISH.space.published)]
    assert settings["updates"] == 1


@pytest.mark.parametrize(
    "blocks", [3, pytest.param(1, marks=pytest.mark.slow)]
)  # between checkpoints, in the middle of episodes
def test_a_resumed_run_is_the_run_that_was_left_alone(finished, tmp_path, blocks):
    out, whole, _ = finished
    values = [FISH.space.published]
    begun = train(SHORT, values, FISH, tmp_path / "run", disturbances=ANY_PHASE, stop=stop_after(blocks))
    assert not begun.complete
    assert begun.step == 200 * blocks
    ended = train(SHORT, values, FISH, tmp_path / "run", disturbances=ANY_PHASE, resume=True)
    assert ended.complete
    assert ended.gradient_steps == whole.gradient_steps
    assert_same_policy(tmp_path / "run", out)
    for name in (EPISODES, EVALUATIONS):
        assert read_record(tmp_path / "run" / name) == read_record(out / name)


@pytest.mark.slow
def test_a_target_run_resumes_within_its_long_episodes(tmp_path):
    settings = TrainingSettings("target", 600, exploration=200, updates=1, batch=32, layers=(16, 16), environments=4)
    values = [FISH.space.published]
    train(settings, values, FISH, tmp_path / "whole")
    train(settings, values, FISH, tmp_path / "parts", stop=stop_after(2))
    train(settings, values, FISH, tmp_path / "parts", resume=True)
    assert_same_policy(tmp_path / "parts", tmp_path / "whole")


def test_it_refuses_to_mix_runs(finished):
    out, _, _ = finished
    with pytest.raises(RunError, match="already holds a run; go on with --resume, or choose another folder"):
        train(SHORT, [FISH.space.published], FISH, out)
    other = TrainingSettings("forward", 800, seed=1, exploration=200, checkpoint_every=400, updates=1)
    with pytest.raises(RunError, match="was begun with another seed: 0, now 1; resume with the same"):
        train(other, [FISH.space.published], FISH, out, resume=True)
    with pytest.raises(RunError, match=r"is no training run: it has no settings\.json"):
        train(SHORT, [FISH.space.published], FISH, out.parent / "nowhere", resume=True)
    assert not (out.parent / "nowhere").exists()


def test_checkpoints_that_are_damaged_or_gone(tmp_path):
    settings = TrainingSettings("forward", 400, exploration=200, updates=1, batch=32, layers=(16,), environments=8)
    run, values = tmp_path / "run", [FISH.space.published]
    train(settings, values, FISH, run, stop=stop_after(1))
    checkpoint = run / "checkpoints/step-000000200"
    for name in ("replay.npz", "networks.npz", "episodes.npz", "state.json"):
        whole = (checkpoint / name).read_bytes()
        (checkpoint / name).write_bytes(whole[: len(whole) // 2])
        with pytest.raises(RunError, match=r"step-000000200' is damaged: .*; remove it"):
            train(settings, values, FISH, run, resume=True)
        (checkpoint / name).write_bytes(whole)
    shutil.rmtree(checkpoint)
    again = train(settings, values, FISH, run, resume=True, stop=stop_after(1))  # begins anew
    assert (again.step, again.complete) == (200, False)


def test_the_rules_for_short_runs():
    paper = TrainingSettings("forward")
    assert (paper.exploration_steps, paper.updates_a_block, paper.replay) == (50_000, 1, 1_000_000)
    short = TrainingSettings("forward", 300_000)
    assert (short.exploration_steps, short.updates_a_block) == (30_000, 17)
    assert short.total_steps // 200 * short.updates_a_block == pytest.approx(25_000, rel=0.03)
    assert TrainingSettings("forward", 2_000).updates_a_block == 200  # one a transition
    assert TrainingSettings("forward", 26_000).updates_a_block == 193
    assert TrainingSettings("forward", 2_000, updates=500).updates_a_block == 500  # who asks for more gets more


def test_settings_out_of_range_are_refused():
    with pytest.raises(ArgumentError, match="environments is 3; it must divide 200"):
        TrainingSettings("forward", environments=3)
    with pytest.raises(ArgumentError, match="env_steps is 100; learning needs 200 at least"):
        TrainingSettings("forward", 100)
    with pytest.raises(ArgumentError, match="exploration is 300; it must be 0 or more and below env_steps"):
        TrainingSettings("forward", 300, exploration=300)


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
    again = Curriculum((1, 2, 3))
    again.restore(curriculum.state())
    assert again.stage == 2


@pytest.mark.slow
def test_threads_change_nothing(finished, tmp_path):
    out, _, _ = finished
    train(SHORT, [FISH.space.published], FISH, tmp_path / "run", disturbances=ANY_PHASE, threads=3)
    assert_same_policy(tmp_path / "run", out)
    assert read_record(tmp_path / "run" / EPISODES) == read_record(out / EPISODES)


def test_no_file_of_a_run_holds_a_pickle(finished):
    out, _, _ = finished
    for path in out.rglob("*.npz"):
        with np.load(path, allow_pickle=False) as arrays:
            assert all(arrays[name].dtype != object for name in arrays)
    files = [path for path in out.rglob("*") if path.is_file() and "tfevents" not in path.name and path.name != LOCK]
    assert {path.suffix for path in files} == {".json", ".jsonl", ".npz"}


def test_a_policy_is_the_network_that_learned(finished):
    torch = pytest.importorskip("torch")
    from swim2real.rl.actor import Actor
    from swim2real.rl.environment import make_environments
    from swim2real.rl.learner import Learner
    from swim2real.rl.vector import RobotVecEnv

    learner = Learner(SHORT, RobotVecEnv(make_environments("forward", None, 8)), 0.99)
    actor, seen = learner.actor, np.random.default_rng(0).standard_normal((5, 52)).astype(np.float32)
    expected = learner._sac.predict(seen, deterministic=True)[0]
    np.testing.assert_allclose(actor.best(seen), expected, atol=1e-6)
    samples = np.array([actor.sample(seen, np.random.default_rng(i)) for i in range(2000)])
    with torch.no_grad():
        mean, log_std, _ = learner._sac.actor.get_action_dist_params(torch.from_numpy(seen))
    before_tanh = np.arctanh(np.clip(samples, -1 + 1e-9, 1 - 1e-9))
    np.testing.assert_allclose(before_tanh.mean(axis=0), mean.numpy(), atol=0.1)
    np.testing.assert_allclose(before_tanh.std(axis=0), np.exp(log_std.numpy()), rtol=0.1)
    path = finished[0] / "policy.npz"
    kept = Actor.load(path)
    assert (kept.inputs, len(kept.mean.bias)) == (52, 1)

"""Policies for other programs: ONNX, which many run, and Stable-Baselines3's .zip, which `SAC.load` trains on."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from swim2real.rl.actor import Actor
from swim2real.rl.rollout import Which, load_policy
from swim2real.rl.training_run import SETTINGS, TrainingRun
from swim2real.settings import TrainingSettings
from swimbase.checking import read
from swimbase.errors import ArgumentError, MissingExtraError, RunError
from swimbase.store import whole_file, write_bytes, writing

_OPSET, _IR = 17, 8  # as old as the graph allows, so that older runtimes read it


def export_policy(policy: str | Path, out: str | Path, *, which: Which = "best", robot: str | None = None) -> Path:
    """Writes a policy for other programs, by the ending of the file.

    `.onnx` has one input `observations` (N, n) and one output `actions` (N, A), from -1 to 1, both float32, and as
    metadata where in an observation each part is and the names of the actuators. `.zip` is of Stable-Baselines3, from
    the last checkpoint: networks, optimizers, entropy coefficient and settings of the run, without the replay buffer.

    Args:
        policy: Folder that `train` wrote.
        out: File to write, .onnx or .zip.
        which: For .onnx: `best` in the evaluations while it learned, or `last`.
        robot: Robot file of the policy, if it has moved.

    Returns:
        The file.

    Raises:
        ArgumentError: The file ends otherwise, or can't be written.
        RunError: The folder has no such policy, or no checkpoint.
        MissingExtraError: The library for the file isn't installed.
    """
    run, path = TrainingRun.open(policy, robot=robot), Path(out)
    if path.suffix not in (".onnx", ".zip"):
        raise ArgumentError(f"--out is '{path}'; it must end in .onnx, or in .zip for Stable-Baselines3")
    if path.suffix == ".zip":
        _write_zip(run, path)
        return path
    content = _onnx(load_policy(run, which))
    with writing(path, ArgumentError, what="--out"):
        write_bytes(path, content)
    return path


def _onnx(actor: Actor) -> bytes:
    """The means of an actor's actions as an ONNX model."""
    try:
        from onnx import TensorProto, checker, helper, numpy_helper
    except ModuleNotFoundError as error:
        raise MissingExtraError(f".onnx needs {error.name}; install it with: pip install 'swim2real[onnx]'") from error
    nodes, weights, name = list[Any](), list[Any](), "observations"
    for i, layer in enumerate((*actor.hidden, actor.mean)):
        weights += [
            numpy_helper.from_array(layer.weight, f"weight{i}"),
            numpy_helper.from_array(layer.bias, f"bias{i}"),
        ]
        last = i == len(actor.hidden)
        ends = "actions" if last else f"features{i}"
        nodes += [
            helper.make_node("Gemm", [name, f"weight{i}", f"bias{i}"], [f"sum{i}"]),
            helper.make_node("Tanh" if last else "Relu", [f"sum{i}"], [ends]),
        ]
        name = ends
    sizes = {"observations": len((*actor.hidden, actor.mean)[0].weight), "actions": len(actor.mean.bias)}
    tensors = [helper.make_tensor_value_info(k, TensorProto.FLOAT, ["N", size]) for k, size in sizes.items()]
    graph = helper.make_graph(nodes, "policy", tensors[:1], tensors[1:], weights)
    opset = [helper.make_opsetid("", _OPSET)]
    model = helper.make_model(graph, opset_imports=opset, ir_version=_IR, producer_name="swim2real")
    helper.set_model_props(model, {key: json.dumps(value) for key, value in actor.about.model_dump().items()})
    checker.check_model(model)
    return model.SerializeToString()


def _write_zip(run: TrainingRun, path: Path) -> None:
    """Writes the last checkpoint as a .zip of Stable-Baselines3."""
    from swim2real.rl.environment import make_environments
    from swim2real.rl.learner import Learner, RobotVecEnv, list_checkpoints

    found = read(TrainingSettings, run.folder / SETTINGS, "training settings", RunError)
    settings = replace(found, task=run.task)
    whole = [checkpoint for checkpoint in list_checkpoints(run.folder) if checkpoint.resumable]
    if not whole:
        raise RunError(f"'{run.folder}' has no checkpoint to train on from; give a folder as `swim2real train` left it")
    environments = make_environments(
        settings.task, run.settings.parameters, settings.environments, robot=run.robot,
        disturbances=run.settings.disturbances,
    )  # fmt: skip
    with closing(environments):
        discount = environments.task.discount if settings.discount is None else settings.discount
        learner = Learner(settings, RobotVecEnv(environments), discount)
        with whole[-1].errors():
            whole[-1].load(learner)
        with writing(path, ArgumentError, what="--out"), whole_file(path) as part:
            learner.save_zip(part, whole[-1].step)

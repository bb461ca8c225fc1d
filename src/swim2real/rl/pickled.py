"""Files of earlier versions that hold pickles: weights of networks, and policies of version 0.1.

torch is told to load weights only, which refuses what else a pickle may do. Its loader isn't made for hostile files all
the same, so a person allows it before: `--allow-code`.
"""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZipFile

import numpy as np

from swim2real import consent
from swim2real.errors import MissingExtraError, RunError
from swim2real.rl.actor import Actor

_WEIGHTS = "policy.pth"  # in an archive of Stable-Baselines3
_LAYERS = {"mu": "mean", "log_std": "log_std"}
_TARGET_ORDER = (*range(16), 21, *range(16, 21))  # `target` of 0.1 observed the previous action last


def check_allowed(path: Path, what: str, *, allow_code: bool = False) -> None:
    """Checks that a person has allowed to load the pickle in a file.

    Args:
        path: Path of the file.
        what: What it is, such as "a policy of version 0.1".
        allow_code: Allow it now, and remember that.

    Raises:
        ConsentError: Nobody has.
    """
    mark = hashlib.sha256(b"pickle " + path.read_bytes()).hexdigest()
    told = f"'{path}' is {what} and holds a pickle, which could run code when it is loaded"
    consent.require(consent.Request(consent.CODE, mark, told), allowed=allow_code)


def read_tensors(file: BinaryIO) -> Any:
    """Dictionaries of tensors that torch has written.

    Raises:
        MissingExtraError: torch isn't installed.
        ValueError: The file is damaged, or holds something else.
    """
    try:
        import torch
    except ModuleNotFoundError as error:
        raise MissingExtraError("weights in a pickle need torch; install it: pip install 'swim2real[rl]'") from error
    try:
        return torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:  # torch and pickle raise errors of many types for a damaged file
        why = (str(error).splitlines() or [type(error).__name__])[0]
        raise ValueError(f"torch can't read its weights: {why}") from error


def read_old_policy(path: Path, task: str) -> Actor:
    """Reads the actor of a policy of version 0.1, an archive of Stable-Baselines3.

    Args:
        path: Path of the archive.
        task: Task of the policy, whose observations may have another order now.

    Raises:
        MissingExtraError: torch isn't installed.
        RunError: The file is damaged.
    """
    try:
        with ZipFile(path) as archive:
            content = read_tensors(io.BytesIO(archive.read(_WEIGHTS)))
        names = [name for name in content if name.startswith("actor.latent_pi.") and name.endswith(".weight")]
        hidden = {f"latent_pi.{name.split('.')[2]}": f"hidden{i}" for i, name in enumerate(names)}
        arrays: dict[str, Any] = {}
        for name, layer in {**hidden, **_LAYERS}.items():
            arrays[f"{layer}.weight"] = np.array(content[f"actor.{name}.weight"].numpy().T, order="C")
            arrays[f"{layer}.bias"] = content[f"actor.{name}.bias"].numpy()
        if task == "target" and hidden:
            arrays["hidden0.weight"] = arrays["hidden0.weight"][list(_TARGET_ORDER)]
        return Actor.from_arrays(arrays)
    except MissingExtraError:
        raise
    except Exception as error:  # as many for an archive
        raise RunError(f"policy '{path}' is damaged: {error}; take another one, or train anew") from error

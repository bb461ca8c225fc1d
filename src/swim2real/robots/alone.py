"""A model is compiled alone, in a process with limits, before this process trusts itself to compile it.

That process runs this module; its last line is what MuJoCo said, as JSON: an error, or an empty text.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from swim2real.errors import RobotError

SECONDS = 60  # that a model may take
MEMORY = 4 << 30  # bytes of address space, on Linux
_PROGRAM = "swim2real.robots.alone"
_OF_MEMORY = ("allocate", "unknown exception", "bad_alloc", "MemoryError")  # in what is said when there is none
_OF_TIME = ("SIGXCPU", "SIGKILL")


def compile_alone(path: Path, where: str = "") -> None:
    """Compiles a model in a process of its own and computes its first state.

    A model that MuJoCo refuses in an orderly way is none of its concern: the caller gets the same refusal.

    Args:
        path: MJCF file.
        where: What a message begins with.

    Raises:
        RobotError: The model crashes MuJoCo, or takes too long or too much memory.
    """
    words = [sys.executable, "-P", "-m", _PROGRAM, str(path.resolve()), str(SECONDS), str(MEMORY)]
    modules = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}  # this one, wherever it is
    try:
        ended = subprocess.run(
            words, stdin=subprocess.DEVNULL, capture_output=True, timeout=SECONDS, check=False, env=modules
        )
    except subprocess.TimeoutExpired:
        raise RobotError(_sentence(path, where, f"takes MuJoCo more than {SECONDS} s")) from None
    answer = _answer(ended.stdout)
    said = ended.stderr.decode("utf-8", "replace") if answer is None else answer
    how = _signal(ended.returncode)
    if any(word in said for word in _OF_MEMORY):
        raise RobotError(_sentence(path, where, f"takes MuJoCo more than {MEMORY / 2**30:g} GiB of memory"))
    if how in _OF_TIME:
        raise RobotError(_sentence(path, where, f"takes MuJoCo more than {SECONDS} s, or too much memory"))
    if ended.returncode != 0 or answer is None:
        last = " ".join(said.strip().split("\n")[-1].split())
        raise RobotError(_sentence(path, where, f"crashes MuJoCo ({how}{f': {last}' if last else ''})"))


def _answer(output: bytes) -> str | None:
    """What MuJoCo said of the model, an empty text where all is well; None where the process ended before."""
    try:
        answer: Any = json.loads(output.decode("utf-8", "replace").splitlines()[-1])
    except (ValueError, IndexError):
        return None
    return str(answer)


def _signal(code: int) -> str:
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit code {code}"


def _sentence(path: Path, where: str, what: str) -> str:
    return f"{where}model '{path}' {what}; make it smaller, or look for what is wrong in it"


def _limit(seconds: int, size: int) -> None:
    """Limits this process's time [s] and memory [bytes], where the system can; it leaves no memory image behind."""
    try:
        import resource
    except ImportError:  # Windows; the parent's clock is left
        return
    for kind, soft, hard in (
        (resource.RLIMIT_CPU, seconds, seconds + 1), (resource.RLIMIT_AS, size, size), (resource.RLIMIT_CORE, 0, 0),
    ):  # fmt: skip
        with suppress(ValueError, OSError):
            resource.setrlimit(kind, (soft, hard))


def _main(path: str, seconds: str, size: str) -> None:
    """Compiles a model and computes its first state; imports MuJoCo alone, so that it is quick to start."""
    import mujoco

    _limit(int(seconds), int(size))
    said = ""
    try:
        model = mujoco.MjSpec.from_file(path).compile()
        mujoco.mj_forward(model, mujoco.MjData(model))
    except Exception as caught:
        said = f"{type(caught).__name__}: {caught}"
    sys.stdout.write("\n" + json.dumps(said))


if __name__ == "__main__":
    _main(*sys.argv[1:])

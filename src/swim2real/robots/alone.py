"""A model is kept from the rest: compiled in a process with limits, and read by a thread that sees only its folder.

That process runs this module; its last line is what MuJoCo said, as JSON: an error, or an empty text. The thread is
confined by Linux's Landlock, so that whatever MuJoCo's parser finds in a text, nothing else is opened.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import struct
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from swimbase.errors import RobotError

SECONDS = 60  # that a model may take
MEMORY = 4 << 30  # bytes of address space, on Linux
_PROGRAM = "swim2real.robots.alone"
_OF_MEMORY = ("allocate", "unknown exception", "bad_alloc", "MemoryError")  # in what is said when there is none
_OF_TIME = ("SIGXCPU", "SIGKILL")
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # Landlock's system calls, of <asm/unistd.h>
_READ_FILE, _PATH_BENEATH = 1 << 2, 1  # of <linux/landlock.h>
_PR_SET_NO_NEW_PRIVS = 38  # of <sys/prctl.h>
T = TypeVar("T")


def compile_alone(path: Path, where: str = "", *, confined: bool = True) -> None:
    """Compiles a model in a process of its own and computes its first state.

    A model that MuJoCo refuses in an orderly way is none of its concern: the caller gets the same refusal.

    Args:
        path: MJCF file.
        where: What a message begins with.
        confined: Whether it can open files in the model's folder alone, as `within` has it.

    Raises:
        RobotError: The model crashes MuJoCo, or takes too long or too much memory.
    """
    words = [sys.executable, "-P", "-m", _PROGRAM, str(path.resolve()), str(SECONDS), str(MEMORY), "1" * confined]
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


def within(folder: Path, read: Callable[[], T]) -> T:
    """Calls a function in a thread that can open files in one folder and below it, and no others.

    Only where the system has Landlock: Linux from 5.13 on. Elsewhere the thread can open all files.
    """
    with ThreadPoolExecutor(1, initializer=_confine, initargs=(folder,)) as thread:
        return thread.submit(read).result()


def _confine(folder: Path) -> None:
    """Takes from this thread, and from those that it starts, the right to open files elsewhere, where it can."""
    if sys.platform != "linux":
        return
    libc, attributes = ctypes.CDLL(None, use_errno=True), struct.pack("=Q", _READ_FILE)
    rules = libc.syscall(_CREATE_RULESET, attributes, len(attributes), 0)
    if rules < 0:
        return
    place = os.open(folder, os.O_PATH)
    try:
        libc.syscall(_ADD_RULE, rules, _PATH_BENEATH, struct.pack("=Qi", _READ_FILE, place), 0)
        libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
        libc.syscall(_RESTRICT_SELF, rules, 0)
    finally:
        os.close(place)
        os.close(rules)


def _answer(output: bytes) -> str | None:
    """Answer of MuJoCo about the model, an empty text if all is well; None if the process ended before."""
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


def _main(path: str, seconds: str, size: str, confined: str) -> None:
    """Compiles a model and computes its first state; imports MuJoCo alone, so that it is quick to start."""
    import mujoco

    _limit(int(seconds), int(size))
    if confined:
        _confine(Path(path).parent)
    said = ""
    try:
        model = mujoco.MjSpec.from_file(path).compile()
        mujoco.mj_forward(model, mujoco.MjData(model))
    except Exception as caught:
        said = f"{type(caught).__name__}: {caught}"
    sys.stdout.write("\n" + json.dumps(said))


if __name__ == "__main__":
    _main(*sys.argv[1:])

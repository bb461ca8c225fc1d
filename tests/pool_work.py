"""What tests give to processes: functions of a module that is quickly imported."""

import ctypes
import os
import signal
import time
from pathlib import Path

from swimbase.errors import TrialError

NAME = "unset"


def alive(pid: int) -> bool:
    try:
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


def square_and_process(number: int) -> tuple[int, int]:
    return number**2, os.getpid()


def set_name(name: str) -> None:
    global NAME
    NAME = name


def get_name() -> str:
    return NAME


def die(path: Path, times: int) -> int:
    """Kills its process the first few times."""
    with path.open("a") as file:
        file.write("x")
    count = len(path.read_text())
    if count <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return count


def fail() -> None:
    raise TrialError("no beat")


def give_a_function() -> object:
    return lambda: None


def write_slowly(path: Path) -> None:
    """Begins a file, says so by its process id, and removes it when it is interrupted."""
    try:
        path.write_text(str(os.getpid()))
        time.sleep(60)
    except BaseException:
        time.sleep(0.2)
        path.unlink()
        raise


def sleep(path: Path) -> None:
    path.with_suffix(".part").write_text(str(os.getpid()))
    path.with_suffix(".part").replace(path)
    time.sleep(60)


def hold_the_interpreter(path: Path) -> None:
    """Computes without a moment in which Python could hear of anything."""
    path.with_suffix(".part").write_text(str(os.getpid()))
    path.with_suffix(".part").replace(path)
    sum(range(10**13))


def forget_the_parent() -> None:
    """Undoes that Linux ends this process with its parent, as on other systems."""
    ctypes.CDLL(None).prctl(1, 0, 0, 0, 0)

"""The pool of processes: work that is done, fails, dies and is interrupted, and parents that are killed."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError
from pathlib import Path

import pytest

import pool_work
from pool_work import alive
from swim2real.processes import ProcessDiedError, ProcessPool
from swimbase.errors import ArgumentError, TrialError

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="no /proc to find a process in")


def wait_for(path: Path) -> str:
    deadline = time.monotonic() + 60
    while not path.exists() or not path.read_text():
        assert time.monotonic() < deadline, f"{path} doesn't appear"
        time.sleep(0.01)
    return path.read_text()


def test_work_is_done_in_processes_that_are_used_again():
    with ProcessPool(2, initializer=pool_work.set_name, initargs=("ready",)) as pool:
        results = [future.result() for future in [pool.submit(pool_work.square_and_process, n) for n in range(6)]]
        assert pool.submit(pool_work.get_name).result() == "ready"
        assert list(pool.map(pow, (2, 3), (2, 2))) == [4, 9]
    assert [number for number, _ in results] == [0, 1, 4, 9, 16, 25]
    processes = {pid for _, pid in results}
    assert len(processes) <= 2
    assert os.getpid() not in processes
    assert not multiprocessing.active_children()


def test_errors_come_back_work_that_dies_is_done_again_and_the_pool_goes_on(tmp_path):
    with ProcessPool(2) as pool:
        others = [pool.submit(pool_work.square_and_process, number) for number in range(4)]
        with pytest.raises(TrialError, match="no beat"):
            pool.submit(pool_work.fail).result()
        with pytest.raises(Exception, match=r"(?i)pickle|local object"):
            pool.submit(lambda: None).result()
        with pytest.raises(TypeError, match=r"lambda.* can't be sent to another process"):
            pool.submit(pool_work.give_a_function).result()
        assert pool.submit(pool_work.die, tmp_path / "once", 1).result() == 2
        with pytest.raises(ProcessDiedError, match=r"the process died 3 times, .*; run again with --workers 1"):
            pool.submit(pool_work.die, tmp_path / "always", 99).result()
        assert (tmp_path / "always").read_text() == "xxx"
        assert [future.result()[0] for future in others] == [0, 1, 4, 9]
        assert pool.submit(pool_work.square_and_process, 7).result()[0] == 49


def test_an_error_inside_lets_work_clean_up_and_begins_nothing_more(tmp_path):
    half = tmp_path / "half"
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt), ProcessPool(1) as pool:  # noqa: PT012
        running, waiting = pool.submit(pool_work.write_slowly, half), pool.submit(pool_work.fail)
        process = int(wait_for(half))
        raise KeyboardInterrupt
    assert time.monotonic() - began < 30
    assert not half.exists()
    assert isinstance(running.exception(), CancelledError)
    assert waiting.cancelled()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith(("work", "start"))]


@LINUX
def test_work_that_cant_be_interrupted_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr("swim2real.processes._CLEANING_TIME", 0.3)
    with pytest.raises(KeyboardInterrupt), ProcessPool(1) as pool:  # noqa: PT012
        pool.submit(pool_work.hold_the_interpreter, tmp_path / "begun")
        process = int(wait_for(tmp_path / "begun"))
        raise KeyboardInterrupt
    assert not alive(process)


@pytest.mark.skipif(sys.platform == "win32", reason="no Ctrl-C to send")
def test_processes_dont_hear_ctrl_c():
    with ProcessPool(1) as pool:
        _, process = pool.submit(pool_work.square_and_process, 1).result()
        os.kill(process, signal.SIGINT)
        time.sleep(0.1)
        assert pool.submit(pool_work.square_and_process, 2).result() == (4, process)


PARENT = """
import sys
from pathlib import Path
import pool_work
from swim2real.processes import ProcessPool

if __name__ == "__main__":
    work, initializer, *files = sys.argv[1:]
    with ProcessPool(len(files), initializer=getattr(pool_work, initializer, None)) as pool:
        for future in [pool.submit(getattr(pool_work, work), Path(file)) for file in files]:
            future.result()
"""


@LINUX
@pytest.mark.parametrize(("work", "initializer"), [
    ("sleep", ""), ("hold_the_interpreter", ""), ("sleep", "forget_the_parent"),
], ids=["asleep", "holding the interpreter", "as on other systems"])  # fmt: skip
def test_processes_end_when_their_parent_is_killed(work, initializer, tmp_path):
    files = [tmp_path / "0", tmp_path / "1"]
    (tmp_path / "parent.py").write_text(PARENT)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    parent = subprocess.Popen([sys.executable, tmp_path / "parent.py", work, initializer, *files], env=environment)
    try:
        processes = [int(wait_for(file)) for file in files]
        assert all(alive(process) for process in processes)
    finally:
        parent.kill()
        parent.wait()
    deadline = time.monotonic() + 10
    while any(alive(process) for process in processes):
        assert time.monotonic() < deadline, "they go on without their parent"
        time.sleep(0.02)


@pytest.mark.parametrize("count", [0, -5])
def test_a_number_of_workers_is_checked(count):
    with pytest.raises(ArgumentError, match=f"workers is {count}; it must be at least 1"):
        ProcessPool(count)

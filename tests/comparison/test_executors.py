"""Processes that die, stop and fail, and a cluster that isn't there."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError, wait
from pathlib import Path

import pytest

from swim2real.comparison.executors import dask, explained, processes
from swim2real.errors import ArgumentError, MissingExtraError, RunError, TrialError


def where(number: int) -> tuple[int, int]:
    return number, os.getpid()


def dies(path: Path, times: int) -> int:
    """Kills its process the first few times."""
    with path.open("a") as file:
        file.write("x")
    count = len(path.read_text())
    if count <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return count


def fails() -> None:
    raise TrialError("no beat")


def waits(path: Path) -> None:
    path.touch()
    time.sleep(60)


def until(path: Path) -> None:
    deadline = time.monotonic() + 30
    while not path.exists():
        assert time.monotonic() < deadline, f"{path} doesn't appear"
        time.sleep(0.01)


def test_work_is_done_in_processes_that_are_used_again():
    with processes(2) as team:
        found = [future.result() for future in [team.submit(where, number) for number in range(6)]]
        pids = team.pids
    assert [number for number, _ in found] == list(range(6))
    assert {pid for _, pid in found} <= set(pids)
    assert len(pids) <= 2
    assert os.getpid() not in pids
    assert team.pids == []


def test_what_is_raised_there_is_raised_here_and_the_process_goes_on():
    with processes(1) as team:
        with pytest.raises(TrialError, match="no beat"):
            team.submit(fails).result()
        with pytest.raises(Exception, match=r"(?i)pickle"):
            team.submit(lambda: None).result()
        assert team.submit(where, 1).result() == (1, team.pids[0])


def test_work_whose_process_is_lost_is_done_again_and_other_work_is_not_disturbed(tmp_path):
    with processes(2) as team:
        others = [team.submit(where, number) for number in range(4)]
        assert team.submit(dies, tmp_path / "once", 1).result() == 2
        assert [future.result()[0] for future in others] == [0, 1, 2, 3]
        with pytest.raises(RunError, match="its process died 3 times, perhaps for want of memory"):
            team.submit(dies, tmp_path / "ever", 99).result()
        assert (tmp_path / "ever").read_text() == "xxx"
        assert team.submit(where, 7).result()[0] == 7


@pytest.mark.slow
def test_an_error_ends_processes_at_once(tmp_path):
    began = time.monotonic()

    def work() -> None:
        with processes(1) as team:
            futures.extend([team.submit(waits, tmp_path / "begun"), team.submit(where, 2)])
            until(tmp_path / "begun")
            pids.extend(team.pids)
            raise KeyboardInterrupt

    futures, pids = [], []
    with pytest.raises(KeyboardInterrupt):
        work()
    assert time.monotonic() - began < 30
    wait(futures, timeout=10)
    assert isinstance(futures[0].exception(), CancelledError)
    assert futures[1].cancelled()
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("minder")]


@pytest.mark.skipif(sys.platform == "win32", reason="no Ctrl-C to send")
def test_processes_dont_hear_ctrl_c():
    with processes(1) as team:
        (pid,) = {team.submit(where, 1).result()[1]}
        os.kill(pid, signal.SIGINT)
        time.sleep(0.1)
        assert team.submit(where, 2).result() == (2, pid)


def alive(pid: int) -> bool:
    try:
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


ORPHAN = """
import sys, threading
from pathlib import Path
sys.path.insert(0, {tests!r})
from swim2real.comparison.executors import processes
from test_executors import waits
if __name__ == "__main__":
    with processes(1) as team:
        team.submit(waits, Path({begun!r}))
        while not Path({begun!r}).exists():
            pass
        print(*team.pids, flush=True)
        threading.Event().wait()
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc to find a process in")
def test_processes_end_when_their_parent_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(ORPHAN.format(tests=str(Path(__file__).parent), begun=str(tmp_path / "begun")))
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    try:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        assert alive(child)
    finally:
        parent.kill()
        parent.communicate()
    deadline = time.monotonic() + 30
    while alive(child):
        assert time.monotonic() < deadline, "it goes on without its parent"
        time.sleep(0.02)


@pytest.mark.parametrize("count", [-1, -5])
def test_a_number_of_workers_is_checked(count):
    with pytest.raises(ArgumentError, match=f"workers is {count}; it must be at least 1"), processes(count):
        pass


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("local:0", "cluster is 'local:0'; write local:N with a whole number N from 1 on"),
        ("local:two", "cluster is 'local:two'; write local:N with a whole number N from 1 on"),
        ("here", "cluster is 'here'; write tcp://HOST:PORT of a Dask scheduler, or local:N"),
    ],
)
def test_an_address_that_makes_no_sense_is_named(address, says):
    with pytest.raises(ArgumentError, match=says), dask(address, os.getpid, lambda found: None):
        pass


def test_without_dask_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    says = r"a Dask cluster needs dask and distributed; install them with: pip install 'swim2real\[cluster\]'"
    with pytest.raises(MissingExtraError, match=says), dask("local:2", os.getpid, lambda found: None):
        pass


def test_lost_work_is_explained():
    assert explained(RunError("its process died")) == "its process died"
    assert explained(CancelledError()) == "the cluster gave it up; run again to go on"
    assert explained(ValueError("what?")) == "unexpected ValueError: what?"

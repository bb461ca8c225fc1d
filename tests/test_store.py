"""Files that can't be written, and what processes that were killed have left of them."""

import errno
import re
import subprocess
import sys
from pathlib import Path

import pytest

from swim2real.calibration import RunFolder
from swim2real.comparison.compare import _WRITTEN as OF_COMPARISONS
from swimbase import store
from swimbase.errors import RunError
from swimbase.parsing import from_json


@pytest.fixture
def small_files():
    """Lets this process write no file of more than 4 kB, as on a disk that gets full in the middle."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


WRITERS = {
    "text": lambda path: store.write_text(path, "x" * 100_000),
    "bytes": lambda path: store.write_bytes(path, b"x" * 100_000),
    "json": lambda path: store.write_json(path, list(range(100_000))),
    "arrays": lambda path: store.write_arrays(path, {"a": [float(i) ** 0.5 for i in range(10_000)]}),
}


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_a_write_that_fails_in_the_middle_leaves_the_old_file_alone(small_files, write, tmp_path):
    place = tmp_path / "file"
    place.write_text("old")
    with pytest.raises(OSError, match="File too large") as failed:
        write(place)
    assert failed.value.filename == str(place)
    assert place.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_folder_that_cant_be_written_leaves_nothing(small_files, tmp_path):
    def write():
        with store.whole_folder(tmp_path / "step") as part:
            (part / "first").write_bytes(b"x" * 1000)
            (part / "second").write_bytes(b"x" * 100_000)

    with pytest.raises(OSError, match="File too large"):
        write()
    assert list(tmp_path.iterdir()) == []


KILLED = """
import os, shutil, sys
from pathlib import Path
from swimbase import store

folder, name, when = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
owner, calls = (shutil if name == "rmtree" else Path), []
real = getattr(owner, name)

def killed(*args, **keywords):
    calls.append(name)
    return os._exit(9) if len(calls) == when else real(*args, **keywords)

setattr(owner, name, killed)
with store.whole_folder(folder) as part:
    (part / "state").write_text("new")
"""


@pytest.mark.parametrize("again", [True, False])
@pytest.mark.parametrize(("call", "when"), [*(("rmtree", i) for i in (1, 2, 3)), *(("replace", i) for i in (1, 2))])
def test_a_folder_that_is_replaced_is_there_whenever_the_process_is_killed(tmp_path, call, when, again):
    with store.whole_folder(tmp_path / "step") as part:
        (part / "state").write_text("old")
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "step"), call, str(when)], check=False)
    if again:
        with pytest.raises(RuntimeError), store.whole_folder(tmp_path / "step"):
            raise RuntimeError
    else:
        store.remove_leftovers(tmp_path, ["st*"])
    assert [path.name for path in tmp_path.iterdir()] == ["step"]
    assert (tmp_path / "step" / "state").read_text() in ("old", "new")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_disk_is_told_with_the_room_that_is_left(tmp_path):
    place = tmp_path / "record.jsonl"
    place.symlink_to("/dev/full")
    with pytest.raises(OSError, match="No space left") as failed:
        store.append_lines(place, [{"a": 1}])
    assert failed.value.filename == str(place)
    says = rf"No space left on device \([\d.]+ [kMG]B free in '{tmp_path}'; make room\)"
    assert re.fullmatch(says, store.reason(failed.value))


@pytest.mark.parametrize("place", ["a.csv", "a.csv/b", "a.csv/b/c"])
def test_a_file_where_a_folder_would_be_is_named(tmp_path, place):
    (tmp_path / "a.csv").touch()
    with pytest.raises(OSError) as caught:  # noqa: PT011
        (tmp_path / place).mkdir(parents=True)
    assert store.reason(caught.value) == f"'{tmp_path / 'a.csv'}' is a file and no folder; give another place"


def test_a_reason_is_a_sentence_and_says_room_only_of_a_full_disk(tmp_path):
    assert store.reason(PermissionError(errno.EACCES, "Permission denied", str(tmp_path))) == "Permission denied"
    assert store.reason(OSError("odd")) == "odd"
    place = tmp_path / "gone" / "a.json"
    with pytest.raises(RunError) as said, store.writing(place, RunError, "make the folder first", what="table"):
        store.write_json(place, {})
    assert str(said.value) == f"can't write table '{place}': No such file or directory; make the folder first"
    with pytest.raises(RunError) as said, store.writing(tmp_path, RunError):
        store.write_json(place, {})
    assert str(said.value) == f"can't write '{place}': No such file or directory"


def test_what_a_killed_process_left_is_removed_by_the_next_that_has_the_run(tmp_path):
    left = ["settings.json.part", "trials.npz.part", "best.json.part", "advisor/call_0001.json.part"]
    others = ["report.html.part", "holiday.mp4.part", "advisor/call_0001.json"]  # of a report, of others, whole
    (tmp_path / "advisor").mkdir()
    for name in (*left, *others):
        (tmp_path / name).write_bytes(b"x" * 2000)
    (tmp_path / "trials.npz.part").unlink()
    (tmp_path / "trials.npz.part").mkdir()
    with RunFolder(tmp_path).locked():
        assert not [name for name in left if (tmp_path / name).exists()]
        assert all((tmp_path / name).is_file() for name in others)


def test_a_lock_that_is_a_link_empties_nothing(tmp_path):  # as filelock before 3.20.1 did
    (tmp_path / "mine").write_text("mine")
    (tmp_path / ".lock").symlink_to(tmp_path / "mine")
    with pytest.raises(RunError, match="can't write run folder"), RunFolder(tmp_path).locked():
        pass
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.mark.parametrize("link", ["advisor", "advisor/media", "advisor/round_001"])
def test_a_link_to_a_folder_is_neither_written_nor_emptied_through(tmp_path, link):
    outside, run = tmp_path / "outside", tmp_path / "run"
    outside.mkdir()
    (outside / "call_0001.json.part").write_text("mine")
    (run / link).parent.mkdir(parents=True)
    (run / link).symlink_to(outside)
    with pytest.raises(RunError, match=rf"run/{link}' is a link, which isn't written through"), RunFolder(run).locked():
        pass
    assert [file.read_text() for file in outside.iterdir()] == ["mine"]


def test_a_link_among_the_runs_of_a_comparison_is_told(tmp_path):
    (tmp_path / "runs" / "paper").mkdir(parents=True)
    (tmp_path / "runs" / "paper" / "ours").symlink_to(tmp_path)
    with pytest.raises(OSError, match="runs/paper/ours' is a link"):
        store.remove_leftovers(tmp_path, OF_COMPARISONS)


def test_a_record_that_is_a_link_or_too_large_is_left_alone(tmp_path):
    (tmp_path / "mine").write_text("without the end of a line")
    (tmp_path / "record.jsonl").symlink_to(tmp_path / "mine")
    with pytest.raises(RunError, match="is a link, which isn't written through"):
        RunFolder(tmp_path).drop_cut_line()
    assert (tmp_path / "mine").read_text() == "without the end of a line"
    (tmp_path / "record.jsonl").unlink()
    with (tmp_path / "record.jsonl").open("wb") as file:
        file.truncate(3_000_000_000)  # takes no room
    RunFolder(tmp_path).drop_cut_line()
    with pytest.raises(RunError, match=r"record\.jsonl isn't read: it has 3000\.0 MB; at most 256 MB are read"):
        RunFolder(tmp_path).record()


def test_a_name_with_two_values_in_an_object_is_refused():
    with pytest.raises(ValueError, match="'drag' stands there twice"):
        from_json('{"format": 1, "parameters": {"drag": 1.0, "mass": 2.0, "drag": 3.0}}')


@pytest.mark.skipif(sys.platform == "win32", reason="its folders can't be made read-only")
def test_leftovers_that_cant_be_removed_stop_nobody(tmp_path, monkeypatch):
    (tmp_path / "settings.json.part").write_text("{")

    def refuse(self, missing_ok=False):
        raise PermissionError(errno.EACCES, "Permission denied", str(self))

    monkeypatch.setattr(Path, "unlink", refuse)
    store.remove_leftovers(tmp_path, ["settings.json"])
    assert (tmp_path / "settings.json.part").exists()

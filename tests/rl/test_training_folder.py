"""The folder of a training: one process at a time, nothing half written, and a full disk in one sentence."""

import errno
import re

import pytest

pytest.importorskip("torch")

from swim2real.errors import RunError
from swim2real.rl.training_run import locked_folder


def test_a_second_training_into_the_folder_is_refused(tmp_path):
    with (
        locked_folder(tmp_path / "run"),
        pytest.raises(RunError, match=r"another process is training into '.*run'; wait for it or choose another"),
        locked_folder(tmp_path / "run"),
    ):
        pass
    with locked_folder(tmp_path / "run"):
        pass


def test_half_a_checkpoint_is_removed(tmp_path):
    (tmp_path / "checkpoints/step-000000400.part").mkdir(parents=True)
    (tmp_path / "checkpoints/step-000000400.part/replay.npz").write_bytes(b"x")
    (tmp_path / "checkpoints/step-000000200").mkdir()
    (tmp_path / "best.npz.part").write_bytes(b"x")
    with locked_folder(tmp_path):
        assert [path.name for path in (tmp_path / "checkpoints").iterdir()] == ["step-000000200"]
        assert not (tmp_path / "best.npz.part").exists()


def test_a_full_disk_that_others_tell_of_is_a_sentence(tmp_path):
    says = (
        rf"can't write '{tmp_path}': No space left on device \([\d.]+ [kMG]B free in '{tmp_path}'; make room\); "
        "--resume goes on from the last checkpoint, or choose another folder"
    )
    with pytest.raises(RunError) as told, locked_folder(tmp_path):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert re.fullmatch(says, str(told.value))

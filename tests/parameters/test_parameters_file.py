import json
import os
import threading
from pathlib import Path

import pytest

from refused import refusal, says
from swim2real.parameters import Parameter, ParameterSpace, read_parameters, write_parameters
from swimbase.errors import ParameterError

SPACE = ParameterSpace(
    (Parameter("drag", "-", 0.0, 10.0, "", 0.4, log_offset=0.1), Parameter("arm", "m", 0.01, 0.06, "", 0.04))
)
VALUES = {"drag": 0.1 + 0.2, "arm": 1 / 30}
PHYSICS = {"integrator": "implicit", "timestep": 0.001, "fluid_fingerprint": [0.1, 1 / 3]}
LEAST = {"format": 1, "robot": "fish", "parameters": VALUES, "engine": "mujoco 3.13.0"}


@pytest.fixture
def place(tmp_path):
    return tmp_path / "best.json"


def read(place):
    return read_parameters(place, "fish", SPACE)


def test_what_was_written_is_read_back_to_the_last_bit(place):
    write_parameters(place, "fish", VALUES, "mujoco 3.13.0", PHYSICS, loss=0.04, evaluation=3)
    content = read(place.parent)  # the folder stands for its best.json
    assert (content.values, content.engine, content.physics) == (VALUES, "mujoco 3.13.0", PHYSICS)
    assert content.path == place
    assert json.loads(place.read_text())["loss"] == 0.04
    place.write_text(json.dumps(LEAST))  # the documented minimum
    assert (read(place).values, read(place).physics) == (VALUES, None)
    place.unlink()
    assert says(refusal(ParameterError, read, place), str(place), "is not there")
    assert says(refusal(ParameterError, read, place.parent), f"'{place.parent}'", "no run folder", "best.json")


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (b"", ("can't be read as JSON",)), (b'{"format": 1,', ("can't be read as JSON",)),
        (b"\xff\xfe\x00\x80", ("can't be read as JSON",)), (b"[1]", ("[1]",)),
        ({"format": 2}, ("'format' is 2", "1")),
        ({"format": None}, ("'format' is null", "1")),
        ({"robot": "eel"}, ("robot 'eel', not 'fish'",)),
        ({"robot": None}, ("'robot' is null", "a text")),
        ({"parameters": [1, 2]}, ("'parameters' is [1, 2]", "a table of names and values")),
        ({"parameters": {"drag": 1.0}}, ("missing parameter", "arm")),
        ({"parameters": {**VALUES, "arn": 0.03}}, ("'arn'", "did you mean 'arm'")),
        ({"parameters": {**VALUES, "arm": 0.07}}, ("'arm'", "0.07, out of bounds", "0.01 to 0.06 m")),
        ({"parameters": {**VALUES, "drag": float("nan")}}, ("'parameters.drag' is NaN", "finite")),
    ],
)  # fmt: skip
def test_wrong_contents_are_refused(place, content, parts):
    place.write_bytes(content if isinstance(content, bytes) else json.dumps({**LEAST, **content}).encode())
    said = refusal(ParameterError, read, place)
    assert str(place) in said
    assert says(said, *parts)


def test_a_reader_never_sees_half_a_file(place):
    write_parameters(place, "fish", VALUES, "mujoco", PHYSICS)
    done = threading.Event()

    def keep_writing() -> None:
        for k in range(60):
            write_parameters(place, "fish", {"drag": k / 100, "arm": 0.03}, "mujoco", PHYSICS, padding="x" * 5000)
        done.set()

    writer = threading.Thread(target=keep_writing)
    writer.start()
    while not done.is_set():
        read(place)
    writer.join()
    assert read(place).values["drag"] == 0.59
    assert os.listdir(place.parent) == [place.name]


def test_a_write_that_fails_leaves_the_old_file_whole(place, monkeypatch):
    write_parameters(place, "fish", VALUES, "mujoco", PHYSICS)

    def no_space(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", no_space)
    with pytest.raises(OSError, match="No space left"):
        write_parameters(place, "fish", {"drag": 1.0, "arm": 0.03}, "mujoco", PHYSICS)
    assert read(place).values == VALUES

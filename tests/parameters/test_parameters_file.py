import json
import os
import threading
from pathlib import Path

import pytest

from swim2real.errors import ParameterError
from swim2real.parameters import Parameter, ParameterSpace, read_parameters, write_parameters

SPACE = ParameterSpace(
    (Parameter("drag", "-", 0.0, 10.0, "", 0.4, log_offset=0.1), Parameter("arm", "m", 0.01, 0.06, "", 0.04))
)
VALUES = {"drag": 0.1 + 0.2, "arm": 1 / 30}
PHYSICS = {"integrator": "implicit", "timestep": 0.001, "fluid_fingerprint": [0.1, 1 / 3]}


@pytest.fixture
def place(tmp_path):
    return tmp_path / "found.json"


@pytest.fixture
def content():
    return {"format": 1, "robot": "fish", "parameters": dict(VALUES), "engine": "mujoco 3.13.0"}


def read(place):
    return read_parameters(place, "fish", SPACE)


def refusal(place) -> str:
    with pytest.raises(ParameterError) as caught:
        read(place)
    return str(caught.value)


def test_what_was_written_is_read_back_to_the_last_bit(place):
    write_parameters(place, "fish", VALUES, "mujoco 3.13.0", PHYSICS, loss=0.04, evaluation=3)
    content = read(place)
    assert content.values == VALUES
    assert content.engine == "mujoco 3.13.0"
    assert content.physics == PHYSICS
    assert content.path == place
    assert json.loads(place.read_text())["loss"] == 0.04


def test_the_documented_minimum_is_enough(place, content):
    place.write_text(json.dumps(content))
    file = read(place)
    assert file.values == VALUES
    assert file.physics is None


def test_a_run_folder_stands_for_its_best_parameters(tmp_path):
    write_parameters(tmp_path / "best.json", "fish", VALUES, "mujoco 3.13.0", PHYSICS)
    assert read(tmp_path).values == VALUES


def test_a_run_folder_without_a_result_is_refused(tmp_path):
    assert refusal(tmp_path) == f"'{tmp_path}' is no run folder with a result: it has no best.json"


def test_a_file_that_is_not_there_is_named(place):
    assert refusal(place) == f"parameters file '{place}' is not there"


@pytest.mark.parametrize("text", ["", "{", "drag = 1", '{"format": 1,'])
def test_what_is_not_json_is_refused(place, text):
    place.write_text(text)
    assert refusal(place).startswith(f"parameters file '{place}' can't be read as JSON: ")


def test_bytes_that_are_no_text_are_refused(place):
    place.write_bytes(b"\xff\xfe\x00\x80")
    assert refusal(place).startswith(f"parameters file '{place}' can't be read as JSON: ")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 2}, "'format' is 2; it must be 1"),
        ({"format": None}, "'format' is null; it must be 1"),
        ({"robot": "eel"}, "is for robot 'eel', not 'fish'"),
        ({"robot": None}, "'robot' is null; it must be a text"),
        ({"parameters": [1, 2]}, "'parameters' is [1, 2]; it must be a table of names and values"),
        ({"parameters": {"drag": 1.0}}, "missing parameter in '{place}': arm"),
        ({"parameters": {**VALUES, "arn": 0.03}}, "unknown parameter 'arn'; did you mean 'arm'? in '{place}'"),
        (
            {"parameters": {**VALUES, "arm": 0.07}},
            "parameter 'arm' in '{place}' is 0.07, out of bounds; allowed is 0.01 to 0.06 m",
        ),
        (
            {"parameters": {**VALUES, "drag": float("nan")}},
            "'parameters.drag' is NaN; it must be finite",
        ),
        (
            {"parameters": {**VALUES, "drag": "much"}},
            "parameter 'drag' in '{place}' is 'much', not a number; allowed is 0 to 10",
        ),
    ],
)
def test_wrong_contents_are_refused_in_words(place, content, change, message):
    place.write_text(json.dumps({**content, **change}))
    assert message.format(place=place) in refusal(place)


def test_a_list_is_no_parameters_file(place):
    place.write_text("[1]")
    assert refusal(place).startswith(f"parameters file '{place}': [1]")


def test_a_reader_never_sees_half_a_file(place):
    write_parameters(place, "fish", VALUES, "mujoco", PHYSICS)
    done = threading.Event()

    def keep_writing() -> None:
        for k in range(60):
            write_parameters(place, "fish", {"drag": k / 100, "arm": 0.03}, "mujoco", PHYSICS, padding="x" * 5000)
        done.set()

    writer = threading.Thread(target=keep_writing)
    writer.start()
    reads = 0
    while not done.is_set() or reads == 0:
        read(place)
        reads += 1
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

"""Python that a robot file names: it runs once it was allowed, and is asked for again when anything of it changes."""

import importlib
import json
import os
import pickle
import py_compile
import sys
import types
from pathlib import Path

import pytest

from made_robots import ARM, DAMPING, RECORDINGS, ROBOT, made
from swim2real import consent
from swim2real.robots import load_robot
from swimbase.errors import ConsentError, RobotError

TEXT = ROBOT.replace("arm.xml", "python:code.py:model")
CODE = f"""
from pathlib import Path
import mujoco
Path(__file__).with_name("ran").write_text("")
def model():
    return mujoco.MjSpec.from_string('''{ARM}''')
"""


@pytest.fixture
def place(tmp_path) -> Path:
    """A robot file whose code leaves a mark."""
    place = made(tmp_path, TEXT, RECORDINGS, DAMPING)
    (tmp_path / "code.py").write_text(CODE)
    return place


def asked(place, **options) -> str:
    """The sentence with which a robot file is refused; its code hasn't run."""
    ran = place.with_name("ran")
    ran.unlink(missing_ok=True)
    with pytest.raises(ConsentError) as caught:
        load_robot(place, **options)
    assert not ran.exists()
    return str(caught.value)


@pytest.mark.parametrize("markers_only", [False, True])
def test_nothing_runs_before_it_is_allowed_and_the_sentence_says_what_would(place, markers_only):
    sentence = asked(place, markers_only=markers_only)
    size = len(CODE.encode())
    for part in (f"robot file '{place}'", f"'model' of '{place.with_name('code.py')}' ({size:,} bytes, SHA-256 ",
                 "--allow-code", "allow_code=True"):  # fmt: skip
        assert part in sentence
    load_robot(place, markers_only=markers_only, allow_code=True)
    assert place.with_name("ran").exists()


def test_what_was_allowed_is_remembered_also_for_other_processes_and_folders(place, tmp_path, monkeypatch):
    load_robot(place, allow_code=True)
    monkeypatch.setattr(consent, "_marks", set())  # as in the next process
    load_robot(place)
    load_robot(place, markers_only=True)
    moved = tmp_path / "moved"
    moved.mkdir()
    for name in ("arm.toml", "code.py"):
        (moved / name).write_text((tmp_path / name).read_text())
    load_robot(moved / "arm.toml")
    [entry] = json.loads((consent.folder() / consent.FILE).read_text())["allowed"].values()
    assert str(place) in entry["what"]


def test_a_change_of_the_code_or_of_the_robot_file_is_asked_for_again(place):
    load_robot(place, allow_code=True)
    code = place.with_name("code.py")
    code.write_text(CODE + "\n# more\n")
    asked(place)
    code.write_text(CODE)
    load_robot(place)
    place.write_text(place.read_text().replace("upper = 1.0", "upper = 1.1"))
    asked(place)


def test_what_the_code_imports_beside_it_counts(place, tmp_path, monkeypatch):
    code, parts = place.with_name("code.py"), tmp_path / "parts"
    code.write_text("import helper\nimport parts.deeper\n" + CODE)
    parts.mkdir()
    for name in ("helper.py", "unrelated.py", "parts/__init__.py", "parts/deeper.py", "parts/idle.py"):
        (tmp_path / name).write_text("import further\n" if name == "helper.py" else "")
    (tmp_path / "further.py").write_text("")
    sentence = asked(place)
    assert "with 'helper.py', 'parts/__init__.py', 'parts/deeper.py', 'further.py' beside it" in sentence
    monkeypatch.syspath_prepend(tmp_path)
    load_robot(place, allow_code=True)
    counting = ("further.py", "helper.py", "parts/deeper.py")
    for name in (*counting, "unrelated.py", "parts/idle.py"):
        before = (tmp_path / name).read_text()
        (tmp_path / name).write_text(before + "# changed\n")
        if name in counting:
            asked(place)
        else:
            load_robot(place)
        (tmp_path / name).write_text(before)
    for name in ("helper", "further", "parts.deeper", "parts"):
        sys.modules.pop(name, None)


def test_what_is_put_beside_allowed_code_later_isnt_imported(place, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path])
    (tmp_path / "helper.py").write_text("value = 1")
    path = "import sys\nsys.path.insert(0, str(Path(__file__).parent))\nimport helper\n"
    place.with_name("code.py").write_text(CODE.replace("import mujoco\n", f"import mujoco\n{path}"))
    load_robot(place, allow_code=True)
    (tmp_path / "colorsys.py").write_text("raise SystemExit('it ran')")  # a module of Python's own
    (tmp_path / "chunk").mkdir()
    (tmp_path / "chunk" / "__init__.py").write_text("raise SystemExit('it ran')")
    load_robot(place)
    for name in ("colorsys", "chunk"):
        monkeypatch.delitem(sys.modules, name, raising=False)
        with pytest.raises(ConsentError, match=f"would run as module '{name}'.*take it away, or mention it"):
            importlib.import_module(name)
    package = types.ModuleType("installed")  # as a finder of an editable installation brings it
    package.__path__, package.__file__ = [str(tmp_path)], str(tmp_path / "__init__.py")
    monkeypatch.setitem(sys.modules, "installed", package)
    assert importlib.import_module("installed.helper").value == 1
    (tmp_path / "other.py").write_text("value = 2")
    assert importlib.import_module("installed.other").value == 2


def test_a_compiled_copy_of_what_is_imported_beside_it_is_asked_for(place, tmp_path):
    (tmp_path / "helper.py").write_text("")
    place.with_name("code.py").write_text("# helper\n" + CODE)
    load_robot(place, allow_code=True)
    py_compile.compile(str(tmp_path / "helper.py"))
    assert "__pycache__" in asked(place)


@pytest.mark.parametrize("module", ["json", "textwrap", "sys", "mylab.robots", "mine"])
def test_a_module_is_asked_for_and_not_imported_before(tmp_path, monkeypatch, module):
    for name in ("mylab/__init__.py", "mylab/robots.py", "mine.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("raise RuntimeError('it ran')")
    monkeypatch.syspath_prepend(tmp_path)
    place = made(tmp_path, ROBOT.replace("arm.xml", f"python:{module}:model"), RECORDINGS, DAMPING)
    assert "'model' of " in asked(place)
    assert not {"mylab", "mine"} & set(sys.modules)


def test_a_changed_module_of_a_package_is_asked_for_again(tmp_path, monkeypatch):
    package = tmp_path / "ourlab"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "robots.py").write_text(CODE)
    (package / "numbers.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    place = made(tmp_path, ROBOT.replace("arm.xml", "python:ourlab.robots:model"), RECORDINGS, DAMPING)
    load_robot(place, allow_code=True)
    load_robot(place)
    (package / "numbers.py").write_text("x = 1")
    assert f"'model' of module 'ourlab.robots' in '{package}' (3 files)" in asked(place)
    for name in ("ourlab", "ourlab.robots"):
        sys.modules.pop(name, None)


def test_what_a_process_was_allowed_goes_with_the_robot_to_others(place, monkeypatch):
    monkeypatch.setenv(consent.FOLDER, os.devnull)  # where nothing can be remembered
    robot = load_robot(place, allow_code=True)
    sent = pickle.dumps(robot)
    monkeypatch.setattr(consent, "_marks", set())
    asked(place)
    assert pickle.loads(sent).build({"damping": 0.1}).compile().nu == 5
    place.with_name("code.py").write_text(CODE + "\n")
    monkeypatch.setattr(consent, "_marks", set())
    with pytest.raises(ConsentError):
        pickle.loads(sent)


def test_code_of_this_program_needs_no_consent_and_others_that_begin_like_it_do(tmp_path):
    load_robot("fish-extended")
    place = made(tmp_path, ROBOT.replace("arm.xml", "python:swim2real.cli.main:main"), RECORDINGS, DAMPING)
    asked(place)


@pytest.mark.parametrize(
    "hook", ["", ".", ".code", "..", "a/b", "/", "é", "x" * 5000, "folder.py", "pipe.py", "gone.py", "x" * 300 + ".py"]
)
def test_what_is_no_code_is_a_sentence(tmp_path, hook):
    (tmp_path / "folder.py").mkdir()
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.py")
    place = made(tmp_path, ROBOT.replace("arm.xml", f"python:{hook}:model"), RECORDINGS, DAMPING)
    with pytest.raises((RobotError, ConsentError), match=r"python:.*can't be imported|names Python code"):
        load_robot(place)

"""The program as it is used: words in, files, text and an exit code out. What calibrates here is a pendulum."""

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from program import pendulum_words, process

import swim2real
from pools import NAMES
from run_settings import record_of as record
from swim2real.calibration import RunFolder
from swim2real.cli import main
from swim2real.cli.first_screen import EVERYDAY, LINES
from swim2real.robots.fish import FISH
from swim2real.simulation import Engine
from swimbase.errors import TrialError

COMMANDS = (
    "board", "calibrate", "check", "compare", "cut", "demo", "deploy", "ensemble", "evaluate", "export-commands",
    "export-model", "export-policy", "export-tracks", "fetch", "identify", "import-recording", "import-tracks", "init",
    "next", "overlay", "pick", "quality", "report", "rollout", "simulate", "track", "train", "view",
)  # fmt: skip
FIGURES = {  # promised of `evaluate --json`
    "marker_error", "aligned_marker_error", "shape_error", "static_offset", "velocity_error", "left_out_share",
}  # fmt: skip


@pytest.fixture
def calibration(pendulum_folder) -> list[str]:
    return pendulum_words(pendulum_folder)


@pytest.fixture
def run(finished, tmp_path) -> Path:
    """A copy of the finished run."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


def without_warnings(text: str) -> list[str]:
    return [line for line in text.splitlines() if not line.startswith("swim2real: warning: ")]


@pytest.fixture
def parameters(tmp_path):
    """Writes a parameters file with the published values, some of them changed or left out (None)."""

    def write(changes=None, **content):
        values = {**FISH.space.published, **(changes or {})}
        path = tmp_path / "parameters.json"
        kept = {name: value for name, value in values.items() if value is not None}
        path.write_text(json.dumps({"format": 1, "robot": "fish", "parameters": kept, **content}))
        return path

    return write


def test_the_help_lists_every_command_and_each_explains_itself(program):
    assert program("--version").done().out == f"swim2real {swim2real.__version__}\n"
    program()
    assert program.code == 2
    assert "swim2real COMMAND" in program.text
    program("--help").done()
    assert all(f" {command} " in program.text for command in COMMANDS)
    for command in COMMANDS:
        program(command, "--help").done()
        assert f"usage: swim2real {command}" in program.text
        assert program.err == ""


def test_debug_shows_where_it_went_wrong(tmp_path):
    for words in (["quality", str(tmp_path / "nothing"), "--debug"], ["--debug", "quality", str(tmp_path / "nothing")]):
        with pytest.raises(TrialError, match="is not there"):
            main(words)


@pytest.mark.parametrize(
    ("error", "said"),
    [(OSError(errno.EIO, "Input/output error", "swims.csv"), "Input/output error: swims.csv"),
     (KeyboardInterrupt(), "interrupted"),
     (ValueError("no idea"), "unexpected ValueError: no idea; --debug shows where")],
)  # fmt: skip
def test_a_fault_and_an_interruption_are_sentences(program, pool_folder, monkeypatch, error, said):
    def fail(reference):
        raise error

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr("swim2real.trials.load_reference", fail)
    assert program("quality", pool_folder).sentence(1) == said
    signal.signal(signal.SIGINT, before)


def test_a_second_interruption_while_the_first_ends_the_program_changes_nothing():
    code = (
        "import atexit, importlib, os, signal, threading, time\n"
        "cli = importlib.import_module('swim2real.cli.main')\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "press = lambda wait: (time.sleep(wait), os.kill(os.getpid(), signal.SIGINT), time.sleep(0.3))\n"
        "cli.parsed = lambda words: lambda: press(0)\n"
        "atexit.register(press, 0.3)\n"
        "threading.Thread(target=press, args=(0.2,)).start()\n"  # which the end waits for
        "cli.main([])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "swim2real: interrupted\n")


@pytest.mark.slow
def test_a_reader_that_has_gone_is_no_fault(pool_folder):
    program = process("evaluate", "published", "--reference", pool_folder, "--json")
    program.stdout.close()
    assert program.stderr.read() == ""
    assert program.wait(timeout=60) == 0
    program.stderr.close()


@pytest.fixture
def published(program, pool_folder):
    return program("evaluate", "published", "--reference", pool_folder, "--json").done().json


def test_evaluate_as_json_has_the_promised_keys_in_si(program, published, pool):
    assert set(published) > FIGURES | {"horizon", "trials", "loss", "protocol", "engine", "sensitivity"}
    assert published["horizon"] == 4.0  # s
    assert tuple(published["trials"]) == NAMES
    for name, frequency in zip(NAMES, (1.2, 1.6), strict=True):
        trial = published["trials"][name]
        assert set(trial) > FIGURES | {"frequency", "velocity_real", "velocity_simulated", "loss"}
        assert len(trial["marker_errors"]) == len(trial["aligned_marker_errors"]) == 9
        assert trial["frequency"] == pytest.approx(frequency, abs=0.01)  # Hz
        assert trial["velocity_real"] == pytest.approx(pool[name].track.speed, rel=1e-6)  # m/s
        assert trial["velocity_error"] == pytest.approx(abs(trial["velocity_simulated"] - trial["velocity_real"]))
        assert 0 <= trial["phase"] < 2 * np.pi  # rad
        assert 1e-4 < trial["shape_error"] < trial["aligned_marker_error"] < 0.5  # m
    for figure in FIGURES:
        assert published[figure] == pytest.approx(np.mean([t[figure] for t in published["trials"].values()]))
    assert published["loss"] == published["motion_error"]
    assert program.err == ""


def test_evaluate_takes_a_run_and_its_parameters_file(program, finished, calibration):
    best = min(entry["loss"] for entry in record(finished))
    for place in (finished, finished / "best.json"):
        content = program("evaluate", place, "--reference", calibration[1], "--json").done().json
        assert content["loss"] == pytest.approx(best, rel=1e-6)
        assert program.err == ""


def test_parameters_that_were_found_with_other_physics_are_told(program, parameters, pool_folder, tmp_path):
    engine = Engine.of(FISH).as_dict()
    other = [1.1 * force for force in engine["fluid_fingerprint"]]
    file = parameters(engine="mujoco 9.9.9", physics={**engine, "name": "mujoco 9.9.9", "fluid_fingerprint": other})
    program("evaluate", file, "--reference", pool_folder, "--json").done()
    assert program.json["loss"] > 0
    assert program.err.startswith(f"swim2real: warning: {file} was made with mujoco 9.9.9, whose fluid forces differ")
    assert len(program.err.splitlines()) == 1
    program("simulate", file, "--frequency", 1.5, "--seconds", 0.2, "--from-rest", "--out", tmp_path / "f.npz").done()
    assert "swim2real: warning: " in program.err


def simulated(program, path: Path, *words: object) -> dict[str, np.ndarray]:
    program("simulate", "published", *words, "--out", path).done()
    assert program.err == ""
    with np.load(path, allow_pickle=False) as stored:
        return dict(stored)


def test_simulate_from_rest_writes_the_promised_arrays(program, tmp_path):
    words = ("--frequency", 1, 1.5, "--seconds", 1, "--rate", 100, "--from-rest")
    swims = simulated(program, tmp_path / "f.npz", *words)
    assert set(swims) == {"times", "frequencies", "markers", "marker_names"}
    np.testing.assert_allclose(swims["times"], np.arange(101) / 100)
    np.testing.assert_array_equal(swims["frequencies"], [1.0, 1.5])
    assert swims["markers"].shape == (2, 101, 9, 2)
    assert np.isfinite(swims["markers"]).all()
    assert list(swims["marker_names"]) == [f"M{i}" for i in range(9)]
    assert "2 swims of 101 samples" in program.text
    # sample 0 is t = 0: the fish lies straight and at rest, whatever the motor does
    for start in swims["markers"][:, 0]:
        np.testing.assert_allclose(start - start[0], FISH.rest_markers, atol=1e-9)
    assert np.ptp(swims["markers"][:, :, 8, 1], axis=1).min() > 0.01


def test_calibrate_leaves_a_whole_run(finished, calibration):
    names = {path.name for path in finished.iterdir()} - {".lock"}
    assert names == {"settings.json", "record.jsonl", "best.json", "outcome.json", "trials.npz", "report.html"}
    settings = RunFolder(finished).settings()
    assert (settings.budget, settings.seed, settings.protocol) == (4, 0, "playback")
    assert settings.reference == os.path.relpath(calibration[1], finished)
    assert settings.versions["swim2real"] == swim2real.__version__
    entries = record(finished)
    assert len(entries) == 4
    assert json.loads((finished / "best.json").read_text())["loss"] == min(entry["loss"] for entry in entries)


def test_calibrate_ends_with_the_values_that_it_has_found(program, calibration, tmp_path):
    words = ("--out", tmp_path / "run", "--horizon", 1, "--method", "least-squares", "--budget", 6)
    program(*calibration, *words).done()
    best = json.loads((tmp_path / "run" / "best.json").read_text())["parameters"]
    assert "parameter unit value fits about as well" in " ".join(program.out.split())
    for name, value in best.items():
        assert re.search(rf"{name} +\S+ +{value:.4g} +(\S+ to \S+|undetermined)", program.out), (name, program.out)
    assert "Fitted trials" not in program.out
    program(*calibration, *words, "--resume", "--quiet", "--verbose").done()
    assert program.out.index("Fitted trials") < program.out.index("parameter  ")
    assert program.err == ""


@pytest.mark.slow
def test_a_run_says_how_it_goes_and_goes_on(program, calibration, tmp_path, monkeypatch):
    run = tmp_path / "run"
    words = (*calibration, "--out", run, "--method", "random", "--hold-out", "b")
    program(*words, "--budget", 2, "--json").done()
    assert program.json == json.loads((run / "outcome.json").read_text())
    assert [tuple(program.json[part]["trials"]) for part in ("fit", "held_out")] == [("a",), ("b",)]
    lines = without_warnings(program.err)
    assert [line.split()[0] for line in lines] == ["1/2", "2/2"]
    before = (run / "record.jsonl").read_bytes()
    program(*words, "--budget", 3, "--resume", "--sensitivity").done()
    assert (run / "record.jsonl").read_bytes().startswith(before)
    assert program.err.splitlines()[0].endswith("read from the record")
    assert "\x1b" not in program.err + program.out
    assert "Effect on the loss" in program.out
    assert len(RunFolder(run).outcome().sensitivity) == 2
    assert len(record(run)) == 3  # the effects are outside the budget
    monkeypatch.setenv("FORCE_COLOR", "1")  # as if it were a terminal
    program(*words, "--budget", 4, "--resume").done()
    assert "\x1b[" in program.err


def test_a_run_that_is_there_isnt_overwritten(program, run, calibration):
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    sentence = program(*calibration, "--out", run, "--budget", 3).sentence(1)
    assert sentence == f"'{run}' holds a run already; go on with --resume or choose another folder"
    assert {path.name: path.read_bytes() for path in run.iterdir()} == before


@pytest.mark.slow
def test_a_run_is_moved_with_its_reference_and_goes_on(program, pendulum_folder, tmp_path):
    begun, moved = tmp_path / "begun", tmp_path / "else" / "where"
    shutil.copytree(pendulum_folder, begun)
    program(*pendulum_words(begun), "--out", begun / "runs/run", "--budget", 2, "--quiet").done()
    settings = (begun / "runs/run/settings.json").read_text()
    assert json.loads(settings)["reference"] == "../../tracks"
    assert str(tmp_path) not in settings
    moved.parent.mkdir()
    begun.rename(moved)
    program("report", moved / "runs/run").done()
    program(*pendulum_words(moved), "--out", moved / "runs/run", "--budget", 2, "--resume", "--quiet").done()
    assert (moved / "runs/run/settings.json").read_text() == settings
    other = shutil.copytree(moved / "tracks", tmp_path / "other")
    (other / "b.csv").write_text("\n".join((other / "b.csv").read_text().splitlines()[:-1]) + "\n")
    refused = program("identify", moved / "runs/run", "--reference", other)
    assert refused.code == 1
    assert refused.err.rstrip().endswith(f"give the one that it was made with, {moved / 'tracks'}")


def test_report_writes_pages_again(program, run, tmp_path):
    runs = run, Path(shutil.copytree(run, tmp_path / "other"))
    for one in runs:
        (one / "report.html").unlink()
    assert program("report", *runs).done().out.split() == [str(one / "report.html") for one in runs]
    page = runs[1] / "report.html"
    assert not re.search(r"<(script|link|img|iframe)[^>]*\s(src|href)\s*=\s*[\"']?(https?:)?//", page.read_text())


@pytest.mark.parametrize("command", COMMANDS)
def test_the_first_screen_of_a_help_has_what_is_needed_and_names_the_rest(command, program):
    lines = program(command, "--help").done().out.splitlines()
    assert len(lines) <= LINES
    whole = program(command, "--help-all").done().out
    shown = set(re.findall(r"--[a-z][\w-]+", " ".join(lines)))
    explained = re.findall(r"^  (--[a-z][\w-]+)", whole, re.MULTILINE)
    assert set(explained) - {"--parameters"} <= shown  # another name of --robot
    assert set(EVERYDAY.get(command, "").split()) <= {*explained, "--robot"}
    assert f"swim2real {command} --help-all" in lines[-1]
    assert "--allow-code" in whole


def test_options_in_a_file_are_those_of_the_line_which_wins(program, calibration, tmp_path):
    file = tmp_path / "run.toml"
    file.write_text('method = "random"\nbudget = 2\nhorizon = 0.5\nhold_out = ["b"]\nquiet = true\nseed = 3\n')
    program(*calibration, "--config", file, "--out", tmp_path / "run", "--seed", 4).done()
    settings = RunFolder(tmp_path / "run").settings()
    assert (settings.method, settings.budget, settings.horizon, settings.hold_out, settings.seed) == (
        "random", 2, 0.5, ("b",), 4,
    )  # fmt: skip
    assert program.err == ""
    program(*calibration, "--config", tmp_path / "run" / "settings.json", "--out", tmp_path / "again").done()
    assert not settings.difference(RunFolder(tmp_path / "again").settings())
    for text, said in (("seed = [", "can't be read"), ("[a]\nb = 1", "has a table 'a'")):
        file.write_text(text)
        assert said in program(*calibration, "--config", file, "--out", tmp_path / "x").sentence(2)
    assert "--config has no value" in program(*calibration, "--config").sentence(2)

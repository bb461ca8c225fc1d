"""The program as it is used: words in, files, text and an exit code out. What calibrates here is a pendulum."""

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from program import process

import swim2real
from pools import NAMES
from swim2real.calibration import RunFolder
from swim2real.calibration.from_rest import backward_from_rest
from swim2real.cli import main
from swim2real.errors import ParameterError, TrialError
from swim2real.robots.fish import FISH
from swim2real.simulation import Engine

COMMANDS = (
    "board", "calibrate", "check", "compare", "cut", "demo", "deploy", "ensemble", "evaluate", "export-commands",
    "export-model", "fetch", "identify", "import-recording", "import-tracks", "init",
    "overlay", "pick", "quality", "report", "rollout", "simulate", "track", "train", "view",
)  # fmt: skip
SPEC_FIGURES = {  # of the interface's `evaluate --json`
    "marker_error", "aligned_marker_error", "shape_error", "static_offset", "velocity_error", "left_out_share",
}  # fmt: skip
OUR_FIGURES = {"motion_error", "recoil_error", "yaw_error", "sway_error", "progress_error", "unweighted_error"}
SPEC_TRIAL = {"frequency", "velocity_real", "velocity_simulated", "loss"}
OUR_TRIAL = {
    "phase",
    "divergence",
    "marker_errors",
    "aligned_marker_errors",
    "seen_shares",
    "shape_marker_errors",
    "beat_real",
    "beat_simulated",
    "path_beat_real",
    "path_beat_simulated",
    "motion_marker_errors",
    "turn_rate_real",
    "turn_rate_simulated",
    *(f"{side}_{end}" for side in ("yaw", "sway") for end in ("real", "simulated", "real_std", "simulated_std", "lag")),
}


def pendulum_words(folder: Path) -> list[str]:
    return ["calibrate", str(folder / "tracks"), "--robot", str(folder / "pendulum.toml")]


@pytest.fixture
def calibration(pendulum_folder) -> list[str]:
    """The words that calibrate the pendulum."""
    return pendulum_words(pendulum_folder)


@pytest.fixture(scope="session")
def finished(pendulum_folder, tmp_path_factory) -> Path:
    """A finished run of three evaluations. Copy it before changing it."""
    run = tmp_path_factory.mktemp("finished") / "run"
    words = [*pendulum_words(pendulum_folder), "--out", str(run), "--budget", "3", "--quiet"]
    with pytest.raises(SystemExit) as leaving:
        main(words)
    assert leaving.value.code == 0
    return run


@pytest.fixture
def run(finished, tmp_path) -> Path:
    """A copy of the finished run."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


def record(run: Path) -> list[dict]:
    return RunFolder(run).record()


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


# the program itself


def test_the_version_is_told(program):
    assert program("--version").done().out == f"swim2real {swim2real.__version__}\n"


def test_the_help_lists_every_command_and_each_explains_itself(program):
    program("--help").done()
    assert all(f" {command} " in program.text for command in COMMANDS)
    for command in COMMANDS:
        program(command, "--help").done()
        assert f"usage: swim2real {command}" in program.text
        assert program.err == ""


@pytest.mark.parametrize(
    "words",
    [
        ["quality"],
        ["calibrate", "REFERENCE"],
        ["calibrate", "REFERENCE", "--out", "run", "--budget", "many"],
        ["simulate", "published", "--frequency", "fast", "--out", "f.npz"],
        ["fetch"],
        ["track", "f1_50.mp4", "--to", "reference", "--markers", "auto", "--tracker", "guess"],
        ["pick"],
        ["import-tracks", "f1_50.csv", "--to", "reference"],
    ],
    ids=" ".join,
)
def test_words_that_make_no_command_leave_with_2(program, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    program(*words)
    assert program.code == 2
    assert program.out == ""
    assert "Traceback" not in program.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--budget", "0"], "budget is 0; it must be at least 1"),
        (["--horizon", "-1"], "horizon is -1 s; it must be 0 (all of each trial) or above, and finite"),
        (["--threads", "-2"], "threads is -2; it must be 0 (all cores) or above"),
        (["--advisor", "openai:any"], "there is no key for 'openai:any': set the environment variable OPENAI_API_KEY"),
        (["--probes", "17"], "probes is 17; the robot has 2 parameters to measure"),
    ],
    ids=" ".join,
)
def test_wrong_arguments_of_calibrate_are_named_and_nothing_is_written(program, calibration, tmp_path, words, says):
    assert program(*calibration, "--out", tmp_path / "run", *words).sentence(2) == says
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--rate", "-60"], "rate is -60; it must be finite and above 0"),
        (["--seconds", "0"], "seconds is 0; it must be finite and above 0"),
        (["--frequency", "1", "-1"], "frequency is -1; it must be finite and above 0"),
    ],
    ids=" ".join,
)
def test_wrong_arguments_of_simulate_are_named_and_nothing_is_written(program, tmp_path, words, says):
    words = words if "--frequency" in words else ["--frequency", "1", *words]
    out = tmp_path / "f.npz"
    assert program("simulate", "published", *words, "--out", out).sentence(2) == says
    assert not out.exists()


def test_without_a_command_the_commands_are_listed(program):
    program()
    assert program.code == 2
    assert "swim2real COMMAND" in program.text


def test_debug_shows_where_it_went_wrong(tmp_path):
    with pytest.raises(TrialError, match="is not there"):
        main(["quality", str(tmp_path / "nothing"), "--debug"])
    with pytest.raises(ParameterError, match="is not there"):
        main(["--debug", "evaluate", str(tmp_path / "nothing"), "--reference", str(tmp_path)])


def test_a_fault_of_ours_is_a_sentence_unless_debug_is_on(program, pool_folder, monkeypatch):
    def fail(reference):
        raise ValueError("no idea")

    monkeypatch.setattr("swim2real.trials.load_reference", fail)
    assert program("quality", pool_folder).sentence(1) == "unexpected ValueError: no idea; --debug shows where"
    with pytest.raises(ValueError, match="no idea"):
        main(["quality", str(pool_folder), "--debug"])


def test_a_fault_of_the_disk_is_a_sentence(program, pool_folder, monkeypatch):
    def fail(reference):
        raise OSError(errno.EIO, "Input/output error", "swims.csv")

    monkeypatch.setattr("swim2real.trials.load_reference", fail)
    assert program("quality", pool_folder).sentence(1) == "Input/output error: swims.csv"


@pytest.mark.slow
def test_as_a_process_a_refusal_is_one_line_and_debug_a_traceback(tmp_path):
    for words, is_traceback in ((["quality", "nothing"], False), (["quality", "nothing", "--debug"], True)):
        program = process(*words, cwd=tmp_path)
        out, err = program.communicate(timeout=60)
        assert (program.returncode, out) == (1, "")
        assert err.startswith("Traceback" if is_traceback else "swim2real: reference 'nothing' is not there")
        assert (len(err.splitlines()) > 1) == is_traceback


def test_it_runs_as_a_module():
    done = subprocess.run([sys.executable, "-m", "swim2real", "--version"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"swim2real {swim2real.__version__}\n", "")


@pytest.mark.slow
def test_a_reader_that_has_gone_is_no_fault(pool_folder):
    program = process("evaluate", "published", "--reference", pool_folder, "--json")
    program.stdout.close()
    assert program.stderr.read() == ""
    assert program.wait(timeout=60) == 0
    program.stderr.close()


def test_a_plot_that_cant_be_written_is_told(program, pool_folder, tmp_path):
    program("quality", pool_folder, "--plot", tmp_path / "nowhere" / "page.html")
    assert program.code in (1, 2)
    assert str(tmp_path / "nowhere" / "page.html") in program.err
    assert "No such file or directory" in program.err


# evaluate


@pytest.fixture
def published(program, pool_folder):
    return program("evaluate", "published", "--reference", pool_folder, "--json").done().json


def test_evaluate_as_json_has_the_promised_keys(program, published):
    extra = {"horizon", "trials", "loss", "protocol", "engine", "sensitivity"}
    assert set(published) == SPEC_FIGURES | OUR_FIGURES | extra
    assert tuple(published["trials"]) == NAMES
    for trial in published["trials"].values():
        assert set(trial) == SPEC_FIGURES | OUR_FIGURES | SPEC_TRIAL | OUR_TRIAL
        assert len(trial["marker_errors"]) == len(trial["aligned_marker_errors"]) == 9
    assert program.err == ""


def test_evaluate_as_json_is_in_si(published, pool):
    assert published["horizon"] == 4.0  # s
    for name, frequency in zip(NAMES, (1.2, 1.6), strict=True):
        trial = published["trials"][name]
        assert trial["frequency"] == pytest.approx(frequency, abs=0.01)  # Hz
        assert trial["velocity_real"] == pytest.approx(pool[name].track.speed, rel=1e-6)  # m/s
        assert trial["velocity_error"] == pytest.approx(abs(trial["velocity_simulated"] - trial["velocity_real"]))
        assert 0 <= trial["phase"] < 2 * np.pi  # rad
        assert 1e-4 < trial["shape_error"] < trial["aligned_marker_error"] < 0.5  # m
    for figure in SPEC_FIGURES | OUR_FIGURES:
        assert published[figure] == pytest.approx(np.mean([t[figure] for t in published["trials"].values()]))
    assert published["loss"] == published["motion_error"]


def test_evaluate_prints_tables(program, pool_folder, published):
    program("evaluate", "published", "--reference", pool_folder).done()
    for phrase in ("Aligned marker error", "Static offset", "Velocity error", "Per trial", "Aligned error per marker"):
        assert phrase in program.text
    assert f"{1e3 * published['aligned_marker_error']:.1f} mm" in program.text
    assert program.err == ""


def test_evaluate_compares_the_whole_trial_with_horizon_0(program, pool_folder):
    program("evaluate", "published", "--reference", pool_folder, "--horizon", 0, "--json").done()
    assert program.json["horizon"] is None


def test_evaluate_by_the_papers_protocol(program, pool_folder):
    program("evaluate", "published", "--reference", pool_folder, "--protocol", "paper", "--json").done()
    content = program.json
    assert content["protocol"] == "paper"
    assert content["loss"] == content["marker_error"]
    assert content["trials"][NAMES[0]]["frequency"] == 1.2  # the nominal one


@pytest.mark.slow
def test_evaluate_tells_each_parameters_effect(program, pool_folder):
    program("evaluate", "published", "--reference", pool_folder, "--sensitivity", "--json").done()
    found = program.json["sensitivity"]
    assert [one["name"] for one in found] == list(FISH.space.names)
    assert {one["verdict"] for one in found} <= {"identified", "weak", "not identified"}


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


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {"fluid_blunt_drag": float("nan")},
            "parameters file {} can't be read as JSON: 'parameters.fluid_blunt_drag' is NaN; it must be finite",
        ),
        ({"motor_arm_length": 0.2}, "parameter 'motor_arm_length' in {} is 0.2, out of bounds; allowed is 0.01 to 0.0"),
        ({"fluid_blunt_drag": "0.4"}, "parameter 'fluid_blunt_drag' in {} is '0.4', not a number"),
        ({"fluid_bluntdrag": 0.4}, "unknown parameter 'fluid_bluntdrag'; did you mean 'fluid_blunt_drag'?"),
        ({"hinge_damping_3": None}, "missing parameter in {}: hinge_damping_3"),
    ],
    ids=["nan", "out of bounds", "text", "unknown", "missing"],
)
def test_wrong_parameters_are_named(program, parameters, pool_folder, changes, says):
    file = parameters(changes)
    for words in (["evaluate", file, "--reference", pool_folder], ["simulate", file, "--frequency", 1, "--out", "f"]):
        assert program(*words).sentence(2).startswith(says.format(f"'{file}'"))


@pytest.mark.parametrize(
    ("content", "says"),
    [({"format": 2}, "'format' is 2"), ({"robot": "eel"}, "no robot 'eel'; there are fish, fish-extended")],
    ids=["format", "robot"],
)
def test_a_parameters_file_for_something_else_is_refused(program, parameters, pool_folder, content, says):
    assert says in program("evaluate", parameters(**content), "--reference", pool_folder).sentence(2)


def test_parameters_that_arent_there_are_named(program, pool_folder, tmp_path):
    place = tmp_path / "nothing"
    assert f"'{place}' is not there" in program("evaluate", place, "--reference", pool_folder).sentence(2)
    assert "has no best.json" in program("evaluate", tmp_path, "--reference", pool_folder).sentence(2)
    place.write_text("{")
    assert "can't be read as JSON" in program("evaluate", place, "--reference", pool_folder).sentence(2)


# references that can't be used


def test_a_reference_that_isnt_there_is_named(program, tmp_path):
    assert "is not there" in program("quality", tmp_path / "nothing").sentence(1)
    assert "holds neither reference.json nor any .csv" in program("quality", tmp_path).sentence(1)


# simulate


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


def test_simulate_takes_a_parameters_file(program, parameters, tmp_path):
    out = tmp_path / "f.npz"
    program("simulate", parameters(), "--frequency", 1.2, "--seconds", 0.3, "--from-rest", "--out", out).done()
    with np.load(out) as stored:
        assert stored["markers"].shape == (1, 19, 9, 2)


def test_an_output_that_cant_be_written_is_told(program, tmp_path):
    out = tmp_path / "nowhere" / "f.npz"
    words = ("--frequency", 1.5, "--seconds", 0.1, "--from-rest")
    sentence = program("simulate", "published", *words, "--out", out).sentence(2)
    assert sentence == f"--out '{out}' can't be written: No such file or directory"


# calibrate and report


def test_calibrate_leaves_a_whole_run(finished, calibration):
    names = {path.name for path in finished.iterdir()} - {".lock"}
    assert names == {"settings.json", "record.jsonl", "best.json", "outcome.json", "trials.npz", "report.html"}
    settings = RunFolder(finished).settings()
    assert (settings.budget, settings.seed, settings.protocol) == (3, 0, "playback")
    assert settings.reference == os.path.relpath(calibration[1], finished)
    assert settings.versions["swim2real"] == swim2real.__version__
    entries = record(finished)
    assert len(entries) == 3
    assert json.loads((finished / "best.json").read_text())["loss"] == min(entry["loss"] for entry in entries)


@pytest.mark.slow
def test_calibrate_quietly_only_warns_of_a_fit_that_swims_backward(program, pool_folder, tmp_path, new_fluid_law):
    out = tmp_path / "run"
    program("calibrate", pool_folder, "--out", out, "--budget", 1, "--horizon", 1, "--quiet").done()
    warning = backward_from_rest(RunFolder(out).outcome().to_json()["from_rest"])
    assert warning or new_fluid_law  # a random fish, which with the older lift force swims tail first
    lines = program.err.splitlines()
    assert all(line.startswith("swim2real: warning: ") for line in lines)
    assert (f"swim2real: warning: {warning}" in lines) == bool(warning)
    assert program.out == ""


@pytest.mark.slow
def test_calibrate_tells_its_progress_in_plain_lines_when_piped(program, calibration, tmp_path):
    program(*calibration, "--out", tmp_path / "run", "--budget", 2, "--method", "random").done()
    lines = without_warnings(program.err)
    assert len(lines) == 2
    for number, line in enumerate(lines, start=1):
        assert re.fullmatch(rf"   {number}/2 (best|    ) +[\d.]+ mm  \(best [\d.]+ mm, [a-z ]+, \d+:\d\d left\)", line)
    assert "\x1b" not in program.err + program.out
    assert "Fitted trials" in program.text
    assert f"Report: {tmp_path / 'run' / 'report.html'}" in program.text


@pytest.mark.slow
def test_calibrate_shows_a_bar_on_a_terminal(program, calibration, tmp_path, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")  # as if it were one
    monkeypatch.setenv("COLUMNS", "120")
    program(*calibration, "--out", tmp_path / "run", "--budget", 2, "--method", "random").done()
    assert "\x1b[" in program.err
    shown = re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", program.err)
    assert re.search(r"calibrating .* 2/2 best [\d.]+ mm, 0:00 left", shown)


@pytest.mark.slow
def test_calibrate_as_json_prints_the_outcome_alone(program, calibration, tmp_path):
    words = ("--budget", 2, "--hold-out", "b", "--json")
    program(*calibration, "--out", tmp_path / "run", *words).done()
    content = program.json
    assert content == json.loads((tmp_path / "run" / "outcome.json").read_text())
    assert tuple(content["fit"]["trials"]) == ("a",)
    assert tuple(content["held_out"]["trials"]) == ("b",)
    assert content["sensitivity"] is None
    assert len(without_warnings(program.err)) == 2  # its progress


@pytest.mark.slow
def test_calibrate_tells_each_parameters_effect_at_the_end(program, run, calibration):
    program(*calibration, "--out", run, "--budget", 3, "--resume", "--sensitivity").done()
    assert "Effect on the loss of a tenth of a parameter's range" in program.text
    assert len(RunFolder(run).outcome().sensitivity) == 2
    assert len(record(run)) == 3  # outside the budget


def test_an_unknown_trial_to_hold_out_is_named_with_the_nearest(program, calibration, tmp_path):
    words = (*calibration, "--out", tmp_path / "run", "--hold-out", "c")
    assert program(*words).sentence(1) == "no trial is named 'c'; there are a, b"
    assert not (tmp_path / "run").exists()
    assert "all 2 trials are held out" in program(*words[:-1], "a", "b").sentence(1)


def test_a_run_that_is_there_isnt_overwritten(program, run, calibration):
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    sentence = program(*calibration, "--out", run, "--budget", 3).sentence(1)
    assert sentence == f"'{run}' holds a run already; go on with --resume or choose another folder"
    assert {path.name: path.read_bytes() for path in run.iterdir()} == before


@pytest.mark.slow
def test_a_larger_budget_goes_on_with_a_run(program, run, calibration):
    before = (run / "record.jsonl").read_bytes()
    program(*calibration, "--out", run, "--budget", 4, "--resume").done()
    assert (run / "record.jsonl").read_bytes().startswith(before)
    assert len(record(run)) == 4
    assert [line.split()[:2] for line in program.err.splitlines()[:3]] == [[f"{i}/4", "read"] for i in (1, 2, 3)]


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
    said = program("identify", moved / "runs/run", "--reference", other).sentence(1)
    assert said.endswith(f"give the one that it was made with, {moved / 'tracks'}")


def test_a_run_on_another_reference_is_refused_by_name(program, run, calibration, tmp_path):
    other = Path(shutil.copytree(calibration[1], tmp_path / "other"))
    table = other / "b.csv"
    table.write_text("\n".join(table.read_text().splitlines()[:-1]) + "\n")
    before = (run / "record.jsonl").read_bytes()
    sentence = program("calibrate", other, *calibration[2:], "--out", run, "--budget", 4, "--resume").sentence(1)
    assert "can't go on: reference_fingerprint was" in sentence
    assert (run / "record.jsonl").read_bytes() == before


@pytest.mark.parametrize("below", [False, True], ids=["a file", "below a file"])
def test_a_run_folder_that_cant_be_made_is_told(program, calibration, tmp_path, below):
    file = tmp_path / "file"
    file.write_text("mine")
    out = file / "run" if below else file
    words = (*calibration, "--out", out, "--budget", 1)
    assert program(*words).sentence(1).startswith(f"can't write run folder '{out}': ")
    assert file.read_text() == "mine"


def test_report_writes_the_page_again(program, run):
    page = run / "report.html"
    page.unlink()
    program("report", run).done()
    assert program.out.strip() == str(page)
    assert not re.search(r"<(script|link|img|iframe)[^>]*\s(src|href)\s*=\s*[\"']?(https?:)?//", page.read_text())


def test_a_report_of_no_run_is_refused(program, tmp_path):
    assert program("report", tmp_path).sentence(1) == f"'{tmp_path}' is no run folder: it has no settings.json"


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGINT") or sys.platform == "win32", reason="no Ctrl-C to send")
def test_an_interrupted_run_is_usable_and_goes_on(program, calibration, tmp_path):
    run = tmp_path / "run"
    started = process(*calibration, "--out", run, "--budget", 500, "--method", "random")
    try:
        deadline = time.monotonic() + 60
        while len(record(run)) < 2:
            assert started.poll() is None, started.communicate()[1]
            assert time.monotonic() < deadline, "the run doesn't get on"
            time.sleep(0.01)
        started.send_signal(signal.SIGINT)
        out, err = started.communicate(timeout=60)
    finally:
        started.kill()
        started.wait()
    assert (started.returncode, out) == (1, "")
    *lines, last = err.splitlines()
    assert last == f"swim2real: interrupted; '{run}' is usable as it is, --resume goes on with it"
    assert all(re.match(r" +\d+/500 ", line) for line in lines)
    done = len(record(run))
    losses = [entry["loss"] for entry in record(run)]
    evaluated = program("evaluate", run, "--reference", calibration[1], "--json").done().json
    assert evaluated["loss"] == pytest.approx(min(losses), rel=1e-6)
    words = ("--budget", done + 2, "--method", "random", "--resume", "--quiet")
    program(*calibration, "--out", run, *words).done()
    assert [entry["loss"] for entry in record(run)][:done] == losses
    assert len(record(run)) == done + 2
    best = min(entry["loss"] for entry in record(run))
    assert json.loads((run / "best.json").read_text())["loss"] == best
    assert (run / "report.html").is_file()


def test_an_interruption_before_a_run_began_promises_nothing(program, calibration, tmp_path, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("swim2real.pipeline.calibrate", interrupted)
    assert program(*calibration, "--out", tmp_path / "run").sentence(1) == "interrupted"


# fetch


def test_fetch_from_a_folder_without_the_files_is_refused(program, tmp_path):
    program("fetch", "--to", tmp_path / "tracks", "--from", tmp_path)
    assert program.code == 1
    assert program.out.splitlines()[0] == "markers_f0_50.csv: not there"
    assert program.err.startswith(f"swim2real: '{tmp_path}' holds none of the published files (markers_f0_50.csv, ")
    assert not (tmp_path / "tracks").exists()


def test_fetch_from_a_folder_says_what_it_took(program, shared, tmp_path):
    source = shared / "data" / "fishsim-markers"
    if not source.is_dir():
        pytest.skip(f"no published tracks at {source}")
    program("fetch", "--to", tmp_path / "tracks", "--from", source).done()
    assert "markers_f1_00.csv: taken" in program.text
    assert f"{len(list(source.glob('*.csv')))} trials" in program.text
    assert program("quality", tmp_path / "tracks").code == 1  # some of the published tracks are lost

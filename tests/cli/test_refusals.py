"""What each command refuses: with which exit code, and in one line that has the thing, its value and what to do."""

import json
import shlex
from pathlib import Path

import pytest
from PIL import Image

from refused import says
from small_models import PENDULUM
from swim2real.robots.fish import FISH

HERE = {"format": 1, "robot": "fish", "parameters": FISH.space.published}


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """The folder that the commands are given in, with some files that they can't use."""
    for folder in ("empty", "films", "run", "policy"):
        (tmp_path / folder).mkdir()
    texts = {
        "text": "mine", "films/a.mp4": "", "films/b.MOV": "", "table.csv": "frame,x,y\n0,1,2\n",
        "model.xml": PENDULUM,
        "run/settings.json": '{"format": 1, "robot": "fish", "method": "random"}',
        "policy/settings.json": '{"kind": "training", "robot": "fish", "task": "forward"}',
        "eel.json": json.dumps({**HERE, "robot": "eel"}),
        "far.json": json.dumps({**HERE, "parameters": {**HERE["parameters"], "motor_arm_length": 0.2}}),
    }  # fmt: skip
    for name, content in texts.items():
        (tmp_path / name).write_text(content)
    Image.new("RGB", (64, 48)).save(tmp_path / "picture.png")
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


# PENDULUM: a reference and its robot; POOL: a reference of the fish; FILM: one of the fish, POINTS: its points
REFUSALS = [
    # the program
    ("swim", 2, "there is no command 'swim'. There are demo, "),
    ("chek", 2, "there is no command 'chek'; did you mean 'check'? There are "),
    ("import", 2, "did you mean 'import-tracks' or 'import-recording'?"),
    ("export_model", 2, "did you mean 'export-model'?"),
    # calibrate, identify, next, ensemble
    ("calibrate {PENDULUM} --out new --seeds 5:5", 2, "seeds has '5:5'"),
    ("calibrate {PENDULUM} --out new --advisor openai:any", 2, "no key for 'openai:any'", "OPENAI_API_KEY"),
    ("calibrate {PENDULUM} --out new --resume", 1, "'new' is no run folder", "settings.json"),
    ("calibrate films --out new", 1, "`swim2real pick films/a.mp4 films/b.MOV`",
     "`swim2real track films/a.mp4 films/b.MOV --markers a.points.json b.points.json --to REFERENCE`"),
    ("identify empty --reference {POOL}", 2, "'empty' is no run folder"),
    ("next run --reference {POOL} --seed -1", 2, "--seed is -1", "0 or above"),
    ("ensemble run --reference {POOL} --out gone/e.json", 2, "gone", "is not there, make it first"),
    # evaluate, simulate, export-model
    ("evaluate gone --reference {POOL}", 2, "'gone' is not there"),
    ("evaluate empty --reference {POOL}", 2, "has no best.json"),
    ("evaluate eel.json --reference {POOL}", 2, "no robot 'eel'", "fish, fish-extended"),
    ("simulate far.json --frequency 1 --out f.npz", 2, "'motor_arm_length' in 'far.json' is 0.2", "allowed is 0.01 to"),
    ("simulate published --frequency 1 -1 --out f.npz", 2, "frequency is -1", "finite and above 0"),
    ("simulate published --frequency 1.5 --seconds 0.1 --from-rest --out gone/f.npz", 2,
     "can't write --out 'gone/f.npz'", "No such file"),
    # references and reports
    ("quality gone", 1, "reference 'gone' is not there"),
    ("quality {POOL} --allow-lost 5", 2, "--allow-lost is 5", "within 0 and 1"),
    ("cut {TRACKS} --to {TRACKS} --from 1", 2, "is the reference itself"),
    ("cut {TRACKS} --to new --from 60", 1, "trial 'a' ends at"),
    ("report", 2, "no run was given", "give the folder of a run"),
    ("report policy", 1, "'policy' is a training run, not a calibration", "`swim2real rollout`"),
    # overlay, view
    ("overlay published --reference {POOL} --out text", 2, "can't write 'text'"),
    ("view {ROBOT}", 2, "no display", "--film FILE.mp4"),
    ("view {ROBOT} --trial one --film f.mp4", 2, "--trial is 'one'", "no --reference"),
    ("view {ROBOT} --reference {TRACKS} --trial nine --film f.mp4", 2, "no trial 'nine'", "there are "),
    ("view {ROBOT} --robot {ROBOT} --film f.mp4", 2, "is a robot itself"),
    # init, check
    ("init model.xml --out robot.xml", 2, "--out is 'robot.xml'", ".toml"),
    ("init gone.xml", 2, "model 'gone.xml' is not there", "MJCF"),
    ("init model.xml --out gone/robot.toml", 2, "can't write robot file 'gone/robot.toml'", "No such file"),
    ("check finch", 2, "there is no robot 'finch'", "fish, fish-extended", "(.toml)"),
    ("check {ROBOT} --reference gone", 1, "reference 'gone' is not there", "reference.json"),
    # compare
    ("compare {PENDULUM} --out new --seeds", 2, "seeds is empty", "0:5"),
    ("compare {PENDULUM} --out new --workers -1", 2, "workers is -1", "0 (as many as there are cores)"),
    ("compare {PENDULUM} --out new --workers 2 --cluster local:2", 2, "workers is 2", "leave it out"),
    ("compare {PENDULUM} --out new --once", 2, "--once is for advisor files"),
    ("compare {PENDULUM} --out text/new", 1, "can't write '", "text/new'", "choose another folder"),
    # track, pick, board
    ("track --to new --markers auto", 2, "no video was given"),
    ("track {FILM} {FILM} --to new --markers auto", 2, "two videos would make trial 'f1_25'", "rename one"),
    ("track {FILM} --to new --markers a b", 2, "--markers has 2 files for 1 videos", "auto"),
    ("track {FILM} --to new --markers auto --frequency 1 2", 2, "--frequency has 2 values for 1 videos", "or none"),
    ("track {FILM} --to new --markers auto --frequency nan", 2, "--frequency is nan Hz", "finite and above 0"),
    ("track {FILM} --to text --markers {POINTS} --quiet", 1, "can't write folder 'text/tracks'", "--to"),
    ("track {FILM} --to new --markers {POINTS} --from 2 --quiet", 1, "ends at 0.233 s", "--from is 2 s", "before"),
    ("track {FILM} --to new --markers {POINTS} --from 0.11 --until 0.12 --quiet", 1, "no frame from 0.11 s to 0.12 s"),
    ("track {FILM} --to new --markers {POINTS} --from 0 --until 0.02 --quiet", 1, "one frame only", "at least 2"),
    ("track gone.mp4 --to new --markers auto --quiet", 1, "no video 'gone.mp4'", "check the path"),
    ("pick {FILM} --out gone/page.html", 1, "can't write 'gone/page.html'", "--out"),
    ("pick {FILM} {FILM} --out page.html", 2, "--out 'page.html' is one page for 2 videos", "leave it out"),
    ("pick {FILM} --out page.html --from 9", 1, "ends at 0.200 s", "no frame from "),
    ("board picture.png --squares 9 --square-size 0.02 --to c.json", 2, "--squares is '9'", "such as 9x6"),
    # import-tracks
    ("import-tracks table.csv --to new --fps 0", 2, "--fps is 0", "finite and above 0"),
    ("import-tracks table.csv --to new --fps 60", 1, "table.csv"),
    # a policy
    ("rollout run", 1, "'run' is a calibration, not a training run", "`swim2real train forward --parameters run --out"),
]  # fmt: skip


@pytest.fixture(scope="session")
def places(pendulum_folder, pool_folder, clip) -> dict[str, object]:
    tracks, robot = pendulum_folder / "tracks", pendulum_folder / "pendulum.toml"
    return {
        "PENDULUM": f"{tracks} --robot {robot}", "TRACKS": tracks, "ROBOT": robot, "POOL": pool_folder,
        "FILM": clip.video, "POINTS": clip.points,
    }  # fmt: skip


def files(folder: Path) -> dict[Path, bytes]:
    """All that a command may not leave behind or change; the plan of a comparison may be there."""
    kept = (".lock", "plan.json")
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.name not in kept}


@pytest.mark.parametrize(("line", "code", "parts"), [(line, code, parts) for line, code, *parts in REFUSALS])
def test_a_refusal_is_one_line_and_nothing_is_written(program, here, places, line, code, parts):
    before = files(here)
    assert says(program(*shlex.split(line.format(**places))).sentence(code), *parts)
    assert files(here) == before


@pytest.mark.parametrize(
    "line",
    [
        "quality", "calibrate REFERENCE", "calibrate REFERENCE --out run --budget many", "fetch", "pick",
        "simulate published --frequency fast --out f.npz", "import-tracks f1_50.csv --to reference",
        "track f1_50.mp4 --to reference --markers auto --tracker guess",
    ],
)  # fmt: skip
def test_words_that_make_no_command_leave_with_2(program, here, line):
    before = files(here)
    program(*line.split())
    assert (program.code, program.out) == (2, "")
    assert "Traceback" not in program.err
    assert files(here) == before

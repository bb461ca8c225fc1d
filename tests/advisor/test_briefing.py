"""All that can reach a VLM, whatever the robot: what is written, burned into pictures, and asked of it."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from playbacks import ARM, CART, Swing, compared, evaluated
from waves import EEL_SPACE, Wave, after, compared_waves, eel, evaluate
from worlds import SPACE

from recorded import PENDULUM, PENDULUM_HIDDEN, pendulum_reference
from swim2real.advisor.briefing.prompt import TrialPromptBuilder, close_miss
from swim2real.advisor.vlm.advisor import repair_request
from swim2real.advisor.vlm.exchange import Request
from swim2real.advisor.vlm.files import HOW_TO
from swim2real.calibration import Problem
from swim2real.errors import WaitingForReply
from swim2real.optimizers import Proposal
from swim2real.pipeline import calibrate
from swim2real.rendering.drawing import Canvas
from swim2real.robots.fish import FISH
from swim2real.settings import BriefingSettings, CalibrationSettings, VlmAccess
from swim2real.video import VideoWriter

FISH_WORDS = r"\bfish|\bfins?\b|\btails?\b"
SWIM_WORDS = rf"{FISH_WORDS}|\bbeat|\bswi[mu]|\bswam|\bfrequenc|\bthrust|\bHz\b"
PAIRS = {"a": (Swing(), Swing(0.12)), "b": (Swing(0.2), Swing(0.2, (0.01, 0.0)))}


@pytest.fixture
def burned_in(monkeypatch):
    """What is written into pictures."""
    texts: list[str] = []
    original = Canvas.text

    def text(self, place, text, *more, **others):
        texts.append(text)
        return original(self, place, text, *more, **others)

    monkeypatch.setattr(Canvas, "text", text)
    return texts


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "real.mp4"
    with VideoWriter(path, 64, 48, 10, crf=5) as writer:
        for k in range(60):
            writer.write(np.full((48, 64, 3), 40 + 3 * k, np.uint8))
    return path


def everything(request: Request) -> str:
    """All the text of a question and of its repair."""
    mended = repair_request(request, "{}", "'parameters' is missing", 100)
    parts = [part if isinstance(part, str) else part.label for part in (*request.parts, *mended.parts)]
    return "\n".join([request.instructions, HOW_TO, json.dumps(request.schema), *parts])


def without(text: str, robot) -> str:
    """The text without what the robot itself says."""
    for said in (robot.description, *(one.meaning for one in robot.space)):
        assert said in text
        text = text.replace(said, "")
    return text


def situation(evaluation, dimension: int):
    """The second round after one that was rejected and one that was accepted."""
    proposal = Proposal(np.full(dimension, 0.6), "It is too lively.", "", {"clipped": {"x": 3.0}, "missing": ["y"]})
    worse = replace(evaluation, loss=2 * evaluation.loss)
    better = replace(evaluation, loss=0.5 * evaluation.loss)
    return after(evaluation, (proposal, [worse, worse]), (proposal, [worse, better]))


def asked(robot, space, comparison, evaluation, videos, takes_video=False) -> Request:
    settings = BriefingSettings("both", "auto", "low")
    builder = TrialPromptBuilder(robot, space, lambda values: comparison, videos, settings, takes_video, 2000)
    return builder.question(situation(evaluation, len(space)))


@pytest.mark.parametrize("takes_video", [False, True])
def test_a_robot_that_swims_is_no_fish_unless_it_says_so(takes_video, film, burned_in):
    pairs = [(Wave(f), Wave(f, 0.15)) for f in (0.8, 1.6)]
    videos = {"swim0": film, "swim1": film}
    evaluation = evaluate([0.5, 0.5], pairs)
    request = asked(eel(), EEL_SPACE, compared_waves(pairs), evaluation, videos, takes_video)
    assert len(request.media) == 3
    text = "\n".join([everything(request), *burned_in])
    assert "0.80 Hz" in text
    assert not re.search(FISH_WORDS, text, re.IGNORECASE)


def test_only_the_fishs_own_words_speak_of_one(burned_in):
    amplitudes, behind = tuple(0.01 * np.arange(9)), tuple(10.0 * np.arange(9))
    pairs = [(Wave(amplitudes=amplitudes, behind=behind), Wave(speed=0.2, amplitudes=amplitudes, behind=behind))]
    evaluation = evaluate(np.full(16, 0.5), pairs)
    request = asked(FISH, SPACE, compared_waves(pairs), evaluation, {})
    text = "\n".join([everything(request), *burned_in])
    assert re.search(FISH_WORDS, text)
    rest = without(text, FISH).replace("Name: fish.", "")
    assert not re.search(FISH_WORDS, rest, re.IGNORECASE)


def test_a_rejected_step_that_came_close_is_shown():
    pairs = [(Wave(f), Wave(f, 0.15)) for f in (0.8, 1.6)]
    evaluation = evaluate([0.5, 0.5], pairs)
    far, near, bound = (replace(evaluation, loss=factor * evaluation.loss) for factor in (2.0, 1.1, 1.05))
    proposal = Proposal(np.full(2, 0.6))
    missed = after(evaluation, (proposal, [far, near]), (proposal, [replace(bound, lower_bound=True), far]))
    number, step = close_miss(missed)
    assert (number, step.step_size, step.evaluation) == (1, 0.5, near)
    settings = BriefingSettings("both", "auto", "low")
    comparison = compared_waves(pairs)
    builder = TrialPromptBuilder(eel(), EEL_SPACE, lambda values: comparison, {}, settings, False, 2000)
    last = builder.question(missed).media[-1].label
    losses = f"{1.1e3 * evaluation.loss:.1f} mm, the current point has {1e3 * evaluation.loss:.1f}"
    assert last.startswith(f"Not the current point but the rejected step 0.5 of round 1 ({losses}): trial swim")
    better = replace(evaluation, loss=0.5 * evaluation.loss)
    assert close_miss(after(evaluation, (proposal, [far, near]), (proposal, [better]))) is None
    assert close_miss(after(evaluation, (proposal, [far, far]))) is None


@pytest.mark.parametrize("takes_video", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("robot", [ARM, CART])
def test_recordings_know_neither_fish_nor_swims(robot, takes_video, film, burned_in):
    comparison = compared(PAIRS, robot)
    request = asked(robot, robot.space, comparison, evaluated(comparison, robot), {"a": film, "b": film}, takes_video)
    kind = "video/mp4" if takes_video else "image/png"
    assert [one.media_type for one in request.media] == [kind] * 3
    assert request.media[-1].label.startswith("The real robot in trial ")
    text = "\n".join([everything(request), *burned_in])
    assert "distance of the markers, simulated to real" in text
    assert not re.search(SWIM_WORDS, without(text, robot), re.IGNORECASE)


def test_a_playback_that_diverged_is_asked_about_in_the_same_words(burned_in):
    comparison = compared({"a": PAIRS["a"], "b": (Swing(), "the simulation diverged 1.200 s after its start")}, CART)
    request = asked(CART, CART.space, comparison, evaluated(comparison, CART), {})
    text = "\n".join([everything(request), *burned_in])
    assert "First of all it must run stably." in text
    assert "simulation diverged" in burned_in
    assert not re.search(SWIM_WORDS, without(text, CART), re.IGNORECASE)


def test_a_simulated_pendulum_is_briefed_from_its_robot_alone(burned_in):
    reference = pendulum_reference(noise=1e-3)
    problem = Problem(PENDULUM, reference, threads=2)
    comparison = problem.evaluate(PENDULUM.space.published)
    evaluation = evaluated(comparison, PENDULUM)
    request = asked(PENDULUM, PENDULUM.space, comparison, evaluation, {})
    text = "\n".join([everything(request), *burned_in])
    assert not re.search(SWIM_WORDS, without(text, PENDULUM), re.IGNORECASE)
    for said in ("pivot", "middle", "end", "gyro[1]", "rad/s", *PENDULUM_HIDDEN, "x right, z up", "2.500 s"):
        assert said in text
    assert f"**The loss is {500 * comparison.loss:.1f} mm**" in text  # of the last step, which halved it


@pytest.mark.slow
def test_a_run_of_recordings_is_briefed_by_file(tmp_path):
    reference = pendulum_reference()
    settings = CalibrationSettings(advisor="files", budget=3, horizon=0.5, threads=2)
    folder = tmp_path / "advisor" / "round_001"
    with pytest.raises(WaitingForReply):
        calibrate(reference, PENDULUM, settings, tmp_path, access=VlmAccess(once=True))
    assert sorted(path.name for path in folder.iterdir()) == ["1.png", "2.png", "briefing.md", "reply.schema.json"]
    (folder / "reply.json").write_text('{"parameters": {"elbow_damping": 0.0006}}')
    with pytest.raises(WaitingForReply):
        calibrate(reference, PENDULUM, settings, tmp_path, access=VlmAccess(once=True), resume=True)
    text = (tmp_path / "advisor" / "round_002" / "briefing.md").read_text()
    assert "## Simulated and real motion at the current point" in text
    assert "The first 0.5 s of each trial are compared." in text
    assert "elbow_damping 0.001 → 0.0006" in text
    assert not re.search(SWIM_WORDS, without(text, PENDULUM), re.IGNORECASE)


def test_instructions_are_those_of_the_trials():
    comparison = compared(PAIRS)
    pairs = [(Wave(), Wave(speed=0.2))]
    arm = asked(ARM, ARM.space, comparison, evaluated(comparison), {}).instructions
    swimmer = asked(eel(), EEL_SPACE, compared_waves(pairs), evaluate([0.5, 0.5], pairs), {}).instructions
    assert arm != swimmer
    for said in (
        "1. diagnosis",
        "2. reasoning",
        "3. parameters",
        '{"diagnosis": text',
        "Simulated is blue, real is red.",
    ):
        assert said in arm
        assert said in swimmer
    assert "with trial, marker and time" in arm
    assert "at which frequencies" in swimmer

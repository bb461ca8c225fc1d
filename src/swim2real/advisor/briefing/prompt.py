"""Builds the question of a round: instructions, words, pictures or films."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from swim2real.advisor.briefing.facts import RoundFacts
from swim2real.advisor.briefing.history import describe_history, describe_measured
from swim2real.advisor.briefing.media import DETAILS, gather_media, shorter
from swim2real.advisor.briefing.texts import mm, number, significant, table
from swim2real.advisor.briefing.trials import Axes, describe_trials, trial_label
from swim2real.advisor.vlm.exchange import Request
from swim2real.advisor.vlm.reply import reply_schema
from swim2real.escaping import plain_markdown
from swim2real.objective import TAIL_FIRST_LOSS, Comparison
from swim2real.optimizers import Evaluation, Situation, Step
from swim2real.parameters import ParameterSpace, Values
from swim2real.rendering.album import Album, TrialPictures
from swim2real.robots.drives import Drive
from swim2real.robots.robot import Robot
from swim2real.settings import BriefingSettings

_INSTRUCTIONS = """\
You calibrate a physics simulator of a robot. Each round you are shown how simulated motion differs from the real \
robot's, as pictures or films, as numbers, or both. Simulated is blue, real is red.

Work in this order:
1. diagnosis: name the physical discrepancies that you see or read, {look_for}.
2. reasoning: say which parameters are responsible and which way each must go. Keep effects apart that look alike: \
{alike}. Learn from the history: a direction that was rejected is wrong or too long; don't repeat it.
3. parameters: propose a value for every parameter, within its bounds. Repeat the current value of those you would \
keep. Change the few that explain most rather than all at once: changes that cancel one another teach nothing.

Your proposal is tried at the full change first, then at half of it, then at a quarter; the first that lowers the loss \
is kept. So the direction matters most, and a bold step costs little.

With "probe": true your values are only measured, once, and you are told what they did before you propose: for a \
parameter, or a direction, whose effect you don't know. A probe costs one evaluation, as each step does.

Answer with one JSON object and nothing else: \
{{"diagnosis": text, "reasoning": text, "parameters": {{name: number}}, "probe": false}}. \
Numbers are plain numbers in the units given, without units, text, null or NaN."""
# discrepancies to look for, and effects that look alike: of robots with a steady beat, and of others
_BEAT = (
    "with trial and marker: too much or too little sideways amplitude and where along the body, a wave that travels "
    "too fast or too slow, too much or too little speed and at which frequencies, a body that is bent the wrong way",
    "amplitude can come from a load of the fluid or from stiffness; speed from thrust or from drag. Use how the "
    "differences depend on frequency",
)
_NO_BEAT = (
    "with trial, marker and time: motion that is too wide or too narrow, too early or too late, that dies away too "
    "soon or too late, a pose that is off all the time, a difference that grows, a sensor that reads too much or too "
    "little",
    "motion can be too wide from too little damping, too little stiffness or too much drive; it can come too late from "
    "too much mass or too much damping. Use where, when and in which trials they differ",
)
CLOSE = 1.15  # times the incumbent's loss: a rejected step that is no worse is shown
_PAPER = (
    "The mean distance between the simulated and the real markers over time, markers and trials, in a frame that turns "
    "with the head and advances with it. The simulated robot starts from rest at motor angle 0 and nothing is fitted: "
    "an unknown motor angle at the start and static offsets of the markers count as well."
)
_STARTS = {
    "rest": "at rest in the model's own pose",
    "markers": "in the pose and at the speed that its first frames show",
    "fitted": "in the pose and at the speed with which it meets the first quarter of a second best",
}
_SCALE = {"log": "the logarithmic scale", "linear": "the linear scale"}


class TrialPromptBuilder:
    """Writes the question of a round from the situation. A `PromptBuilder`."""

    def __init__(
        self, robot: Robot, space: ParameterSpace, simulate: Callable[[Values], Comparison], videos: Mapping[str, Path],
        settings: BriefingSettings, takes_video: bool, reply_tokens: int,
        from_rest: Callable[[Values], Mapping[str, float | None]] = lambda values: {},
    ) -> None:  # fmt: skip
        """Prepares the builder.

        Args:
            robot: The robot whose simulator is calibrated.
            space: Its parameters, on the run's scale.
            simulate: Simulates parameter values once more, so that they can be drawn.
            videos: Real films by the names of their trials, where there are any.
            settings: Settings of what is shown.
            takes_video: Whether films are shown, or sheets of pictures.
            reply_tokens: Most tokens of a reply.
            from_rest: Simulates from rest: forward speeds by trial [m/s], None where it diverged.
        """
        self._robot, self._space, self._simulate, self._videos = robot, space, simulate, dict(videos)
        self._settings, self._takes_video, self._reply_tokens = settings, takes_video, reply_tokens
        self._from_rest, self._schema = from_rest, reply_schema(space)

    def question(self, situation: Situation, level: int = 0) -> Request:
        """What is asked in a situation.

        Args:
            situation: Situation of the run.
            level: 0 for the detail of the settings, 1 for the next lower one.
        """
        detail = DETAILS[self._settings.detail]
        detail = shorter(detail) if level else detail
        instructions = instructions_for(self._robot)
        values = self._space.to_values(situation.incumbent.candidate.point)
        known = RoundFacts(situation, self._robot, self._space, self._from_rest(values))
        text = describe(known, numbers=self._settings.show != "pictures", rounds=detail.rounds)
        if self._settings.show == "numbers":
            return Request(instructions, (text,), self._schema, self._reply_tokens)
        scenes = self._scenes(situation.incumbent)
        rejected = self._rejected(situation, scenes)
        media, remarks = gather_media(scenes, detail, self._takes_video, self._videos, rejected)
        kind = "films" if self._takes_video else "pictures"
        intro = " ".join((f"## The {kind}\n\nSimulated is blue, real is red.", *remarks))
        return Request(instructions, (text, intro, *media), self._schema, self._reply_tokens)

    def _scenes(self, evaluation: Evaluation) -> list[TrialPictures]:
        """The trials of an evaluation, simulated once more."""
        return Album(self._simulate(self._space.to_values(evaluation.candidate.point)), self._robot).trials

    def _rejected(self, situation: Situation, here: Sequence[TrialPictures]) -> tuple[str, TrialPictures] | None:
        """The best rejected step since the incumbent was found, where it came close, and the trial it changes most."""
        found = close_miss(situation)
        if found is None:
            return None
        nth, step = found
        there = self._scenes(step.evaluation)
        changed = max(range(len(there)), key=lambda i: abs(there[i].loss - here[i].loss))
        what = f"Not the current point but the rejected step {step.step_size:.3g} of round {nth}"
        if self._settings.show == "both":
            what += f" ({mm(step.evaluation.loss)} mm, the current point has {mm(situation.incumbent.loss)})"
        return what, there[changed]


def close_miss(situation: Situation) -> tuple[int, Step] | None:
    """The best step that was rejected since the incumbent was found, with its round, where its loss came close."""
    since: list[tuple[int, Step]] = []
    for i, finished in enumerate(situation.rounds, start=1):
        whole = [(i, s) for s in finished.steps if not s.evaluation.failed]
        since = [] if finished.accepted else since + whole
    best = min(since, key=lambda one: one[1].evaluation.loss, default=None)
    return best if best is not None and best[1].evaluation.loss <= CLOSE * situation.incumbent.loss else None


def instructions_for(robot: Robot) -> str:
    """The system prompt: what to look for depends on whether the robot's trials have a steady beat."""
    look_for, alike = _BEAT if robot.trials.swims is not None else _NO_BEAT
    return _INSTRUCTIONS.format(look_for=look_for, alike=alike)


def describe(facts: RoundFacts, *, numbers: bool = True, rounds: int | None = None) -> str:
    """All facts of a round as Markdown in plain English, for a VLM or a person.

    It knows no robot: what is special about one is in its description and in its parameters' meanings.

    Args:
        facts: Facts of the round.
        numbers: Whether anything is told that was measured or compared. Without, what stays is the robot, its
            parameters, and which proposals were accepted.
        rounds: How many of the last rounds are told in full; older ones get a line. None for all.
    """
    sections = [f"# Round {len(facts.situation.rounds) + 1}", _robot(facts), _parameters(facts)]
    if numbers:
        sections += [_differences(facts), *filter(None, [describe_measured(facts)])]
    sections.append(describe_history(facts, numbers, rounds))
    return plain_markdown("\n\n".join(sections)) + "\n"


def _robot(facts: RoundFacts) -> str:
    robot, names = facts.robot, facts.robot.marker_names
    markers = f"Markers{', head first' if facts.beats else ''}: {', '.join(names)}."
    links = ", ".join(f"{names[a]} to {names[b]}" for a, b in robot.links)
    if not facts.beats:
        markers += f" Lines in the pictures join {links}." if links else ""
        markers += f" The pictures have {Axes.of(robot).picture}."
    return f"## The robot\n\nName: {robot.name}. {robot.description}\n\n{markers}"


def _parameters(facts: RoundFacts) -> str:
    here, begun = facts.situation.incumbent.candidate.point, facts.situation.first.candidate.point
    rows = [
        [
            one.name, one.unit, *map(significant, (one.lower, one.upper, first, current)), number(place, 2),
            one.meaning,
        ]
        for one, first, current, place in zip(
            facts.space, facts.space.to_values(begun).values(), facts.space.to_values(here).values(), here, strict=True
        )
    ]  # fmt: skip
    how = (
        "Each value is in the unit of its row; answer in the same unit. `current` is the best point so far, from which "
        "you change; `first` is where the run began. `place` says where `current` lies between the bounds, 0 at the "
        f"lower and 1 at the upper one, on {_SCALE[facts.space.scale]} on which steps are taken."
    )
    columns = ("parameter", "unit", "lower", "upper", "first", "current", "place", "meaning")
    return f"## Parameters of the simulator\n\n{how}\n\n{table(columns, rows)}"


def _differences(facts: RoundFacts) -> str:
    """How simulated trials differ from the real ones at the best point so far."""
    trials = facts.here.trials
    parts = ["## Simulated and real motion at the current point", _compared(facts)]
    if facts.situation.incumbent.failed:
        parts.append("The simulation at the current point failed, so it has no loss. First of all it must run stably.")
    diverged = [f"- {trial_label(trial)}: diverged. {trial.divergence}" for trial in trials if trial.divergence]
    if diverged:
        parts.append("\n".join(["These trials have no simulated motion:", *diverged]))
    if not trials:
        return "\n\n".join([*parts, "There are no numbers of this point."])
    return "\n\n".join([*parts, *describe_trials(facts)])


def _compared(facts: RoundFacts) -> str:
    situation, figures = facts.situation, facts.here.figures
    seconds = "All of each trial is compared."
    if figures.horizon:
        seconds = f"The first {figures.horizon:g} s of each trial are compared."
    found = max((nth for nth, finished in enumerate(situation.rounds, start=1) if finished.accepted), default=0)
    loss = ""
    if not situation.incumbent.failed:
        began = f" (first {mm(situation.first.loss)} mm)" if found and not situation.first.failed else ""
        origin = f", found in round {found}" if found else ""
        loss = f"**The loss is {mm(situation.incumbent.loss)} mm**{began}{origin}; lower is better."
    names = "Names of trials are only names; see their frequencies." if facts.beats else ""
    terms = _PAPER if figures.protocol == "paper" else " ".join(_loss_terms(facts.robot, figures.protocol))
    return " ".join(part for part in (loss, terms, seconds, names) if part)


def _loss_terms(robot: Robot, protocol: str) -> list[str]:
    trials = robot.trials
    sentences = ["The mean distance between the simulated and the real markers over time, markers and trials"]
    if trials.frame is None:
        sentences[0] += ", in the world."
    elif protocol == "motion":
        origin, ahead = (robot.marker_names[marker] for marker in trials.frame)
        sentences[0] += (
            ". It is taken in the frame of the trial's path, so that the yaw and the sway of the head count: x points "
            f"along the path, the way that {ahead} lies from {origin}, and the robot goes the other way. A slow turn "
            "of the course is removed."
        )
    else:
        origin, ahead = (robot.marker_names[marker] for marker in trials.frame)
        sentences[0] += f". It is taken in a frame that is fixed to {origin}, with its x axis toward {ahead}."
        if trials.score_progress:
            sentences.append(
                "Along that axis the distance by which the simulated robot has come too far or not far enough is "
                f"added; forward is from {ahead} to {origin}."
            )
    if trials.sensors:
        weights = ", ".join(
            f"1 {sensor.unit} of {sensor.name} as {1e3 * sensor.meters_per_unit:g} mm" for sensor in trials.sensors
        )
        sentences.append(f"The mean error of each sensor is added: {weights}.")
    sentences.append("Lost tracks don't count.")
    if protocol in ("motion", "aligned"):
        sentences.append(
            "The motor's angle at the start is fitted, and static offsets of the markers don't count. The simulated "
            "robot is in its steady motion from the start."
        )
        if protocol == "motion":
            sentences.append(
                f"Where any trial goes backward, last marker first, {1e3 * TAIL_FIRST_LOSS:.0f} mm are added, so that "
                "it is never better than one in which all go forward."
            )
        return sentences
    return [*sentences, _drive(robot), _start(robot), "Neither time nor place is fitted."]


def _drive(robot: Robot) -> str:
    groups: dict[str, list[str]] = {}
    for actuator, control in robot.trials.controls.items():
        groups.setdefault(_command(control), []).append(actuator)
    drive = "; ".join(f"{' and '.join(actuators)}: {command}" for command, actuators in groups.items())
    return f"Each trial is played back under its own commands ({drive})." if drive else "Nothing drives a playback."


def _start(robot: Robot) -> str:
    start = robot.recordings.start
    how = _STARTS.get(start, f"in the model's pose '{start}'")
    return f"It starts {how}, unless the trial says how it started."


def _command(drive: Drive) -> str:
    if drive.table:
        return "as recorded"
    if drive.speed:
        return "a steady speed at the trial's own rate"
    if drive.amplitude:
        around = f" around {drive.offset:g}" if drive.offset else ""
        return f"a sine of {drive.amplitude:g}{around} at the trial's own rate"
    return f"always {drive.offset:g}"

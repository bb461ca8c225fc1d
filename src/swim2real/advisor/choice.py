"""From an advisor's name to the advisor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from swim2real.advisor.briefing.media import Films
from swim2real.advisor.briefing.prompt import FromRest, TrialPromptBuilder
from swim2real.advisor.physics import PhysicsAdvisor, SensitivityAdvisor
from swim2real.advisor.vlm.advisor import REPAIRS, AdvisorEvent, ReplayAdvisor, VlmAdvisor
from swim2real.advisor.vlm.client import ModelClient
from swim2real.advisor.vlm.files import FilesClient
from swim2real.advisor.vlm.instruments import Instruments
from swim2real.advisor.vlm.reply import reply_schema
from swim2real.advisor.vlm.transcript import Transcript, totals
from swim2real.objective import Comparison
from swim2real.optimizers import Advice, Advisor, Measurement, Situation
from swim2real.optimizers.advisor import reads_residuals
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.robot import Robot
from swim2real.settings import FILES, PHYSICS, BriefingSettings, VlmAccess, check_advisor, replayed_run
from swimbase.errors import ArgumentError


@dataclass(frozen=True)
class AdvisorContext:
    """Parts of a run that an advisor needs which is shown trials.

    Attributes:
        run: Folder of the run, for the transcript.
        simulate: Simulates parameter values once more, so that they can be drawn.
        from_rest: Simulates them from rest: forward speeds by trial [m/s], once settled and over the first two beats,
            None where it diverged; empty for robots without a beat.
        videos: Real films by the names of their trials, where there are any, with the rates that were given.
        briefing: Settings of what is shown.
        access: How a VLM is reached.
        on_event: Called as things happen.
        budget: Evaluations that the run has; None where that isn't known.
        several: Whether step sizes and alternatives are asked for, which method proposal-search tries.
    """

    run: Path
    simulate: Callable[[Values], Comparison]
    from_rest: Callable[[Values], FromRest] = lambda values: {}
    videos: Films = field(default_factory=dict[str, tuple[Path, float | None]])
    briefing: BriefingSettings = field(default_factory=BriefingSettings)
    access: VlmAccess = field(default_factory=VlmAccess)
    on_event: Callable[[AdvisorEvent], None] = lambda event: None
    budget: int | None = None
    several: bool = False


def make_advisor(
    name: str, robot: Robot, space: ParameterSpace, seed: int, context: AdvisorContext | None = None
) -> Advisor:
    """The advisor of a name.

    Args:
        name: `physics`, `files`, `replay:RUN`, or `PROVIDER:MODEL`. The first begins with the robot's measured response
            where there is one, and measures sensitivities itself where there is none.
        robot: The robot whose simulator is calibrated.
        space: Its parameters, on the run's scale.
        seed: Seed of the physics advisor's random choices.
        context: What the advisors that ask need; the physics advisor and a replay need none.

    Raises:
        ArgumentError: There is none of that name, or it can't be had like this.
        MissingExtraError: A library that it needs isn't installed.
    """
    check_advisor(name)
    if name == PHYSICS:
        measured = robot.trials.steady and robot.swims.response is not None
        return PhysicsAdvisor(robot, space, seed) if measured else SensitivityAdvisor(space, seed)
    if (source := replayed_run(name)) is not None:
        return ReplayAdvisor(Transcript(source), space)
    if context is None:
        raise ArgumentError(f"advisor '{name}' needs the context of a run")
    access, briefing, transcript = context.access, context.briefing, Transcript(context.run)

    def on_wait(text: str, number: int) -> None:
        context.on_event(AdvisorEvent("waits", number, text, totals(transcript.calls)))

    if name == FILES:
        films = briefing.media == "video"
        client = FilesClient(
            context.run, reply_schema(space, bounds=True, several=context.several), films, access.once, on_wait
        )
    else:
        client = ModelClient(name, access, briefing.media)
    prompts = TrialPromptBuilder(
        robot, space, context.simulate, context.videos, briefing, client.takes_video, access.reply_tokens,
        context.from_rest, context.budget, context.several,
    )  # fmt: skip
    repairs = None if name == FILES else REPAIRS  # a person may try as often as they like
    asking = VlmAdvisor(
        client, prompts.question, space, transcript, access, context.on_event, repairs, Instruments(robot, space)
    )
    return ReplayAdvisor(transcript, space, then=asking)


class ProbingAdvisor:
    """Has the first parameters changed one after the other, each at one evaluation, then another advisor proposes."""

    def __init__(self, advisor: Advisor, space: ParameterSpace, count: int) -> None:
        """Prepares the probes.

        Args:
            advisor: Who proposes.
            space: Parameters as the optimizer uses them; they are measured in their order.
            count: Number of parameters that are measured.

        Raises:
            ArgumentError: There are fewer parameters.
        """
        if count > len(space):
            raise ArgumentError(f"probes is {count}; the robot has {len(space)} parameters to measure")
        self._advisor, self._space, self._count = advisor, space, count
        self.needs_residual = reads_residuals(advisor)

    def propose(self, situation: Situation) -> Advice:
        """The next parameter to measure, a step toward the middle of its range, or the advisor's advice."""
        i = len(situation.measurements)
        if situation.rounds or i >= self._count:
            return self._advisor.propose(situation)
        here = situation.incumbent.candidate.point
        return Measurement.of_one(here, i, self._space.names[i])

"""From an advisor's name to the advisor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from swim2real.advisor.briefing.prompt import TrialPromptBuilder
from swim2real.advisor.physics import PhysicsAdvisor, SensitivityAdvisor
from swim2real.advisor.vlm.advisor import REPAIRS, AdvisorEvent, Limits, ReplayAdvisor, VlmAdvisor
from swim2real.advisor.vlm.client import RetryPolicy, make_client
from swim2real.advisor.vlm.exchange import Client
from swim2real.advisor.vlm.files import FilesClient
from swim2real.advisor.vlm.reply import reply_schema
from swim2real.advisor.vlm.transcript import Transcript, totals
from swim2real.errors import ArgumentError
from swim2real.objective import Comparison
from swim2real.optimizers import Advisor
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.robot import Robot
from swim2real.settings import FILES, PHYSICS, BriefingSettings, VlmAccess, check_advisor, replayed_run


@dataclass(frozen=True)
class AdvisorContext:
    """What an advisor that is shown trials needs of its run.

    Attributes:
        run: Folder of the run, for the transcript.
        simulate: Simulates parameter values once more, so that they can be drawn.
        from_rest: Simulates them from rest: forward speeds by trial [m/s], None where it diverged; empty for robots
            without a beat.
        videos: Real films by the names of their trials, where there are any.
        briefing: Settings of what is shown.
        access: How a VLM is reached.
        on_event: Called as things happen.
    """

    run: Path
    simulate: Callable[[Values], Comparison]
    from_rest: Callable[[Values], Mapping[str, float | None]] = lambda values: {}
    videos: Mapping[str, Path] = field(default_factory=dict[str, Path])
    briefing: BriefingSettings = field(default_factory=BriefingSettings)
    access: VlmAccess = field(default_factory=VlmAccess)
    on_event: Callable[[AdvisorEvent], None] = lambda event: None


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
        measured = robot.trials.response is not None
        return PhysicsAdvisor(robot, space, seed) if measured else SensitivityAdvisor(space, seed)
    if (source := replayed_run(name)) is not None:
        return ReplayAdvisor(source, space)
    if context is None:
        raise ArgumentError(f"advisor '{name}' needs the context of a run")
    access = context.access
    transcript = Transcript(context.run)
    repairs: int | None = REPAIRS
    if name == FILES:

        def on_wait(text: str, number: int) -> None:
            context.on_event(AdvisorEvent("waits", number, text, totals(transcript.calls)))

        schema, films = reply_schema(space, bounds=True), context.briefing.media == "video"
        client: Client = FilesClient(context.run, schema, films, access.once, on_wait)
        repairs = None  # a person may try as often as they like
    else:
        retry = RetryPolicy(access.tries)
        client = make_client(
            name, access.base_url, access.key_variable, access.timeout, context.briefing.media, retry
        )  # fmt: skip
    prompts = TrialPromptBuilder(
        robot, space, context.simulate, context.videos, context.briefing, client.takes_video, access.reply_tokens,
        context.from_rest,
    )  # fmt: skip
    limits = Limits(access.max_calls, access.max_cost, repairs)
    return VlmAdvisor(client, prompts, space, transcript, limits, context.on_event)

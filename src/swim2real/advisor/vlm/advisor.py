"""The advisor that asks a VLM: brief, ask, understand, have it mended, and give up in good order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from swim2real.advisor.vlm.events import AdvisorEvent, Kind
from swim2real.advisor.vlm.exchange import Attempt, CallError, Client, Reply, Request
from swim2real.advisor.vlm.prompt import repair
from swim2real.advisor.vlm.providers import same_model
from swim2real.advisor.vlm.reply import ReplyError, Understood, understand
from swim2real.advisor.vlm.transcript import Call, Outcome, Transcript, stated, totals
from swim2real.errors import AdvisorError, ArgumentError
from swim2real.optimizers import Proposal, Situation
from swim2real.parameters import ParameterSpace

REPAIRS = 2  # of one reply
FAILURES = 3  # rounds without a proposal, in a row, before a run stops


class Briefer(Protocol):
    """Writes the question of a round."""

    def question(self, situation: Situation, level: int = 0) -> Request:
        """What is shown.

        Args:
            situation: Of the run.
            level: 0 as asked for, 1 shorter, for a context that is too small.
        """
        ...


@dataclass(frozen=True)
class Limits:
    """What a run's calls may take.

    Attributes:
        max_calls: Calls, repairs and failed ones included; None for any number.
        max_cost: [USD]; None for any.
        repairs: Of one reply; None as often as it takes.
    """

    max_calls: int | None = None
    max_cost: float | None = None
    repairs: int | None = REPAIRS

    def __post_init__(self) -> None:
        if self.max_calls is not None and self.max_calls < 1:
            raise ArgumentError(f"max_calls is {self.max_calls}; it must be at least 1")
        if self.max_cost is not None and not 0 < self.max_cost < float("inf"):
            raise ArgumentError(f"max_cost is {self.max_cost:g} USD; it must be finite and above 0")


class VlmAdvisor:
    """An advisor behind a client, be it a service, a server in the next room or a person with a text editor.

    A round without a usable reply costs no evaluation; after three in a row the advisor gives up with an error, and
    the run can go on later. A reply that is on record for a round is used again, not paid for twice.
    """

    def __init__(
        self, client: Client, briefer: Briefer, space: ParameterSpace, transcript: Transcript,
        limits: Limits | None = None, on_event: Callable[[AdvisorEvent], None] = lambda event: None,
    ) -> None:  # fmt: skip
        """Prepares the advisor.

        Args:
            client: Carries requests.
            briefer: Writes them.
            space: Of the parameters.
            transcript: Of the run, where every call is kept.
            limits: On calls and cost.
            on_event: Called as things happen.

        Raises:
            ArgumentError: A cost is limited and nobody knows the price.
        """
        self._client, self._briefer, self._space, self._transcript = client, briefer, space, transcript
        self._limits, self._on_event = limits or Limits(), on_event
        if self._limits.max_cost is not None and not client.price_known:
            raise ArgumentError(
                f"max_cost is {self._limits.max_cost:g} USD, but the price of {client.name} isn't known; "
                f"limit the calls with --max-calls"
            )
        self._warned: set[str] = set()

    def propose(self, situation: Situation) -> Proposal:
        """Asks for a proposal.

        Raises:
            AdvisorError: Three rounds in a row failed, a limit is reached, or a setting is wrong.
        """
        number = len(situation.rounds) + 1
        used = self._transcript.answer(number, situation.incumbent)
        problem = ""
        for _ in range(FAILURES):
            if used is None:
                used, problem = self._ask(situation, number, problem)
        if used is None:
            raise AdvisorError(
                f"round {number}: {FAILURES} times in a row there was no usable reply from {self._client.name}; the "
                f"last time, {problem}; nothing is lost, --resume asks again"
            )
        return proposal_of(used, self._transcript.of_round(number), situation, self._space)

    def _ask(self, situation: Situation, number: int, earlier: str) -> tuple[Call | None, str]:
        """One try of a round: the call whose reply can be used, or None and why there is none."""
        question = self._question(situation, number, earlier)
        request, repairs, shrunk = question, 0, False
        current = self._space.to_values(situation.incumbent.candidate.point)
        while True:
            try:
                reply = self._call(request, situation)
            except CallError as error:
                if error.kind == "too_long" and not shrunk:
                    question = request = self._question(situation, number, earlier, 1)
                    shrunk = True
                    continue
                if error.kind == "settings":
                    raise
                return None, str(error)
            problem = ""
            try:
                understand(reply.text, self._space, current)
            except ReplyError as error:
                problem = {
                    "length": f"the reply was cut off after {reply.output_tokens or request.max_tokens} tokens, "
                    f"so {error}; answer more briefly",
                    "refusal": "the reply declined to answer; this is about numbers of a physics simulation",
                }.get(reply.finish, str(error))
            call = self._keep(request, situation, "unusable" if problem else "used", problem or None, reply)
            if not problem:
                self._tell("answered", number, _summary(call))
                return call, ""
            self._tell("unusable", number, problem)
            if self._limits.repairs is not None and repairs == self._limits.repairs:
                return None, f"{problem} (after {repairs} repairs)"
            repairs += 1
            longer = 2 if reply.finish == "length" else 1
            request = repair(question, reply.text, problem, longer * request.max_tokens)

    def _question(self, situation: Situation, number: int, earlier: str, level: int = 0) -> Request:
        question = replace(self._briefer.question(situation, level), round=number)
        if not earlier:
            return question
        note = f"An earlier answer to this could not be used: {earlier}."
        return replace(question, parts=(*question.parts, note))

    def _call(self, request: Request, situation: Situation) -> Reply:
        self._check_limits()
        number = request.round
        media = request.media
        size = sum(len(one.data) for one in media)
        shown = f" with {len(media)} pictures or films ({size / 1e6:.1f} MB)" if media else ""
        self._tell("asks", number, f"{'repair' if request.is_repair else 'question'}{shown} to {self._client.name}")

        def on_attempt(attempt: Attempt) -> None:
            self._tell("waits", number, f"{attempt.error}; again in {attempt.waited:.0f} s")

        try:
            reply = self._client.call(request, on_attempt)
            self._tell("received", number, "")
        except CallError as error:
            self._keep(request, situation, "failed", str(error), None, error.attempts)
            self._tell("failed", number, str(error))
            raise
        except KeyboardInterrupt:
            self._keep(request, situation, "failed", "interrupted", None)
            raise
        self._check_model(reply, number)
        return reply

    def _check_limits(self) -> None:
        so_far = totals(self._transcript.calls)
        limits = self._limits
        if limits.max_calls is not None and so_far.calls >= limits.max_calls:
            raise AdvisorError(
                f"{so_far.calls} calls were made and --max-calls is {limits.max_calls}; --resume with a higher one "
                f"goes on"
            )
        dearest = max((call.reply.cost or 0.0 for call in self._transcript.calls if call.reply), default=0.0)
        if limits.max_cost is not None and (so_far.cost or 0.0) + dearest > limits.max_cost:
            raise AdvisorError(
                f"{so_far.cost or 0.0:.2f} USD are spent and another call may cost {dearest:.2f}; --max-cost is "
                f"{limits.max_cost:g}; --resume with a higher one goes on"
            )

    def _check_model(self, reply: Reply, number: int) -> None:
        asked = self._client.name.partition(":")[2]
        if reply.model and asked and not same_model(asked, reply.model) and reply.model not in self._warned:
            self._warned.add(reply.model)
            self._tell("warning", number, f"{asked} was asked and {reply.model} answered; the record says which")

    def _keep(
        self, request: Request, situation: Situation, outcome: Outcome, problem: str | None, reply: Reply | None,
        attempts: tuple[Attempt, ...] = (),
    ) -> Call:  # fmt: skip
        made = attempts if reply is None else reply.attempts
        call = Call(
            0, request.round, request.is_repair, self._client.name, outcome, problem, stated(situation.incumbent),
            reply, made,
        )  # fmt: skip
        return self._transcript.write(call, request)

    def _tell(self, kind: Kind, number: int, text: str) -> None:
        self._on_event(AdvisorEvent(kind, number, text, totals(self._transcript.calls)))


def proposal_of(used: Call, calls: tuple[Call, ...], situation: Situation, space: ParameterSpace) -> Proposal:
    """The proposal that a recorded reply makes: the same today and in a replay.

    Args:
        used: The call whose reply is used.
        calls: All of its round.
        situation: That it answers.
        space: Of the parameters.

    Raises:
        AdvisorError: The reply can't be understood.
    """
    if used.reply is None:
        raise AdvisorError(f"call {used.number} has no reply")
    start = situation.incumbent.candidate.point
    said: Understood = understand(used.reply.text, space, space.to_values(start))
    sums = totals(calls)
    notes = {
        "advisor": used.advisor, "model": used.reply.model, "calls": [call.number for call in calls],
        "input_tokens": sums.input_tokens, "output_tokens": sums.output_tokens, "cost": sums.cost,
        "seconds": round(sums.seconds, 3), **said.notes(),
    }  # fmt: skip
    if used.reply.notes:
        notes["remarks"] = list(used.reply.notes)
    return Proposal(said.point(space, start), said.diagnosis, said.reasoning, notes)


def _summary(call: Call) -> str:
    reply = call.reply
    if reply is None:
        return ""
    parts = [f"{call.seconds:.0f} s"]
    if reply.input_tokens is not None and reply.output_tokens is not None:
        parts.append(f"{reply.input_tokens} + {reply.output_tokens} tokens")
    if reply.cost is not None:
        parts.append(f"{reply.cost:.3f} USD")
    return ", ".join(parts)

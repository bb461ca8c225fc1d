"""The advisor that asks a VLM, and the one that replays what it answered.

A round is briefed, asked and parsed. The model is asked to repair a reply that can't be used; a round that fails is
asked anew, and given up in good order after three times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Protocol

from swim2real.advisor.vlm.exchange import Attempt, CallError, Client, Reply, Request
from swim2real.advisor.vlm.providers import same_model
from swim2real.advisor.vlm.reply import ParsedReply, ReplyError, parse_reply
from swim2real.advisor.vlm.transcript import Call, Incumbent, Outcome, Totals, Transcript, totals
from swim2real.errors import AdvisorError, ArgumentError
from swim2real.optimizers import Advice, Measurement, Proposal, Situation
from swim2real.parameters import ParameterSpace

REPAIRS = 2  # of one reply
PROBE = "probe"  # note of a measurement that was asked for in a reply
FAILURES = 3  # rounds without a proposal, in a row, before a run stops
_LONGEST_QUOTE = 6000  # characters of an earlier reply that are shown again

EventKind = Literal["asks", "waits", "received", "answered", "unusable", "failed", "warning"]


@dataclass(frozen=True)
class AdvisorEvent:
    """What a person wants to see while an advisor is asked.

    Attributes:
        kind: `asks` when a call begins, `waits` while it lasts, `received` or `failed` when it ends; then `answered`
            when the reply is used or `unusable` when it has to be repaired; `warning` for what a person should know.
        round: Round of the run, from 1 on.
        text: What happened, in a sentence.
        totals: What the calls of the run took so far.
    """

    kind: EventKind
    round: int
    text: str
    totals: Totals


class PromptBuilder(Protocol):
    """Writes the question of a round."""

    def question(self, situation: Situation, level: int = 0) -> Request:
        """What is shown.

        Args:
            situation: Situation of the run.
            level: 0 for the detail of the settings, 1 for less, where a context is too small.
        """
        ...


@dataclass(frozen=True)
class Limits:
    """What a run's calls may take.

    Attributes:
        max_calls: Most calls, repairs and failed ones included; None for any number.
        max_cost: Highest cost [USD]; None for any.
        repairs: Most repairs of one reply; None for any number.
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
        self, client: Client, prompts: PromptBuilder, space: ParameterSpace, transcript: Transcript,
        limits: Limits | None = None, on_event: Callable[[AdvisorEvent], None] = lambda event: None,
    ) -> None:  # fmt: skip
        """Prepares the advisor.

        Args:
            client: Carries requests.
            prompts: Writes the questions.
            space: Parameters of the simulator.
            transcript: Transcript of the run, where every call is kept.
            limits: Limits of calls and cost.
            on_event: Called as things happen.

        Raises:
            ArgumentError: The cost is limited and the price isn't known.
        """
        self._client, self._prompts, self._space, self._transcript = client, prompts, space, transcript
        self._limits, self._on_event = limits or Limits(), on_event
        if self._limits.max_cost is not None and not client.price_known:
            raise ArgumentError(
                f"max_cost is {self._limits.max_cost:g} USD, but the price of {client.name} isn't known; "
                f"limit the calls with --max-calls"
            )
        self._warned: set[str] = set()

    def propose(self, situation: Situation) -> Advice:
        """Asks for a proposal, or for what is to be measured before it.

        Raises:
            AdvisorError: Three rounds in a row failed, a limit is reached, or a setting is wrong.
        """
        number = len(situation.rounds) + 1
        recorded = recorded_advice_of(self._transcript, situation, self._space)
        if recorded is not None:
            return recorded
        problem = ""
        for _ in range(FAILURES):
            answer = self._ask(situation, number, problem)
            if not isinstance(answer, str):
                return advice_of(*answer, self._transcript, situation, self._space)
            problem = answer
        raise AdvisorError(
            f"round {number}: {FAILURES} times in a row there was no usable reply from {self._client.name}; the "
            f"last time, {problem}; nothing is lost, --resume asks again"
        )

    def _ask(self, situation: Situation, number: int, earlier: str) -> tuple[Call, ParsedReply] | str:
        """One try of a round: the call whose reply can be used, and what it says; or why there is none."""
        question = self._question(situation, number, earlier)
        request, repairs, shortened = question, 0, False
        current = self._space.to_values(situation.incumbent.candidate.point)
        while True:
            try:
                reply = self._call(request, situation)
            except CallError as error:
                if error.kind == "too_long" and not shortened:
                    question = request = self._question(situation, number, earlier, 1)
                    shortened = True
                    continue
                if error.kind == "settings":
                    raise
                return str(error)
            try:
                parsed = parse_reply(reply.text, self._space, current)
            except ReplyError as error:
                problem = _why_unusable(reply, request, error)
            else:
                call = self._record(request, situation, "used", None, reply)
                self._report("answered", number, _summary(call))
                return call, parsed
            self._record(request, situation, "unusable", problem, reply)
            self._report("unusable", number, problem)
            if self._limits.repairs is not None and repairs == self._limits.repairs:
                return f"{problem} (after {repairs} repairs)"
            repairs += 1
            longer = 2 if reply.finish == "length" else 1
            request = repair_request(question, reply.text, problem, longer * request.max_tokens)

    def _question(self, situation: Situation, number: int, earlier: str, level: int = 0) -> Request:
        question = replace(self._prompts.question(situation, level), round=number, turn=turn_of(situation))
        if not earlier:
            return question
        note = f"An earlier answer to this could not be used: {earlier}."
        return replace(question, parts=(*question.parts, note))

    def _call(self, request: Request, situation: Situation) -> Reply:
        self._check_limits()
        number = request.round
        media = request.media
        size = sum(len(file.data) for file in media)
        shown = f" with {len(media)} pictures or films ({size / 1e6:.1f} MB)" if media else ""
        self._report("asks", number, f"{'repair' if request.is_repair else 'question'}{shown} to {self._client.name}")

        def on_attempt(attempt: Attempt) -> None:
            self._report("waits", number, f"{attempt.error}; again in {attempt.waited:.0f} s")

        try:
            reply = self._client.call(request, on_attempt)
            self._report("received", number, "")
        except CallError as error:
            self._record(request, situation, "failed", str(error), None, error.attempts)
            self._report("failed", number, str(error))
            raise
        except KeyboardInterrupt:
            self._record(request, situation, "failed", "interrupted", None)
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
        requested = self._client.name.partition(":")[2]
        if reply.model and requested and not same_model(requested, reply.model) and reply.model not in self._warned:
            self._warned.add(reply.model)
            self._report("warning", number, f"{requested} was asked and {reply.model} answered; the record says which")

    def _record(
        self, request: Request, situation: Situation, outcome: Outcome, problem: str | None, reply: Reply | None,
        attempts: tuple[Attempt, ...] = (),
    ) -> Call:  # fmt: skip
        made = attempts if reply is None else reply.attempts
        call = Call(
            0, request.round, request.is_repair, self._client.name, outcome, problem,
            Incumbent.of(situation.incumbent), reply, made, turn=request.turn,
        )  # fmt: skip
        return self._transcript.write(call, request)

    def _report(self, kind: EventKind, number: int, text: str) -> None:
        self._on_event(AdvisorEvent(kind, number, text, totals(self._transcript.calls)))


class ReplayAdvisor:
    """Answers from another run's transcript, without a network or a key, as long as the run takes the same way."""

    def __init__(self, run: str | Path, space: ParameterSpace) -> None:
        """Opens the transcript.

        Args:
            run: Run folder whose calls are on record.
            space: Parameters of the simulator, on the scale of that run.

        Raises:
            ArgumentError: There is no call on record.
            AdvisorError: The transcript is damaged.
        """
        self._run, self._space, self._transcript = Path(run), space, Transcript(run)
        if not self._transcript.calls:
            raise ArgumentError(
                f"'{run}' has no calls on record, so there is nothing to replay; give the folder of a run with a VLM "
                f"or with --advisor files"
            )

    def propose(self, situation: Situation) -> Advice:
        """The recorded advice.

        Raises:
            AdvisorError: The record ends before, or this run has come elsewhere.
        """
        recorded = recorded_advice_of(self._transcript, situation, self._space)
        if recorded is not None:
            return recorded
        number = len(situation.rounds) + 1
        used = [call for call in self._transcript.of_round(number) if call.outcome == "used"]
        if used:
            raise AdvisorError(
                f"round {number} of '{self._run}' began at a loss of {1e3 * used[0].incumbent.loss:.3f} mm and here it "
                f"is {1e3 * situation.incumbent.loss:.3f} mm; a replay needs the same reference, settings and versions"
            )
        raise AdvisorError(
            f"the replies in '{self._run}' end before round {number}; a budget up to that run's replays without it"
        )


def turn_of(situation: Situation) -> int:
    """Which turn of its round an advisor has: 1, and one more after each of its probes."""
    return 1 + sum(bool(measured.candidate.note.get(PROBE)) for measured in situation.measurements)


def recorded_advice_of(transcript: Transcript, situation: Situation, space: ParameterSpace) -> Advice | None:
    """The advice that is on record for a situation, None without.

    Raises:
        AdvisorError: There is no reply, or it can't be used.
    """
    call = transcript.answer(len(situation.rounds) + 1, turn_of(situation), situation.incumbent)
    if call is None:
        return None
    if call.reply is None:
        raise AdvisorError(f"call {call.number} has no reply")
    parsed = parse_reply(call.reply.text, space, space.to_values(situation.incumbent.candidate.point))
    return advice_of(call, parsed, transcript, situation, space)


def advice_of(
    call: Call, parsed: ParsedReply, transcript: Transcript, situation: Situation, space: ParameterSpace
) -> Advice:
    """The proposal or the probe that a call's reply makes: the same when it is answered and in a replay.

    Args:
        call: Call whose reply is used.
        parsed: What its reply says.
        transcript: Transcript of the run, with all calls of the turn.
        situation: Situation that it answers.
        space: Parameters of the simulator.
    """
    calls = [made for made in transcript.of_round(call.round) if made.turn == call.turn]
    sums = totals(calls)
    notes = {
        "advisor": call.advisor, "model": call.reply and call.reply.model, "calls": [made.number for made in calls],
        "input_tokens": sums.input_tokens, "output_tokens": sums.output_tokens, "cost": sums.cost,
        "seconds": round(sums.seconds, 3), **parsed.notes(),
    }  # fmt: skip
    if call.reply and call.reply.notes:
        notes["remarks"] = list(call.reply.notes)
    point = parsed.point(space, situation.incumbent.candidate.point)
    if parsed.probe:
        texts = {"diagnosis": parsed.diagnosis, "reasoning": parsed.reasoning}
        return Measurement(point, {PROBE: True, **texts, "notes": notes})
    return Proposal(point, parsed.diagnosis, parsed.reasoning, notes)


def repair_request(question: Request, reply: str, problem: str, max_tokens: int) -> Request:
    """A follow-up that asks to repair a reply, without showing the media again.

    Args:
        question: Request that was sent first.
        reply: Text of the earlier reply.
        problem: Why it can't be used.
        max_tokens: Most tokens of the new reply.
    """
    texts = [part for part in question.parts if isinstance(part, str)]
    quote = reply if len(reply) <= _LONGEST_QUOTE else reply[:_LONGEST_QUOTE] + " […]"
    quoted = f"Your reply was:\n\n{quote}\n\n" if quote.strip() else ""
    ask = (
        f"{quoted}It can't be used: {problem}.\n\n"
        "Answer again with the whole JSON object, put right. The pictures or films aren't shown again; keep what you "
        "saw in them."
    )
    return replace(question, parts=(*texts, ask), max_tokens=max_tokens, problem=problem)


def _why_unusable(reply: Reply, request: Request, error: ReplyError) -> str:
    match reply.finish:
        case "length":
            tokens = reply.output_tokens or request.max_tokens
            return f"the reply was cut off after {tokens} tokens, so {error}; answer more briefly"
        case "refusal":
            return "the reply declined to answer; this is about numbers of a physics simulation"
        case "stop":
            return str(error)


def _summary(call: Call) -> str:
    reply = call.reply
    parts = [f"{call.seconds:.0f} s"]
    if reply and reply.input_tokens is not None and reply.output_tokens is not None:
        parts.append(f"{reply.input_tokens} + {reply.output_tokens} tokens")
    if reply and reply.cost is not None:
        parts.append(f"{reply.cost:.3f} USD")
    return ", ".join(parts)

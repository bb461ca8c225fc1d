"""The advisor that asks a VLM, and the one that replays what it answered.

A round is briefed, asked and parsed. The model is asked to repair a reply that can't be used; a round that fails is
asked anew, and given up in good order after three times.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from swim2real.advisor.vlm.exchange import Attempt, CallError, Client, Reply, Request
from swim2real.advisor.vlm.instruments import MOST_ASKED, Instruments
from swim2real.advisor.vlm.providers import same_model
from swim2real.advisor.vlm.reply import SOLVED, ReplyError, parse_reply
from swim2real.advisor.vlm.transcript import Call, Incumbent, Outcome, Totals, Transcript, totals
from swim2real.optimizers import Advice, Advisor, Evaluation, Measurement, Situation
from swim2real.optimizers.advisor import STAYS, reads_residuals
from swim2real.parameters import ParameterSpace, Values
from swim2real.settings import VlmAccess
from swimbase.errors import AdvisorError, ArgumentError

REPAIRS = 2  # of one reply
_PROBE = "probe"  # note of a measurement that was asked for in a reply, of a list of them the last
_LIST = "of list"  # note of one of a list: the number of the call
_FAILURES = 3  # rounds without a proposal, in a row, before a run stops
_LONGEST_QUOTE = 6000  # characters of an earlier reply that are shown again

EventKind = Literal["asks", "waits", "received", "answered", "unusable", "failed", "warning"]


@dataclass(frozen=True)
class AdvisorEvent:
    """News for a person while an advisor is asked.

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


class VlmAdvisor:
    """An advisor behind a client, be it a service, a server in the next room or a person with a text editor.

    A round without a usable reply costs no evaluation; after three in a row the advisor gives up with an error, and
    the run can go on later. Instruments are answered at once, from the residuals of the run's evaluations.
    """

    needs_residual = True

    def __init__(
        self, client: Client, question: Callable[[Situation, int], Request], space: ParameterSpace,
        transcript: Transcript, access: VlmAccess | None = None,
        on_event: Callable[[AdvisorEvent], None] = lambda event: None, repairs: int | None = REPAIRS,
        instruments: Instruments | None = None,
    ) -> None:  # fmt: skip
        """Prepares the advisor.

        Args:
            client: Carries requests.
            question: Writes what is asked in a situation, at level 0 in the detail of the settings, at 1 in less, where
                a context is too small.
            space: Parameters of the simulator.
            transcript: Transcript of the run, where every call is kept.
            access: What calls may take.
            on_event: Called as things happen.
            repairs: Most repairs of one reply; None for any number.
            instruments: What answers a reply that asks instruments; None where there are none.

        Raises:
            ArgumentError: The cost is limited and the price isn't known.
        """
        self._client, self._write_question, self._space, self._transcript = client, question, space, transcript
        self._access, self._on_event, self._repairs = access or VlmAccess(), on_event, repairs
        self._instruments = instruments
        if self._access.max_cost is not None and not client.price_known:
            raise ArgumentError(
                f"max_cost is {self._access.max_cost:g} USD, but the price of {client.name} isn't known; "
                f"limit the calls with --max-calls"
            )
        self._warned: set[str] = set()

    def propose(self, situation: Situation) -> Advice:
        """Asks for a proposal, or for what is to be measured before it.

        Raises:
            AdvisorError: Three rounds in a row failed, a limit is reached, or a setting is wrong.
        """
        problem = ""
        for _ in range(_FAILURES):
            answer = self._ask(situation, problem)
            if isinstance(answer, Call):
                return _advice_of(answer, self._transcript, situation, self._space)
            problem = answer
        raise AdvisorError(
            f"round {len(situation.rounds) + 1}: {_FAILURES} times in a row there was no usable reply from "
            f"{self._client.name}; the last time, {problem}; nothing is lost, --resume asks again"
        )

    def _ask(self, situation: Situation, earlier: str) -> Call | str:
        """One try of a round: the call whose reply can be used, or why there is none."""
        question = self._question(situation, earlier)
        request, repairs, level = question, 0, 0
        while True:
            try:
                reply = self._call(request, situation)
            except CallError as error:
                if error.kind == "too_long" and level == 0:
                    level = 1
                    question = request = self._question(situation, earlier, level)
                    continue
                if error.kind == "settings":
                    raise
                return str(error)
            try:
                here = self._space.to_values(situation.incumbent.candidate.point)
                calls = self._transcript.of_turn(question.round, question.turn, situation.incumbent)
                parsed = parse_reply(reply.text, self._space, here, _offered(calls, situation, self._space))
                if parsed.asks_instruments:
                    if self._instruments is None:
                        raise ReplyError("there are no instruments in this run; propose or measure")
                    asked = [call.reply.text for call in calls if call.outcome == "asked" and call.reply]
                    again = request is question and asked[-1:] == [reply.text]  # a run was resumed, not answered
                    if len(asked) == MOST_ASKED and not again:
                        raise ReplyError(
                            f"instruments were asked {MOST_ASKED} times in this turn, which is the most; propose or "
                            f"measure"
                        )
                    said = self._instruments.answers(parsed, situation)
                    if not again:
                        self._record(request, situation, "asked", None, reply, solved=said.solved)
                    left = MOST_ASKED - len(asked) - (not again)
                    request = _follow_up(question, reply.text, said.text, left)
                    continue
                _check_measurements(len(parsed.measure) or parsed.probe, situation, len(self._space))
            except ReplyError as error:
                problem = _why_unusable(reply, request, error)
            else:
                call = self._record(request, situation, "used", None, reply)
                self._report("answered", request.round, _summary(call))
                return call
            self._record(request, situation, "unusable", problem, reply)
            self._report("unusable", request.round, problem)
            if self._repairs is not None and repairs == self._repairs:
                return f"{problem} (after {repairs} repairs)"
            repairs += 1
            longer = 2 if reply.finish == "length" else 1
            request = repair_request(question, reply.text, problem, longer * request.max_tokens)

    def _question(self, situation: Situation, earlier: str, level: int = 0) -> Request:
        question = self._write_question(situation, level)
        note = (f"An earlier answer to this could not be used: {earlier}.",) if earlier else ()
        number, turn = len(situation.rounds) + 1, _turn_of(situation)
        return replace(question, round=number, turn=turn, parts=(*question.parts, *note))

    def _call(self, request: Request, situation: Situation) -> Reply:
        self._check_limits()
        number, size = request.round, sum(len(file.data) for file in request.media)
        shown = f" with {len(request.media)} pictures or films ({size / 1e6:.1f} MB)" if request.media else ""
        self._report("asks", number, f"{'repair' if request.is_repair else 'question'}{shown} to {self._client.name}")

        def on_attempt(attempt: Attempt) -> None:
            self._report("waits", number, f"{attempt.error}; again in {attempt.waited:.0f} s")

        try:
            reply = self._client.call(request, on_attempt)
        except CallError as error:
            self._record(request, situation, "failed", str(error), None, error.attempts)
            self._report("failed", number, str(error))
            raise
        except KeyboardInterrupt:
            self._record(request, situation, "failed", "interrupted", None)
            raise
        self._report("received", number, "")
        asked = self._client.name.partition(":")[2]
        if reply.model and asked and not same_model(asked, reply.model) and reply.model not in self._warned:
            self._warned.add(reply.model)
            self._report("warning", number, f"{asked} was asked and {reply.model} answered; the record says which")
        return reply

    def _check_limits(self) -> None:
        so_far, access = totals(self._transcript.calls), self._access
        if access.max_calls is not None and so_far.calls >= access.max_calls:
            raise AdvisorError(
                f"{so_far.calls} calls were made and --max-calls is {access.max_calls}; --resume with a higher one "
                f"goes on"
            )
        spent = so_far.cost or 0.0
        dearest = max((call.reply.cost or 0.0 for call in self._transcript.calls if call.reply), default=0.0)
        if access.max_cost is not None and spent + dearest > access.max_cost:
            raise AdvisorError(
                f"{spent:.2f} USD are spent and another call may cost {dearest:.2f}; --max-cost is "
                f"{access.max_cost:g}; --resume with a higher one goes on"
            )

    def _record(
        self, request: Request, situation: Situation, outcome: Outcome, problem: str | None, reply: Reply | None,
        attempts: tuple[Attempt, ...] = (), solved: Values | None = None,
    ) -> Call:  # fmt: skip
        call = Call(
            0, request.round, request.is_repair, self._client.name, outcome, problem,
            Incumbent.of(situation.incumbent), reply, attempts if reply is None else reply.attempts, turn=request.turn,
            solved=solved,
        )  # fmt: skip
        return self._transcript.write(call, request)

    def _report(self, kind: EventKind, number: int, text: str) -> None:
        self._on_event(AdvisorEvent(kind, number, text, totals(self._transcript.calls)))


class ReplayAdvisor:
    """Answers from a run's transcript, without a network or a key, as long as the run takes the same way.

    In the run itself a reply that is on record is used again, not paid for twice, before another advisor is asked.
    """

    def __init__(self, transcript: Transcript, space: ParameterSpace, then: Advisor | None = None) -> None:
        """Prepares the replay.

        Args:
            transcript: Calls on record.
            space: Parameters of the simulator, on the scale of that run.
            then: Who is asked what isn't on record; None where that is an error.

        Raises:
            ArgumentError: There is no call on record, and nobody else to ask.
            AdvisorError: The transcript is damaged.
        """
        self._transcript, self._space, self._then = transcript, space, then
        self.needs_residual = reads_residuals(then)
        if then is None and not transcript.calls:
            raise ArgumentError(
                f"'{transcript.run}' has no calls on record, so there is nothing to replay; give the folder of a run "
                f"with a VLM or with --advisor files"
            )

    def propose(self, situation: Situation) -> Advice:
        """The recorded advice, or the other advisor's.

        Raises:
            AdvisorError: The record ends before, or this run has come elsewhere.
        """
        number, run = len(situation.rounds) + 1, self._transcript.run
        call = self._transcript.answer(number, _turn_of(situation), _before_list(situation))
        if call is not None:
            return _advice_of(call, self._transcript, situation, self._space)
        if self._then is not None:
            return self._then.propose(situation)
        used = [call for call in self._transcript.of_round(number) if call.outcome == "used"]
        if used:
            raise AdvisorError(
                f"round {number} of '{run}' began at a loss of {1e3 * used[0].incumbent.loss:.3f} mm and here it "
                f"is {1e3 * situation.incumbent.loss:.3f} mm; a replay needs the same reference, settings and versions"
            )
        raise AdvisorError(
            f"the replies in '{run}' end before round {number}; a budget up to that run's replays without it"
        )


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


def _follow_up(question: Request, reply: str, said: str, left: int) -> Request:
    """A request that goes on from a reply which asked instruments, without showing the media again."""
    texts = [part for part in question.parts if isinstance(part, str)]
    more = f"You may ask instruments {left} more times before you propose." if left else "Now propose or measure."
    quote = reply if len(reply) <= _LONGEST_QUOTE else reply[:_LONGEST_QUOTE] + " […]"
    answer = f"Your reply was:\n\n{quote}\n\n{said}\n\n{more} Answer with the whole JSON object."
    return replace(question, parts=(*texts, answer), answers=f"{said}\n\n{more}")


def _offered(calls: Sequence[Call], situation: Situation, space: ParameterSpace) -> dict[str, Values]:
    """Values that a turn's reply may take: of the last step that was solved in it, and of the round's measurements."""
    solved = [call.solved for call in calls if call.solved is not None]
    offered: dict[str, Values] = {SOLVED: solved[-1]} if solved else {}
    made = ((str(i), one) for i, one in enumerate(situation.measurements, start=1) if not one.failed)
    return offered | {number: space.to_values(one.candidate.point) for number, one in made}


def _check_measurements(asked: int, situation: Situation, most: int) -> None:
    """Refuses more measurements in a round than there are parameters, which tell all that a step needs."""
    made = sum(bool({_PROBE, _LIST} & one.candidate.note.keys()) for one in situation.measurements)
    if asked and made + asked > most:
        left = f"{most - made} more can be" if made < most else "no more can be"
        raise ReplyError(
            f"{made} points have been measured in this round and {asked} more are asked for, but {left}, as there are "
            f"{most} parameters; propose, such as a solved step or a measurement with 'take'"
        )


def _turn_of(situation: Situation) -> int:
    """Which turn of its round an advisor has: 1, and one more after each of its probes and lists of measurements."""
    return 1 + sum(bool(measured.candidate.note.get(_PROBE)) for measured in situation.measurements)


def _of_list(situation: Situation) -> list[Evaluation]:
    """Measurements so far of a list that isn't finished: those since the last turn."""
    notes = [measured.candidate.note for measured in situation.measurements]
    begun = max((i for i, note in enumerate(notes) if note.get(_PROBE)), default=-1) + 1
    return [one for one in situation.measurements[begun:] if _LIST in one.candidate.note]


def _before_list(situation: Situation) -> Evaluation:
    """The best evaluation when the present turn began."""
    made = _of_list(situation)
    apart = [*made, *(one for one in situation.evaluations if one.candidate.note.get(STAYS))]
    known = [one for one in situation.evaluations if not one.failed and all(one is not other for other in apart)]
    return min(known, key=lambda one: one.loss, default=situation.incumbent) if made else situation.incumbent


def _advice_of(call: Call, transcript: Transcript, situation: Situation, space: ParameterSpace) -> Advice:
    """The proposal or the probe that a call's reply makes: the same when it is answered and in a replay."""
    if call.reply is None:
        raise AdvisorError(f"call {call.number} has no reply")
    here = situation.incumbent.candidate.point
    calls = [made for made in transcript.of_round(call.round) if made.turn == call.turn]
    alike = [made for made in calls if made.incumbent.matches(call.incumbent)]
    parsed = parse_reply(call.reply.text, space, space.to_values(here), _offered(alike, situation, space))
    sums = totals(calls)
    notes = {
        "advisor": call.advisor, "model": call.reply.model, "calls": [made.number for made in calls],
        "input_tokens": sums.input_tokens, "output_tokens": sums.output_tokens, "cost": sums.cost,
        "seconds": round(sums.seconds, 3), **parsed.notes(),
    }  # fmt: skip
    if call.reply.notes:
        notes["remarks"] = list(call.reply.notes)
    if parsed.measure:
        made = len(_of_list(situation))
        name, change = list(parsed.measure.items())[made]
        one = Measurement.of_one(here, space.names.index(name), name, change)
        how = {_LIST: call.number, **({_PROBE: True} if made + 1 == len(parsed.measure) else {})}
        how |= {} if parsed.keep else {STAYS: True}
        return Measurement(np.clip(one.point, 0.0, 1.0), {**one.notes, **how, "notes": notes})
    if parsed.probe:
        texts = {"diagnosis": parsed.diagnosis, "reasoning": parsed.reasoning}
        return Measurement(parsed.point(space, here), {_PROBE: True, **texts, "notes": notes})
    return parsed.proposal(space, here, notes)


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
    reply, parts = call.reply, [f"{call.seconds:.0f} s"]
    if reply and reply.input_tokens is not None and reply.output_tokens is not None:
        parts.append(f"{reply.input_tokens} + {reply.output_tokens} tokens")
    if reply and reply.cost is not None:
        parts.append(f"{reply.cost:.3f} USD")
    return ", ".join(parts)

"""The words that a VLM is instructed with, and those that ask for a repair."""

from __future__ import annotations

from dataclasses import replace

from swim2real.advisor.vlm.exchange import Request

_LONGEST_QUOTE = 6000  # characters of an earlier reply that are shown again

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

Answer with one JSON object and nothing else: \
{{"diagnosis": text, "reasoning": text, "parameters": {{name: number}}}}. \
Numbers are plain numbers in the units given, without units, text, null or NaN."""


def instructions(look_for: str, alike: str) -> str:
    """The system's part of the prompt.

    Args:
        look_for: Discrepancies that may be seen, of trials of the robot's kind.
        alike: Effects that look alike, and what tells them apart.
    """
    return _INSTRUCTIONS.format(look_for=look_for, alike=alike)


def repair(question: Request, reply: str, problem: str, max_tokens: int) -> Request:
    """A follow-up that asks to mend a reply, without showing the media again.

    Args:
        question: What was asked first.
        reply: The earlier reply.
        problem: Why it can't be used.
        max_tokens: Of the new reply.
    """
    texts = [part for part in question.parts if isinstance(part, str)]
    quote = reply if len(reply) <= _LONGEST_QUOTE else reply[:_LONGEST_QUOTE] + " […]"
    said = f"Your reply was:\n\n{quote}\n\n" if quote.strip() else ""
    ask = (
        f"{said}It can't be used: {problem}.\n\n"
        "Answer again with the whole JSON object, put right. The pictures or films aren't shown again; keep what you "
        "saw in them."
    )
    return replace(question, parts=(*texts, ask), max_tokens=max_tokens, problem=problem)

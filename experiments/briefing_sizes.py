"""What the questions of a recorded run with a VLM take: tokens of text and pictures, cost, seconds.

    python experiments/briefing_sizes.py examples/vlm-runs/extended-2 tracks --show both --detail medium

Builds every question again from the run's record, as a VLM that takes pictures would get it, and writes them to --out.
Tokens are estimates: of text by a rule of thumb, of a picture its pixels over 750. What a question has in common with
the beginning of the one before it is read from a service's cache at a tenth of the price; what is written to it costs a
quarter more, as with Anthropic.
"""

import argparse
import io
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from swim2real import pipeline
from swim2real.advisor.briefing.media import DETAILS, PIXELS_A_TOKEN
from swim2real.advisor.briefing.prompt import TrialPromptBuilder
from swim2real.calibration import Problem, RunFolder
from swim2real.optimizers import BacktrackingLineSearch, Evaluation, ScriptedAdvisor, recorded_advice
from swim2real.robots import load_robot
from swim2real.settings import BriefingSettings, CalibrationSettings
from swim2real.trials import load_reference

_PIECE = re.compile(r"[A-Za-z]+|[^\s]|\n")
_LETTERS = 6  # of a word that a token holds, on average
READ, WRITTEN = 0.1, 1.25  # prices of a token from and to the cache, of that of any other


def estimate_tokens(text):
    """About how many tokens a text takes: one for up to six letters of a word, one for every digit, sign, line break.

    Four characters per token, the usual rule, is for prose; several tokenizers split numbers into digits.
    """
    return sum(-(-len(piece) // _LETTERS) for piece in _PIECE.findall(text))


class Situations:
    """Keeps what an advisor is told at each of its turns."""

    def __init__(self, advice):
        self._advisor, self.seen = ScriptedAdvisor(advice), []

    def propose(self, situation):
        self.seen.append(situation)
        return self._advisor.propose(situation)


def situations_of(entries, problem, space):
    """What the advisor was told at each turn, with the residuals that the local model needs."""
    advisor = Situations(recorded_advice(entries))
    search = BacktrackingLineSearch(advisor, entries[0]["point"])
    for entry in entries:
        made, failed = problem.evaluate(space.to_values(np.array(entry["point"]))), entry["failed"]
        stages = () if failed else made.residual_stages()
        search.tell(
            Evaluation(
                search.ask(), entry["loss"], failed, entry["evidence"], stages=stages, margins=made.first_beats,
                parts=made.residual_parts, widths=made.residual_widths,
            )
        )  # fmt: skip
    return advisor.seen


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path)
    parser.add_argument("reference", type=Path)
    parser.add_argument("--detail", choices=DETAILS, default="medium")
    parser.add_argument("--show", choices=("numbers", "pictures", "both"), default="both")
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    settings = pipeline.as_replayed(CalibrationSettings(advisor=f"replay:{a.run}"))
    robot = load_robot(RunFolder(a.run).settings().robot)
    space = replace(robot.space, scale=settings.resolved_scale)
    problem = Problem.with_settings(robot, load_reference(a.reference), settings)
    entries = [entry.model_dump(exclude_unset=True) for entry in RunFolder(a.run).record()]
    situations = situations_of(entries, problem, space)
    builder = TrialPromptBuilder(
        robot, space, problem.evaluate, {}, BriefingSettings(a.show, "images", a.detail), False, 1000,
        problem.speeds_from_rest, settings.budget,
    )  # fmt: skip
    print("| turn | text | of it kept | pictures | counts as | s |\n|---|---|---|---|---|---|")
    sums, before = [0.0] * 5, ()
    for turn, situation in enumerate(situations, start=1):
        began = time.monotonic()
        question = builder.question(situation)
        seconds = time.monotonic() - began
        lasting = (question.instructions, *question.parts[: question.lasting])
        text = sum(map(estimate_tokens, (question.instructions, *(p for p in question.parts if isinstance(p, str)))))
        text += sum(estimate_tokens(media.label) for media in question.media)
        shared = sum(estimate_tokens(one) for one, other in zip(lasting, before, strict=False) if one == other)
        new = sum(map(estimate_tokens, lasting)) - shared
        sizes = [Image.open(io.BytesIO(media.data)).size for media in question.media]
        pictures = sum(width * height // PIXELS_A_TOKEN for width, height in sizes)
        paid = text + pictures - (1 - READ) * shared + (WRITTEN - 1) * new
        row, before = (text, shared, pictures, paid, seconds), lasting
        sums = [total + one for total, one in zip(sums, row, strict=True)]
        print(f"| {turn} | {text} | {shared} | {pictures} | {paid:.0f} | {seconds:.1f} |", flush=True)
        if a.out:
            a.out.mkdir(exist_ok=True)
            parts = (part if isinstance(part, str) else f"*{part.label}*" for part in question.parts)
            (a.out / f"turn_{turn:02d}.md").write_text("\n\n".join([question.instructions, *parts]))
    print(f"| all | {' | '.join(f'{total:.0f}' for total in sums)} |")


if __name__ == "__main__":
    main()

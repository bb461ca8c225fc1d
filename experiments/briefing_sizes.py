"""How large the briefings of a run's rounds are, for every `--detail` and every `--show`, and how long they take.

    python experiments/briefing_sizes.py examples/vlm-runs/fish-2 tracks --rounds 1 8 16

Builds the questions again from the run's record, as a VLM that takes pictures would get them. Tokens are estimates: of
text by a rule of thumb, of a picture its pixels over 750.
"""

import argparse
import io
import re
import time
from dataclasses import replace
from pathlib import Path

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


def situations_of(entries):
    advisor = Situations(recorded_advice(entries))
    search = BacktrackingLineSearch(advisor, entries[0]["point"])
    for entry in entries:
        search.tell(Evaluation(search.ask(), entry["loss"], entry["failed"], entry["evidence"]))
    return {len(situation.rounds) + 1: situation for situation in advisor.seen}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path)
    parser.add_argument("reference", type=Path)
    parser.add_argument("--rounds", type=int, nargs="+", default=[1])
    a = parser.parse_args()
    settings = pipeline.as_replayed(CalibrationSettings(advisor=f"replay:{a.run}"))
    robot = load_robot(RunFolder(a.run).settings().robot)
    space = replace(robot.space, scale=settings.resolved_scale)
    problem = Problem.with_settings(robot, load_reference(a.reference), settings)
    situations = situations_of([entry.model_dump(exclude_unset=True) for entry in RunFolder(a.run).record()])
    print("| round | detail | show | tokens of text | of pictures | MB | seconds |\n|---|---|---|---|---|---|---|")
    for number in a.rounds:
        for detail in DETAILS:
            for show in ("numbers", "pictures", "both"):
                briefing = BriefingSettings(show, "images", detail)
                builder = TrialPromptBuilder(
                    robot, space, problem.evaluate, {}, briefing, False, 1000, problem.speeds_from_rest
                )
                began = time.monotonic()
                question = builder.question(situations[number])
                seconds = time.monotonic() - began
                texts = [part if isinstance(part, str) else part.label for part in question.parts]
                sizes = [Image.open(io.BytesIO(media.data)).size for media in question.media]
                print(
                    f"| {number} | {detail} | {show} | {estimate_tokens(' '.join([question.instructions, *texts]))} | "
                    f"{sum(width * height // PIXELS_A_TOKEN for width, height in sizes)} | "
                    f"{sum(len(media.data) for media in question.media) / 1e6:.2f} | {seconds:.1f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()

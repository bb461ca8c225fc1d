"""What the line search did in the calibrations with a VLM of `examples/vlm-runs`.

    python experiments/vlm_runs.py examples/vlm-runs

Prints a row per run and their sums: the lowest loss, its mean over the evaluations (AUC), rounds, and how many were
accepted at the full, the half and the quarter step.
"""

import argparse
from pathlib import Path

import numpy as np

from swim2real.calibration import RunFolder

STEPS = (1.0, 0.5, 0.25)


def rounds_of(entries):
    """Each round: the entry it began with, and those of its steps."""
    best, rounds = entries[0], {}
    for entry in entries[1:]:
        if "round" in entry["note"]:  # a measurement belongs to no step
            rounds.setdefault(entry["note"]["round"], (best, []))[1].append(entry)
        if not entry["failed"] and entry["loss"] < best["loss"]:
            best = entry
    return list(rounds.values())


def accepted(start, steps):
    return not steps[-1]["failed"] and steps[-1]["loss"] < start["loss"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    a = parser.parse_args()
    every = []
    for path in sorted(path.parent for path in a.folder.glob("*/record.jsonl")):
        entries = [entry.model_dump(exclude_unset=True) for entry in RunFolder(path).record()]
        lowest = 1e3 * np.minimum.accumulate([entry["loss"] for entry in entries])
        best = min(entries, key=lambda entry: entry["loss"])
        rounds = rounds_of(entries)
        kept = [sum(accepted(*one) and len(one[1]) == k + 1 for one in rounds) for k in range(len(STEPS))]
        print(
            f"{path.name}: {lowest[-1]:.1f} mm, AUC {lowest.mean():.1f} mm, velocity error "
            f"{1e3 * best['evidence']['velocity_error']:.1f} mm/s; {len(rounds)} rounds, {sum(kept)} accepted: "
            f"{', '.join(map(str, kept))} at the full, half and quarter step"
        )
        every += rounds
    kept = np.array([sum(accepted(*one) and len(one[1]) == k + 1 for one in every) for k in range(len(STEPS))])
    wasted = sum(len(steps) for start, steps in every if not accepted(start, steps))
    print(
        f"in all: {len(every)} rounds, {kept.sum()} accepted ({100 * kept.sum() / len(every):.0f} %), of them "
        f"{', '.join(f'{100 * share:.0f}' for share in kept / kept.sum())} % at the full, half and quarter step; "
        f"{wasted} evaluations of {sum(len(steps) for _, steps in every)} in rejected rounds"
    )


if __name__ == "__main__":
    main()

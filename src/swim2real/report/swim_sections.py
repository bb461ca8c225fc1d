"""What a page shows of steady swims."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from swim2real.calibration import RunFolder, SavedTrial, load_trials
from swim2real.calibration.from_rest import backward_from_rest
from swim2real.calibration.run_folder import TRIALS
from swim2real.report.headline import split, tiles
from swim2real.report.marker_errors import marker_errors
from swim2real.report.run import Json, ReportedRun, Sections
from swim2real.report.run_charts import speeds
from swim2real.report.trial_charts import drawn_trials, envelope, path_markers, swim_paths, swim_ranges, tail_tip
from swim2real.report.trial_table import trial_rows


@dataclass(frozen=True)
class SwimSections(Sections):
    """Speeds, shapes and beats in the body frame.

    Attributes:
        swims: Real and simulated at the best parameters, by frequency; simulated positions are NaN where the simulation
            diverged. Empty before a run ends.
        backward: That the best parameters don't swim forward from rest, and what to do; None where they do and where
            nobody tried.
    """

    template = "swims.html.j2"
    file = TRIALS
    drawn = ("marker paths", "body envelopes")

    swims: tuple[SavedTrial, ...] = ()
    backward: str | None = None

    @classmethod
    def read(cls, folder: RunFolder, outcome: Json) -> SwimSections:
        """From a run folder.

        Args:
            folder: Of the run.
            outcome: That of the best parameters; empty before a run ends.

        Raises:
            RunError: The swims are damaged.
        """
        there = outcome and (folder.path / TRIALS).is_file()
        swims = load_trials(folder) if there else ()
        return cls(
            tuple(sorted(swims, key=lambda swim: (swim.compared.frequency or 0.0, swim.compared.name))),
            backward_from_rest(outcome.get("from_rest") or {}),
        )

    @property
    def warning(self) -> str | None:
        return self.backward

    def content(self, run: ReportedRun) -> dict[str, Any]:
        drawn = drawn_trials(self.swims)
        swims = [swim.compared for swim in drawn]
        ranges, path_ranges = swim_ranges(swims), swim_ranges(swims, path_markers(run.marker_names).start)
        charts: dict[str, Any] = {"speeds": partial(speeds, run)}
        for i, swim in enumerate(swims):
            charts[f"paths-{i}"] = partial(swim_paths, swim, run.marker_names, path_ranges)
            charts[f"envelope-{i}"] = partial(envelope, swim, ranges)
            charts[f"tail-{i}"] = partial(tail_tip, swim, run.marker_names, ranges)
        return {
            "loss": "marker error" if run.paper_protocol else "aligned marker error",
            "tiles": tiles(run),
            "split": split(run),
            "order": "marker, head to tail",
            "errors": marker_errors(run, [swim.compared for swim in self.swims]),
            "trials": trial_rows(run),
            "charts": charts,
            "swims": drawn,
            "diverged": {trial.name for trial in run.trials if trial.diverged},
        }

"""What a page shows of recordings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swim2real.calibration import RunFolder, SavedTrial, load_trials
from swim2real.calibration.run_folder import TRIALS
from swim2real.report.marker_errors import MarkerErrors, by_trial, stored
from swim2real.report.recording_headline import loss_name, split, tiles
from swim2real.report.recording_table import recording_table
from swim2real.report.run import Json, ReportedRun, ReportedTrial, Sections
from swim2real.report.trial_charts import (
    axis_titles,
    drawn_trials,
    errors_over_time,
    progress_over_time,
    recording_paths,
    recording_ranges,
    sensor_readings,
)


@dataclass(frozen=True)
class RecordingSections(Sections):
    """Markers and sensors at the same times, in the frame of comparison.

    Attributes:
        recordings: With their playbacks at the best parameters, by name. Empty before a run ends.
    """

    template = "recordings.html.j2"
    file = TRIALS
    drawn = ("marker paths", "errors over time")
    unused = ("start",)

    recordings: tuple[SavedTrial, ...] = ()

    @classmethod
    def read(cls, folder: RunFolder, outcome: Json) -> RecordingSections:
        """From a run folder.

        Args:
            folder: Of the run.
            outcome: That of the best parameters; empty before a run ends.

        Raises:
            RunError: The recordings are damaged.
        """
        there = outcome and (folder.path / TRIALS).is_file()
        return cls(tuple(sorted(load_trials(folder), key=lambda one: one.compared.name)) if there else ())

    @property
    def warning(self) -> str | None:
        return None

    def content(self, run: ReportedRun) -> dict[str, Any]:
        about, shown = run.robot.recordings, drawn_trials(self.recordings)
        units = {sensor.name: sensor.unit for sensor in about.sensors}
        ranges, titles = recording_ranges([one.compared for one in shown]), axis_titles(run.robot)
        charts: dict[str, Any] = {}
        for i, one in enumerate(shown):
            trial = one.compared
            charts[f"paths-{i}"] = partial(recording_paths, trial, run.marker_names, run.robot.links, ranges, titles)
            if trial.divergence:
                continue
            charts[f"off-{i}"] = partial(errors_over_time, trial, run.marker_names)
            if about.score_progress:
                charts[f"way-{i}"] = partial(progress_over_time, trial)
            charts |= {
                f"sensor-{i}-{j}": partial(sensor_readings, s, units.get(s.name, ""))
                for j, s in enumerate(trial.sensors)
            }
        return {
            "loss": loss_name(run),
            "tiles": tiles(run),
            "split": split(run),
            "order": "marker",
            "errors": marker_errors(run),
            "trials": recording_table(run),
            "charts": charts,
            "recordings": shown,
            "about": about,
        }


def marker_errors(run: ReportedRun) -> tuple[MarkerErrors, ...]:
    """Errors of each marker, and two things that they may be made of."""
    if not any(not trial.diverged for trial in run.trials) or not run.marker_names:
        return ()
    count = len(run.marker_names)

    def offset(trial: ReportedTrial) -> NDArray[np.float64]:
        vectors = np.array(trial.figures.get("offset") or [[None, None]] * count, dtype=float)
        return np.linalg.norm(vectors, axis=1)

    def amplitude(trial: ReportedTrial) -> NDArray[np.float64]:
        real, simulated = (stored(run, f"amplitude_{kind}")(trial) for kind in ("real", "simulated"))
        return np.abs(simulated - real)

    offset_note = "What stays of it in the mean over time: a marker in another place, or a pose that sags."
    amplitude_note = "By how much it moves more or less, as a standard deviation along the line that it moves along."
    return (
        by_trial(
            run, "marker", "Marker error", "Mean distance at the same times.", stored(run, "aligned_marker_errors")
        ),
        by_trial(run, "offset", "Constant offset", offset_note, offset),
        by_trial(run, "amplitude", "Difference in amplitude", amplitude_note, amplitude),
    )

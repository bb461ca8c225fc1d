"""The kinds of trials and what a page shows of each: the only place of the room that asks which it is."""

from __future__ import annotations

from swim2real.calibration import RunFolder
from swim2real.report.recording_sections import RecordingSections
from swim2real.report.run import Json, Sections
from swim2real.report.swim_sections import SwimSections
from swim2real.robots.robot import Robot

_SECTIONS: dict[str, type[SwimSections | RecordingSections]] = {"swims": SwimSections, "recordings": RecordingSections}


def read_sections(robot: Robot, folder: RunFolder, outcome: Json) -> Sections:
    """What a page shows of a robot's trials.

    Args:
        robot: That was calibrated.
        folder: Of the run.
        outcome: That of the best parameters; empty before a run ends.

    Raises:
        RunError: The trials of the run are damaged.
    """
    return _SECTIONS[robot.trials.kind].read(folder, outcome)

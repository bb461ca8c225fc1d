"""How recordings are told and shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from swim2real.advisor.briefing.averages import mean
from swim2real.advisor.briefing.recordings.compared import compared
from swim2real.advisor.briefing.recordings.differences import differences
from swim2real.advisor.briefing.recordings.trials import trials_of
from swim2real.advisor.briefing.recordings.words import recording_details
from swim2real.advisor.briefing.tables import mm, number, value
from swim2real.advisor.briefing.telling import Facts
from swim2real.robots.robot import Robot


class RecordingTelling:
    """Tells recordings: which markers are off, where to, when, and how far they move. A `Telling`."""

    kind = "recordings"
    motion = "motion"
    names = ""
    look_for = (
        "with trial, marker and time: motion that is too wide or too narrow, too early or too late, that dies away too "
        "soon or too late, a pose that is off all the time, a difference that grows, a sensor that reads too much or "
        "too little"
    )
    alike = (
        "motion can be too wide from too little damping, too little stiffness or too much drive; it can come too late "
        "from too much mass or too much damping. Use where, when and in which trials they differ"
    )

    def compared(self, detail: Facts, robot: Robot) -> dict[str, Any]:
        return compared(robot, detail.get("horizon"))

    def trials(self, detail: Facts, robot: Robot) -> list[dict[str, Any]]:
        return trials_of(detail, robot.marker_names, robot.recordings.sensors)

    def differences(self, trials: Sequence[Facts]) -> dict[str, Any]:
        return differences(trials)

    def outcome(self, trials: Sequence[Facts]) -> dict[str, Any]:
        whole = differences(trials)
        markers = mean(trial["figures"].get("aligned_marker_error") for trial in trials) if whole["sensors"] else None
        return {"marker_error": markers, "sensors": whole["sensors"], **whole["median"]}

    def markers(self, facts: Facts) -> str:
        names, compared = ", ".join(facts["robot"]["markers"]), facts["compared"]
        links = ", ".join(f"{a} to {b}" for a, b in compared["links"])
        joined = f" Lines in the pictures join {links}." if links else ""
        return f"Markers: {names}.{joined} The pictures have {compared['picture']}."

    def called(self, trial: Facts) -> str:
        return trial["name"]

    def details(self, facts: Facts) -> list[str]:
        return recording_details(facts)

    def steps(self, facts: Facts) -> str:
        told = ["its loss, the change from the loss before the round"]
        if facts["differences"]["sensors"]:
            told.append("what the markers have of it, the mean error of each sensor")
        told.append("the ratio of amplitudes (simulated / real)")
        told += ["the ratio of speeds"] if facts["compared"]["travels"] else []
        return f"A step tells {', '.join(told[:-1])} and {told[-1]}: learn from it what a change does."

    def step(self, outcome: Facts) -> str:
        told = [f"markers {mm(outcome['marker_error'], 1)} mm"] if outcome["marker_error"] is not None else []
        told += [
            f"{one['name']} {value(one['error'], 3)} {one['unit']}"
            for one in outcome["sensors"]
            if one["error"] is not None
        ]
        for what, ratio in (("amplitude", outcome["amplitude_ratio"]), ("speed", outcome["speed_ratio"])):
            told += [f"{what} {number(ratio, 2)}"] if ratio is not None else []
        return "".join(f", {part}" for part in told)

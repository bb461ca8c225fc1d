"""How steady swims are told and shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from swim2real.advisor.briefing.swims.differences import differences
from swim2real.advisor.briefing.swims.trials import protocol_of, trials_of
from swim2real.advisor.briefing.swims.words import swim_called, swim_details
from swim2real.advisor.briefing.tables import number
from swim2real.advisor.briefing.telling import Facts
from swim2real.robots.robot import Robot

LOSS = {
    "aligned": (
        "The mean distance between the simulated and the real markers over time, markers and trials. It is taken in a "
        "frame that is fixed to the first two markers, and along the swimming direction the distance by which the "
        "simulated robot has come too far or not far enough is added. The motor's angle at the start is fitted; static "
        "offsets of the markers and lost tracks don't count. The simulated robot is in its steady swim from the start."
    ),
    "paper": (
        "The mean distance between the simulated and the real markers over time, markers and trials, in a frame that "
        "turns with the head and advances with it. The simulated robot starts from rest at motor angle 0 and nothing "
        "is fitted: an unknown motor angle at the start and static offsets of the markers count as well."
    ),
}


class SwimTelling:
    """Tells steady swims: speed, amplitude, body wave, and how they change with frequency. A `Telling`."""

    kind = "swims"
    motion = "swim"
    names = "Names of trials are only names; see their frequencies."
    look_for = (
        "with trial and marker: too much or too little sideways amplitude and where along the body, a wave that "
        "travels too fast or too slow, too much or too little speed and at which frequencies, a body that is bent the "
        "wrong way"
    )
    alike = (
        "amplitude can come from a load of the fluid or from stiffness; speed from thrust or from drag. Use how the "
        "differences depend on frequency"
    )

    def compared(self, detail: Facts, robot: Robot) -> dict[str, Any]:
        protocol = protocol_of(detail)
        return {"protocol": protocol, "horizon": detail.get("horizon"), "loss": LOSS[protocol]}

    def trials(self, detail: Facts, robot: Robot) -> list[dict[str, Any]]:
        return trials_of(detail, robot.marker_names)

    def differences(self, trials: Sequence[Facts]) -> dict[str, Any]:
        return differences(trials)

    def outcome(self, trials: Sequence[Facts]) -> dict[str, Any]:
        whole = differences(trials)
        speed = whole["trend"]["speed_ratio"]
        return {
            "speed_ratios": [speed["low"], speed["high"]] if speed else None,
            "amplitude_ratio": whole["median"]["amplitude_ratio"],
        }

    def markers(self, facts: Facts) -> str:
        return f"Markers, head first: {', '.join(facts['robot']['markers'])}."

    def called(self, trial: Facts) -> str:
        return swim_called(trial)

    def details(self, facts: Facts) -> list[str]:
        return swim_details(facts)

    def steps(self, facts: Facts) -> str:
        return (
            "A step tells its loss, the change from the loss before the round, the speed ratio (simulated / real) "
            "at the lowest and at the highest frequency, and the amplitude ratio of "
            f"{facts['robot']['markers'][-1]}: learn from it what a change does."
        )

    def step(self, outcome: Facts) -> str:
        speeds, amplitude = outcome["speed_ratios"], outcome["amplitude_ratio"]
        told = f", speed {number(speeds[0], 2)} to {number(speeds[1], 2)}" if speeds else ""
        return told + (f", amplitude {number(amplitude, 2)}" if amplitude is not None else "")

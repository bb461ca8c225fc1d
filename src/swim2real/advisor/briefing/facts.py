"""All that a VLM can be told at a round, as plain data: a pure function of the situation.

What a trial hasn't is None or empty: a beat with its frequency and phases, a way that it has come, windows of time,
sensors. There are no kinds of trials here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from swim2real.advisor.briefing.compared import how_compared
from swim2real.advisor.briefing.differences import differences
from swim2real.advisor.briefing.history import history
from swim2real.objective import rounded
from swim2real.optimizers import Situation
from swim2real.parameters import ParameterSpace
from swim2real.robots.robot import Robot

MOVING = 0.05  # of the widest real amplitude of a trial: below it a marker's amplitude is noise and has no ratio
STILL = 1e-3  # m, below which a beat's amplitude is noise and has neither ratio nor phase
LEAST_SEEN = 0.3  # of the frames: a marker that is seen in fewer of them says nothing
_ABOUT = ("trials", "protocol", "horizon", "loss", "sensor_errors")
_NEED_NO_SIMULATION = ("frequency", "left_out_share")
_ELSEWHERE = ("loss", "frequency", "phase", "velocity_real", "velocity_simulated", "divergence")
_DEGREES = 180 / math.pi

Facts = Mapping[str, Any]


def facts(
    situation: Situation, robot: Robot, space: ParameterSpace, from_rest: Mapping[str, float | None] | None = None
) -> dict[str, Any]:
    """What is known at a round, ready for JSON.

    Lengths are in m, speeds in m/s, phases in degrees, parameters in their units. None stands for what isn't known: a
    marker that was lost, a simulation that diverged, a ratio to something that hardly moves.

    Args:
        situation: Situation as an advisor gets it.
        robot: The robot whose simulator is calibrated.
        space: Its parameters, as the optimizer uses them.
        from_rest: Forward speed of the incumbent once it has settled from rest, by trial [m/s], where that is known.
    """
    detail: Facts = situation.incumbent.detail or {}
    trials = trial_facts(detail, robot)
    protocol = detail.get("protocol") or robot.trials.protocols[0]
    return rounded(
        {
            "round": len(situation.rounds) + 1,
            "robot": {
                "name": robot.name, "description": robot.description, "markers": list(robot.marker_names),
                "beats": robot.trials.motor_joint is not None,
            },
            "compared": how_compared(robot, protocol, detail.get("horizon")),
            "scale": space.scale,
            "parameters": _parameters(situation, space),
            "incumbent": _incumbent(situation, detail, trials, from_rest or {}),
            "differences": differences(trials),
            "history": history(situation, space, lambda evaluation: trial_facts(evaluation.detail or {}, robot)),
        }
    )  # fmt: skip


def trial_facts(detail: Facts, robot: Robot) -> list[dict[str, Any]]:
    """Every trial that was simulated, by rising frequency, or in the order of the reference where they have none.

    Args:
        detail: Evidence of an evaluation.
        robot: The robot whose trials they are.
    """
    protocol = detail.get("protocol") or "aligned"
    trials = [_trial(name, content, protocol, robot) for name, content in detail.get("trials", {}).items()]
    return sorted(trials, key=lambda trial: trial["frequency"] or 0.0)


def wrapped(degrees: float) -> float:
    """An angle from -180 to 180 [deg]."""
    return (degrees + 180) % 360 - 180


def _trial(name: str, content: Facts, protocol: str, robot: Robot) -> dict[str, Any]:
    """One trial. A diverged simulation has no figures."""
    diverged = content.get("divergence")
    figures = {key: value for key, value in content.items() if not isinstance(value, Mapping | list)}
    known = _without_errors(figures) if diverged else figures
    windows, errors = content.get("windows"), content.get("sensor_errors") or {}
    # evidence of swims had no loss by trial in version 0.1
    loss = "marker_error" if protocol == "paper" else "aligned_marker_error"
    return {
        "name": name,
        "frequency": content.get("frequency"),
        "diverged": diverged,
        "error": known.get("loss", known.get(loss)),
        "figures": {key: value for key, value in known.items() if key not in _ELSEWHERE},
        "velocity": {"real": content.get("velocity_real"), "simulated": known.get("velocity_simulated")},
        "edges": windows["edges"] if windows else None,
        "markers": _markers(content, protocol, robot.marker_names),
        "sensors": [
            {
                "name": sensor.name, "unit": sensor.unit, "meters_per_unit": sensor.meters_per_unit,
                "error": None if diverged else errors.get(sensor.name),
                "windows": windows["sensors"].get(sensor.name) if windows else None,
            }
            for sensor in robot.trials.sensors
        ],
    }  # fmt: skip


def _markers(content: Facts, protocol: str, names: Sequence[str]) -> list[dict[str, Any]]:
    """Each marker in one trial: its errors, how far it moves, and its phase or by how much it is off over time.

    Under the paper's protocol the simulation starts at motor angle 0, wherever the real motor stood, so that a
    difference of phases says nothing.
    """
    diverged, unknown = bool(content.get("divergence")), [None] * len(names)
    # evidence of recordings had the aligned errors by the name of the paper's in version 0.1
    kind = {"paper": "marker_errors", "motion": "motion_marker_errors"}.get(protocol, "aligned_marker_errors")
    errors = content.get(kind) or content.get("marker_errors") or unknown
    seen = [share >= LEAST_SEEN for share in content.get("seen_shares") or [1.0] * len(names)]  # new in 0.2
    real, simulated = (_motion(content, side, seen) for side in ("real", "simulated"))
    if diverged:
        simulated = _motion({}, "simulated", seen)
    beats, windows, offsets = "beat_real" in content, content.get("windows"), content.get("offset")
    widest = max((size for size in real["amplitude"] if size is not None), default=0.0)
    markers: list[dict[str, Any]] = []
    for i, name in enumerate(names):
        silent = diverged or not seen[i]
        amplitude = {"real": real["amplitude"][i], "simulated": simulated["amplitude"][i]}
        phase = {"real": real["phase"][i], "simulated": simulated["phase"][i]}
        ratio = _ratio(amplitude["real"], amplitude["simulated"], beats, widest)
        in_step = ratio is not None and protocol in ("motion", "aligned") and None not in phase.values()
        markers.append(
            {
                "name": name,
                "error": None if silent else errors[i],
                "shape_error": None if silent else (content.get("shape_marker_errors") or unknown)[i],
                "amplitude": {**amplitude, "ratio": ratio},
                "phase_deg": phase,
                "phase_difference_deg": wrapped(phase["simulated"] - phase["real"]) if in_step else None,
                "mean": {"real": real["mean"][i], "simulated": simulated["mean"][i]},
                "offset": _complete(offsets[i]) if offsets and not silent else None,
                "windows": [_complete(window[i]) for window in windows["markers"]] if windows else None,
            }
        )
    return markers


def _motion(content: Facts, side: str, seen: Sequence[bool]) -> dict[str, list[Any]]:
    """Amplitude [m], phase [deg] and mean [m] of each marker that is seen on one side, None where nothing is known."""
    unknown: list[Any] = [None] * len(seen)
    beat = content.get(f"beat_{side}") or {"amplitude": content.get(f"amplitude_{side}") or unknown}
    phases = [None if phase is None else _DEGREES * phase for phase in beat.get("phase", unknown)]
    motion = {"amplitude": beat["amplitude"], "phase": phases, "mean": beat.get("mean", unknown)}
    return {
        name: [known if there else None for known, there in zip(values, seen, strict=True)]
        for name, values in motion.items()
    }


def _ratio(real: float | None, simulated: float | None, beats: bool, widest: float) -> float | None:
    """Of amplitudes, simulated to real; None for a marker that hardly moves."""
    if real is None or simulated is None:
        return None
    moves = min(real, simulated) >= STILL if beats else 0 < real >= MOVING * widest
    return simulated / real if moves else None


def _parameters(situation: Situation, space: ParameterSpace) -> list[dict[str, Any]]:
    here = situation.incumbent.candidate.point
    current, first = space.to_values(here), space.to_values(situation.first.candidate.point)
    return [
        {
            "name": parameter.name, "unit": parameter.unit, "lower": parameter.lower, "upper": parameter.upper,
            "meaning": parameter.meaning, "current": current[parameter.name], "first": first[parameter.name],
            "place": float(here[i]),
        }
        for i, parameter in enumerate(space)
    ]  # fmt: skip


def _incumbent(
    situation: Situation, detail: Facts, trials: Sequence[Facts], from_rest: Mapping[str, float | None]
) -> dict[str, Any]:
    evaluation = situation.incumbent
    accepted = [number for number, finished in enumerate(situation.rounds, start=1) if finished.accepted]
    figures = {name: value for name, value in detail.items() if name not in _ABOUT}
    return {
        "found_in_round": accepted[-1] if accepted else 0,
        "failed": evaluation.failed,
        "loss": None if evaluation.failed else evaluation.loss,
        "figures": _without_errors(figures) if evaluation.failed else figures,
        "trials": list(trials),
        "from_rest": dict(from_rest),
    }


def _without_errors(figures: Facts) -> dict[str, Any]:
    """Figures of a simulation that diverged: only those that need no simulation are known."""
    return {name: value if name in _NEED_NO_SIMULATION else None for name, value in figures.items()}


def _complete(vector: Sequence[float | None]) -> list[float] | None:
    known = [part for part in vector if part is not None]
    return known if len(known) == len(vector) else None

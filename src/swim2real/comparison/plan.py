"""What a comparison consists of: contestants, seeds and protocols under one budget, and the jobs that come of them."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from swim2real import checking
from swim2real.calibration import protocol_for, reference_fingerprint, versions
from swim2real.comparison.contestants import Contestant, folder_name
from swim2real.errors import ArgumentError, RunError
from swim2real.robots.fingerprint import fingerprint
from swim2real.robots.robot import Robot
from swim2real.settings import (
    HORIZON,
    BriefingSettings,
    CalibrationSettings,
    ProtocolName,
    Start,
    asks_a_vlm,
    chooses_start,
    start_of,
)
from swim2real.simulation import Engine
from swim2real.store import reason, write_json
from swim2real.trials import TrialSet

FORMAT = 1
PLAN, RUNS = "plan.json", "runs"
T = TypeVar("T")
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Job:
    """One run of a comparison.

    Attributes:
        key: Its name, such as `aligned/line-search/seed-0`.
        folder: Run folder.
        method: Label of the contestant.
        settings: Settings of the run.
    """

    key: str
    folder: Path
    method: str
    settings: CalibrationSettings

    @property
    def held_out(self) -> str | None:
        """Name of the trial that is left out of the fit, None where there is none."""
        return self.settings.hold_out[0] if self.settings.hold_out else None


@dataclass(frozen=True)
class Plan:
    """Which runs a comparison consists of, and what they rest on.

    Attributes:
        contestants: Methods that take part.
        seeds: Seeds that each contestant runs with.
        protocols: Protocols that each contestant runs under.
        budget: Evaluations of a run.
        robot: Name of the robot that is calibrated.
        trials: Names of the real trials.
        markers: Names of the markers.
        reference: Fingerprint of the real trials.
        engine: Physics engine that simulates.
        leave_one_out: Whether every run is made once more for each trial, without it.
        horizon: Seconds of each trial that are compared, None for all.
        briefing: What VLMs are shown.
        source: Where the reference came from.
        versions: Versions of the libraries that the numbers depend on.
        robot_fingerprint: Fingerprint of the robot file; None for a robot known by its name.
        sensors: Units of the sensors that are compared, by name.
        start: Where steady swims begin; None for each protocol's own.
        format: Version of the file's format.
    """

    contestants: tuple[Contestant, ...]
    seeds: tuple[int, ...]
    protocols: tuple[ProtocolName, ...]
    budget: int
    robot: str
    trials: tuple[str, ...]
    markers: tuple[str, ...]
    reference: str
    engine: Engine
    leave_one_out: bool = False
    horizon: float | None = HORIZON
    briefing: BriefingSettings = field(default_factory=BriefingSettings)
    source: str = ""
    versions: Mapping[str, str] = field(default_factory=versions)
    robot_fingerprint: str | None = None
    sensors: Mapping[str, str] = field(default_factory=dict[str, str])
    start: Start | None = None
    format: Literal[1] = FORMAT

    def __post_init__(self) -> None:
        if not self.contestants or not self.seeds or not self.protocols:
            raise ArgumentError("a comparison needs at least one method, one seed and one protocol")
        if self.leave_one_out and len(self.trials) < 2:
            raise ArgumentError(f"leave-one-out needs at least 2 trials; the reference has {', '.join(self.trials)}")
        if self.start == "rest" and not any(chooses_start(protocol) for protocol in self.protocols):
            raise ArgumentError(
                f"start is '{self.start}', which is for steady swims under protocol motion or aligned; "
                f"this comparison has {', '.join(self.protocols)}"
            )
        self.jobs(".")  # settings that can't be are refused here

    def jobs(self, root: str | Path) -> list[Job]:
        """Every run, in the order of the table, with its folder in the comparison's."""
        runs = Path(root) / RUNS
        jobs: dict[str, Job] = {}
        for protocol in self.protocols:
            for contestant in self.contestants:
                label = contestant.label(CalibrationSettings(protocol=protocol).resolved_scale)
                for seed in self.seeds:
                    for trial in (None, *self.trials) if self.leave_one_out else (None,):
                        key = f"{protocol}/{folder_name(label)}/seed-{seed}"
                        if trial is not None:
                            key += f"/without-{folder_name(trial)}"
                        settings = CalibrationSettings(
                            method=contestant.method, advisor=contestant.advisor, protocol=protocol,
                            budget=self.budget, seed=seed, first="random", starts=1, scale=contestant.scale or "auto",
                            max_steps=contestant.max_steps, horizon=self.horizon,
                            start=start_of(protocol, self.start if chooses_start(protocol) else None),
                            hold_out=() if trial is None else (trial,), briefing=self.briefing, threads=1,
                        )  # fmt: skip
                        jobs[key] = Job(key, runs / key, label, settings)
        return list(jobs.values())

    @property
    def methods(self) -> tuple[str, ...]:
        """Labels of the contestants, in order."""
        return tuple(dict.fromkeys(job.method for job in self.jobs(".")))

    @property
    def basis(self) -> dict[str, Any]:
        """What every run must rest on, by its name in a run's settings."""
        return {
            "robot": self.robot, "robot_fingerprint": self.robot_fingerprint, "reference_fingerprint": self.reference,
            "engine": self.engine,
        }  # fmt: skip

    def extending(self, before: Plan) -> Plan:
        """The plan that has all of an earlier one and of this one.

        Raises:
            RunError: The two can't share a table.
        """
        fixed: list[tuple[str, Any, Any]] = [
            ("reference", _describe_reference(before), _describe_reference(self)),
            ("robot", before.robot, self.robot),
            ("robot file", before.robot_fingerprint, self.robot_fingerprint),
            ("engine", _describe_engine(before.engine), _describe_engine(self.engine)),
            ("horizon", before.horizon, self.horizon),
            *(
                (f"start under protocol {protocol}", start_of(protocol, before.start), start_of(protocol, self.start))
                for protocol in before.protocols
            ),
        ]
        if any(asks_a_vlm(contestant.advisor) for contestant in (*before.contestants, *self.contestants)):
            fixed.append(("briefing", asdict(before.briefing), asdict(self.briefing)))
        for what, then, now in fixed:
            if then != now:
                raise RunError(
                    f"a comparison that was begun can't go on with another {what}: it was {then} and is now {now}; "
                    f"use the same, or another folder"
                )
        if self.budget < before.budget:
            raise RunError(
                f"this comparison has a budget of {before.budget} evaluations and can't go on with {self.budget}; "
                f"use at least as many, or another folder"
            )
        old = before.versions
        changed = [f"{name} {old.get(name)} → {now}" for name, now in self.versions.items() if old.get(name) != now]
        if changed:
            _log.warning("the comparison goes on with other versions: %s", ", ".join(changed))
        return replace(
            self,
            contestants=_union(before.contestants, self.contestants),
            seeds=tuple(sorted({*before.seeds, *self.seeds})),
            protocols=_union(before.protocols, self.protocols),
            leave_one_out=before.leave_one_out or self.leave_one_out,
        )

    def write(self, root: Path) -> None:
        """Writes plan.json.

        Raises:
            RunError: The disk failed.
        """
        with writing(root):
            write_json(root / PLAN, {"format": FORMAT, **asdict(self)}, indent=1)


def make_plan(
    contestants: Sequence[Contestant], seeds: Sequence[int], protocols: Sequence[ProtocolName], budget: int,
    reference: TrialSet, robot: Robot, *, leave_one_out: bool = False, horizon: float | None = HORIZON,
    briefing: BriefingSettings | None = None, source: str = "", start: Start | None = None,
) -> Plan:  # fmt: skip
    """The plan of a comparison of contestants on a reference, as `Plan` describes it.

    Without protocols it has all that the robot's trials can be compared by.

    Raises:
        ArgumentError: The robot's trials can't be compared by a protocol.
    """
    asked: list[ProtocolName] = [protocol_for(robot, protocol).name for protocol in protocols or robot.trials.protocols]
    return Plan(
        tuple(contestants), tuple(dict.fromkeys(seeds)), tuple(dict.fromkeys(asked)), budget, robot.name,
        reference.names, robot.marker_names, reference_fingerprint(reference), Engine.of(robot),
        leave_one_out, horizon, briefing or BriefingSettings(), source,
        robot_fingerprint=None if robot.source is None else fingerprint(robot.source),
        sensors={sensor.name: sensor.unit for sensor in robot.trials.sensors}, start=start,
    )  # fmt: skip


def read_plan(root: str | Path) -> Plan | None:
    """The plan of a comparison's folder, None where there is none yet.

    Raises:
        RunError: It is damaged, or of another format.
    """
    path = Path(root) / PLAN
    if not path.exists():
        return None
    remedy = "restore it or use another folder"
    try:
        return checking.read(Plan, path, "plan", RunError, remedy)
    except ArgumentError as error:  # settings that can't be
        raise RunError(f"plan '{path}': {error}; {remedy}") from error


@contextmanager
def writing(place: str | Path) -> Generator[None]:
    """Turns errors of the disk into a sentence.

    Raises:
        RunError: The disk failed.
    """
    try:
        yield
    except OSError as error:
        raise RunError(
            f"can't write '{error.filename or place}': {reason(error)}; what was run so far is kept, the "
            f"same command goes on"
        ) from error


def _union(first: Sequence[T], second: Sequence[T]) -> tuple[T, ...]:
    return tuple(dict.fromkeys((*first, *second)))


def _describe_reference(plan: Plan) -> str:
    return f"{plan.reference[:12]} ({', '.join(plan.trials)})"


def _describe_engine(engine: Engine) -> str:
    forces = hashlib.sha256(json.dumps(engine.fluid_fingerprint).encode()).hexdigest()
    return f"{engine.name} ({engine.integrator}, {engine.timestep} s, fluid forces {forces[:8]})"

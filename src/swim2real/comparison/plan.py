"""Plan of a comparison: methods, seeds and protocols under one budget, and the jobs that come of them."""

from __future__ import annotations

import hashlib
import json
import logging
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal, cast

from swim2real.calibration import RunFolder, protocol_for, reference_fingerprint, versions
from swim2real.methods import ABLATION, ADVISED, METHODS, MethodName
from swim2real.robots.fingerprint import fingerprint
from swim2real.robots.robot import Robot
from swim2real.settings import (
    CalibrationSettings,
    ComparisonSettings,
    Scale,
    asks_a_vlm,
    check_advisor,
    chooses_start,
    expand_seeds,
)
from swim2real.simulation import Engine
from swim2real.trials import TrialSet
from swimbase import checking
from swimbase.errors import ArgumentError, RunError
from swimbase.names import quoted
from swimbase.store import write_json, writing

FORMAT = 2
PLAN, RUNS = "plan.json", "runs"
PROBLEM = "problem.txt"  # in the run folder of a job that failed
NAMES: tuple[str, ...] = (*METHODS, ABLATION)
KEPT = "what was run so far is kept, the same command goes on"  # remedy where the disk fails
_OWN = "each protocol's own"  # start, where none is asked for
_LONGEST = 1000  # characters of a name; an advisor may be the path of a run
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class MethodVariant:
    """A method with its advisor and scale, as the settings of a run have them.

    Attributes:
        name: Name without the scale: `METHOD`, or `METHOD@ADVISOR` where that isn't physics.
        method: Method.
        advisor: Advisor.
        max_steps: Steps of the line search.
        scale: Scale of the parameters; None takes the protocol's.
    """

    name: str
    method: MethodName
    advisor: str
    max_steps: int
    scale: Scale | None

    def label(self, protocol_scale: Scale | None = None) -> str:
        """Name in tables, with the scale if that isn't the protocol's."""
        return self.name if self.scale in (None, protocol_scale) else f"{self.name}+{self.scale}"


def method_variant(name: str) -> MethodVariant:
    """Reads a variant's name: `METHOD`, `METHOD@ADVISOR`, and either with `+log` or `+linear`.

    Raises:
        ArgumentError: There is no such method or advisor.
    """
    scale: Scale | None = None
    if name.endswith(("+log", "+linear")):
        name, _, ending = name.rpartition("+")
        scale = cast("Scale", ending)
    method, at, advisor = name.partition("@")
    if method not in NAMES or len(name) > _LONGEST:
        raise ArgumentError(
            f"there is no method {quoted(name if method in NAMES else method)}; there are {', '.join(NAMES)}, "
            f"and with another advisor {', '.join(f'{one}@ADVISOR' for one in (*ADVISED, ABLATION))}"
            f"{checking.did_you_mean(method, NAMES)}"
        )
    run_method = "line-search" if method == ABLATION else method
    if at and not METHODS[run_method].advised:
        raise ArgumentError(f"method {method} has no advisor; write '{method}' without '@{advisor}'")
    if at:
        check_advisor(advisor)
    if advisor == "files":
        raise ArgumentError(
            "advisor 'files' waits for a person, and the runs of a comparison for nobody; "
            "use `swim2real calibrate --advisor files`, then '@replay:RUN' here"
        )
    steps = 1 if method == ABLATION else 3
    return MethodVariant(name.removesuffix("@physics"), run_method, advisor or "physics", steps, scale)


def default_methods(robot: Robot) -> tuple[str, ...]:
    """Names of the methods that are compared by default: without stages for a robot that has no plan of them."""
    left_out = {name for name, method in METHODS.items() if not method.by_default}
    if not robot.trials.steady or robot.swims.fit_plan is None:
        left_out |= {name for name, method in METHODS.items() if method.staged}
    return tuple(name for name in NAMES if name not in left_out)


@dataclass(frozen=True)
class Job:
    """One run of a comparison.

    Attributes:
        key: Its name, such as `aligned/line-search/seed-0`.
        folder: Run folder.
        method: Label of the method.
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

    def is_finished(self, plan: Plan) -> bool:
        """True if the run is finished, with these settings.

        Raises:
            RunError: It was made with others, or is damaged.
        """
        folder = RunFolder(self.folder)
        if not folder.exists:
            return False
        recorded = folder.settings()
        wanted = {
            **vars(self.settings), "scale": self.settings.resolved_scale, "robot": plan.robot, "engine": plan.engine,
            "robot_fingerprint": plan.robot_fingerprint, "reference_fingerprint": plan.reference,
            "start": self.settings.start or recorded.start,
        }  # fmt: skip
        if (differing := recorded.difference(replace(recorded, **wanted))) is not None:
            name, before, now = differing
            raise RunError(
                f"'{self.folder}' was run with another setting of {name}: {before!r}, and now it is {now!r}; remove "
                f"it, or use another folder for the comparison"
            )
        record, outcome = folder.record(), folder.outcome()
        # the outcome may be of a smaller budget
        return outcome is not None and outcome.evaluations == len(record) >= (self.settings.budget or 0)


@dataclass(frozen=True)
class Plan:
    """Which runs a comparison consists of, and what they rest on.

    Attributes:
        settings: What is compared, with every method, seed and protocol by its name.
        robot: Name of the robot that is calibrated.
        trials: Names of the real trials.
        markers: Names of the markers.
        reference: Fingerprint of the real trials.
        engine: Physics engine that simulates.
        source: Where the reference came from.
        versions: Versions of the libraries that the numbers depend on.
        robot_fingerprint: Fingerprint of the robot file; None for a robot known by its name.
        sensors: Units of the sensors that are compared, by name.
        format: Version of the file's format.
    """

    settings: ComparisonSettings
    robot: str
    trials: tuple[str, ...]
    markers: tuple[str, ...]
    reference: str
    engine: Engine
    source: str = ""
    versions: Mapping[str, str] = field(default_factory=versions)
    robot_fingerprint: str | None = None
    sensors: Mapping[str, str] = field(default_factory=dict[str, str])
    format: Literal[2] = FORMAT

    def __post_init__(self) -> None:
        settings = self.settings
        if not settings.methods or not settings.protocols:
            raise ArgumentError("a comparison needs at least one method and one protocol")
        if settings.leave_one_out and len(self.trials) < 2:
            raise ArgumentError(f"leave-one-out needs at least 2 trials; the reference has {', '.join(self.trials)}")
        if settings.start == "rest" and not any(map(chooses_start, settings.protocols)):
            raise ArgumentError(
                f"start is '{settings.start}', which is for steady swims under protocol motion or aligned; "
                f"this comparison has {', '.join(settings.protocols)}"
            )
        self.jobs(".")  # settings that can't be are refused here

    def jobs(self, root: str | Path) -> list[Job]:
        """Every run, in the order of the table, with its folder in the comparison's."""
        jobs: dict[str, Job] = {}
        asked, variants = self.settings, [method_variant(name) for name in self.settings.methods]
        left_out = (None, *self.trials) if asked.leave_one_out else (None,)
        for protocol, variant, seed, trial in product(asked.protocols, variants, expand_seeds(asked.seeds), left_out):
            label = variant.label(CalibrationSettings(protocol=protocol).resolved_scale)
            without = "" if trial is None else f"/without-{folder_name(trial)}"
            key = f"{protocol}/{folder_name(label)}/seed-{seed}{without}"
            settings = CalibrationSettings(
                method=variant.method, advisor=variant.advisor, protocol=protocol, budget=asked.budget, seed=seed,
                first="random", starts=1, scale=variant.scale or "auto", max_steps=variant.max_steps,
                horizon=asked.horizon, start=asked.start if chooses_start(protocol) else None,
                hold_out=() if trial is None else (trial,), briefing=asked.briefing, threads=1,
            )  # fmt: skip
            jobs[key] = Job(key, Path(root) / RUNS / key, label, settings)
        return list(jobs.values())

    @property
    def methods(self) -> tuple[str, ...]:
        """Labels of the methods, in order."""
        return tuple(dict.fromkeys(job.method for job in self.jobs(".")))

    def extending(self, before: Plan) -> Plan:
        """The plan that has all of an earlier one and of this one.

        Raises:
            RunError: The two can't share a table.
        """
        old, new = before.settings, self.settings
        fixed: list[tuple[str, Any, Any]] = [
            ("reference", _reference_of(before), _reference_of(self)),
            ("robot", before.robot, self.robot),
            ("robot file", before.robot_fingerprint, self.robot_fingerprint),
            ("engine", _shown(before.engine), _shown(self.engine)),
            ("horizon", old.horizon, new.horizon),
            ("start", old.start or _OWN, new.start or _OWN),
        ]
        if any(asks_a_vlm(method_variant(name).advisor) for name in (*old.methods, *new.methods)):
            fixed.append(("briefing", asdict(old.briefing), asdict(new.briefing)))
        for what, then, now in fixed:
            if then != now:
                raise RunError(
                    f"a comparison that was begun can't go on with another {what}: it was {then} and is now {now}; "
                    f"use the same, or another folder"
                )
        if new.budget < old.budget:
            raise RunError(
                f"this comparison has a budget of {old.budget} evaluations and can't go on with {new.budget}; "
                f"use at least as many, or another folder"
            )
        earlier = before.versions
        changed = [
            f"{name} {earlier.get(name)} → {now}" for name, now in self.versions.items() if earlier.get(name) != now
        ]
        if changed:
            _log.warning("the comparison goes on with other versions: %s", ", ".join(changed))
        both = replace(
            new,
            methods=tuple(dict.fromkeys((*old.methods, *new.methods))),
            seeds=tuple(sorted({*expand_seeds(old.seeds), *expand_seeds(new.seeds)})),
            protocols=tuple(dict.fromkeys((*old.protocols, *new.protocols))),
            leave_one_out=old.leave_one_out or new.leave_one_out,
        )
        return replace(self, settings=both)

    def write(self, root: Path) -> None:
        """Writes plan.json.

        Raises:
            RunError: The disk failed.
        """
        with writing(root, RunError, KEPT):
            write_json(root / PLAN, asdict(self), indent=1)


def make_plan(settings: ComparisonSettings, reference: TrialSet, robot: Robot, source: str = "") -> Plan:
    """The plan of a comparison on a reference.

    Raises:
        ArgumentError: A method isn't known, or the robot's trials can't be compared by a protocol.
    """
    methods: list[str] = []
    for variant, scale in product(map(method_variant, settings.methods or default_methods(robot)), settings.scale):
        own = variant.scale or (None if scale == "auto" else scale)
        methods.append(replace(variant, scale=own).label())
    protocols = [protocol_for(robot, protocol).name for protocol in settings.protocols or robot.trials.protocols[:1]]
    resolved = replace(
        settings, methods=tuple(dict.fromkeys(methods)), scale=("auto",), protocols=tuple(dict.fromkeys(protocols)),
        seeds=tuple(dict.fromkeys(expand_seeds(settings.seeds))), workers=0, cluster=None,
    )  # fmt: skip
    return Plan(
        resolved, robot.name, reference.names, robot.marker_names, reference_fingerprint(reference), Engine.of(robot),
        source, robot_fingerprint=None if robot.source is None else fingerprint(robot.source),
        sensors={sensor.name: sensor.unit for sensor in robot.trials.sensors},
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


def folder_name(label: str) -> str:
    """A label as the name of a folder; no two labels have the same."""
    plain = re.sub(r"[^A-Za-z0-9._@+=-]", "_", label.replace(":", "="))
    if plain == label.replace(":", "=") and len(plain) <= 80:
        return plain
    return f"{plain[:80]}-{hashlib.sha256(label.encode()).hexdigest()[:6]}"


def _reference_of(plan: Plan) -> str:
    return f"{plan.reference[:12]} ({', '.join(plan.trials)})"


def _shown(engine: Engine) -> str:
    forces = hashlib.sha256(json.dumps(engine.fluid_fingerprint).encode()).hexdigest()
    return f"{engine.name} ({engine.integrator}, {engine.timestep} s, fluid forces {forces[:8]})"

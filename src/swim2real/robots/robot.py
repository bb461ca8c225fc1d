"""Description of a robot, from which the rest of swim2real takes all that it knows about one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from markertrack.layout import Layout
from swim2real.formatting import html_table, significant
from swim2real.parameters import ParameterSpace, Values
from swim2real.robots.drives import Drive
from swim2real.robots.targets import Delay, Delays, Target
from swim2real.settings import ProtocolName
from swim2real.trials import Signals, Trial, TrialSet
from swimbase.errors import ArgumentError, TrialError

_PLACES = tuple(
    map(int, (mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtSensor.mjSENS_TENDONPOS, mujoco.mjtSensor.mjSENS_ACTUATORPOS))
)
_JUMP, _RANGE = 0.75, 1.01  # of a turn: readings that jump by more, and lie within it, begin anew after it
_EITHER = "at rest or where their first stretch fits best, whichever suits them,"


class Response(Protocol):
    """Rough response of a robot's swimming to its parameters, as measured over its whole box."""

    @property
    def lengths(self) -> NDArray[np.float64]:
        """Over which change of each parameter the beat changes, relative to the others. Shape (d,)."""
        ...

    def speeds(
        self, points: NDArray[np.float64], frequencies: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Forward speeds [m/s], and whether swims go forward, from -1 for surely not to 1 for surely.

        From points in the logarithmic cube. Shapes (N, d), (F,) to (N, F) and (N, F).
        """
        ...

    def beats(
        self, points: NDArray[np.float64], frequencies: NDArray[np.float64], whole_motion: bool = False
    ) -> NDArray[np.float64]:
        """Sideways fundamentals of the markers, real then imaginary parts [m]. Shapes (N, d), (F,) to (N, F, 2 M).

        In the body frame, or in the frame of the path where the `whole_motion` is compared.
        """
        ...


Score = Callable[[Mapping[str, Any]], float]


@dataclass(frozen=True)
class FitStage:
    """Some parameters that a person would fit on their own.

    Attributes:
        name: In a word.
        parameters: Their names.
        share: Share of the evaluations, relative to the other stages.
        together: Whether all have one place in their ranges and a scan along it, or each its own and a search.
        score: What is minimized, a function of the evidence of an evaluation; NaN where it is unknown. None is the
            loss.
    """

    name: str
    parameters: tuple[str, ...]
    share: float
    together: bool = False
    score: Score | None = None


@dataclass(frozen=True)
class FitPlan:
    """Steps by which a person would fit a robot, for the method of stages.

    Attributes:
        stages: In order.
        held: Values of parameters that are set once and never fitted [unit].
    """

    stages: tuple[FitStage, ...]
    held: Values


@dataclass(frozen=True)
class Sensor:
    """A sensor of the model that trials record, too.

    Attributes:
        name: Name of the model's sensor; one value of a vector is `NAME[I]`.
        unit: Unit of its readings.
        meters_per_unit: Meters of marker error that an error of one unit counts as [m/unit].
        factor: How many of this unit one of the model's is.
        turn: After how much an angle comes back to where it was, or the range of readings is over [unit]; None for what
            never does.
        wraps: Whether readings surely begin anew then; otherwise they do where they jump by about a turn.
    """

    name: str
    unit: str
    meters_per_unit: float
    factor: float = 1.0
    turn: float | None = None
    wraps: bool = False

    def period(self, readings: NDArray[np.float64]) -> float:
        """After how much these readings begin anew [unit]; 0 where they don't. Shape (R,).

        Raises:
            TrialError: They go beyond the range that the robot file gives them.
        """
        known = readings[np.isfinite(readings)]
        if self.turn is None or not known.size:
            return 0.0
        within = float(np.ptp(known)) <= _RANGE * self.turn
        if self.wraps and not within:
            raise TrialError(
                f"readings of sensor '{self.name}' go from {known.min():g} to {known.max():g} {self.unit}, more than "
                f"the {self.turn:g} of its range; give 'range' in the robot file in the unit of the readings"
            )
        jumps = np.abs(np.diff(known)).max(initial=0.0) > _JUMP * self.turn
        return self.turn if self.wraps or (within and jumps) else 0.0


@dataclass(frozen=True)
class Trials:
    """A robot's recordings: how they start, what drives them and what is compared; `SteadySwims` are another kind.

    A recording is played back: simulated from its start under its controls, and compared at the same times.

    Attributes:
        controls: What drives each actuator, by its name; an actuator that isn't named gets 0.
        sensors: Sensors that are compared beside the markers.
        start: Of a recording. `rest`: the model's own pose, at rest. `markers`: the pose that fits the markers best at
            the trial's first frames, and their speed. `fitted`: the pose and speed that fit the first stretch best,
            found with the model of each candidate. Anything else is the name of a keyframe. A trial's own start goes
            first.
        start_named: Whether somebody has said so; else each recording gets the better of rest and fitted.
        frame: Indices of the two markers that make the frame of comparison, origin at the first, x toward the second;
            None compares in the world.
        score_progress: Whether the robot goes somewhere and how far it comes is compared: along the line from the
            second to the first marker of the frame.
        steady: Whether they are steady swims.
        description: What they are, in words.
        protocols: How they can be compared, the default first.
    """

    controls: Mapping[str, Drive]
    sensors: tuple[Sensor, ...] = ()
    start: str = "rest"
    frame: tuple[int, int] | None = None
    score_progress: bool = False
    start_named: bool = True

    steady: ClassVar[bool] = False
    description: ClassVar[str] = "recordings"
    protocols: ClassVar[tuple[ProtocolName, ...]] = ("playback",)

    @property
    def scales(self) -> dict[str, float]:
        """Meters that an error of one unit of each sensor counts as, by the sensor's name [m/unit]."""
        return {sensor.name: sensor.meters_per_unit for sensor in self.sensors}

    def unwrapped(self, trial: Trial) -> tuple[Trial, dict[str, float]]:
        """The trial, with readings that go on where they began anew; after how much these did [unit], by their names.

        Raises:
            TrialError: Readings go beyond the range that the robot file gives them.
        """
        read, periods = trial.sensors, dict[str, float]()
        if read is None:
            return trial, periods
        values = read.values.copy()
        for sensor in self.sensors:
            column = values[:, read.names.index(sensor.name)] if sensor.name in read.names else np.zeros(0)
            if period := sensor.period(column):
                known, periods[sensor.name] = np.isfinite(column), period
                column[known] = np.unwrap(column[known], period=period)
        return replace(trial, sensors=Signals(read.times, read.names, values)) if periods else trial, periods

    def summary(self, marker_names: tuple[str, ...]) -> str:
        """Description of a trial, in a sentence."""
        starts = {
            "rest": "at rest",
            "markers": "where the markers are",
            "fitted": "where their first stretch fits best",
        }
        start = starts.get(self.start, f"in keyframe '{self.start}'") if self.start_named else _EITHER
        pair = "" if self.frame is None else " and ".join(marker_names[i] for i in self.frame)
        frame = f"the frame of {pair}" if pair else "the world"
        progress = ", progress included" if self.score_progress else ""
        if not marker_names:
            return f"Trials are recordings without a camera that start {start} and are compared by their sensors."
        return f"Trials are recordings that start {start} and are compared in {frame}{progress}."


@dataclass(frozen=True, kw_only=True)
class SteadySwims(Trials):
    """Trials in which a robot swims with a steady beat, at one frequency a trial; they are compared once it is steady.

    Attributes:
        surge_joints: The two joints that carry the robot along world x and y.
        tail_markers: Indices of the markers whose sideways motion shows the beat best.
        motor_joint: The joint that turns once a beat, at a constant speed; None for a tail that swings with a servo.
        slow_mode: Whether something swings slower than the tail beats, so that swims may not repeat beat by beat.
        from_afar: Whether trials are compared without the camera's perspective, where they say what it did to them.
        head_first: Frequencies at which the robot is known to swim head first from rest, also where no trial shows it
            [Hz].
        response: What the built-in physics advisor believes at first; None where nothing was measured.
        fit_plan: Stages in which a person would fit the robot; None where nobody has planned any.
    """

    surge_joints: tuple[str, str]
    tail_markers: tuple[int, ...]
    motor_joint: str | None = None
    slow_mode: bool = False
    from_afar: bool = False
    head_first: tuple[float, ...] = ()
    response: Response | None = None
    fit_plan: FitPlan | None = None

    steady: ClassVar[bool] = True
    description: ClassVar[str] = "steady swims"
    protocols: ClassVar[tuple[ProtocolName, ...]] = ("motion", "aligned", "paper")

    def summary(self, marker_names: tuple[str, ...]) -> str:
        beats = f"joint '{self.motor_joint}' turns" if self.motor_joint else "the servo swings"
        return (
            f"Trials are steady swims: {beats} at the trial's frequency, and the robot moves along joints "
            f"'{self.surge_joints[0]}' and '{self.surge_joints[1]}'."
        )


@dataclass(frozen=True)
class CommandLimits:
    """Limits of a policy's commands: an action, from -1 to 1, is the rate at which an actuator's command changes.

    Attributes:
        lower: Least command [unit].
        upper: Greatest command [unit].
        rate: Greatest change of the command [unit/s], that of an action of 1.
        unit: Unit of the commands, as rad/s of a motor or rad of a servo.
    """

    lower: float
    upper: float
    rate: float
    unit: str


@dataclass(frozen=True)
class PolicySetup:
    """Commands and observations of a robot's policies.

    Attributes:
        actuators: Limits of each actuator's command, by its name.
        sites: Sites of the model that a policy sees beside the markers.
        observe: Parts of the observation by task, as `rl.state.PARTS` names them; a task that isn't named sees
            what it asks for.
        rubbing_tendon: Tendon that loses tension where friction is studied; None where none does.
    """

    actuators: Mapping[str, CommandLimits]
    sites: tuple[str, ...] = ()
    observe: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    rubbing_tendon: str | None = None


@dataclass(frozen=True)
class Robot:
    """A robot that can be built for any parameter values.

    Attributes:
        name: As in parameters files.
        description: What it is, where its markers are, what drives it and which way it moves, in two to five sentences
            for a person or a VLM who has never seen it.
        space: The parameters that are calibrated, with their default scale.
        build: Values to an MjSpec. Its last sensors are one `framepos` a marker, in order, named `marker:NAME`, except
            for steady swims, whose spec has these sensors only, under the markers' names.
        marker_names: M names; of a swimmer head first.
        rest_markers: Marker positions in the pose of the model, relative to the first, in the plane of the camera [m].
            Of a swimmer straight, x toward the tail. Shape (M, 2).
        marker_heights: Heights of the markers above the robot's origin, toward the camera, which sees higher ones
            farther out [m]. Shape (M,).
        trials: What a trial of this robot is.
        plane: Axes of the world that the camera sees, to its right and up: (0, 1) from above, (0, 2) from the side.
        links: Pairs of markers that a picture joins by a line.
        policy: What a policy commands and sees; None where nobody has said.
        delays: What parameters delay in recordings, by the parameter's name.
        source: File that describes the robot; None for one of Python's.
        targets: Places in the model that a parameter sets, by its name, where a file says so.
    """

    name: str
    description: str
    space: ParameterSpace
    build: Callable[[Values], mujoco.MjSpec]
    marker_names: tuple[str, ...]
    rest_markers: NDArray[np.float64]
    marker_heights: NDArray[np.float64]
    trials: Trials
    plane: tuple[int, int] = (0, 1)
    links: tuple[tuple[int, int], ...] = ()
    policy: PolicySetup | None = None
    delays: Mapping[str, tuple[Delay, ...]] = field(default_factory=dict[str, tuple[Delay, ...]])
    source: Path | None = None
    targets: Mapping[str, tuple[Target, ...]] = field(default_factory=dict[str, tuple[Target, ...]])

    def __repr__(self) -> str:
        kind = "steady swims" if self.trials.steady else "recordings"
        return f"<Robot {self.name}: {len(self.space)} parameters, {len(self.marker_names)} markers, {kind}>"

    def _repr_html_(self) -> str:
        rows = [
            (p.name, "" if p.unit == "-" else p.unit, significant(p.lower), significant(p.upper),
             significant(p.published), p.meaning)
            for p in self.space
        ]  # fmt: skip
        return html_table(repr(self), ("parameter", "unit", "lower", "upper", "value", "meaning"), rows)

    def __getstate__(self) -> dict[str, object]:
        """Without what is compiled, which another process compiles when it needs it."""
        return {name: value for name, value in vars(self).items() if name not in ("model", "marker_bodies")}

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled robot with its published values; whoever changes it takes a copy."""
        return self.build(self.space.published).compile()

    @cached_property
    def marker_bodies(self) -> tuple[int, ...]:
        """Number of the rigid body that carries each marker, 0 for the world: bodies that are welded together are one.

        Markers of one body keep their distances as the robot moves, and those of the world don't move.
        """
        model = self.model
        sensors = [model.sensor(i) for i in range(model.nsensor - len(self.marker_names), model.nsensor)]
        return tuple(int(model.body_weldid[model.site_bodyid[int(sensor.objid[0])]]) for sensor in sensors)

    @cached_property
    def size(self) -> float:
        """Largest distance between two markers at rest, else the model's extent [m]."""
        apart = np.linalg.norm(self.rest_markers[:, None] - self.rest_markers, axis=2).max(initial=0.0)
        return float(apart or self.model.stat.extent)

    @property
    def sensed_places(self) -> tuple[str, ...]:
        """Sensors that are compared and tell a place: that of a joint, a tendon or an actuator."""
        kinds = {self.model.sensor(i).name: int(self.model.sensor(i).type[0]) for i in range(self.model.nsensor)}
        return tuple(sensor.name for sensor in self.trials.sensors if kinds.get(sensor.name) in _PLACES)

    @property
    def layout(self) -> Layout:
        """The markers, as tracking knows them: those of a swimmer are a chain."""
        markers = self.marker_names, self.rest_markers, self.marker_heights, self.marker_bodies
        return Layout(*markers, self.trials.steady, f"robot '{self.name}'")

    def check_markers(self, what: str) -> None:
        """Refuses a robot that is recorded without a camera.

        Args:
            what: What one would do with its markers, as a verb.

        Raises:
            ArgumentError: It has no markers.
        """
        if not self.marker_names:
            raise ArgumentError(
                f"robot '{self.name}' has no markers, so there is nothing to {what}; its trials are tables of sensors, "
                f"which calibrate, evaluate and identify take as they are"
            )

    def check_trials(self, trials: TrialSet) -> None:
        """Refuses trials of another robot.

        Raises:
            TrialError: They have another number of markers; of recordings, or other names.
        """
        theirs, own = trials.marker_names, self.marker_names
        if theirs != own and (not self.trials.steady or len(theirs) != len(own)):
            raise TrialError(
                f"these trials have {len(theirs)} markers ({', '.join(theirs)}); robot '{self.name}' has {len(own)} "
                f"({', '.join(own)}); give --robot FILE.toml, or name the markers alike, in the same order"
            )

    def starting(self, start: str) -> Robot:
        """The robot whose recordings start like that."""
        return replace(self, trials=replace(self.trials, start=start))

    def delays_of(self, values: Values) -> Delays:
        """The delays of recordings for parameter values."""
        return Delays(self.delays, values)

    @property
    def swims(self) -> SteadySwims:
        """Steady swims of a robot.

        Raises:
            ArgumentError: Its trials are recordings.
        """
        if not isinstance(self.trials, SteadySwims):
            raise ArgumentError(
                f"the trials of robot '{self.name}' are recordings; this needs steady swims, so a robot file with "
                f"[swims] instead of [recordings]"
            )
        return self.trials

    @property
    def motor_joint(self) -> str | None:
        """The joint that the motor of a steady swimmer turns; None for a servo, and for recordings."""
        return self.trials.motor_joint if isinstance(self.trials, SteadySwims) else None

    @property
    def recordings(self) -> Trials:
        """Trials of a robot whose trials are recordings.

        Raises:
            ArgumentError: They are steady swims.
        """
        if self.trials.steady:
            raise ArgumentError(f"the trials of robot '{self.name}' are steady swims; this needs recordings")
        return self.trials

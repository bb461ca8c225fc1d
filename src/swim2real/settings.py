"""Settings that a person decides of a calibration, a comparison, tracking or training, checked when they are made.

The command line is built from these classes: a field is an option, and the text below it is its help. So the module
needs the standard library alone, and a number that stands for "all" can be written as 0.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from swim2real.methods import ADVISED, METHODS, MethodName
from swimbase.errors import ArgumentError
from swimbase.names import quoted

ProtocolName = Literal["motion", "aligned", "paper", "playback"]
Start = Literal["speed", "rest"]
FIRST = ("auto", "model", "random")  # or a parameters file
FROM_FILE = "file"  # first point of a run that began at the values of one
Scale = Literal["log", "linear"]
ScaleChoice = Literal["auto", "log", "linear"]
Show = Literal["both", "numbers", "pictures"]
MediaKind = Literal["auto", "video", "images"]
DetailName = Literal["low", "medium", "high"]
TrackerName = Literal["detection", "aruco"]

HORIZON = 4.0  # s of each trial that are compared
PAPER_BUDGET = 40  # evaluations
REPLY_TOKENS = 16_384  # thinking included
PAPER_STEPS = 5_000_000  # of a training
PAPER_EXPLORATION = 50_000
TRAIN_FREQ = 200  # transitions between two rounds of learning: the prior work's train_freq
MOST_REPLAY = 1_000_000  # transitions kept, as Stable-Baselines3 does

PHYSICS, FILES, REPLAY = "physics", "files", "replay:"
BUILT_IN = (PHYSICS,)  # advisors that aren't briefed
# the providers of VLMs, each with the name of a model, which begins with that of its family
EXAMPLE_MODELS = {
    "google": "google:gemini-3.1-pro-preview",
    "openai": "openai:gpt-5.2",
    "anthropic": "anthropic:claude-sonnet-5",
}


@dataclass(frozen=True)
class BriefingSettings:
    """Contents of the briefing of a VLM, or of a person in its place.

    Attributes:
        show: Numbers, pictures or both; one alone is an ablation.
        media: Films or sheets of pictures; auto: films for models that accept them.
        detail: Amount: trials, pictures, history.
    """

    show: Show = "both"
    media: MediaKind = "auto"
    detail: DetailName = "medium"

    def __post_init__(self) -> None:
        _choice("show", self.show, get_args(Show))
        _choice("media", self.media, get_args(MediaKind))
        _choice("detail", self.detail, get_args(DetailName))


@dataclass(frozen=True)
class VlmAccess:
    """Access to a VLM, and its cost. All of it may change when a run is resumed.

    Attributes:
        base_url: A server with the provider's protocol, such as vLLM, llama.cpp or Ollama (http://127.0.0.1:8000/v1).
        key_variable: Environment variable with the key for --base-url; by default no key is sent.
        max_calls: Stop after this many calls, corrections and failed ones included; the run can be resumed with more.
        max_cost: Stop before the calls cost more [USD], if the price is known.
        reply_tokens: Largest number of tokens of a reply, thinking included.
        timeout: Longest duration of one attempt [s].
        tries: Attempts of one call.
        once: With advisor files: write the question and exit; --resume continues when the reply is there.
    """

    base_url: str | None = None
    key_variable: str | None = None
    max_calls: int | None = None
    max_cost: float | None = None
    reply_tokens: int = REPLY_TOKENS
    timeout: float = 180.0
    tries: int = 6
    once: bool = False

    def __post_init__(self) -> None:
        _finite("timeout", self.timeout, unit=" s")
        _least("tries", self.tries, 1)
        _least("reply_tokens", self.reply_tokens, 256)
        _least("max_calls", self.max_calls, 1)
        _finite("max_cost", self.max_cost, unit=" USD")


def chooses_start(protocol: str) -> bool:
    """True if steady swims may begin at rest or at speed under a protocol."""
    return protocol in ("motion", "aligned")


@dataclass(frozen=True, kw_only=True)
class EvaluationSettings:
    """Comparison of parameters with real trials.

    Attributes:
        protocol: For steady swims. motion: the whole motion in the frame of the path, with the recoil of the head.
            aligned: the body and its progress alone. Both use the identified frequency, a steady swim, phase and
            registration, and leave lost tracks out. paper: none of these. Recordings are always compared by playback.
        start: Start of steady swims. rest: at rest, like the robot, so that no fit swims tail first from there; takes
            about half as long again. speed: at the real speed. Default: rest for protocol motion, speed for aligned and
            for a robot that names frequencies at which it swims head first from rest (`head_first`).
        horizon: Compared seconds of each trial; 0 for all of it.
        pieces: Cut each recording into pieces of this many seconds, each simulated from a fitted start of its own. For
            chaotic motion, and for oscillations over many periods. By default a recording is simulated in one piece.
        threads: Trials simulated in parallel; 0 for all cores. Results don't depend on it.
    """

    protocol: ProtocolName = "motion"
    start: Start | None = None
    horizon: float | None = HORIZON
    pieces: float | None = None
    threads: int | None = None

    def __post_init__(self) -> None:
        _choice("protocol", self.protocol, get_args(ProtocolName))
        _choice("start", "rest" if self.start is None else self.start, get_args(Start))
        object.__setattr__(self, "horizon", _horizon(self.horizon))
        _finite("pieces", self.pieces, unit=" s")
        object.__setattr__(self, "threads", all_cores(self.threads))


@dataclass(frozen=True, kw_only=True)
class CalibrationSettings(EvaluationSettings):
    """Settings that decide the result of a calibration.

    On resume `threads` and `minutes` may change, and the budget may be raised; without a budget, multi-start searches
    on until it is done, and a run by another method is finished with it from where it stands.

    Attributes:
        method: An entry of `swim2real.methods`.
        advisor: What proposes parameters. physics: built in, no key. google:MODEL, openai:MODEL, anthropic:MODEL: a
            VLM, key from GOOGLE_API_KEY, OPENAI_API_KEY or ANTHROPIC_API_KEY. files: you, or any chat window.
            replay:RUN: an earlier run's replies, without a network; settings that aren't given are that run's.
        budget: Most simulation evaluations, the first included. By default multi-start searches until it is done, and
            other methods make the paper's 40.
        minutes: Longest search. By default evaluations alone end it, so that its result doesn't depend on how fast the
            machine is; one that minutes end isn't finished, and goes on with --resume.
        seed: Decides the first point and every random choice.
        finish: When the budget is spent, go on from the best point with multi-start until it is done: an advisor finds
            where to search, least squares the rest.
        first: First point. model: the values of the robot's model. random: anywhere within the bounds, by the seed.
            FILE: those of a parameters file, or the best ones of a run folder. auto: model for recordings with seed 0
            or several starts, else random.
        starts: Points that the line search evaluates first, the first point included, spread over the bounds by the
            seed; it descends from the best, and from the next best where it stalls. Default: 1; for recordings with the
            physics advisor, a tenth of the budget, at most two per parameter.
        scale: Scale of the parameters; auto: linear for protocol paper, log otherwise.
        max_steps: Steps of the line search; 1 is the ablation without it.
        probes: Parameters measured before the advisor's first proposal, in the robot's order, at one evaluation each; a
            VLM gets their effects in a table.
        hold_out: Trials to leave out of the fit and to evaluate at the end.
    """

    method: MethodName | None = None
    advisor: str = PHYSICS
    budget: int | None = None
    minutes: float | None = None
    finish: bool = False
    seed: int = 0
    first: str = "auto"
    starts: int | None = None
    scale: ScaleChoice = "auto"
    max_steps: int = 3
    probes: int = 0
    hold_out: tuple[str, ...] = ()
    briefing: BriefingSettings = field(default_factory=BriefingSettings)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_advisor(self.advisor)
        if self.method is None:
            advised = self.advisor != PHYSICS or self.probes or (self.starts or 1) > 1
            object.__setattr__(self, "method", "line-search" if advised else "multi-start")
        _choice("method", self.method, METHODS)
        if self.budget is None and self.method != "multi-start":
            object.__setattr__(self, "budget", PAPER_BUDGET)
        _least("budget", self.budget, 1)
        _finite("minutes", self.minutes, unit=" min")
        if self.finish and self.budget is None:
            raise ArgumentError("finish needs a budget, as it continues once that is spent: leave it out, or give one")
        _seed(self.seed)
        _least("starts", self.starts, 1)
        if (self.starts or 1) > 1 and self.method not in ADVISED:
            raise ArgumentError(f"starts is for {' and '.join(ADVISED)}; method {self.method} has starts of its own")
        if self.first not in FIRST and not Path(self.first).exists() and self.first != FROM_FILE:
            raise ArgumentError(
                f"first is '{self.first}'; it must be {', '.join(FIRST)}, or a parameters file or run folder, "
                f"and there is none of that name"
            )
        _choice("scale", self.scale, get_args(ScaleChoice))
        _least("max_steps", self.max_steps, 1)
        _least("probes", self.probes, 0)
        if self.probes and self.method not in ADVISED:
            raise ArgumentError(f"probes is for {' and '.join(ADVISED)}, which have an advisor, not {self.method}")

    @property
    def chosen_method(self) -> MethodName:
        """The method, chosen by the advisor where none is given."""
        return self.method or "multi-start"

    @property
    def steps_of_a_rejection(self) -> int:
        """Steps after which a round that gained nothing may be over; proposal-search may ask again after one."""
        return self.max_steps if self.method == "line-search" else 1

    @property
    def resolved_scale(self) -> Scale:
        """The scale of the parameters, chosen by the protocol where the scale is `auto`."""
        if self.scale == "auto":
            return "linear" if self.protocol == "paper" else "log"
        return self.scale


@dataclass(frozen=True, kw_only=True)
class ComparisonSettings:
    """Which methods are compared, and under which conditions.

    Attributes:
        methods: Entries of `swim2real.methods`, or no-line-search, the ablation of line-search. An advisor other than
            physics stands behind an @, as in line-search@google:MODEL or line-search@replay:RUN. By default all but
            those that are not `by_default`, and `staged` for a robot without stages.
        seeds: Numbers, and ranges without their end: 0:5 is 0 1 2 3 4.
        budget: Simulation evaluations per run, the first included.
        protocols: As for calibrate; by default the one that calibrate takes.
        start: Start of steady swims, as for calibrate; by default each protocol's own.
        scale: Scales of the parameters, each a separate contestant; auto: linear under protocol paper, log otherwise.
            METHOD+log and METHOD+linear choose it for one method.
        leave_one_out: Also run every method and seed once per trial, with that trial left out of the fit, and evaluate
            on it.
        horizon: Compared seconds of each trial; 0 for all of it.
        workers: Runs in parallel on this machine; 0 for all cores.
        cluster: Instead of --workers, a Dask cluster: the address of its scheduler (tcp://HOST:PORT), or local:N. Its
            workers need this version of swim2real and must see --out at the same path. Results don't depend on the
            workers.
    """

    methods: tuple[str, ...] = ()
    seeds: tuple[int | str, ...] = ("0:5",)
    budget: int = 40
    protocols: tuple[ProtocolName, ...] = ()
    start: Start | None = None
    scale: tuple[ScaleChoice, ...] = ("auto",)
    leave_one_out: bool = False
    horizon: float | None = HORIZON
    briefing: BriefingSettings = field(default_factory=BriefingSettings)
    workers: int = 0
    cluster: str | None = None

    def __post_init__(self) -> None:
        expand_seeds(self.seeds)
        _least("budget", self.budget, 1)
        for protocol in self.protocols:
            _choice("protocols", protocol, get_args(ProtocolName))
        _choice("start", "rest" if self.start is None else self.start, get_args(Start))
        for scale in self.scale:
            _choice("scale", scale, get_args(ScaleChoice))
        object.__setattr__(self, "horizon", _horizon(self.horizon))
        if self.workers < 0:
            raise ArgumentError(f"workers is {self.workers}; it must be 0 (as many as there are cores) or above")
        if self.cluster is not None and self.workers:
            raise ArgumentError(
                f"workers is {self.workers}, which is for this machine; leave it out with cluster {self.cluster}"
            )


@dataclass(frozen=True)
class TrackingSettings:
    """Settings of marker tracking in videos.

    Attributes:
        tracker: detection: follows markers by flow and by what they look like. aruco: ArUco and AprilTag markers,
            identified by their numbers.
        tags: Dictionary of the tags for --tracker aruco, as OpenCV names it: 4X4_50, APRILTAG_36h11 and others.
        midline: Follow the midline of a swimmer without markers, of one tone, under a fixed camera; --markers then has
            the first and the last marker alone, clicked at the tips of head and tail (`pick --midline`).
        camera: JSON file with known lengths, camera height, plane or lens; docs/tracking.md describes it.
        smooth: Smooth the track over time; at 60 frames per second it keeps 98 % of a beat of 2.25 Hz and its harmonic.
        overlay: Whether the overlay video is written; --no-overlay leaves it out.
    """

    tracker: TrackerName = "detection"
    tags: str = "4X4_50"
    midline: bool = False
    camera: Path | None = None
    smooth: bool = False
    overlay: bool = True

    def __post_init__(self) -> None:
        _choice("tracker", self.tracker, get_args(TrackerName))
        if self.midline and self.tracker != "detection":
            raise ArgumentError(f"--midline follows a swimmer without markers; leave out --tracker {self.tracker}")


@dataclass(frozen=True)
class TrainingSettings:
    """Settings that decide a training; the defaults are the paper's.

    The prior work learns once after every 200 transitions: 25,000 updates in 5 million steps. A shorter run makes about
    as many: it still learns after every 200 transitions, but `ceil(5 M / env_steps)` times, and at most 200 times: one
    update a transition is soft actor-critic's own ratio. Stable-Baselines3 counts `train_freq` in steps of all
    environments together, so it gets 200 divided by their number.

    Attributes:
        task: forward: as far as possible in 2 s. target: to a goal in the plane, in three stages. A task of your own:
            the name of a package's entry point, or python:FILE.py:CLASS.
        env_steps: Steps of all environments together, 50 per second.
        seed: Decides the network's start, exploration and every episode.
        environments: Environments stepped together; a divisor of 200.
        exploration: Random steps before learning; by default a tenth of the run, at most 50,000.
        updates: Gradient steps after every 200 environment steps; by default as many as make about 25,000 in all (1 for
            5 million steps, as in the prior work), at most 200.
        checkpoint_every: Environment steps between checkpoints; by default a twentieth of the run.
        learning_rate: Of actor, critics and entropy coefficient.
        batch: Transitions per gradient step.
        discount: Discount of rewards per step; by default the task's: 0.99 for forward and paper-target (the paper's),
            0.995 for target.
        target_rate: Share by which the target critics follow per gradient step.
        layers: Widths of the hidden layers of actor and critics.
        near_goals: For target and paper-target: share of the episodes that have a goal of an earlier stage.
        turn_reward: For target: distance [m] by which the goal counts as nearer after a turn of 1 rad to it. 0.2 for a
            robot that turns slowly, such as fish-rolling; 0 for one whose head swings, such as the snake.
        noise_time: Time over which the noise of exploration stays alike [s]; with 0 every step draws anew.
    """

    task: str
    env_steps: int = PAPER_STEPS
    seed: int = 0
    environments: int = 100
    exploration: int | None = None
    updates: int | None = None
    checkpoint_every: int | None = None
    learning_rate: float = 2e-3
    batch: int = 256
    discount: float | None = None
    target_rate: float = 0.1
    layers: tuple[int, ...] = (256, 256)
    near_goals: float = 0.0
    turn_reward: float = 0.0
    noise_time: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.near_goals < 1:
            raise ArgumentError(f"near_goals is {self.near_goals:g}; it is a share, from 0 below 1")
        for name, value, unit in (("turn_reward", self.turn_reward, "m"), ("noise_time", self.noise_time, "s")):
            if not 0 <= value < math.inf:
                raise ArgumentError(f"{name} is {value:g} {unit}; it must be finite and 0 or above")
        if self.env_steps < TRAIN_FREQ:
            raise ArgumentError(f"env_steps is {self.env_steps}; learning needs {TRAIN_FREQ} at least")
        if not 0 <= self.seed < 2**31:
            raise ArgumentError(f"seed is {self.seed}; it must be 0 or more and below 2^31")
        if self.environments < 1 or TRAIN_FREQ % self.environments:
            raise ArgumentError(
                f"environments is {self.environments}; it must divide {TRAIN_FREQ}: 1, 2, 4, 5, 8, 10, 20 …"
            )
        _least("updates", self.updates, 1)
        _least("checkpoint_every", self.checkpoint_every, 1)
        if self.exploration is not None and not 0 <= self.exploration < self.env_steps:
            raise ArgumentError(f"exploration is {self.exploration}; it must be 0 or more and below env_steps")

    @property
    def exploration_steps(self) -> int:
        """Random steps before learning."""
        return min(PAPER_EXPLORATION, self.env_steps // 10) if self.exploration is None else self.exploration

    @property
    def updates_per_round(self) -> int:
        """Gradient steps after every 200 transitions."""
        wanted = min(TRAIN_FREQ, math.ceil(PAPER_STEPS / self.env_steps))
        return wanted if self.updates is None else self.updates

    @property
    def checkpoint_steps(self) -> int:
        """Environment steps between checkpoints, a multiple of 200."""
        wanted = max(10_000, self.env_steps // 20) if self.checkpoint_every is None else self.checkpoint_every
        return max(TRAIN_FREQ, wanted // TRAIN_FREQ * TRAIN_FREQ)

    @property
    def total_steps(self) -> int:
        """Environment steps that are made: a multiple of 200."""
        return math.ceil(self.env_steps / TRAIN_FREQ) * TRAIN_FREQ

    @property
    def replay(self) -> int:
        """Transitions that the replay buffer holds."""
        return min(MOST_REPLAY, self.total_steps)


@dataclass(frozen=True)
class IdentifiabilitySettings:
    """Settings that decide the result of a study of identifiability.

    Attributes:
        rounds: Rounds of 32 evaluations, after which the sets that fit are drawn again.
        seed: Decides every random choice.
    """

    rounds: int = 8
    seed: int = 0

    def __post_init__(self) -> None:
        _least("rounds", self.rounds, 1)
        _least("seed", self.seed, 0)


@dataclass(frozen=True)
class EnsembleSettings:
    """Settings that decide which parameter sets are in an ensemble.

    Attributes:
        within: Highest loss of a member, as a multiple of the lowest.
        count: Members to keep, spread out.
    """

    within: float = 1.1
    count: int = 20

    def __post_init__(self) -> None:
        if not 1 < self.within <= 10:
            raise ArgumentError(f"within is {self.within:g}; it is a multiple of the lowest loss, above 1 and up to 10")
        _least("count", self.count, 2)


# the help of the command line lists the entries
for _settings, _said, _listed in (
    (CalibrationSettings, "An entry of `swim2real.methods`.", " ".join(f"{m}: {METHODS[m].help}." for m in METHODS)),
    (ComparisonSettings, "Entries of `swim2real.methods`", ", ".join(METHODS)),
    (ComparisonSettings, "those that are not `by_default`", ", ".join(m for m in METHODS if not METHODS[m].by_default)),
    (ComparisonSettings, "`staged`", " and ".join(m for m in METHODS if METHODS[m].staged)),
):
    _settings.__doc__ = str(_settings.__doc__).replace(_said, _listed)


def check_advisor(name: str) -> None:
    """Checks the name of an advisor.

    Raises:
        ArgumentError: There is no advisor of this name.
    """
    if name in (*BUILT_IN, FILES):
        return
    if name.startswith(REPLAY):
        if not name.removeprefix(REPLAY):
            raise ArgumentError("advisor is 'replay:'; say of which run: replay:RUN")
        return
    if ":" not in name:
        vlms = ", ".join(f"{provider}:MODEL" for provider in EXAMPLE_MODELS)
        raise ArgumentError(f"advisor is {quoted(name)}; there are {', '.join(BUILT_IN)}, {FILES}, {REPLAY}RUN, {vlms}")
    split_vlm_name(name)


def asks_a_vlm(name: str) -> bool:
    """True if the advisor of this name is briefed: a VLM, or a person in its place."""
    return name not in BUILT_IN and replayed_run(name) is None


def replayed_run(name: str) -> Path | None:
    """The run whose replies the advisor of this name repeats, None for other advisors."""
    return Path(name.removeprefix(REPLAY)) if name.startswith(REPLAY) else None


def split_vlm_name(name: str) -> tuple[str, str]:
    """The provider and the model of a name such as `google:gemini-3.1-pro-preview`.

    Raises:
        ArgumentError: It isn't of that form, or there is no such provider.
    """
    provider, colon, model = (part.strip() for part in name.partition(":"))
    if provider not in EXAMPLE_MODELS:
        families = {example.partition(":")[2].split("-")[0]: kind for kind, example in EXAMPLE_MODELS.items()}
        near = [kind for word, kind in families.items() if provider.lower().startswith(word)]
        near += difflib.get_close_matches(provider.lower(), EXAMPLE_MODELS, n=1)
        is_model = near and "-" in provider and families.get(provider.split("-")[0].lower()) == near[0]
        hint = f"; did you mean {near[0]}:{model or (provider if is_model else 'MODEL')}?" if near else ""
        forms = ", ".join(f"{kind}:MODEL" for kind in EXAMPLE_MODELS)
        raise ArgumentError(f"there is no advisor {quoted(name)}; a VLM is {forms}{hint}")
    if not colon or not model or re.search(r"\s", model):
        raise ArgumentError(f"{quoted(name)} names no model; say which one, such as {EXAMPLE_MODELS[provider]}")
    return provider, model


def expand_seeds(seeds: Sequence[int | str]) -> list[int]:
    """Seeds with their ranges written out: 0:3 is 0, 1, 2.

    Raises:
        ArgumentError: One is neither a number from 0 on nor a range, or there is none.
    """
    numbers: list[int] = []
    for seed in seeds:
        begin, colon, end = str(seed).partition(":")
        if not all(number.isdecimal() for number in ((begin, end) if colon else (begin,))):
            raise ArgumentError(f"seeds has '{seed}'; write numbers from 0 on, and ranges such as 0:5")
        if colon and int(end) <= int(begin):
            raise ArgumentError(f"seeds has '{seed}', which is empty; 0:5 is 0 1 2 3 4")
        numbers += range(int(begin), int(end)) if colon else [int(begin)]
    if not numbers:
        raise ArgumentError("seeds is empty; write numbers from 0 on, and ranges such as 0:5")
    return numbers


def all_cores(threads: int | None) -> int | None:
    """A number of threads, None for all cores, where it may be written as 0.

    Raises:
        ArgumentError: It is below 0.
    """
    if threads is not None and (isinstance(threads, bool) or not hasattr(threads, "__index__") or threads < 0):
        raise ArgumentError(f"threads is {threads!r}; it must be 0 (all cores) or above")
    return threads or None


def _choice(name: str, value: object, allowed: Iterable[str]) -> None:
    """Checks that a setting is one of some words."""
    if value not in tuple(allowed):
        raise ArgumentError(f"{name} is '{value}'; there are {', '.join(allowed)}")


def _least(name: str, value: int | None, least: int) -> None:
    """Checks that a setting, where it is given, is large enough."""
    if value is None:
        return
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise ArgumentError(f"{name} is {value!r}; it must be a whole number from {least} on")
    if value < least:
        raise ArgumentError(f"{name} is {value}; it must be at least {least}")


def _finite(name: str, value: float | None, unit: str) -> None:
    """Checks that a setting, where it is given, is above 0 and finite."""
    if value is None:
        return
    _number(name, value)
    if not 0 < value < math.inf:
        raise ArgumentError(f"{name} is {value:g}{unit}; it must be finite and above 0")


def _number(name: str, value: object) -> None:
    """Checks that a setting is a number."""
    if isinstance(value, bool) or not hasattr(value, "__float__"):
        raise ArgumentError(f"{name} is {value!r}; it must be a number")


def _horizon(seconds: float | None) -> float | None:
    if seconds is not None:
        _number("horizon", seconds)
    if seconds is not None and not 0 <= seconds < math.inf:
        raise ArgumentError(f"horizon is {seconds:g} s; it must be 0 (all of each trial) or above, and finite")
    return seconds or None


def _seed(seed: object) -> None:
    if isinstance(seed, bool) or not hasattr(seed, "__index__") or seed < 0:  # pyright: ignore[reportOperatorIssue]
        raise ArgumentError(f"seed is {seed!r}; it must be a whole number from 0 on")

"""The commands and their arguments, as typed dataclasses. Help texts are their docstrings.

Nothing heavy is imported here, so that `swim2real --help` is quick.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from swim2real.cli.compare_arguments import Compare
from swim2real.cli.deployment_arguments import Deploy
from swim2real.cli.rl_arguments import ExportCommands, Rollout, Train
from swim2real.cli.robot_arguments import Check, ExportModel, Init
from swim2real.cli.study_arguments import Ensemble, Identify
from swim2real.cli.sysid_arguments import ExportSysid, ImportSysid
from swim2real.cli.vlm_arguments import Vlm

Positional = tyro.conf.Positional
# as in pipeline.methods, which would bring NumPy and more
Method = Literal[
    "line-search", "random", "warm-start", "cma-es", "bayesopt", "least-squares", "mujoco-sysid", "staged"
]  # fmt: skip


@dataclass(frozen=True)
class Calibrate:
    """Find simulator parameters that make simulated swims match real ones.

    Reads a reference (a folder with reference.json, or with published CSVs) and writes a run folder: settings.json,
    record.jsonl (one line an evaluation), best.json (the parameters), outcome.json, trials.npz and report.html. Costs
    under a second an evaluation on two cores. Ctrl-C leaves a usable run; --resume goes on with it.
    """

    reference: Positional[Path]
    """Folder with the real trials."""
    out: Path
    """Run folder to write."""
    method: Method = "line-search"
    """line-search: an advisor's proposals with backtracking. warm-start: one proposal, then random. cma-es: pycma.
    bayesopt: scikit-optimize. least-squares: Levenberg-Marquardt with finite differences. mujoco-sysid: the least
    squares of MuJoCo's own toolbox. staged: the prior work's stages by hand."""
    advisor: str = "physics"
    """Who proposes. physics: built in, no key. google:MODEL, openai:MODEL, anthropic:MODEL: a VLM, key from
    GOOGLE_API_KEY, OPENAI_API_KEY or ANTHROPIC_API_KEY. files: you, or any chat window. replay:RUN: an earlier run's
    replies, without a network."""
    robot: Annotated[str, tyro.conf.arg(aliases=["--parameters"])] = "fish"
    """What is calibrated. fish: the paper's 16 parameters. fish-extended: dry friction at the water's surface, too.
    FILE.toml: your robot; `swim2real init` writes such a file."""
    protocol: Literal["aligned", "paper"] = "aligned"
    """aligned: identified frequency, steady swim, phase, registration, lost tracks left out. paper: none of these.
    Only for steady swims: recordings have a protocol of their own, playback, which needs no choice."""
    start: Literal["speed", "rest"] = "speed"
    """Where steady swims begin under protocol aligned. speed: at the real speed. rest: at rest, as the robot did, so
    that no fit swims tail first from there; takes about half as long again."""
    budget: int = 40
    """Simulation evaluations, the first included."""
    seed: int = 0
    """Decides the first point and every random choice."""
    scale: Literal["auto", "log", "linear"] = "auto"
    """Scale of the parameters; auto: linear for protocol paper, log otherwise."""
    max_steps: int = 3
    """Steps of the line search; 1 is the ablation without it."""
    early_stop: bool = False
    """Stop a step's evaluation once it is certain to be rejected. The advisor then sees less of rejected steps."""
    horizon: float = 4.0
    """Seconds of each trial that are compared; 0 for all of it."""
    hold_out: tuple[str, ...] = ()
    """Trials to leave out of the fit and to evaluate on afterwards."""
    sensitivity: bool = False
    """Also measure each parameter's effect on the loss at the end: two evaluations a parameter, outside the budget."""
    vlm: Vlm = field(default_factory=Vlm)
    resume: bool = False
    """Go on with the run in --out."""
    threads: int = 0
    """Swims simulated at a time; 0 for all cores. Results don't depend on it."""
    json: bool = False
    """Print the outcome as JSON."""
    quiet: bool = False
    """Print no progress."""


@dataclass(frozen=True)
class Evaluate:
    """Compare parameters with real trials: every figure, per trial and per marker.

    Reads a run folder or parameters file and a reference; writes nothing. Costs one evaluation, under a second.
    """

    parameters: Positional[Path]
    """Run folder or parameters file; 'published' for the prior work's values."""
    reference: Path
    """Folder with the real trials."""
    protocol: Literal["aligned", "paper"] = "aligned"
    """As for calibrate."""
    start: Literal["speed", "rest"] = "speed"
    """As for calibrate."""
    horizon: float = 4.0
    """Seconds of each trial that are compared; 0 for all of it."""
    sensitivity: bool = False
    """Also print each parameter's effect on the loss: about 30 more evaluations."""
    threads: int = 0
    """Swims simulated at a time; 0 for all cores."""
    json: bool = False
    """Print JSON in SI units."""


@dataclass(frozen=True)
class Overlay:
    """Draw simulated trials over real ones: films and pictures to see what differs.

    Reads a run folder or parameters file and a reference; writes NAME.mp4 and NAME.png a trial, and all.png. Blue is
    simulated, red is real. Costs about 2 s a trial.
    """

    parameters: Positional[Path]
    """Run folder or parameters file; 'published' for the prior work's values."""
    reference: Path
    """Folder with the real trials."""
    out: Path
    """Folder to write."""
    protocol: Literal["aligned", "paper"] = "aligned"
    """As for calibrate."""
    horizon: float = 4.0
    """Seconds of each trial that are drawn; 0 for all of it."""
    fps: float = 30.0
    """Frames a second of the films."""
    width: int = 960
    """Of the films [px]."""
    threads: int = 0
    """Swims simulated at a time; 0 for all cores."""


@dataclass(frozen=True)
class Track:
    """Find the markers in videos and make trials of them.

    Reads videos (any codec, frame rate and rotation) and the markers' places in their first frames; adds a trial per
    video to a reference folder, and to its folder tracks the track in pixels (.pixels.csv, as DeepLabCut writes it), an
    overlay video to judge it by (.mp4) and what was found (.json). A marker that isn't seen is lost, not guessed.
    Costs about 10 ms of one core a frame and the video's decoding. Interrupted, it goes on with the videos that aren't
    done when run again.
    """

    videos: Positional[tuple[Path, ...]]
    """Videos, one per trial; their names become the trials'. f1_50.mp4 is a command of 1.50 Hz."""
    to: Path
    """Reference folder to add the trials to."""
    robot: str = "fish"
    """Whose markers they are: fish, or a robot file (.toml)."""
    markers: tuple[str, ...] = ("auto",)
    """points.json of each video, in order (`swim2real pick` makes them), or auto to find the markers."""
    frequency: tuple[float, ...] = ()
    """What was asked of the motor in each video [Hz], where the names don't say it. Only protocol paper needs it."""
    controls: tuple[Path, ...] = ()
    """Tables of what drove the robot in each video, in order: time_s on the video's clock, then one an actuator."""
    sensors: tuple[Path, ...] = ()
    """Likewise of what was measured: time_s, then a column a sensor."""
    tracker: Literal["detection", "csrt"] = "detection"
    """detection: finds all markers anew in every frame. csrt: the paper's, for comparison."""
    camera: Path | None = None
    """JSON file with known lengths, camera height, plane or lens; docs/tracking.md describes it."""
    smooth: bool = False
    """Smooth the track over time; at 60 frames a second 98 % of a beat of 2.25 Hz and its harmonic are left."""
    overlay: bool = True
    """Write the overlay video."""
    workers: int = 0
    """Videos tracked at a time; 0 for as many as there are cores."""
    json: bool = False
    """Print what was found as JSON."""
    quiet: bool = False
    """Print no progress."""


@dataclass(frozen=True)
class Pick:
    """Write a page for each video on which the markers of its first frame are clicked.

    One self-contained HTML file: open it in a browser, click the markers in order, download NAME.points.json.
    """

    videos: Positional[tuple[Path, ...]]
    """Videos whose first frames are shown."""
    out: Path | None = None
    """Page to write, for one video; by default beside each video."""
    robot: str = "fish"
    """Whose markers they are: fish, or a robot file (.toml)."""


@dataclass(frozen=True)
class ImportTracks:
    """Make trials of tracks that other programs wrote: DeepLabCut's CSV tables, which SLEAP and movement write too."""

    tables: Positional[tuple[Path, ...]]
    """Tables, one per trial, in pixels."""
    to: Path
    """Reference folder to add the trials to."""
    fps: float
    """Frames a second of the videos."""
    robot: str = "fish"
    """Whose markers they are: fish, or a robot file (.toml)."""
    camera: Path | None = None
    """JSON file with known lengths, camera height, plane or lens; docs/tracking.md describes it."""
    frequency: tuple[float, ...] = ()
    """What was asked of the motor in each trial [Hz]."""
    controls: tuple[Path, ...] = ()
    """Tables of what drove the robot in each trial, in order: time_s, then one an actuator."""
    sensors: tuple[Path, ...] = ()
    """Likewise of what was measured: time_s, then a column a sensor."""


@dataclass(frozen=True)
class Quality:
    """Check the tracks of a reference: lost markers, body lengths, and what drove each trial.

    Exits with 1 when a trial shouldn't be used as it is. Calibration leaves lost marker-frames out by itself.
    """

    reference: Positional[Path]
    """Folder with the real trials."""
    robot: str = "fish"
    """Whose markers they are: fish, or a robot file (.toml)."""
    allow_lost: float = 0.05
    """Share of frames that a marker may be lost for in a trial that passes."""
    plot: Path | None = None
    """Also write an HTML page that shows which marker is lost when."""
    json: bool = False
    """Print JSON."""


@dataclass(frozen=True)
class Simulate:
    """Simulate swims and write the markers' paths.

    Writes an .npz with times (T,) s, frequencies (F,) Hz, markers (F, T, M, 2) m in the world frame and marker_names.
    """

    parameters: Positional[Path]
    """Run folder or parameters file; 'published' for the prior work's values."""
    frequency: tuple[float, ...]
    """Motor frequencies [Hz]."""
    out: Path
    """File to write."""
    seconds: float = 4.0
    """Length of each swim [s]."""
    rate: float = 60.0
    """Samples a second [Hz]."""
    from_rest: bool = False
    """Start from rest with the motor turning; otherwise a steady cycle, from motor angle 0."""
    threads: int = 0
    """Swims simulated at a time; 0 for all cores."""


@dataclass(frozen=True)
class Report:
    """Write the report page of a run or a comparison: one self-contained HTML file that opens without a network.

    For a comparison also tables.md and the figures for papers (PDF and PNG).
    """

    run: Positional[Path]
    """Folder of a run or a comparison."""


@dataclass(frozen=True)
class Fetch:
    """Get the eight published marker tracks, check them (sha256) and write a reference folder."""

    to: Path
    """Folder to write."""
    source: Annotated[str | None, tyro.conf.arg(name="from")] = None
    """Folder or URL that holds the CSV files; by default their public repository."""


@dataclass(frozen=True)
class Demo:
    """Run the whole pipeline on an embedded example: no data, no network, no key.

    Films a 'real' fish with hidden parameters, a finer time step, misplaced markers and glare in a synthetic pool,
    tracks its markers in the videos, calibrates, evaluates on a trial that was left out, and writes the report.
    """

    out: Path = Path("demo-out")
    """Folder to write."""
    budget: int = 40
    """Simulation evaluations."""
    seed: int = 0
    """Decides the first point and every random choice."""
    full: bool = False
    """Film all eight frequencies instead of four."""
    resume: bool = False
    """Go on with an interrupted demo."""
    quiet: bool = False
    """Print no progress."""


Command = (
    Calibrate
    | Check
    | Compare
    | Demo
    | Deploy
    | Ensemble
    | Evaluate
    | ExportCommands
    | ExportModel
    | ExportSysid
    | Fetch
    | Identify
    | ImportSysid
    | ImportTracks
    | Init
    | Overlay
    | Pick
    | Quality
    | Report
    | Rollout
    | Simulate
    | Track
    | Train
)

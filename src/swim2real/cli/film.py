"""From published tables, videos and tracks to a reference, from `fetch` to `quality`, and back: `export-tracks`."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from tyro.conf import Positional

from swim2real.cli import options as opt
from swim2real.cli.options import From, finite_above_0, for_robot, one_each, word
from swim2real.cli.terminal import say, say_json, tell
from swim2real.settings import TrackingSettings
from swimbase.errors import ArgumentError, Swim2RealError, TrackingError, TrialError

if TYPE_CHECKING:
    from markertrack.kinematics import Kinematics
    from swim2real.calibration import Problem
    from swim2real.pipeline import TrackingReport
    from swim2real.robots.robot import Robot
    from swim2real.trials import Trial, TrialSet

AUTO = "auto"
LOST = "Frames for which each marker is lost [%]"
MOST_REFUSED = 10  # markers of a trial that a refusal names
PoseFormat = Annotated[Literal["deeplabcut", "sleap", "movement"], tyro.conf.arg(name="format")]
Findings = dict[str, dict[str, Any]]  # of the trials, by name


def fetch(*, to: Path, source: Annotated[str | None, tyro.conf.arg(name="from")] = None) -> int:
    """Get the eight published marker tracks, check them (sha256) and write a reference folder.

    Args:
        to: Folder to write.
        source: Folder or URL that holds the CSV files; by default their public repository.
    """
    from swim2real.trials.fetch import fetch as fetch_tracks

    trials = fetch_tracks(to, source, lambda name, state: say(f"{name}: {state}"))
    say(f"{to}: {len(trials)} trials")
    return 0


def pick(
    videos: Positional[tuple[Path, ...]], *, out: Path | None = None, robot: opt.RobotOfMarkers = "fish",
    midline: bool = False, begin: From = (), fps: tuple[float, ...] = (),
) -> int:  # fmt: skip
    """Write a page per video on which you click the markers of its first frame.

    One self-contained HTML file: open it in a browser, click the markers in order, download NAME.points.json.

    Args:
        videos: Videos, folders of pictures or patterns of their names, as for `track`; their first frames are shown.
        out: Page to write, for one video; by default beside each video.
        midline: Click the first and the last marker alone, at the tips of head and tail, for `track --midline`.
        begin: Show the first frame from this time on [s], as for `track --from`; one for all videos, or one for each.
        fps: Frames per second that the camera took, as for `track --fps`, if --from is given.
    """
    if not videos:
        raise ArgumentError("no video was given")
    rates = _rates(fps, len(videos))
    if out is not None and len(videos) > 1:
        raise ArgumentError(f"--out '{out}' is one page for {len(videos)} videos; leave it out")
    from markertrack.pages import write_pick_page
    from markertrack.span import spans
    from markertrack.video import film_name, film_title, first_frame
    from swim2real.robots import load_robot

    begins = [span.begin for span in spans(begin, (), len(videos), "videos")]
    body = load_robot(robot, markers_only=True)
    body.check_markers("pick")
    kept = slice(None, None, max(len(body.marker_names) - 1, 1)) if midline else slice(None)  # head and tail
    names, places = body.marker_names[kept], body.rest_markers[kept]
    points, unknown = [f"{film_name(video)}.points.json" for video in videos], False
    for video, since, rate, saved in zip(videos, begins, rates, points, strict=True):
        page = out or (video if video.name else video.resolve()).with_name(f"{film_name(video)}.pick.html")
        frame = first_frame(video, since, rate)
        unknown |= rate is None and math.isnan(frame.time)
        write_pick_page(frame.image, names, film_title(video), page, places, frame.index, not midline)
        say(f"{page}: open it in a browser, click {names[0]} to {names[-1]}, download {saved}")
    options = for_robot(robot) + _tables_of(body, len(videos))
    for option, values in (("from", begin), ("fps", fps)):
        options += f" --{option} {' '.join(f'{value:g}' for value in values)}" if values else ""
    options += (" --midline" if midline else "") + (" --fps RATE" if unknown else "")
    say(f"Next: swim2real track {shlex.join(map(str, videos))} --markers {shlex.join(points)} --to REFERENCE{options}")
    return 0


def track(
    videos: Positional[tuple[Path, ...]], settings: TrackingSettings, *, to: opt.ToReference, markers: tuple[str, ...],
    corrections: tuple[Path, ...] = (), robot: opt.RobotOfMarkers = "fish", frequency: tuple[float, ...] = (),
    controls: opt.ControlTables = (), sensors: opt.SensorTables = (), begin: From = (), until: opt.Until = (),
    fps: tuple[float, ...] = (), workers: int = 0, json: opt.Json = False, quiet: opt.Quiet = False,
) -> int:  # fmt: skip
    """Find the markers in videos and make trials of them.

    Reads videos (any codec, frame rate and rotation; a folder of numbered pictures, a pattern of their names such as
    frame_%04d.png, a TIFF of many pages) and the markers' places in one of their frames. Adds one trial per video to a
    reference folder, and to its folder tracks the track in pixels (.pixels.csv, DeepLabCut's format), an overlay video
    (.mp4) and the findings (.json); `swim2real ui` shows what is doubtful, for corrections. A marker that isn't visible
    is lost, not guessed. With --midline a swimmer without markers is followed. Takes about twice as long as decoding.
    After an interruption the same command continues.

    Args:
        videos: Videos, one per trial; their names become the trials' names. f1_50.mp4 means a command of 1.50 Hz.
        settings: How they are tracked.
        markers: points.json of each video, in order (from `swim2real pick`), or auto to find the markers, which fails
            if glare or shadows leave a doubt; tags are taken in the order of their numbers.
        corrections: File per video, saved by `swim2real ui` (NAME.corrections.json), or points of
            another frame: markers are followed from there in both directions, and correct positions are kept.
        frequency: Motor command in each video [Hz], if the names don't contain it. Only protocol paper needs it.
        begin: Track from this time of the video on [s], which becomes time 0 of the trial and its tables; one for all
            videos, or one for each. The points belong to that frame or a later one: `pick --from`. It is a time of the
            camera, as --fps has it.
        fps: Frames per second that the camera took; one for all videos, or one for each. By default the video's own
            rate: give it for slow motion (240 for 240 frames per second that play at 30) and where the video has none.
        workers: Videos tracked in parallel; 0 for all cores.
    """
    count = len(videos)
    if workers < 0:
        raise ArgumentError(f"--workers is {workers}; it must be 0 (as many as there are cores) or above")
    if markers != (AUTO,) and len(markers) != count:
        raise ArgumentError(
            f"--markers has {len(markers)} files for {count} videos; give one for each video in order, or auto"
        )
    per_video = {"corrections": corrections, "frequency": frequency, "controls": controls, "sensors": sensors}
    for option, values in per_video.items():
        one_each(option, values, count, "videos")
    finite_above_0("frequency", *frequency, unit=" Hz")
    rates = _rates(fps, count)
    from swim2real.cli.progress import films_shown, loading

    with loading(f"reading {', '.join(video.name for video in videos)}", quiet or json):
        from markertrack.span import spans
        from swim2real.pipeline import TRACKS, TrackedVideo, track_videos
        from swim2real.robots import load_robot
        from swim2real.trials import load_reference

        stretches = spans(begin, until, count, "videos")
        points = [AUTO] * count if markers == (AUTO,) else list(markers)
        body = load_robot(robot, markers_only=True)
        body.check_markers("track")
    try:
        with films_shown(quiet or json) as (on_progress, on_done):
            results = track_videos(
                videos, points, body, settings, to, corrections=corrections or None, frequencies=frequency or None,
                controls=controls or None, sensors=sensors or None, spans=stretches, fps=rates, workers=workers or None,
                on_progress=on_progress, on_done=on_done,
            )  # fmt: skip
    except KeyboardInterrupt:
        tell("interrupted; the same command goes on with the videos that aren't done")
        return 1
    reports = {result.name: result.report for result in results if isinstance(result, TrackedVideo)}
    if json:
        say_json({name: report.model_dump() for name, report in reports.items()})
    elif reports:
        _print_tracked(reports, body)
        run = f"swim2real calibrate {word(to)} --out RUN{for_robot(robot)}"
        if missing := _tables_of(body, count, [trial for trial in load_reference(to) if trial.name in reports]):
            run = f"the same command with{missing}, recorded with each video"
        say(f"Reference: {to}   Overlays: {to / TRACKS}   Next: {run}")
    failed = [(video, error) for video, error in zip(videos, results, strict=True) if isinstance(error, Swim2RealError)]
    for video, error in failed:
        where = "" if str(video) in str(error) else f"{video}: "
        tell(f"{where}{error}")
    return 1 if failed else 0


def import_tracks(
    tables: Positional[tuple[Path, ...]], *, to: opt.ToReference, fps: float, robot: opt.RobotOfMarkers = "fish",
    camera: Path | None = None, frequency: opt.Frequencies = (), controls: opt.ControlTables = (),
    sensors: opt.SensorTables = (), begin: From = (), until: opt.Until = (), midline: bool = False,
) -> int:  # fmt: skip
    """Make trials of other programs' tracks: tables of DeepLabCut, SLEAP, or others with columns NAME.x and NAME.y.

    Also SLEAP's analyses (.h5) and movement's data sets (.nc). With --midline of midlines: of trackter and fishmechr
    (rows of frame, point, x, y), TRex (the npz of its setting output_posture_data), and WormTracer (NAME_x.csv, with
    NAME_y.csv beside it).

    Args:
        tables: Tables, one per trial, in pixels; their frames are counted from the video's first, 0.
        fps: Frames per second of the videos.
        camera: JSON file with known lengths, camera height, plane or lens; docs/tracking.md describes it.
        begin: Use the track from this time on [s], which becomes time 0 of the trial and its tables; one for all
            tables, or one for each.
        midline: Read midlines of swimmers without markers, and put the robot's markers on them, the first at the head
            and the last at the tail.
    """
    for option, values in (("frequency", frequency), ("controls", controls), ("sensors", sensors)):
        one_each(option, values, len(tables), "tables")
    finite_above_0("frequency", *frequency, unit=" Hz")
    finite_above_0("fps", fps)
    from swim2real import pipeline
    from swim2real.robots import load_robot

    made = pipeline.import_tracks(
        tables, load_robot(robot, markers_only=True), to, fps=fps, camera=camera, frequency=frequency,
        controls=controls, sensors=sensors, begin=begin, until=until, midline=midline,
    )  # fmt: skip
    for one in made:
        track, scale = one.trial.track, 1e3 * (one.trial.meters_per_pixel or 0.0)
        say(f"{one.trial.name}: {track.frame_count} frames, {track.duration:.2f} s, {scale:.4f} mm per pixel")
        for line in one.notes:
            say(f"{one.trial.name}: {line}")
    say(f"{to}: check the tracks with: swim2real quality {word(to)}{for_robot(robot)}")
    return 0


def export_tracks(
    reference: Positional[opt.Reference], *, to: Path, kind: PoseFormat = "deeplabcut", trials: tuple[str, ...] = (),
) -> int:  # fmt: skip
    """Write tracks for other programs, in pixels with y down: a table or file per trial.

    Tracks of videos are written as they were seen, others in pixels of the trial's scale, or of 1 mm. `import-tracks`
    reads all three.

    Args:
        to: Folder to write.
        kind: deeplabcut: a table, .csv. sleap: an analysis, .h5. movement: a data set, .nc.
        trials: Names of the trials; by default all.
    """
    from swim2real import pipeline

    for path, rate in pipeline.export_tracks(reference, to, kind, trials):
        say(f"{path}: at {rate:g} fps")
    return 0


def cut(
    reference: Positional[opt.Reference], *, to: opt.ToReference, begin: From = (), until: opt.Until = (),
    trials: tuple[str, ...] = (),
) -> int:  # fmt: skip
    """Cut a stretch out of recordings: tracks, controls and sensors, with times from 0.

    Reads a reference and adds the cut trials to another one. Commands of the 5 s before them stay, at times below 0,
    since filters, muscles and servos remember them.

    Args:
        begin: Start of the stretch on the trial's clock [s]; one for all trials, or one for each.
        trials: Names of the trials; by default all.
    """
    from markertrack.span import spans
    from swim2real.trials import load_reference
    from swim2real.trials.reference import add_trial

    if to.resolve() == reference.resolve():
        raise ArgumentError(
            f"--to '{to}' is the reference itself, whose whole trials would be lost; give another folder"
        )
    whole = load_reference(reference)
    chosen = [whole[name] for name in trials or whole.names]
    stretches = spans(begin, until, len(chosen), "trials")
    pieces = [trial.within(span) for trial, span in zip(chosen, stretches, strict=True)]  # before any is written
    for trial, piece in zip(chosen, pieces, strict=True):
        add_trial(to, piece, whole.marker_names)
        say(
            f"{piece.name}: {piece.track.frame_count} of {trial.track.frame_count} frames, {piece.track.duration:.3f} s"
        )
    if any(piece.start != trial.start for trial, piece in zip(chosen, pieces, strict=True)):
        say('The start that was known is cut off; start = "fitted" in the robot file finds the new one')
    return 0


def quality(
    reference: Positional[opt.Reference], *, robot: opt.RobotOfMarkers = "fish", allow_lost: float = 0.05,
    plot: Path | None = None, kinematics: Path | None = None, json: opt.Json = False,
) -> int:  # fmt: skip
    """Check the tracks of a reference: clocks, lost markers, body lengths, and what drove each trial.

    Exits with 1 if a trial shouldn't be used as it is. Calibration leaves lost marker-frames out by itself.

    Args:
        allow_lost: Share of frames in which a marker may be lost in a usable trial.
        plot: Also write an HTML page that shows when each marker is lost, and the values of --kinematics.
        kinematics: Also write a CSV table of how each trial swims: frequency, amplitudes along the body, wavelength,
            speed and Strouhal number with standard errors. The markers stand in a row.
    """
    if not 0 <= allow_lost <= 1:
        raise ArgumentError(f"--allow-lost is {allow_lost:g}; it is a share of frames within 0 and 1, such as 0.05")
    from markertrack.quality import check_lost
    from swim2real.robots import load_robot
    from swim2real.trials import load_reference
    from swim2real.trials.timebase import described

    body, trials = load_robot(robot, markers_only=True), load_reference(reference)
    findings, refusals = _examined(trials, body)
    for name, finding in findings.items():
        finding["clocks"] = described(trials[name])
    refused: dict[str, dict[str, float]] = {}
    for name, finding in findings.items():
        shares = zip(body.marker_names, finding["lost_share"], strict=True)
        lost = {marker: share for marker, share in shares if share > allow_lost}
        finding["usable"] = not lost and not finding["doubts"]
        if lost:
            refused[name] = lost
    if json:
        errors = {name: {"error": reason, "usable": False} for name, reason in refusals.items()}
        say_json({**findings, **errors})
    else:
        _print_quality(findings, body)
        for reason in refusals.values():
            say(reason)
        if refused:
            say(_refusal(refused, allow_lost))
    swimming = _swimming(trials, body, kinematics) if kinematics is not None else {}
    if plot is not None:
        from swim2real.report import write_quality_page

        checked = [
            (trial, check_lost(trial.track, body.layout, trial.midline)) for trial in trials if trial.name in findings
        ]
        write_quality_page(checked, body.marker_names, plot, swimming)
    return 0 if all(finding["usable"] for finding in findings.values()) and not refusals else 1


def _swimming(trials: TrialSet, robot: Robot, path: Path) -> dict[str, Kinematics]:
    """Kinematics of trials by name, which a table gets; of one without a beat the reason is told instead."""
    from markertrack.kinematics import swimming_kinematics
    from swimbase.store import write_text, writing

    found: dict[str, Kinematics] = {}
    for trial in trials:
        try:
            found[trial.name] = swimming_kinematics(trial.track, robot.layout)
        except TrackingError as error:
            tell(f"{trial.name}: {error}")
    with writing(path, TrialError, "choose another with --kinematics", what="table"):
        rows = [one.to_csv(name, robot.marker_names, not i) for i, (name, one) in enumerate(found.items())]
        write_text(path, "".join(rows))
    return found


def _rates(fps: tuple[float, ...], count: int) -> tuple[float | None, ...]:
    """The rate of each video, where one for all, one for each or none was given."""
    finite_above_0("fps", *fps, unit=" frames per second")
    rates: tuple[float | None, ...] = (fps or (None,)) * (count if len(fps) < 2 else 1)
    one_each("fps", rates, count, "videos")
    return rates


def _tables_of(robot: Robot, count: int, trials: Sequence[Trial] = ()) -> str:
    """Options for the tables that trials of a robot need beside their films and these don't have."""
    about = robot.trials
    needed = {"controls": about.controls, "sensors": about.sensors} if not about.steady else {}
    lacking = [kind for kind, any_of in needed.items() if any_of]
    if trials:
        lacking = [kind for kind in lacking if any(getattr(trial, kind) is None for trial in trials)]
    return "".join(f" --{kind}{' TABLE.csv' * count}" for kind in lacking)


def _examined(reference: TrialSet, robot: Robot) -> tuple[Findings, dict[str, str]]:
    """Findings in each trial, and the reasons why others can't be examined.

    Raises:
        TrialError: None can be examined.
    """
    from swim2real.calibration import Problem
    from swim2real.trials import TrialSet

    findings: Findings = {}
    refusals: dict[str, str] = {}
    problem: Problem | None = None
    for trial in reference:
        alone = TrialSet((trial,), reference.marker_names)
        try:
            problem = Problem(robot, alone, horizon=None) if problem is None else problem.of(alone)
            findings |= problem.examinations()
        except TrialError as error:
            refusals[trial.name] = str(error)
    if not findings:
        raise TrialError(next(iter(refusals.values())))
    return findings, refusals


def _print_tracked(reports: Mapping[str, TrackingReport], robot: Robot) -> None:
    from swim2real.cli import tables

    if robot.marker_names:
        rows = [
            (
                (name, str(report.frames), f"{1e3 * report.meters_per_pixel:.4f}"), report.lost_share,
                ("yes" if report.usable else "no",),
            )
            for name, report in reports.items()
        ]  # fmt: skip
        tables.by_marker(
            LOST, robot.marker_names, ("trial", "frames", "mm/px"), ("usable as it is",), rows,
            lambda share: f"{100 * share:.1f}" if share else "–",
        )  # fmt: skip
    findings = [(name, line) for name, report in reports.items() for line in report.findings]
    if findings:
        tables.table("What to know", ("trial", "finding"), findings)


def _print_quality(findings: Findings, robot: Robot) -> None:
    from swim2real.cli import tables

    swims = robot.trials.steady
    if swims:
        tables.table(
            "What drove each trial",
            ("trial", "nominal Hz", "beat Hz", "±", "ratio", "phase rad", "speed mm/s", "±", "tail mm"),
            [
                (
                    name, "–" if t["nominal_frequency"] is None else f"{t['nominal_frequency']:.2f}",
                    f"{t['frequency']:.4f}", f"{t['frequency_std']:.4f}",
                    "–" if t["nominal_frequency"] is None else f"{t['frequency'] / t['nominal_frequency']:.3f}",
                    f"{t['phase']:.2f}", tables.millimeters(t["start_speed"]),
                    tables.millimeters(t["start_speed_std"]), tables.millimeters(t["amplitude"]),
                )
                for name, t in findings.items()
            ],
        )  # fmt: skip
    else:
        tables.table(
            "What was recorded", ("trial", "s", "frames", "nominal Hz", "controls", "sensors"),
            [
                (
                    name, f"{t['duration']:.2f}", str(t["frames"]),
                    "–" if t["nominal_frequency"] is None else f"{t['nominal_frequency']:.2f}",
                    ", ".join(t["controls"]) or "–", ", ".join(t["sensors"]) or "–",
                )
                for name, t in findings.items()
            ],
        )  # fmt: skip
    lengths = {"head_spread": "head ±%", "body_spread": "body ±%"} if swims else {}
    rows = [
        ((name,), t["lost_share"], (*(f"{100 * t[key]:.1f}" for key in lengths), "yes" if t["usable"] else "no"))
        for name, t in findings.items()
    ]
    tables.by_marker(
        LOST, robot.marker_names, ("trial",), (*lengths.values(), "usable as it is"), rows, tables.percent
    )  # fmt: skip
    for name, t in findings.items():
        for line in (f"clocks: {t['clocks']}", *t["findings"]):
            say(f"{name}: {line}")


def _refusal(refused: Mapping[str, Mapping[str, float]], allowed: float) -> str:
    """Which trials and markers are refused, and what to do."""
    listed: list[str] = []
    for trial, shares in refused.items():
        named = list(shares)
        if more := max(0, len(named) - MOST_REFUSED):
            named = sorted(named, key=lambda name: -shares[name])[:MOST_REFUSED]
        markers = ", ".join(f"{name} {100 * shares[name]:.0f} %" for name in named)
        listed.append(f"{trial} ({markers}{f' and {more} more' if more else ''})")
    enough = math.ceil(100 * max(max(shares.values()) for shares in refused.values())) / 100
    return (
        f"Not to be used as they are, markers lost in more than {100 * allowed:g} % of frames: {'; '.join(listed)}. "
        f"Track these videos again, leave the trials out (--hold-out of calibrate), or accept them with "
        f"--allow-lost {enough:g}: calibration leaves lost marker-frames out by itself."
    )

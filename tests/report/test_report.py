"""The page of a run: what it shows, that it needs nothing else, and that no text from a run gets through as HTML."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from charts import check, check_page, line, titles_of
from matplotlib.figure import Figure

from browser import open_to_scripts, opened
from swim2real.calibration import Problem, RunFolder, SavedTrial, conclude
from swim2real.calibration.protocols import Aligned
from swim2real.errors import ParameterError, RunError
from swim2real.objective import ComparedTrial, Comparison, evidence
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.report import write_report
from swim2real.report.page import content
from swim2real.report.run import read_run
from swim2real.report.style import COLORS
from swim2real.report.units import mm, percent, significant, spread, text
from swim2real.robots.fish import FISH
from swim2real.simulation import Engine, Swim
from swim2real.trials import Actuation, Trial
from swimmers import Swimmer

SPACE = ParameterSpace(
    (
        Parameter("arm", "m", 0.01, 0.06, "Length of the arm.", 0.04),
        Parameter("stiffness", "N·m/rad", 0.1, 5.0, "Stiffness of the joint.", 0.65, log_offset=0.02),
        Parameter("drag", "-", 0.0, 10.0, "Drag of the body.", 0.4, log_offset=0.1),
    )
)
MARKERS = ("M0", "M1", "M2", "M3")
ROBOT = replace(FISH, space=SPACE, marker_names=MARKERS)
TIMES = np.arange(120) / 60
EVIL = "<script>alert('no')</script><img src=x onerror=alert(1)>"


def swim(name: str, frequency: float, miss: float, lost: int | None = None, divergence: str | None = None):
    """A real swim and a simulated one that is `miss` [m] behind and beats stronger; marker `lost` never counts."""
    share = np.array([0.0, 0.2, 0.6, 1.0])
    angle = 2 * np.pi * frequency * TIMES[:, None] - share
    real = np.stack([np.broadcast_to(0.5 * share, angle.shape), 0.1 * share**2 * np.cos(angle)], axis=-1)
    simulated = real * [1.0, 1.2] if divergence is None else np.zeros_like(real)
    weights = np.ones(angle.shape)
    weights[5:9, 2] = 0
    if lost is not None:
        weights[:, lost] = 0
        real[:, lost] = np.nan
    return ComparedTrial(
        name, "aligned_marker_error", TIMES, weights, real, simulated, np.full((4, 2), 0.003), real, simulated, (0, 1),
        0.1 * TIMES, 0.1 * TIMES - miss * TIMES / TIMES[-1], 0.1, 0.1 - miss / TIMES[-1], (), frequency, None, 0.4,
        0.004, simulated - real, divergence,
    )  # fmt: skip


class Evaluated(Problem):
    """A problem whose every evaluation has one result, and whose fish swims from rest at a speed [m/s]."""

    def __init__(self, result: Comparison, from_rest: float = 0.1) -> None:
        def simulate(values: object, swims: list[Swim]) -> list[Trial]:
            made = [Swimmer(s.actuation.frequency, from_rest, duration=s.duration) for s in swims]
            return [Trial(s.name, one.track(noise=0)) for s, one in zip(swims, made, strict=True)]

        self.result, self.robot, self.protocol = result, ROBOT, Aligned()
        self.prepared = tuple(
            SimpleNamespace(
                trial=SimpleNamespace(name=trial.name), examination={},
                request=Swim(trial.name, Actuation(trial.frequency), 2.0),
            )
            for trial in result.trials
        )  # fmt: skip
        self.simulator = SimpleNamespace(engine=Engine("mujoco 3.13.0", "implicit", 0.001, ()), simulate=simulate)

    def evaluate(self, values: object, stop_above: float | None = None) -> Comparison:
        return self.result


def compared(*trials: ComparedTrial) -> Comparison:
    return Comparison(trials, "aligned", 4.0)


@dataclass
class Run:
    """Writes a run folder step by step."""

    path: Path
    method: str = "line-search"
    budget: int = 6
    lost: int | None = None

    def __post_init__(self) -> None:
        self.folder = RunFolder(self.path)
        self.path.mkdir()
        self.folder.begin({
            "robot": "fish", "method": self.method, "advisor": "physics" if self.method == "line-search" else None,
            "protocol": "aligned", "budget": self.budget, "seed": 3, "scale": "log", "hold_out": ["f1_75"],
            "reference": "tracks/<b>bold</b>", "reference_fingerprint": "d5756570ca64", "commit": "abc123-dirty",
            "engine": {"name": "mujoco 3.13.0", "fluid_fingerprint": [-0.95, 11.05, -4.2, 0.1]},
            "versions": {"swim2real": "0.1.0"}, "own_setting": True,
        })  # fmt: skip
        self.best: tuple[float, dict[str, float]] | None = None

    def comparison(self, miss: float, divergence: str | None = None) -> Comparison:
        return compared(swim("f0_50", 0.5, miss, self.lost), swim("f1<b>00", 1.0, miss, divergence=divergence))

    def add(
        self, miss: float, point: tuple[float, float, float], divergence: str | None = None, **note: object
    ) -> None:
        found = self.comparison(miss, divergence)
        values = SPACE.to_values(point)
        index = len(self.folder.record())
        self.folder.append({
            "index": index, "loss": found.loss, "failed": found.divergence is not None, "reason": found.divergence,
            "point": list(point), "values": values, "note": {"source": "test", **note}, "evidence": evidence(found),
            "seconds": 1.0,
        })  # fmt: skip

    def conclude(
        self, miss: float, held_out: float | None = 0.09, sensitivity: bool = True, from_rest: float = 0.1
    ) -> None:
        unseen = None if held_out is None else Evaluated(compared(swim("f1_75", 1.3, held_out)))
        outcome = conclude(self.folder, Evaluated(self.comparison(miss), from_rest), unseen, {}).to_json()
        outcome["trials"] = {
            "f0_50": {
                "nominal_frequency": 0.5, "frequency": 0.3774, "frequency_std": 0.0002, "usable": False,
                "findings": ["M2 is lost in 3 % of frames (collapsed 4)"],
            }
        }  # fmt: skip
        if sensitivity:
            outcome["sensitivity"] = [
                {"name": "arm", "lower": 0.0123, "upper": None, "speed": 0.1, "verdict": "identified"},
                {"name": "stiffness", "lower": 0.0001, "upper": -0.0002, "speed": 0.1, "verdict": "not identified"},
            ]
        self.folder.write_json("outcome.json", outcome)


def proposal(diagnosis: str) -> dict[str, object]:
    return {
        "point": [1.0, 0.2, 0.9], "diagnosis": diagnosis, "reasoning": "Less drag.", "notes": {"trust": 0.3, "raw": {}}
    }  # fmt: skip


def searched(path: Path, lost: int | None = None) -> Run:
    """A line search: a first point, an accepted round, a rejected one, and one that the budget cut short."""
    run = Run(path, budget=7, lost=lost)
    run.add(0.2, (0.5, 0.5, 0.5))
    run.add(0.3, (1.0, 0.2, 0.9), round=1, step_size=1.0, proposal=proposal(EVIL))
    run.add(0.1, (1.0, 0.35, 0.7), round=1, step_size=0.5)
    run.add(
        0.5, (0.1, 0.1, 0.9), "the simulation grew without limit", round=2, step_size=1.0, proposal=proposal("Slow.")
    )
    run.add(0.2, (0.1, 0.2, 0.9), round=2, step_size=0.5)
    run.add(0.15, (0.1, 0.3, 0.9), round=2, step_size=0.25)
    run.add(0.14, (0.1, 0.4, 0.9), round=3, step_size=1.0, proposal=proposal("Tail too soft."))
    return run


@pytest.fixture
def run(tmp_path: Path) -> Run:
    found = searched(tmp_path / "run")
    found.conclude(0.1)
    return found


def page_of(run: Run) -> str:
    return write_report(run.path, ROBOT).read_text(encoding="utf-8")


def visible(page: str) -> str:
    """Text of the page without styles, scripts, charts and tags."""
    body = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", body))


def charts_of(run: Run) -> dict[str, Callable[[], Figure]]:
    return content(read_run(run.path, ROBOT))["charts"]


def test_a_finished_run_shows_everything(run: Run) -> None:
    shown = visible(page_of(run))
    loss, first = (run.folder.record()[i]["loss"] for i in (2, 0))
    for words in (
        f"Aligned marker error {mm(loss)} mm first evaluation {mm(first)} mm held-out trials",
        "Method line-search with advisor physics", "7 of 7 evaluations", "Seed 3", "Shape error",
        "Speed velocity_error",
        "progress_error", "static_offset", "left_out_share", "the paper's Eq. 1".replace("'", "&#39;"),
        "Convergence", "Speed against frequency", "Real and simulated", "Error from head to tail",
        "on its upper bound", "identified", "+12.30", "Length of the arm.", "1 of 3 rounds were accepted",
        "Tail too soft.", "trust: 0.3", "0.37740 ± 0.00020", "check the track", "M2 is lost in 3 % of frames",
        "held out", "−0.95, 11.05, −4.2, … (4 numbers)", "d5756570ca64", "abc123-dirty", "own_setting", "mujoco 3.13.0",
    ):  # fmt: skip
        assert words in shown, words
    assert "has not ended" not in shown


def test_the_same_folder_gives_the_same_page(run: Run) -> None:
    assert page_of(run) == page_of(run)
    assert write_report(str(run.path), ROBOT) == run.path / "report.html"
    assert not list(run.path.glob("*.part"))


@pytest.mark.slow
def test_a_whole_page_is_sound_small_and_escaped_and_needs_no_network(run: Run, drawn: None) -> None:
    page = page_of(run)
    markup = re.sub(r"(<(script|style)\b[^>]*>).*?</\2>", r"\1", page, flags=re.DOTALL)
    tags = re.findall(r"<[^>]+>", markup)
    assert not [tag for tag in tags if re.search(r"^<(link|iframe|img|object|base)\b|\ssrc\s*=", tag)]
    assert all(target.startswith("#") for target in re.findall(r'href="([^"]*)"', markup))
    style = re.search(r"<style>(.*?)</style>", page, re.DOTALL)
    assert style
    assert "url(" not in style[1]
    assert "@import" not in style[1]
    assert "default-src 'none'" in page
    assert len(page) < 5e5
    check_page(page)
    assert "<script>alert" not in page
    assert "<img" not in markup
    assert "&lt;script&gt;alert(&#39;no&#39;)" in page
    assert "tracks/&lt;b&gt;bold" in page
    assert "f1<b>00" not in page
    assert "<title>f1&lt;b&gt;00</title>" in page


def test_rounds_tell_what_was_tried(run: Run) -> None:
    first, second, third = content(read_run(run.path, ROBOT))["rounds"]
    assert [one.status for one in (first, second, third)] == ["accepted", "rejected", "cut short"]
    assert [step.size for step in second.steps] == ["100 %", "50 %", "25 %"]
    assert second.steps[0].loss == "diverged"
    assert first.after == second.before == second.after
    assert first.steps[1].better
    assert first.steps[1].change.startswith("−")
    assert first.moves[0] == "arm 0.035 → 0.06 m"
    assert first.notes == (("trust", "0.3"),)


def test_parameters_show_their_place_within_the_bounds(run: Run) -> None:
    arm, stiffness, drag = content(read_run(run.path, ROBOT))["parameters"]
    assert (arm.bound, stiffness.bound, drag.bound) == ("upper", "", "")
    assert arm.position == 100
    assert stiffness.position == pytest.approx(35)
    assert (arm.down, arm.up, arm.verdict) == ("+12.30", "–", "identified")
    assert drag.verdict == ""


def test_an_interrupted_run_says_what_is_missing(tmp_path: Path) -> None:
    shown = visible(page_of(searched(tmp_path / "run")))
    assert "This run has not ended: 7 of 7 evaluations are on record" in shown
    assert "--resume" in shown
    assert "Real and simulated real" not in shown
    for words in ("Convergence", "Speed against frequency", "Parameters", "Tail too soft.", "Aligned error in numbers"):
        assert words in shown
    assert "No trial was held out" not in shown


def test_an_outcome_of_earlier_parameters_is_not_shown(run: Run) -> None:
    run.add(0.01, (0.3, 0.3, 0.3), round=4, step_size=1.0, proposal=proposal("More."))
    shown = visible(page_of(run))
    assert "has found better parameters since" in shown
    assert "Real and simulated real" not in shown


def test_a_fit_that_swims_backward_from_rest_is_said(run: Run) -> None:
    assert "unusable" not in visible(page_of(run))
    run.conclude(0.1, from_rest=-0.02)
    says = "Warning: unusable: from rest, where a policy and the robot begin, this fit swims tail first at "
    assert says in visible(page_of(run))


def test_an_outcome_of_an_earlier_version_is_shown(run: Run) -> None:
    outcome = run.folder.outcome().to_json()
    assert outcome is not None
    assert outcome.pop("from_rest")
    run.folder.write_json("outcome.json", outcome)
    shown = visible(page_of(run))
    assert "Real and simulated real" in shown
    assert "unusable" not in shown


def test_missing_swims_are_said(run: Run) -> None:
    (run.path / "trials.npz").unlink()
    assert "has no trials.npz" in visible(page_of(run))


def test_a_random_run_has_no_rounds(tmp_path: Path) -> None:
    run = Run(tmp_path / "run", method="random", budget=3)
    for k in range(3):
        run.add(0.2 - 0.05 * k, (0.2, 0.3, 0.4 + 0.1 * k))
    run.conclude(0.1, held_out=None, sensitivity=False)
    shown = visible(page_of(run))
    assert "rounds" not in shown.lower().replace("the advisor's rounds", "")
    assert "with advisor" not in shown
    assert "No trial was held out" in shown
    assert "was not determined in this run" in shown
    legend = charts_of(run)["convergence"]().axes[0].get_legend_handles_labels()[1]
    assert legend == ["evaluation", "best so far"]


def test_failed_evaluations_are_at_the_top(run: Run) -> None:
    axes = charts_of(run)["convergence"]().axes[0]
    failed = next(points for points in axes.collections if points.get_label().startswith("diverged"))
    (place,) = failed.get_offsets()
    top = axes.get_ylim()[1]
    assert place[0] == 4
    assert 0.9 * top < place[1] < top
    assert "grew without limit" in failed.get_urls()[0]
    best = next(drawn for drawn in axes.lines if drawn.get_label() == "best so far").get_ydata()
    assert (np.diff(best) <= 0).all()
    assert top < 500  # m of a failure don't stretch the axis


def test_a_run_of_failures_alone(tmp_path: Path) -> None:
    run = Run(tmp_path / "run", method="random")
    run.add(0.1, (0.2, 0.3, 0.4), "the simulation grew without limit")
    run.add(0.1, (0.3, 0.3, 0.4), "the simulation grew without limit")
    run.conclude(0.1, sensitivity=False)  # of values that don't matter here
    shown = visible(page_of(run))
    assert "Every simulation of this run diverged" in shown
    assert "Aligned marker error diverged" in shown


def test_a_held_out_trial_that_diverged(run: Run) -> None:
    unseen = compared(swim("f1_75", 1.3, 0.1, divergence="the simulation grew without limit"))
    conclude(run.folder, Evaluated(run.comparison(0.1)), Evaluated(unseen), {})
    shown = visible(page_of(run))
    assert "simulation diverged" in shown
    assert "held-out trials diverged" in shown
    check(
        {name: draw for name, draw in charts_of(run).items() if name in ("speeds", "paths-2", "envelope-2", "tail-2")}
    )


def test_markers_that_never_count(tmp_path: Path) -> None:
    run = searched(tmp_path / "run", lost=3)
    run.conclude(0.1)
    assert run.folder.outcome().fit.trials["f0_50"].aligned_marker_errors[3] is None
    page_of(run)
    charts = charts_of(run)
    tails = {titles_of(charts[f"tail-{i}"]())[1] for i in range(3)}
    assert tails == {"M2 sideways (mm)", "M3 sideways (mm)"}
    shape = next(one for one in content(read_run(run.path, ROBOT))["errors"] if one.key == "shape")
    row = shape.trials.index("f0_50")
    assert shape.cells[row][3] == ("–", 0)
    assert np.isfinite(shape.mean).all()


def test_charts_have_units(run: Run) -> None:
    for draw in charts_of(run).values():
        for title in titles_of(draw()):
            assert re.search(r"\((mm|mm/s|s|Hz)\)$", title) or title in ("evaluation", "marker, head to tail"), title


def test_paths_are_registered_and_leave_lost_frames_out(run: Run) -> None:
    figure = charts_of(run)["paths-0"]()
    assert len(line(figure, "lost by tracking, not counted").get_xdata()) == 4
    real = line(figure, "M2, real").get_xdata()
    assert np.flatnonzero(np.isnan(real)).tolist() == [5, 6, 7, 8]
    assert line(figure, "M2, simulated").get_xdata()[0] == pytest.approx(real[0] + 3.0)


def test_long_swims_are_thinned(run: Run) -> None:
    found = read_run(run.path, ROBOT)
    pair = found.saved[0].compared
    count = 2_000
    long = replace(
        pair, times=np.arange(count) / 240,
        weights=np.resize(pair.weights, (count, 4)), real=np.resize(pair.real, (count, 4, 2)),
        simulated=np.resize(pair.simulated, (count, 4, 2)), path_real=np.resize(pair.path_real, (count, 4, 2)),
        path_simulated=np.resize(pair.path_simulated, (count, 4, 2)),
        progress_real=np.resize(pair.progress_real, count),
        progress_simulated=np.resize(pair.progress_simulated, count),
    )  # fmt: skip
    saved = tuple(SavedTrial(False, replace(long, name=f"t{i}", frequency=0.5 + i / 100)) for i in range(40))
    many = replace(found, saved=saved)
    shown = content(many)
    assert len(shown["saved"]) == 24
    assert max(len(drawn.get_xdata()) for drawn in shown["charts"]["paths-23"]().axes[0].lines) <= 480


def test_nothing_to_report(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no run folder"):
        write_report(tmp_path, ROBOT)
    with pytest.raises(RunError, match="nothing to report"):
        write_report(Run(tmp_path / "run").path, ROBOT)


def test_another_robot_s_run_is_refused(run: Run) -> None:
    with pytest.raises(ParameterError, match="unknown parameter 'drag'"):
        write_report(run.path, replace(ROBOT, space=ParameterSpace(SPACE.parameters[:2])))


def test_numbers_for_a_person() -> None:
    assert mm(-0.00123) == "−1.2"
    assert mm(None) == mm(float("nan")) == "–"
    assert mm(-1e-6, signed=True) == "0.0"
    assert mm(1e-3, signed=True) == "+1.0"
    assert percent(0.1377) == "13.8 %"
    assert percent(None) == "–"
    assert significant(1.4e-17) == "0"
    assert significant(-0.958170443317) == "−0.9582"
    assert spread(0.377406892, 0.00018951) == "0.37741 ± 0.00019"
    assert spread(0.5, None) == "0.500"
    assert text(2.0, 2) == "2.00"


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_browser_shows_every_chart(run: Run, drawn: None, tmp_path: Path, dark: bool) -> None:
    path = tmp_path / "page.html"
    path.write_text(open_to_scripts(page_of(run)).replace("</body>", LOOK), encoding="utf-8")
    shown, told = opened(path, f"--blink-settings=preferredColorScheme={0 if dark else 1}")
    assert "CONSOLE" not in told, told[-2000:]
    said = re.search(r'<pre id="said">(.*?)</pre>', shown)
    assert said
    color, heights, needed, there = json.loads(said[1])
    red, green, blue = (int(COLORS["real"][dark][i : i + 2], 16) for i in (1, 3, 5))
    assert color == f"rgb({red}, {green}, {blue})"
    assert len(heights) == len(charts_of(run))
    assert min(heights) > 100
    assert needed <= there


LOOK = """
<script>addEventListener("load", () => {
  const said = document.createElement("pre"); said.id = "said";
  const red = document.querySelector('svg path[style*="stroke: var(--real)"]');
  said.textContent = JSON.stringify([
    getComputedStyle(red).stroke, [...document.querySelectorAll(".plot svg")].map((one) => one.clientHeight),
    document.documentElement.scrollWidth, innerWidth]);
  document.body.append(said);
});</script></body>"""

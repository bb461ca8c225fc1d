"""Run folders that are written step by step, and what tests ask of their pages and charts."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
from matplotlib.figure import Figure

from browser import open_to_scripts, opened
from run_settings import record_of, run_settings
from swim2real.calibration import Problem, RunFolder, conclude
from swim2real.calibration.protocols import Aligned
from swim2real.objective import ComparedBeat, ComparedProgress, ComparedTrial, Comparison, evidence
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.report import write_report
from swim2real.report.page import RunPage, page_context
from swim2real.report.run import read_run
from swim2real.report.style import TITLE, VARIABLES
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
ROBOT = replace(FISH, space=SPACE, marker_names=MARKERS, build=lambda values: FISH.build(FISH.space.published))
TIMES = np.arange(120) / 60


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
        divergence=divergence, beat=ComparedBeat(frequency, frequency, 0.4, 0.004, simulated - real),
        progress=ComparedProgress(0.1 * TIMES, 0.1 * TIMES - miss * TIMES / TIMES[-1], 0.1, 0.1 - miss / TIMES[-1]),
    )  # fmt: skip


def longer(trial: ComparedTrial, count: int, rate: float) -> ComparedTrial:
    """The trial again and again, for as many frames."""
    arrays = {
        name: np.resize(value, (count, *value.shape[1:]))
        for name, value in vars(trial).items()
        if isinstance(value, np.ndarray) and len(value) == len(trial.times)
    }
    sensors = tuple(
        replace(s, **{k: np.resize(getattr(s, k), count) for k in ("times", "real", "simulated")})
        for s in trial.sensors
    )
    way = trial.progress and replace(
        trial.progress, **{side: np.resize(getattr(trial.progress, side), count) for side in ("real", "simulated")}
    )
    return replace(trial, **{**arrays, "times": np.arange(count) / rate, "sensors": sensors, "progress": way})


class Evaluated(Problem):
    """A problem whose every evaluation has one result, and whose fish swims from rest at a speed [m/s]."""

    def __init__(self, result: Comparison, from_rest: float = 0.1) -> None:
        def simulate(values: object, swims: list[Swim]) -> list[Trial]:
            made = [Swimmer(s.actuation.frequency, from_rest, duration=s.duration) for s in swims]
            return [Trial(s.name, one.track(noise=0)) for s, one in zip(swims, made, strict=True)]

        self.result, self.robot, self.protocol = result, ROBOT, Aligned()
        self.prepared = tuple(
            SimpleNamespace(
                trial=SimpleNamespace(name=trial.name, track=Swimmer(trial.frequency, 0.1, duration=2.0).track()),
                examination={},
                request=Swim(trial.name, Actuation(trial.frequency), 2.0),
            )
            for trial in result.trials
        )  # fmt: skip
        self.simulator = SimpleNamespace(engine=Engine("mujoco 3.13.0", "implicit", 0.001, ()), simulate=simulate)

    def evaluate(self, values: object) -> Comparison:
        return self.result


UNSEEN = swim("f1_75", 1.3, 0.09)


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
        self.folder.begin(run_settings(
            method=self.method, protocol="aligned", budget=self.budget, seed=3, hold_out=("f1_75",),
            reference="tracks/<b>bold</b>", reference_fingerprint="d5756570ca64", commit="abc123-dirty",
            engine=Engine("mujoco 3.13.0", "implicit", 0.001, (-0.95, 11.05, -4.2, 0.1)),
            versions={"swim2real": "0.1.0"},
        ))  # fmt: skip

    def change_settings(self, **changes: object) -> None:
        path = self.path / "settings.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | changes))

    def comparison(self, miss: float, divergence: str | None = None) -> Comparison:
        trials = swim("f0_50", 0.5, miss, self.lost), swim("f1<b>00", 1.0, miss, divergence=divergence)
        return Comparison(trials, "aligned", 4.0)

    def add(
        self, miss: float, point: tuple[float, float, float], divergence: str | None = None, **note: object
    ) -> None:
        found = self.comparison(miss, divergence)
        self.folder.append({
            "index": len(record_of(self.folder)), "loss": found.loss, "failed": found.divergence is not None,
            "reason": found.divergence, "point": list(point), "values": SPACE.to_values(point),
            "note": {"source": "test", **note}, "evidence": evidence(found), "seconds": 1.0,
        })  # fmt: skip

    def conclude(
        self, miss: float, held_out: ComparedTrial | None = UNSEEN, sensitivity: bool = True,
        from_rest: float = 0.1,
    ) -> None:  # fmt: skip
        unseen = None if held_out is None else Evaluated(Comparison((held_out,), "aligned", 4.0))
        outcome = conclude(self.folder, Evaluated(self.comparison(miss), from_rest), unseen, {}).to_json()
        outcome["trials"] = {
            "f0_50": {
                "nominal_frequency": 0.5, "frequency": 0.3774, "frequency_std": 0.0002, "usable": False,
                "findings": ["M2 is lost in 3 % of frames (collapsed 4)"],
            }
        }  # fmt: skip
        if sensitivity:
            outcome["sensitivity"] = [
                {"name": "arm", "lower": 0.0123, "upper": None, "speed": 0.1},
                {"name": "stiffness", "lower": 0.0001, "upper": -0.0002, "speed": 0.1},
            ]
        self.folder.write_json("outcome.json", outcome)


def proposal(diagnosis: str) -> dict[str, object]:
    notes = {"trust": 0.3, "raw": {}}
    return {"point": [1.0, 0.2, 0.9], "diagnosis": diagnosis, "reasoning": "Less drag.", "notes": notes}


def searched(path: Path, lost: int | None = None) -> Run:
    """A line search: a first point, an accepted round, a rejected one, and one that the budget cut short."""
    run = Run(path, budget=7, lost=lost)
    run.add(0.2, (0.5, 0.5, 0.5))
    run.add(0.3, (1.0, 0.2, 0.9), round=1, step_size=1.0, proposal=proposal("Tail too stiff."))
    run.add(0.1, (1.0, 0.35, 0.7), round=1, step_size=0.5)
    run.add(0.5, (0.1, 0.1, 0.9), "it grew without limit", round=2, step_size=1.0, proposal=proposal("Slow."))
    run.add(0.2, (0.1, 0.2, 0.9), round=2, step_size=0.5)
    run.add(0.15, (0.1, 0.3, 0.9), round=2, step_size=0.25)
    run.add(0.14, (0.1, 0.4, 0.9), round=3, step_size=1.0, proposal=proposal("Tail too soft."))
    return run


def page_of(run: Run) -> str:
    return write_report(run.path, ROBOT).read_text(encoding="utf-8")


def shown_of(run: Run) -> RunPage:
    """What the template shows."""
    return page_context(read_run(run.path, ROBOT))


def charts_of(run: Run) -> dict[str, Callable[[], Figure]]:
    return shown_of(run).charts


def visible(page: str) -> str:
    """Text of the page without styles, scripts, charts and tags."""
    body = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", body))


def missing(words: tuple[str, ...], text: str) -> list[str]:
    """The words that a text hasn't."""
    return [word for word in words if word not in text]


def seen_by(page: str, place: Path, look: str, *options: str) -> list:
    """What a script finds on a page in a browser, which has nothing to complain of."""
    script = f"""<script id="look">addEventListener("load", async () => {{
      const say = document.createElement("pre"); say.id = "said";
      say.textContent = JSON.stringify(await (async () => {{ {look} }})());
      document.body.append(say); }});</script></body>"""
    place.write_text(open_to_scripts(page).replace("</body>", script), encoding="utf-8")
    shown, told = opened(place, *options)
    assert "CONSOLE" not in told, told[-2000:]
    said = re.search(r'<pre id="said">(.*?)</pre>', shown)
    assert said
    return json.loads(said[1])


def line(figure: Figure, title: str):
    """The line of a chart that shows a text where one points at it."""
    return next(found for found in figure.axes[0].lines if found.get_gid() == TITLE + title)


def titles_of(figure: Figure) -> tuple[str, str]:
    """Titles of the axes of a chart."""
    axes = figure.axes[0]
    return axes.get_xlabel(), axes.get_ylabel()


def check_charts(page: str) -> None:
    """The charts of a page are sound XML in the theme's colors, need nothing from elsewhere, and share no names."""
    charts = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert charts
    names: list[str] = []
    for text in charts:
        own = [e.attrib["id"] for e in ElementTree.fromstring(text).iter() if "id" in e.attrib]
        assert set(re.findall(r'(?:url\(#|href="#)([^)"]+)', text)) <= set(own)
        assert not re.findall(r"(?:fill|stroke): #", text)
        assert set(re.findall(r"var\((--[^)]+)\)", text)) <= VARIABLES.keys()
        assert not re.findall(r"\bnan\b", text, re.IGNORECASE)
        names += own
    assert len(set(names)) == len(names)

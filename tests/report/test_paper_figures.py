"""Figures for papers: the files, their fonts and sizes, the same bytes each time; what is drawn is what was found."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from made_results import TRIALS, made_results, made_run, playback_results, two_methods
from swim2real.calibration import RunFolder
from swim2real.calibration.saved_trials import save_trials
from swim2real.comparison.results import ComparisonResults
from swim2real.comparison.statistics import method_statistics
from swim2real.objective import ComparedBeat, ComparedProgress, ComparedTrial, Comparison
from swim2real.report import paper_figures
from swim2real.report.comparison_charts import convergence, line_search, strip, velocity
from swim2real.report.paper_figures import chronophotography, moments, outline, write_figures
from swim2real.report.style import COLORS, VARIABLES, method_styles, paper_style

KNOWN = ("line-search", "no-line-search", "bayesopt", "cma-es", "random", "staged", "least-squares")
TIMES = np.arange(61) / 30


def put_swims(folder: Path, results: ComparisonResults) -> None:
    """Two short swims in each run folder, as a run leaves them: 40 mm long bodies of three markers."""
    for run in results.runs:
        place = folder / run.folder
        place.mkdir(parents=True)
        trials: list[ComparedTrial] = []
        for i in range(2):
            swing = 0.1 * np.sin(2 * np.pi * TIMES)
            body = np.zeros((len(TIMES), 3, 2))
            body[:, 1, 0], body[:, 2, 0], body[:, 2, 1] = 0.15, 0.5, swing
            trials.append(
                ComparedTrial(
                    TRIALS[i], "aligned_marker_error", TIMES, np.ones((len(TIMES), 3)), body, body, np.zeros((3, 2)),
                    body, body, (0, 1), beat=ComparedBeat((0.5, 1.5)[i], (0.5, 1.5)[i], 0.0, 0.0, 0 * body),
                    progress=ComparedProgress(0.1 * TIMES, 0.2 * TIMES, 0.1, 0.2),
                )
            )  # fmt: skip
        save_trials(RunFolder(place), Comparison(tuple(trials), "aligned", None), None)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> list[Path]:
    """Two figures as files, of a column and of both."""
    folder = tmp_path_factory.mktemp("comparison")
    put_swims(folder, two_methods())
    methods, styles = method_statistics(two_methods(), "aligned"), method_styles(["good", "bad"])
    with paper_style():
        paths = paper_figures._save(strip(methods, styles), folder, "strip")
        paths += paper_figures._save(chronophotography(methods, styles, folder), folder, "bodies")
    return paths


def test_every_figure_is_there(unsaved: None, tmp_path: Path) -> None:
    put_swims(tmp_path, two_methods())
    names = ("convergence", "strip", "velocity", "line-search", "markers", "chronophotography")
    assert [path.stem for path in write_figures(two_methods(), tmp_path)] == [f"{name}-aligned" for name in names]


@pytest.mark.slow
def test_the_same_results_give_the_same_files(tmp_path: Path) -> None:
    both = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        put_swims(tmp_path / name, two_methods())
        both.append(write_figures(two_methods(), tmp_path / name))
    for first, second in zip(*both, strict=True):
        assert first.read_bytes() == second.read_bytes(), first.name


def test_letters_in_the_pdf_are_embedded_and_sizes_are_those_of_columns(written) -> None:
    assert [path.name for path in written] == [
        f"{name}.{kind}" for name in ("strip", "bodies") for kind in ("pdf", "svg", "png")
    ]
    for path in written:
        if path.suffix == ".pdf":
            content = path.read_bytes()
            assert not any(mark in content for mark in (b"/CreationDate", b"/Type3"))
            assert all(mark in content for mark in (b"/CIDFontType2", b"/FontFile2"))
        if path.suffix == ".png":
            with Image.open(path) as image:
                assert image.width in (1020, 2100), path.name  # 3.4 and 7 inches at 300 dots an inch
                assert image.info["dpi"] == pytest.approx((300, 300), abs=0.1)
                assert "Software" not in image.info
                assert np.ptp(np.asarray(image.convert("L"))) > 150  # not blank


def test_the_mean_and_each_seed_and_theory_are_lines() -> None:
    methods = method_statistics(two_methods(), "aligned")
    with paper_style():
        axes = convergence(methods, method_styles(["good", "bad"])).axes[0]
    good = [line for line in axes.lines if line.get_color() == method_styles(["good", "bad"])["good"].light]
    seeds, mean = [line for line in good if line.get_linewidth() < 1], good[-1]
    np.testing.assert_allclose([line.get_ydata()[-1] for line in seeds], [10, 12, 14])
    np.testing.assert_allclose(mean.get_ydata()[:-1], 1e3 * methods[0].curves.mean(axis=0))
    assert axes.get_yscale() == "log"
    methods = method_statistics(two_methods(), "aligned")
    with paper_style():
        figure = velocity(methods, method_styles(["good", "bad"]), {"slow": 0.03, "fast": 0.17})
        labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["real", "good (4.0 mm/s)", "bad (30.0 mm/s)", "elongated body theory (20.0 mm/s)"]


def test_line_search_bars_add_up_and_methods_without_rounds_are_left_out() -> None:
    methods = method_statistics(two_methods(), "aligned")
    with paper_style():
        left = line_search(methods, method_styles(["good", "bad"])).axes[0]
        widths = [patch.get_width() for patch in left.patches]
        assert line_search(methods[1:], method_styles(["good", "bad"])) is None
    assert widths == pytest.approx([100 / 3, 100 / 3, 0, 100 / 3])
    assert [label.get_text() for label in left.get_yticklabels()] == ["good"]


def test_bodies_swim_to_the_right_and_lost_markers_are_left_out() -> None:
    body = np.zeros((3, 4, 2))
    body[:, :, 0] = [0, 0.15, 0.3, 0.5]
    weights = np.ones((3, 4))
    weights[2, 2] = 0
    progress = np.array([0.0, 0.2, 0.4])
    pair = ComparedTrial(
        "t", "aligned_marker_error", np.arange(3.0), weights, body, body, np.zeros((4, 2)), body, body, (0, 1),
        progress=ComparedProgress(progress, progress, 0.2, 0.2),
    )  # fmt: skip
    placed = moments(pair, "real", [0, 1, 2])
    np.testing.assert_allclose(placed[:, 0, 0], [0, 0.2, 0.4])
    np.testing.assert_allclose(placed[0, 3], [-0.5, 0])
    assert np.isnan(placed[2, 2]).all()
    assert not np.isnan(moments(pair, "simulated", [0, 1, 2])).any()
    around = outline(placed[2])
    assert around[:, 0].max() == pytest.approx(0.4, abs=1e-3)
    assert around[:, 0].min() == pytest.approx(-0.1, abs=0.01)
    assert np.ptp(around[:, 1]) == pytest.approx(0.065, abs=0.015)


@pytest.fixture
def unsaved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn, and their files are named but not written."""
    monkeypatch.setattr(paper_figures, "_save", lambda figure, folder, name: [folder / f"{name}.pdf"])


def test_without_swims_the_others_are_still_drawn(unsaved: None, tmp_path: Path, caplog) -> None:
    paths = write_figures(two_methods(), tmp_path)
    assert len(paths) == 5
    assert "no chronophotography for protocol aligned" in caplog.text
    assert "trials.npz" in caplog.text


def test_recordings_have_no_figure_of_speed_and_none_of_swims(unsaved: None, tmp_path: Path, caplog) -> None:
    files = write_figures(playback_results(), tmp_path)
    assert {path.stem for path in files} == {"convergence-playback", "strip-playback", "markers-playback"}
    assert not caplog.text


def test_a_protocol_without_runs_is_said(unsaved: None, tmp_path: Path, caplog) -> None:
    made = replace(made_results(made_run("a", 0, [0.2] * 8)), protocols=("aligned", "paper"))
    assert len(write_figures(made, tmp_path)) == 4  # no rounds, no swims
    assert "no figures for protocol paper" in caplog.text


def test_each_method_has_its_own_look_everywhere() -> None:
    styles = method_styles(KNOWN)
    assert len({style.light for style in styles.values()}) == len(KNOWN)
    assert len({style.mark for style in styles.values()}) == len(KNOWN)
    # whichever methods stand beside it
    assert method_styles(["x", "random"])["random"] == styles["random"]
    many = method_styles([f"line-search@{i}" for i in range(6)])
    assert len({(s.light, s.mark, s.dashes) for s in many.values()}) == 6
    assert len({style.light for style in many.values()} | {s.light for s in styles.values()}) == 13
    known = {light for light, _ in VARIABLES.values()}
    assert {s.light for s in (*many.values(), *styles.values())} <= known
    assert not {s.light for s in (*many.values(), *styles.values())} & {light for light, _ in COLORS.values()}

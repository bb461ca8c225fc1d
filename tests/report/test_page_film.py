"""The film on a run's page: what it holds of the trials, that a browser plays it; how long the page is on a phone."""

import base64
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_pages import ROBOT, Run, longer, page_of, searched, seen_by, swim

from swim2real.calibration import SavedTrial
from swim2real.report.film import Film, Picture, films

LOST = -(2**15)


def film_of(trial) -> Film:
    (film,) = films([SavedTrial(False, trial)], ROBOT)
    return film


def positions(picture: Picture, text: str) -> np.ndarray:
    """Positions from the middle of the picture [mm], NaN where they aren't known. Shape (T, points, 2)."""
    whole = np.frombuffer(base64.b64decode(text), dtype="<i2").reshape(-1, picture.points, 2)
    return np.where(whole == LOST, np.nan, whole * picture.step)


def test_it_holds_the_real_and_the_registered_simulated_markers_at_half_the_rate() -> None:
    trial = swim("f1_00", 1.0, 0.02)
    film = film_of(trial)
    assert (film.name, film.frames, film.markers, film.picture.step) == ("1.00 Hz, f1_00", 60, 4, 0.1)
    assert film.rate == pytest.approx(30)
    found, real = positions(film.picture, film.picture.real), 1e3 * trial.path_real
    picked = np.abs(trial.times[:, None] - np.arange(60) / 30).argmin(axis=0)
    seen = trial.weights[picked] > 0
    assert (np.isnan(found).any(axis=2) == ~seen).all()
    assert np.nanmax(np.abs((found - found[0, 0]) - (real[picked] - real[0, 0]))) <= 0.11
    simulated = positions(film.picture, film.picture.simulated)
    axes = trial.path_simulated[picked, 1] - trial.path_simulated[picked, 0]
    along = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    shift = 3.0 * (along + np.stack([-along[:, 1], along[:, 0]], axis=1))  # mm, of the registration
    expected = 1e3 * trial.path_simulated[picked] + shift[:, None]
    assert np.abs((simulated - found[0, 0]) - (expected - real[0, 0])).max() <= 0.16


def test_a_simulation_that_diverged_and_one_that_goes_astray() -> None:
    diverged = film_of(swim("a", 1.0, 0.0, divergence="it grew"))
    assert diverged.diverged
    assert np.isnan(positions(diverged.picture, diverged.picture.simulated)).all()
    trial = swim("a", 1.0, 0.0)
    astray = film_of(replace(trial, path_simulated=1e3 * trial.path_simulated))
    assert max(astray.picture.width, astray.picture.height) < 3e3  # mm; the real one still is to be seen


def test_many_long_trials_stay_small_and_say_what_is_cut(tmp_path: Path) -> None:
    trial = swim("f1_00", 1.0, 0.02)
    long = longer(trial, 60 * 100, 60)
    made = films([SavedTrial(False, replace(long, name=f"t{i}")) for i in range(24)], ROBOT)
    assert sum(len(film.picture.real) + len(film.picture.simulated) for film in made) < 3.2e5
    assert {film.cut is None for film in made} == {False}
    assert film_of(long).cut == pytest.approx(899 / 30)
    assert film_of(trial).cut is None
    assert films([SavedTrial(False, trial)], replace(ROBOT, marker_names=())) == ()
    assert 'id="film"' not in page_of(searched(tmp_path / "run"))


@pytest.fixture
def finished(tmp_path: Path) -> Run:
    run = searched(tmp_path / "run")
    run.conclude(0.1)
    return run


@pytest.mark.slow
def test_a_browser_plays_it(finished: Run, tmp_path: Path) -> None:
    before, after, blank, trials, label = seen_by(
        page_of(finished),
        tmp_path / "page.html",
        """window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 16);
        const player = document.querySelector(".player"), canvas = player.querySelector("canvas");
        const time = player.querySelector(".time"), trial = player.querySelector(".trial");
        trial.selectedIndex = 1; trial.dispatchEvent(new Event("change"));
        const before = canvas.toDataURL();
        player.querySelector("button").click();
        const label = player.querySelector("button").textContent;
        await new Promise((done) => setTimeout(done, 700));
        const blank = document.createElement("canvas"); blank.width = canvas.width; blank.height = canvas.height;
        return [Number(time.value), before !== canvas.toDataURL(), before === blank.toDataURL(),
                [...trial.options].map((one) => one.textContent), label];""",
    )
    assert 0.2 < before < 1.9
    assert after
    assert not blank
    assert trials == ["0.50 Hz, f0_50", "1.00 Hz, f1&lt;b&gt;00", "1.30 Hz, f1_75 (held out)"]
    assert label == "Pause"


@pytest.mark.slow
def test_on_a_phone_it_is_below_ten_screens_with_the_rounds_folded(finished: Run, drawn: None, tmp_path: Path) -> None:
    height, wide, rounds = seen_by(
        page_of(finished),
        tmp_path / "page.html",
        """document.getElementById("look").remove();
        const frame = document.createElement("iframe");
        frame.style = "width: 390px; height: 844px"; frame.srcdoc = document.documentElement.outerHTML;
        const loaded = new Promise((done) => frame.addEventListener("load", done));
        document.body.append(frame); await loaded;
        const page = frame.contentDocument.documentElement;
        const open = frame.contentDocument.querySelectorAll("#rounds > details[open]");
        return [page.scrollHeight, page.scrollWidth, open.length];""",
    )
    assert height < 10 * 844
    assert wide <= 390
    assert rounds == 0

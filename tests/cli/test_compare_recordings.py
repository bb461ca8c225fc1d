"""`compare` on a robot whose trials are recordings: results, tables, figures and a page of what there is."""

import csv
import re

import pytest


@pytest.mark.slow
def test_a_comparison_on_a_robot_file_gives_results_tables_figures_and_a_page(program, pendulum_folder, tmp_path):
    out = tmp_path / "comparison"
    tracks, robot = pendulum_folder / "tracks", pendulum_folder / "pendulum.toml"
    command = ["compare", tracks, "--robot", robot, "--out", out, "--budget", 3]
    program(
        *command, "--methods", "random", "least-squares", "--seeds", 1, "--leave-one-out", "--horizon", 0.5,
        "--workers", 1,
    ).done()  # fmt: skip
    assert re.search(r"^Calibration performance over 1 seed, playback protocol, 3 evaluations", program.out)
    with (out / "results.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["method"], row["held_out"]) for row in rows] == [
        (method, out) for method in ("random", "least-squares") for out in ("", "a", "b")
    ]
    first = rows[0]
    assert first["protocol"] == "playback"
    assert float(first["aligned_marker_error"]) + 0.001 * float(first["sensor_errors.gyro[1]"]) == pytest.approx(
        float(first["best_loss"])
    )
    assert float(rows[1]["held_out_sensor_errors.gyro[1]"]) > 0
    assert not [column for column in first if "velocity" in column or "shape" in column or "offset" in column]
    tables = (out / "tables.md").read_text(encoding="utf-8")
    for words in ("lowest playback error", "gyro[1] (rad/s)", "Error of each marker", "Trials left out of the fit"):
        assert words in tables
    assert [word for word in ("elocity", "Eq. 1", "head to tail", "egistered") if word in tables] == []
    assert {path.name for path in (out / "figures").glob("*.pdf")} == {
        f"{name}-playback.pdf" for name in ("convergence", "strip", "markers")
    }
    page = (out / "comparison.html").read_text(encoding="utf-8")
    assert "Speed against frequency is left out: the trials are recordings, which have none." in page
    assert "Playback protocol" in page
    assert "elongated body theory" not in page
    (out / "comparison.html").unlink()
    program("report", out).done()
    assert (out / "comparison.html").read_text(encoding="utf-8") == page

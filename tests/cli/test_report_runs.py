"""`report` of several runs."""

import pytest


@pytest.mark.slow
def test_the_page_of_two_runs_is_written_here_and_said(program, pendulum_folder, tmp_path, monkeypatch) -> None:
    runs = [tmp_path / name for name in ("one", "two")]
    for seed, run in enumerate(runs):
        program(
            "calibrate", pendulum_folder / "tracks", "--robot", pendulum_folder / "pendulum.toml", "--out", run,
            "--method", "random", "--budget", 2, "--seed", seed, "--horizon", 0.5,
        ).done()  # fmt: skip
    monkeypatch.chdir(tmp_path)
    program("report", *runs).done()
    assert program.out.strip() == "runs.html"
    assert "2 runs side by side" in (tmp_path / "runs.html").read_text(encoding="utf-8")
    program("report", *runs, "--out", tmp_path / "both.html").done()
    assert program.out.strip() == str(tmp_path / "both.html")
    (tmp_path / "comparison").mkdir()
    (tmp_path / "comparison" / "plan.json").write_text("{}")
    assert (
        program("report", runs[0], tmp_path / "comparison")
        .sentence(2)
        .startswith(f"'{tmp_path / 'comparison'}' is a comparison; ")
    )

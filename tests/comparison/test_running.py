"""Comparisons as they are run: by processes and by a Dask cluster, killed, stopped, gone on with and added to."""

import csv
import os
import shutil
import signal
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from glob import glob
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock

from recorded import PENDULUM, pendulum_reference
from run_settings import record_of
from swim2real.calibration import RunFolder, load_trials, versions
from swim2real.comparison import (
    ComparisonProgress,
    Plan,
    compare,
    load_results,
    make_plan,
    read_plan,
    read_results,
)
from swim2real.comparison.cluster import check_session, check_versions, dask_cluster, session
from swim2real.comparison.compare import Work, run_job
from swim2real.comparison.plan import PROBLEM
from swim2real.pipeline import calibrate
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings, ComparisonSettings
from swim2real.simulation import Engine
from swimbase.errors import ArgumentError, MissingExtraError, RunError

METHODS = ("random", "no-line-search")
REFERENCE = pendulum_reference()


def make(methods=METHODS, seeds=(0, 1), budget=6, **options) -> Plan:
    settings = ComparisonSettings(methods=tuple(methods), seeds=tuple(seeds), budget=budget, **options)
    return make_plan(settings, REFERENCE, PENDULUM)


def compare_pendulum(plan: Plan, out: Path, **options):
    return compare(plan, REFERENCE, PENDULUM, out, **options)


def table(out: Path) -> bytes:
    return (out / "results.csv").read_bytes()


def rows(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(table(out).decode().splitlines()))


def lines(out: Path) -> dict[str, int]:
    """Evaluations on record, by job."""
    runs = out / "runs"
    found = sorted(runs.rglob("record.jsonl"))
    return {path.parent.relative_to(runs).as_posix(): path.read_bytes().count(b"\n") for path in found}


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """Two methods by two seeds, by another process. Don't write into it."""
    out = tmp_path_factory.mktemp("finished") / "comparison"
    assert compare_pendulum(make(), out, workers=1).missing == {}
    return out


@pytest.fixture
def copy(finished, tmp_path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "copy"))


@pytest.fixture
def in_a_thread(monkeypatch) -> None:
    """Runs jobs in a thread of this process, which needs no time to start."""
    module = sys.modules["swim2real.comparison.compare"]
    monkeypatch.setattr(module, "ProcessPool", lambda workers: ThreadPoolExecutor(1))


def test_a_comparison_is_run_folders_results_and_a_table(finished):
    assert lines(finished) == dict.fromkeys((f"playback/{m}/seed-{s}" for m in sorted(METHODS) for s in (0, 1)), 6)
    written = sorted(path.name for path in finished.iterdir())
    assert written == [".lock", "plan.json", "results.csv", "results.json", "runs"]
    assert read_plan(finished) == make()
    results = load_results(finished)
    assert results == read_results(finished)
    assert (results.methods, results.protocols, results.budget) == (METHODS, ("playback",), 6)
    assert (results.trials, results.markers) == (REFERENCE.names, PENDULUM.marker_names)
    for run_, row in zip(results.runs, rows(finished), strict=True):
        folder = RunFolder(finished / run_.folder)
        record = record_of(folder)
        assert run_.losses == tuple(entry["loss"] for entry in record)
        assert run_.best.tolist() == np.minimum.accumulate(run_.losses).tolist()
        assert run_.values == record[run_.best_evaluation - 1]["values"]
        assert (run_.fit, run_.held_out_fit, run_.spent) == (folder.outcome().fit, None, None)
        assert len(load_trials(folder)) == 2
        expected = {
            "seed": run_.seed, "best_loss": min(run_.losses), "aligned_marker_error": run_.fit.aligned_marker_error,
            "sensor_errors.gyro[1]": run_.fit.sensor_errors["gyro[1]"], **run_.values,
        }  # fmt: skip
        assert {name: float(row[name]) for name in expected} == expected
        if run_.method == "random":
            assert (run_.rounds, run_.calls) == ((), 0)
            continue
        assert run_.calls == len(run_.rounds) == 2
        assert [(r.begin, r.sizes, r.finished) for r in run_.rounds] == [(4, (1.0,), True), (5, (1.0,), True)]
        assert [r.accepted for r in run_.rounds] == [run_.losses[i] < run_.best[i - 1] for i in (4, 5)]
    # the same first point for every method of a seed
    assert len({(run_.seed, run_.losses[0]) for run_ in results.runs}) == 2


def test_a_run_is_what_calibrate_makes_of_the_same_settings(finished, tmp_path):
    settings = CalibrationSettings(method="random", budget=6, seed=1)
    calibrate(REFERENCE, PENDULUM, settings, tmp_path / "alone", on_warning=None)
    paths = (tmp_path / "alone", finished / "runs/playback/random/seed-1")
    first, second = ([entry["evidence"] for entry in record_of(path)] for path in paths)
    assert first == second


def test_the_same_again_only_reads(copy):
    told: list[ComparisonProgress] = []
    before = {path: path.stat().st_mtime_ns for path in (copy / "runs").rglob("*") if path.is_file()}
    compare_pendulum(make(), copy, on_progress=told.append)
    assert [p.finished and p.finished.state for p in told] == ["read"] * 4
    last = told[-1]
    assert (last.jobs_done, last.jobs, last.evaluations, last.budget) == (4, 4, 24, 24)
    assert last.best == {m: min(r.best_loss for r in load_results(copy).of(m, "playback")) for m in METHODS}
    assert {path: path.stat().st_mtime_ns for path in (copy / "runs").rglob("*") if path.is_file()} == before
    with FileLock(copy / ".lock"), pytest.raises(RunError, match=f"another process is working on comparison '{copy}'"):
        compare_pendulum(make(), copy)


def test_methods_are_added_to_the_seeds_that_are_there(copy, in_a_thread):
    before, told = rows(copy), []
    results = compare_pendulum(make(["least-squares"], (0,)), copy, on_progress=told.append)
    assert (results.missing, results.methods) == ({}, (*METHODS, "least-squares"))
    assert {p.finished.key: p.finished.state for p in told if p.finished is not None} == {
        f"playback/{method}/seed-{seed}": "done" if method == "least-squares" else "read"
        for method in results.methods for seed in (0, 1)
    }  # fmt: skip
    assert rows(copy)[: len(before)] == before
    assert len(rows(copy)) == 6


def test_every_trial_is_left_out_once_and_a_plan_without_a_run_binds_nobody(tmp_path, in_a_thread):
    make(["least-squares"], range(9), 99).write(tmp_path)
    results = compare_pendulum(make(["random"], (0,), 2, leave_one_out=True), tmp_path)
    assert (results.missing, len(results.runs)) == ({}, 3)
    assert [set(run_.fit.trials) for run_ in results.runs] == [{"a", "b"}, {"b"}, {"a"}]
    whole, *found = rows(tmp_path)
    assert whole["held_out_loss"] == ""
    for one, row in zip(results.left_out("random", "playback"), found, strict=True):
        assert one.folder == f"runs/playback/random/seed-0/without-{one.held_out}"
        assert set(one.held_out_fit.trials) == {one.held_out} == {row["held_out"]}
        assert float(row["held_out_aligned_marker_error"]) == one.held_out_fit.aligned_marker_error


@pytest.mark.slow
def test_a_higher_budget_goes_on_and_an_outcome_of_the_lower_one_isnt_taken_for_it(copy, in_a_thread):
    folder = RunFolder(copy / "runs/playback/random/seed-1")
    old, plan = folder.outcome(), make(["random"], (1,), 12)
    assert compare_pendulum(plan, copy).missing == {}
    assert lines(copy) == dict.fromkeys(lines(copy), 12)
    new = folder.outcome()
    assert new.fit.loss < old.fit.loss
    folder.write_json("outcome.json", old.to_json())  # as if killed before the run was concluded again
    assert read_results(copy).missing == {"playback/random/seed-1": "12 of 12 evaluations are done"}
    (copy / ".session").write_text("token")
    assert run_job(plan.jobs(copy)[0], Work(copy, "token", plan, REFERENCE, PENDULUM)).state == "done"
    assert folder.outcome() == new


@pytest.mark.slow
def test_stages_are_planned_by_the_budget_so_they_begin_anew_with_another(pool, tmp_path):
    asked = ComparisonSettings(methods=("staged",), seeds=(0,), protocols=("aligned",))
    plans = [make_plan(replace(asked, budget=budget), pool, FISH) for budget in (2, 3)]
    (tmp_path / ".session").write_text("token")
    shared = Work(tmp_path, "token", plans[0], pool, FISH)
    staged = [plan.jobs(tmp_path)[0] for plan in plans]
    for one in staged:
        assert run_job(one, shared).problem is None
        assert len(record_of(one.folder)) == RunFolder(one.folder).settings().budget == one.settings.budget
    assert len(record_of(staged[0].folder / "budget-2")) == 2
    assert run_job(staged[1], shared).state == "read"


def test_a_job_that_fails_leaves_the_others_alone_and_is_done_again(copy, in_a_thread):
    broken = copy / "runs/playback/random/seed-0/record.jsonl"
    good = broken.read_bytes()
    broken.write_bytes(b"{nothing}\n" + good)
    told: list[ComparisonProgress] = []
    gone = make(["random", "line-search@replay:nowhere"], (0,))
    results = compare_pendulum(gone, copy, on_progress=told.append)
    (folder,) = (copy / "runs/playback").glob("line-search@*")
    failed = {f"playback/{folder.name}/seed-{seed}" for seed in (0, 1)}
    assert set(results.missing) == {"playback/random/seed-0", *failed}
    assert results.missing["playback/random/seed-0"].startswith(f"{broken}, line 1 is damaged (")
    for key in failed:
        assert results.missing[key] == "'nowhere' is no run folder: it has no settings.json"
        assert (copy / "runs" / key / PROBLEM).read_text() == results.missing[key] + "\n"
    assert len(results.runs) == 3
    assert [p.finished.state for p in told if p.finished] == ["read"] * 3 + ["failed"] * 3
    broken.write_bytes(good)
    assert set(read_results(copy).missing) == failed


@pytest.fixture
def work(tmp_path):
    """A session without anybody who waits, and its first job."""
    with session(tmp_path) as token:
        yield make().jobs(tmp_path)[0], Work(tmp_path, token, make(), REFERENCE, PENDULUM)


def test_a_job_stops_when_nobody_waits_for_it_any_more(work, monkeypatch):
    monkeypatch.setattr("swim2real.comparison.cluster._HIDDEN_TIME", 0.3)
    job, shared = work
    (shared.root / ".session").write_text("of another")
    assert run_job(job, shared).state == "stopped"
    assert not job.folder.exists()
    with pytest.raises(RunError, match=f"doesn't see comparison '{shared.root / 'elsewhere'}'; put it on a file"):
        check_session(shared.root / "elsewhere", "token")


@pytest.mark.slow
def test_a_job_in_the_middle_stops_after_an_evaluation_and_goes_on(work):
    job, shared = work

    def leave() -> None:
        while not (job.folder / "record.jsonl").exists():
            time.sleep(0.01)
        (shared.root / ".session").unlink()

    leaving = threading.Thread(target=leave)
    leaving.start()
    assert run_job(replace(job, settings=replace(job.settings, budget=3000)), shared).state == "stopped"
    leaving.join()
    before = record_of(job.folder)
    assert 1 <= len(before) < 2000
    (shared.root / ".session").write_text(shared.token)
    longer = replace(job, settings=replace(job.settings, budget=len(before) + 1))
    assert run_job(longer, shared).state == "done"
    assert record_of(job.folder)[:-1] == before


def test_other_settings_another_engine_and_faults_end_one_job(work):
    job, shared = work
    other = replace(shared.plan, engine=Engine("mujoco 9.9", "implicit", 0.001, (1.0,)))
    problem = run_job(job, replace(shared, plan=other)).problem
    assert "whose physics differs from that of mujoco 9.9, which the comparison was begun with" in problem
    problem = run_job(job, replace(shared, reference=None)).problem
    assert problem.startswith("unexpected AttributeError: ")
    assert (job.folder / PROBLEM).read_text().startswith(f"{problem}\nTraceback (most recent call last):")
    assert run_job(job, shared).state == "done"
    report = run_job(replace(job, settings=replace(job.settings, seed=5)), shared)
    assert report.state == "failed"
    assert report.problem.startswith(f"'{job.folder}' was run with another setting of seed: 0, and now it is 5; ")


@pytest.mark.slow
def test_a_local_cluster_gives_the_same_table(finished, tmp_path):
    assert compare_pendulum(make(), tmp_path / "comparison", cluster="local:1").missing == {}
    assert table(tmp_path / "comparison") == table(finished)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="no /proc to find a worker in")
def test_a_cluster_that_loses_a_worker_in_the_middle_gives_the_same_table(tmp_path, in_a_thread):
    from distributed import Client, LocalCluster

    plan, alone, out = make(budget=25), tmp_path / "alone", tmp_path / "comparison"
    compare_pendulum(plan, alone)
    killed: list[int] = []

    def kill() -> None:
        """Kills the process that works in a run folder in the middle of its run."""
        while not killed:
            busy = {out / "runs" / key / ".lock" for key, count in lines(out).items() if 0 < count < 20}
            for link in map(Path, glob("/proc/[0-9]*/fd/*")):  # passes over processes that have just ended
                try:
                    held = link.readlink() in busy
                except OSError:
                    continue
                if held and not killed:
                    killed.append(int(link.parts[2]))
                    os.kill(killed[0], signal.SIGKILL)

    options = {"threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": None}
    with LocalCluster(n_workers=2, **options) as cluster, Client(cluster, set_as_default=False) as client:
        workers = set(client.run(os.getpid).values())
        killer = threading.Thread(target=kill, daemon=True)
        killer.start()
        results = compare_pendulum(plan, out, cluster=client.scheduler.address)
        killer.join(timeout=10)
    assert set(killed) < workers
    assert results.missing == {}
    assert table(out) == table(alone)


def test_versions_of_workers_are_compared(caplog):
    here = versions()
    check_versions({"one": here, "two": {**here, "numpy": "1.0"}})
    assert caplog.messages == ["worker two has numpy 1.0; last digits of results may differ"]
    with pytest.raises(RunError, match=r"worker two has swim2real 9, here it is \d.*; install the same version"):
        check_versions({"one": here, "two": {**here, "swim2real": "9"}})


@pytest.mark.parametrize(
    ("address", "error", "says"),
    [("local:0", ArgumentError, "cluster is 'local:0'"), ("here", ArgumentError, "cluster is 'here'"),
     ("tcp://127.0.0.1:9", RunError, "no Dask scheduler answers at 'tcp://127.0.0.1:9'"),
     (None, MissingExtraError, r"pip install 'swim2real\[cluster\]'")],
)  # fmt: skip
def test_a_cluster_that_cant_be_is_named(address, error, says, tmp_path, monkeypatch):
    monkeypatch.setattr("swim2real.comparison.cluster._CONNECTION_TIME", 1)
    if address is None:
        monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(error, match=says), dask_cluster(address or "local:2", tmp_path, "token"):
        pass

"""Comparisons as they are run: by processes and by a Dask cluster, killed, stopped, gone on with and added to."""

import csv
import os
import shutil
import signal
import sys
import threading
import time
from concurrent.futures import CancelledError, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock

from recorded import PENDULUM, pendulum_reference
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
from swim2real.comparison.cluster import (
    check_session,
    check_versions,
    dask_cluster,
    explain_failure,
    session,
    versions_seen,
)
from swim2real.comparison.jobs import PROBLEM, Work, run_job
from swim2real.errors import ArgumentError, MissingExtraError, RunError
from swim2real.pipeline import calibrate
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings, ComparisonSettings
from swim2real.simulation import Engine

METHODS = ("random", "no-line-search")
REFERENCE = pendulum_reference()


def make(methods=METHODS, seeds=(0, 1), budget=6, reference=REFERENCE, **options) -> Plan:
    settings = ComparisonSettings(methods=tuple(methods), seeds=tuple(seeds), budget=budget, **options)
    return make_plan(settings, reference, PENDULUM)


def compare_pendulum(plan: Plan, out: Path, **options):
    return compare(plan, REFERENCE, PENDULUM, out, **options)


def table(out: Path) -> bytes:
    return (out / "results.csv").read_bytes()


def rows(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((out / "results.csv").read_text().splitlines()))


def lines(out: Path) -> dict[str, int]:
    """Evaluations on record, by job."""
    runs = out / "runs"
    return {
        path.parent.relative_to(runs).as_posix(): path.read_bytes().count(b"\n") for path in runs.rglob("record.jsonl")
    }


def holder(folder: Path) -> int | None:
    """The process that works in a run folder; None when none does."""
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            if link.readlink() == folder / ".lock":
                return int(link.parts[2])
        except OSError:
            continue
    return None


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """Two methods by two seeds, by two processes. Don't write into it."""
    out = tmp_path_factory.mktemp("finished") / "comparison"
    results = compare_pendulum(make(), out, workers=2)
    assert results.missing == {}
    return out


@pytest.fixture
def copy(finished, tmp_path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "copy"))


@pytest.fixture
def in_a_thread(monkeypatch) -> None:
    """Runs jobs in a thread of this process, which needs no time to start."""
    monkeypatch.setattr(
        sys.modules["swim2real.comparison.compare"], "ProcessPool", lambda workers: ThreadPoolExecutor(1)
    )


@pytest.fixture(scope="module")
def dask_client():
    from distributed import Client, LocalCluster

    options = {"threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": None}
    with LocalCluster(n_workers=2, **options) as cluster, Client(cluster, set_as_default=False) as client:
        yield client


@pytest.fixture
def cluster(dask_client):
    """A Dask cluster of two processes, and a client to ask them for their ids."""
    dask_client.wait_for_workers(2, timeout=60)  # one may have been killed and be on its way back
    return dask_client


# what is written


def test_a_comparison_is_run_folders_results_and_a_table(finished):
    keys = [f"playback/{method}/seed-{seed}" for method in METHODS for seed in (0, 1)]
    assert lines(finished) == dict.fromkeys(sorted(keys), 6)
    assert sorted(path.name for path in finished.iterdir()) == [
        ".lock", "plan.json", "results.csv", "results.json", "runs"
    ]  # fmt: skip
    assert read_plan(finished) == make()
    results = load_results(finished)
    assert results == read_results(finished)
    assert (results.methods, results.protocols, results.budget) == (METHODS, ("playback",), 6)
    assert (results.trials, results.markers) == (REFERENCE.names, PENDULUM.marker_names)
    for run_ in results.runs:
        folder = RunFolder(finished / run_.folder)
        record, outcome = folder.record(), folder.outcome()
        assert run_.losses == tuple(entry["loss"] for entry in record)
        assert run_.best.tolist() == np.minimum.accumulate(run_.losses).tolist()
        assert run_.best_loss == min(run_.losses) == run_.losses[run_.best_evaluation - 1]
        assert run_.values == record[run_.best_evaluation - 1]["values"]
        assert run_.fit == outcome.fit
        assert (run_.held_out, run_.held_out_fit, run_.spent) == (None, None, None)
        assert len(run_.fit.trials["a"].aligned_marker_errors) == 3
        assert folder.settings().threads == 1
        assert len(load_trials(folder)) == 2
    starts = {(run_.seed, run_.losses[0]) for run_ in results.runs}
    assert len(starts) == 2  # the same first point for every method of a seed


def test_a_run_is_what_calibrate_makes_of_the_same_settings(finished, tmp_path):
    calibrate(REFERENCE, PENDULUM, CalibrationSettings(method="random", budget=6, seed=1), tmp_path / "alone")
    paths = (tmp_path / "alone", finished / "runs/playback/random/seed-1")
    first, second = ([entry["evidence"] for entry in RunFolder(path).record()] for path in paths)
    assert first == second


def test_rounds_tell_steps_and_what_came_of_them(finished):
    results = load_results(finished)
    for run_ in results.of("no-line-search", "playback"):
        assert run_.calls == len(run_.rounds) == 2
        assert [(r.begin, r.sizes, r.finished) for r in run_.rounds] == [(4, (1.0,), True), (5, (1.0,), True)]
        assert [r.accepted for r in run_.rounds] == [run_.losses[i] < run_.best[i - 1] for i in (4, 5)]
    assert all(run_.rounds == () and run_.calls == 0 for run_ in results.of("random", "playback"))


def test_the_table_has_a_line_a_run(finished):
    first, *_ = found = rows(finished)
    assert [(row["method"], row["seed"]) for row in found] == [(m, s) for m in METHODS for s in ("0", "1")]
    run_ = load_results(finished).runs[0]
    assert float(first["best_loss"]) == run_.best_loss
    assert float(first["aligned_marker_error"]) == run_.fit.aligned_marker_error
    assert float(first["sensor_errors.gyro[1]"]) == run_.fit.sensor_errors["gyro[1]"]
    assert float(first["auc"]) == pytest.approx(np.mean(run_.best))
    assert {name: float(first[name]) for name in PENDULUM.space.names} == run_.values


# going on


def test_the_same_again_only_reads(copy):
    told: list[ComparisonProgress] = []
    before = {path: path.stat().st_mtime_ns for path in (copy / "runs").rglob("*") if path.is_file()}
    compare_pendulum(make(), copy, on_progress=told.append)
    assert [p.finished and p.finished.state for p in told] == ["read"] * 4
    assert (told[-1].jobs_done, told[-1].jobs, told[-1].evaluations, told[-1].budget) == (4, 4, 24, 24)
    assert {path: path.stat().st_mtime_ns for path in (copy / "runs").rglob("*") if path.is_file()} == before
    assert told[-1].best == {m: min(r.best_loss for r in load_results(copy).of(m, "playback")) for m in METHODS}


def test_methods_are_added_to_the_seeds_that_are_there(copy, in_a_thread):
    before = rows(copy)
    states: dict[str, str] = {}

    def tell(p: ComparisonProgress) -> None:
        if p.finished is not None:
            states[p.finished.key] = p.finished.state

    results = compare_pendulum(make(["least-squares"], (0,)), copy, on_progress=tell)
    assert results.missing == {}
    assert results.methods == (*METHODS, "least-squares")
    assert states == {
        **{f"playback/{method}/seed-{seed}": "read" for method in METHODS for seed in (0, 1)},
        "playback/least-squares/seed-0": "done",
        "playback/least-squares/seed-1": "done",
    }
    assert rows(copy)[: len(before)] == before
    assert len(rows(copy)) == 6


def test_every_trial_is_left_out_once(tmp_path, in_a_thread):
    plan = make(["random"], (0,), 2, leave_one_out=True)
    results = compare_pendulum(plan, tmp_path)
    assert results.missing == {}
    (whole,) = results.of("random", "playback")
    assert set(whole.fit.trials) == {"a", "b"}
    assert [one.held_out for one in results.left_out("random", "playback")] == ["a", "b"]
    for one in results.left_out("random", "playback"):
        assert one.folder == f"runs/playback/random/seed-0/without-{one.held_out}"
        assert set(one.fit.trials) == {"a", "b"} - {one.held_out}
        assert set(one.held_out_fit.trials) == {one.held_out}
        (row,) = (row for row in rows(tmp_path) if row["held_out"] == one.held_out)
        assert float(row["held_out_aligned_marker_error"]) == one.held_out_fit.aligned_marker_error
    assert rows(tmp_path)[0]["held_out_loss"] == ""


@pytest.mark.slow
def test_a_higher_budget_goes_on_and_an_outcome_of_the_lower_one_isnt_taken_for_it(copy, in_a_thread):
    folder = RunFolder(copy / "runs/playback/random/seed-1")
    old = folder.outcome()
    assert compare_pendulum(make(["random"], (1,), 12), copy).missing == {}
    assert lines(copy) == dict.fromkeys(lines(copy), 12)
    new = folder.outcome()
    assert new.fit.loss < old.fit.loss
    folder.write_json("outcome.json", old.to_json())  # as if killed before the run was concluded again
    assert read_results(copy).missing == {"playback/random/seed-1": "12 of 12 evaluations are done"}
    work = Work(copy, "token", make(), REFERENCE, PENDULUM)
    (copy / ".session").write_text("token")
    (job,) = [job for job in make(budget=12).jobs(copy) if job.key == "playback/random/seed-1"]
    assert run_job(job, work).state == "done"
    assert folder.outcome() == new


@pytest.mark.slow
def test_stages_are_planned_by_the_budget_so_they_begin_anew_with_another(pool, tmp_path):
    asked = ComparisonSettings(methods=("staged",), seeds=(0,), protocols=("aligned",))
    plans = [make_plan(replace(asked, budget=budget), pool, FISH) for budget in (2, 3)]
    staged = [plan.jobs(tmp_path)[0] for plan in plans]
    (tmp_path / ".session").write_text("token")
    shared, job = Work(tmp_path, "token", plans[0], pool, FISH), staged[0]
    for one in staged:
        assert run_job(one, shared).problem is None
        assert len(RunFolder(job.folder).record()) == RunFolder(job.folder).settings().budget == one.settings.budget
    assert len(RunFolder(job.folder / "budget-2").record()) == 2
    assert run_job(staged[1], shared).state == "read"


def test_another_reference_is_refused_and_nothing_is_changed(copy):
    before = (copy / "plan.json").read_bytes(), table(copy)
    other = replace(REFERENCE, trials=REFERENCE.trials[:1])
    with pytest.raises(RunError, match="a comparison that was begun can't go on with another reference"):
        compare(make(reference=other), other, PENDULUM, copy)
    assert ((copy / "plan.json").read_bytes(), table(copy)) == before


def test_a_plan_without_a_run_binds_nobody(tmp_path, in_a_thread):
    make(["least-squares"], range(9), 99).write(tmp_path)
    assert compare_pendulum(make(["random"], (0,), 1), tmp_path).missing == {}
    assert lines(tmp_path) == {"playback/random/seed-0": 1}


def test_one_comparison_at_a_time(copy):
    says = f"another process is working on comparison '{copy}'; wait or use another folder"
    with FileLock(copy / ".lock"), pytest.raises(RunError) as caught:
        compare_pendulum(make(), copy)
    assert str(caught.value) == says


# what goes wrong


def test_a_job_that_fails_leaves_the_others_alone_and_is_done_again(copy, in_a_thread):
    broken = copy / "runs/playback/random/seed-0/record.jsonl"
    good = broken.read_bytes()
    broken.write_bytes(b"{nothing}\n" + good)
    gone = "line-search@replay:nowhere"
    told: list[ComparisonProgress] = []
    results = compare_pendulum(make(["random", gone], (0,)), copy, on_progress=told.append)
    (folder,) = (copy / "runs/playback").glob("line-search@*")
    key = f"playback/{folder.name}/seed-0"
    assert set(results.missing) == {"playback/random/seed-0", key, key.replace("seed-0", "seed-1")}
    assert results.missing["playback/random/seed-0"].startswith(f"{broken}, line 1 is damaged (")
    assert results.missing[key] == "'nowhere' is no run folder: it has no settings.json"
    assert (folder / "seed-0" / PROBLEM).read_text() == results.missing[key] + "\n"
    assert len(results.runs) == 3
    assert [p.finished.state for p in told if p.finished] == ["read"] * 3 + ["failed"] * 3
    broken.write_bytes(good)
    results = read_results(copy)
    assert set(results.missing) == {key, key.replace("seed-0", "seed-1")}


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


@pytest.mark.slow
def test_a_job_in_the_middle_stops_after_an_evaluation_and_goes_on(work):
    job, shared = work
    longer = replace(job, settings=replace(job.settings, budget=3000))

    def leave() -> None:
        while not (job.folder / "record.jsonl").exists():
            time.sleep(0.01)
        (shared.root / ".session").unlink()

    leaving = threading.Thread(target=leave)
    leaving.start()
    assert run_job(longer, shared).state == "stopped"
    leaving.join()
    count = len(RunFolder(job.folder).record())
    assert 1 <= count < 2000
    (shared.root / ".session").write_text(shared.token)
    before = RunFolder(job.folder).record()
    assert run_job(replace(job, settings=replace(job.settings, budget=count + 1)), shared).state == "done"
    assert RunFolder(job.folder).record()[:-1] == before


def test_a_run_of_other_settings_is_refused(work):
    job, shared = work
    assert run_job(job, shared).state == "done"
    other = replace(job, settings=replace(job.settings, seed=5))
    report = run_job(other, shared)
    assert report.state == "failed"
    assert report.problem.startswith(f"'{job.folder}' was run with another setting of seed: 0, and now it is 5; ")


def test_a_worker_with_another_engine_is_refused(work):
    job, shared = work
    other = replace(shared.plan, engine=Engine("mujoco 9.9", "implicit", 0.001, (1.0,)))
    problem = run_job(job, replace(shared, plan=other)).problem
    assert "whose physics differs from that of mujoco 9.9, which the comparison was begun with" in problem


def test_an_unexpected_error_is_kept_with_its_trace(work):
    job, shared = work
    job.folder.mkdir(parents=True)
    (job.folder / "settings.json").mkdir()  # what nobody thinks of
    report = run_job(job, replace(shared, reference=None))
    assert report.state == "failed"
    assert report.problem.startswith("unexpected AttributeError: ")
    first, second, *_ = (job.folder / PROBLEM).read_text().splitlines()
    assert (first, second) == (report.problem, "Traceback (most recent call last):")


# a cluster


@pytest.mark.slow
def test_a_local_cluster_gives_the_same_table(finished, tmp_path):
    out = tmp_path / "comparison"
    assert compare_pendulum(make(), out, cluster="local:1").missing == {}
    assert table(out) == table(finished)
    assert sorted(path.name for path in out.iterdir()) == [".lock", "plan.json", "results.csv", "results.json", "runs"]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="no /proc to find a worker in")
def test_a_cluster_that_loses_a_worker_in_the_middle_gives_the_same_table(cluster, tmp_path, in_a_thread):
    plan, alone, out = make(budget=25), tmp_path / "alone", tmp_path / "comparison"
    compare_pendulum(plan, alone)
    killed: list[int] = []

    def kill() -> None:
        while not killed:
            for key, count in lines(out).items():
                if 0 < count < 20 and not killed and (process := holder(out / "runs" / key)) is not None:
                    os.kill(process, signal.SIGKILL)
                    killed.append(process)

    workers = set(cluster.run(os.getpid).values())
    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    results = compare_pendulum(plan, out, cluster=cluster.scheduler.address)
    killer.join(timeout=10)
    assert set(killed) < workers
    assert results.missing == {}
    assert table(out) == table(alone)


@pytest.mark.slow
def test_a_cluster_works_for_nobody_no_longer(cluster, tmp_path):
    out = tmp_path / "comparison"

    def interrupt(p: ComparisonProgress) -> None:
        if p.evaluations:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compare_pendulum(make(budget=3000), out, cluster=cluster.scheduler.address, on_progress=interrupt)
    for folder in (out / "runs/playback").glob("*/seed-*"):
        with FileLock(folder / ".lock", timeout=30):
            pass
    assert sum(lines(out).values()) < 4 * 3000
    assert not (out / ".session").exists()


def test_a_scheduler_that_isnt_there_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("swim2real.comparison.cluster._CONNECTION_TIME", 1)
    with pytest.raises(RunError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:9': .*; check the address"):
        compare_pendulum(make(), tmp_path / "comparison", cluster="tcp://127.0.0.1:9")


def test_versions_of_workers_are_compared(tmp_path, caplog):
    with session(tmp_path) as token:
        here = versions_seen(tmp_path, token)
    assert here == versions()
    check_versions({"one": here})
    assert caplog.text == ""
    check_versions({"one": here, "two": {**here, "numpy": "1.0"}})
    assert "worker two has numpy 1.0; last digits of results may differ" in caplog.text
    with pytest.raises(RunError, match=r"worker two has swim2real 9, here it is \d.*; install the same version"):
        check_versions({"one": here, "two": {**here, "swim2real": "9"}})


def test_a_worker_that_doesnt_see_the_folder_says_so(tmp_path):
    with pytest.raises(RunError, match=f"doesn't see comparison '{tmp_path / 'elsewhere'}'; put it on a file system"):
        check_session(tmp_path / "elsewhere", "token", timeout=0.1)


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("local:0", "cluster is 'local:0'; write local:N with a whole number N from 1 on"),
        ("local:two", "cluster is 'local:two'; write local:N with a whole number N from 1 on"),
        ("here", "cluster is 'here'; write tcp://HOST:PORT of a Dask scheduler, or local:N"),
    ],
)
def test_an_address_that_makes_no_sense_is_named(address, says, tmp_path):
    with pytest.raises(ArgumentError, match=says), dask_cluster(address, tmp_path, "token"):
        pass


def test_without_dask_a_sentence_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "distributed", None)
    says = r"a Dask cluster needs dask and distributed; install them with: pip install 'swim2real\[cluster\]'"
    with pytest.raises(MissingExtraError, match=says), dask_cluster("local:2", tmp_path, "token"):
        pass


def test_lost_runs_are_explained():
    assert explain_failure(RunError("its process died")) == "its process died"
    assert explain_failure(CancelledError()) == "the cluster gave it up; run again to go on"
    assert explain_failure(ValueError("what?")) == "unexpected ValueError: what?"

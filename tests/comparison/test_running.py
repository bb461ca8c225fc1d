"""Comparisons as they are run: by processes and by a Dask cluster, killed, stopped, gone on with and added to."""

import csv
import os
import shutil
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock

from swim2real.calibration import RunFolder, load_trials
from swim2real.comparison import (
    ComparisonProgress,
    Plan,
    compare,
    contestants,
    load_results,
    make_plan,
    read_plan,
    read_results,
)
from swim2real.comparison.jobs import PROBLEM, Work, run_job
from swim2real.comparison.session import Worker, check_session, judge, probe, session
from swim2real.errors import RunError
from swim2real.pipeline import run
from swim2real.robots.fish import FISH
from swim2real.settings import CalibrationSettings

METHODS = ("random", "no-line-search")


def make(pool, methods=METHODS, seeds=(0, 1), budget=3, **options) -> Plan:
    return make_plan(contestants(methods), seeds, ["aligned"], budget, pool, FISH, **options)


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


def holder(folder: Path) -> int:
    """The process that works in a run folder."""
    while True:
        for link in Path("/proc").glob("[0-9]*/fd/*"):
            try:
                if link.readlink() == folder / ".lock":
                    return int(link.parts[2])
            except OSError:
                continue


@pytest.fixture(scope="module")
def finished(pool, tmp_path_factory) -> Path:
    """Two methods by two seeds, by two processes. Don't write into it."""
    out = tmp_path_factory.mktemp("finished") / "comparison"
    results = compare(make(pool), pool, FISH, out, workers=2)
    assert results.missing == {}
    return out


@pytest.fixture
def copy(finished, tmp_path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "copy"))


@pytest.fixture(scope="module")
def cluster():
    """A Dask cluster of two processes, and a client to ask them for their ids."""
    from distributed import Client, LocalCluster

    options = {"threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": None}
    with LocalCluster(n_workers=2, **options) as cluster, Client(cluster, set_as_default=False) as client:
        yield client


# what is written


def test_a_comparison_is_run_folders_results_and_a_table(finished, pool):
    keys = [f"aligned/{method}/seed-{seed}" for method in METHODS for seed in (0, 1)]
    assert lines(finished) == dict.fromkeys(sorted(keys), 3)
    assert sorted(path.name for path in finished.iterdir()) == [
        ".lock", "plan.json", "results.csv", "results.json", "runs"
    ]  # fmt: skip
    assert read_plan(finished) == make(pool)
    results = load_results(finished)
    assert results == read_results(finished)
    assert (results.methods, results.protocols, results.budget) == (METHODS, ("aligned",), 3)
    assert results.trials == pool.names
    assert results.markers == FISH.marker_names
    for run_ in results.runs:
        folder = RunFolder(finished / run_.folder)
        record, outcome = folder.record(), folder.outcome()
        assert run_.losses == tuple(entry["loss"] for entry in record)
        assert run_.best.tolist() == np.minimum.accumulate(run_.losses).tolist()
        assert run_.best_loss == min(run_.losses) == run_.losses[run_.best_evaluation - 1]
        assert run_.values == record[run_.best_evaluation - 1]["values"]
        assert run_.fit == outcome["fit"]
        assert (run_.held_out, run_.held_out_fit, run_.spent) == (None, None, None)
        assert {"marker_errors", "aligned_marker_errors", "shape_marker_errors"} <= set(run_.fit["trials"]["f1_20"])
        assert folder.settings()["threads"] == 1
        assert len(load_trials(folder)) == 2
    starts = {(run_.seed, run_.losses[0]) for run_ in results.runs}
    assert len(starts) == 2  # the same first point for every method of a seed


def test_a_run_is_what_calibrate_makes_of_the_same_settings(finished, pool, tmp_path):
    run(pool, FISH, CalibrationSettings(method="random", budget=3, seed=1), tmp_path / "alone")
    one, other = (RunFolder(path).record() for path in (tmp_path / "alone", finished / "runs/aligned/random/seed-1"))
    assert [e["evidence"] for e in one] == [e["evidence"] for e in other]


def test_rounds_tell_steps_and_what_came_of_them(finished):
    results = load_results(finished)
    for run_ in results.of("no-line-search", "aligned"):
        assert run_.calls == len(run_.rounds) == 2
        assert [(r.begin, r.sizes, r.finished) for r in run_.rounds] == [(1, (1.0,), True), (2, (1.0,), True)]
        before = run_.best[:-1]
        assert [r.accepted for r in run_.rounds] == [run_.losses[i + 1] < before[i] for i in range(2)]
    assert all(run_.rounds == () and run_.calls == 0 for run_ in results.of("random", "aligned"))


def test_the_table_has_a_line_a_run(finished):
    first, *_ = found = rows(finished)
    assert [(row["method"], row["seed"]) for row in found] == [(m, s) for m in METHODS for s in ("0", "1")]
    run_ = load_results(finished).runs[0]
    assert float(first["best_loss"]) == run_.best_loss
    assert float(first["velocity_error"]) == run_.fit["velocity_error"]
    assert float(first["auc"]) == pytest.approx(np.mean(run_.best))
    assert {name: float(first[name]) for name in FISH.space.names} == run_.values


# going on


def test_the_same_again_only_reads(copy, pool):
    told: list[ComparisonProgress] = []
    before = {path: path.stat().st_mtime_ns for path in (copy / "runs").rglob("*") if path.is_file()}
    compare(make(pool), pool, FISH, copy, on_progress=told.append)
    assert [p.finished and p.finished["state"] for p in told] == ["read"] * 4
    assert (told[-1].jobs_done, told[-1].jobs, told[-1].evaluations, told[-1].budget) == (4, 4, 12, 12)
    assert {path: path.stat().st_mtime_ns for path in (copy / "runs").rglob("*") if path.is_file()} == before
    assert told[-1].best == {m: min(r.best_loss for r in load_results(copy).of(m, "aligned")) for m in METHODS}


@pytest.mark.slow
def test_methods_are_added_to_the_seeds_that_are_there(copy, pool):
    before = rows(copy)
    states: dict[str, str] = {}

    def tell(p: ComparisonProgress) -> None:
        if p.finished is not None:
            states[p.finished["key"]] = p.finished["state"]

    results = compare(make(pool, ["warm-start"], (0,)), pool, FISH, copy, workers=2, on_progress=tell)
    assert results.missing == {}
    assert results.methods == (*METHODS, "warm-start")
    assert states == {
        **{f"aligned/{method}/seed-{seed}": "read" for method in METHODS for seed in (0, 1)},
        "aligned/warm-start/seed-0": "done",
        "aligned/warm-start/seed-1": "done",
    }
    assert rows(copy)[: len(before)] == before
    assert len(rows(copy)) == 6


def test_every_trial_is_left_out_once(pool, tmp_path):
    plan = make(pool, ["random"], (0,), 2, leave_one_out=True)
    results = compare(plan, pool, FISH, tmp_path, workers=2)
    assert results.missing == {}
    (whole,) = results.of("random", "aligned")
    assert set(whole.fit["trials"]) == {"f1_20", "f1_60"}
    assert [one.held_out for one in results.left_out("random", "aligned")] == ["f1_20", "f1_60"]
    for one in results.left_out("random", "aligned"):
        assert one.folder == f"runs/aligned/random/seed-0/without-{one.held_out}"
        assert set(one.fit["trials"]) == {"f1_20", "f1_60"} - {one.held_out}
        assert set(one.held_out_fit["trials"]) == {one.held_out}
        (row,) = (row for row in rows(tmp_path) if row["held_out"] == one.held_out)
        assert float(row["held_out_aligned_marker_error"]) == one.held_out_fit["aligned_marker_error"]
    assert rows(tmp_path)[0]["held_out_loss"] == ""


@pytest.mark.slow
def test_a_higher_budget_goes_on_and_an_outcome_of_the_lower_one_isnt_taken_for_it(copy, pool):
    folder = RunFolder(copy / "runs/aligned/random/seed-1")
    old = folder.outcome()
    assert compare(make(pool, ["random"], (1,), 6), pool, FISH, copy, workers=2).missing == {}
    assert lines(copy) == dict.fromkeys(lines(copy), 6)
    new = folder.outcome()
    assert new["fit"]["loss"] < old["fit"]["loss"]
    folder.write_json("outcome.json", old)  # as if killed before the run was concluded again
    assert read_results(copy).missing == {"aligned/random/seed-1": "6 of 6 evaluations are done"}
    work = Work(copy, "token", pool, FISH, make(pool, budget=6).basis)
    (copy / ".session").write_text("token")
    (job,) = [job for job in make(pool, budget=6).jobs(copy) if job.key == "aligned/random/seed-1"]
    assert run_job(job, work)["state"] == "done"
    assert folder.outcome() == new


@pytest.mark.slow
def test_stages_are_planned_by_the_budget_so_they_begin_anew_with_another(work):
    job, shared = work
    staged = [replace(job, settings=replace(job.settings, method="staged", budget=budget)) for budget in (2, 3)]
    for one in staged:
        assert run_job(one, shared)["problem"] is None
        assert len(RunFolder(job.folder).record()) == RunFolder(job.folder).settings()["budget"] == one.settings.budget
    assert len(RunFolder(job.folder / "budget-2").record()) == 2
    assert run_job(staged[1], shared)["state"] == "read"


def test_another_reference_is_refused_and_nothing_is_changed(copy, pool):
    before = (copy / "plan.json").read_bytes(), table(copy)
    other = replace(pool, trials=pool.trials[:1])
    with pytest.raises(RunError, match="a comparison that was begun can't go on with another reference"):
        compare(make(other), other, FISH, copy)
    assert ((copy / "plan.json").read_bytes(), table(copy)) == before


def test_a_plan_without_a_run_binds_nobody(pool, tmp_path):
    make(pool, ["warm-start"], range(9), 99).write(tmp_path)
    assert compare(make(pool, ["random"], (0,), 1), pool, FISH, tmp_path, workers=1).missing == {}
    assert lines(tmp_path) == {"aligned/random/seed-0": 1}


def test_one_comparison_at_a_time(copy, pool):
    says = f"another process is working on comparison '{copy}'; wait or use another folder"
    with FileLock(copy / ".lock"), pytest.raises(RunError) as caught:
        compare(make(pool), pool, FISH, copy)
    assert str(caught.value) == says


# what goes wrong


def test_a_job_that_fails_leaves_the_others_alone_and_is_done_again(pool, copy):
    broken = copy / "runs/aligned/random/seed-0/record.jsonl"
    good = broken.read_bytes()
    broken.write_bytes(b"{nothing}\n" + good)
    gone = "line-search@replay:nowhere"
    told: list[ComparisonProgress] = []
    plan = make(pool, ["random", gone], (0,))
    results = compare(plan, pool, FISH, copy, workers=1, on_progress=told.append)
    (folder,) = (copy / "runs/aligned").glob("line-search@*")
    key = f"aligned/{folder.name}/seed-0"
    assert set(results.missing) == {"aligned/random/seed-0", key, key.replace("seed-0", "seed-1")}
    assert results.missing["aligned/random/seed-0"].startswith(f"{broken}, line 1 is damaged (")
    assert results.missing[key] == "'nowhere' is no run folder: it has no settings.json"
    assert (folder / "seed-0" / PROBLEM).read_text() == results.missing[key] + "\n"
    assert len(results.runs) == 3
    assert [p.finished["state"] for p in told if p.finished] == ["read"] * 3 + ["failed"] * 3
    broken.write_bytes(good)
    results = read_results(copy)
    assert set(results.missing) == {key, key.replace("seed-0", "seed-1")}


@pytest.fixture
def work(pool, tmp_path):
    """A session without anybody who waits, and its first job."""
    with session(tmp_path) as token:
        yield make(pool).jobs(tmp_path)[0], Work(tmp_path, token, pool, FISH, make(pool).basis)


def test_a_job_stops_when_nobody_waits_for_it_any_more(work, monkeypatch):
    monkeypatch.setattr("swim2real.comparison.session._SEEN_AFTER", 0.3)
    job, shared = work
    (shared.root / ".session").write_text("of another")
    assert run_job(job, shared)["state"] == "stopped"
    assert not job.folder.exists()


def test_a_job_in_the_middle_stops_after_an_evaluation_and_goes_on(work):
    job, shared = work
    longer = replace(job, settings=replace(job.settings, budget=500))

    def leave() -> None:
        while not (job.folder / "record.jsonl").exists():
            time.sleep(0.01)
        (shared.root / ".session").unlink()

    leaving = threading.Thread(target=leave)
    leaving.start()
    assert run_job(longer, shared)["state"] == "stopped"
    leaving.join()
    count = len(RunFolder(job.folder).record())
    assert 1 <= count < 100
    (shared.root / ".session").write_text(shared.token)
    before = RunFolder(job.folder).record()
    assert run_job(replace(job, settings=replace(job.settings, budget=count + 1)), shared)["state"] == "done"
    assert RunFolder(job.folder).record()[:-1] == before


def test_a_run_of_other_settings_is_refused(work):
    job, shared = work
    assert run_job(job, shared)["state"] == "done"
    other = replace(job, settings=replace(job.settings, seed=5))
    summary = run_job(other, shared)
    assert summary["state"] == "failed"
    assert summary["problem"].startswith(f"'{job.folder}' was run with another setting of seed: 0, and now it is 5; ")


def test_a_worker_with_another_engine_is_refused(work):
    job, shared = work
    other = {**shared.basis, "engine": {**shared.basis["engine"], "name": "mujoco 9.9", "fluid_fingerprint": [1.0]}}
    problem = run_job(job, replace(shared, basis=other))["problem"]
    assert "whose physics differs from that of mujoco 9.9, which the comparison was begun with" in problem


def test_an_unexpected_error_is_kept_with_its_trace(work):
    job, shared = work
    job.folder.mkdir(parents=True)
    (job.folder / "settings.json").mkdir()  # what nobody thinks of
    summary = run_job(job, replace(shared, reference=None))
    assert summary["state"] == "failed"
    assert summary["problem"].startswith("unexpected AttributeError: ")
    first, second, *_ = (job.folder / PROBLEM).read_text().splitlines()
    assert (first, second) == (summary["problem"], "Traceback (most recent call last):")


# a cluster


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="no /proc to find a worker in")
def test_a_cluster_that_loses_a_worker_in_the_middle_gives_the_same_table(finished, pool, cluster, tmp_path):
    out = tmp_path / "comparison"
    workers = set(cluster.run(os.getpid).values())
    killed: list[int] = []

    def kill() -> None:
        while not (begun := [key for key, count in lines(out).items() if count]):
            time.sleep(0.01)
        victim = holder(out / "runs" / begun[0])
        os.kill(victim, signal.SIGKILL)
        killed.append(victim)

    killer = threading.Thread(target=kill)
    killer.start()
    results = compare(make(pool), pool, FISH, out, cluster=cluster.scheduler.address)
    killer.join()
    assert set(killed) < workers
    assert not set(killed) & set(cluster.run(os.getpid).values())
    assert results.missing == {}
    assert table(out) == table(finished)
    assert sorted(path.name for path in out.iterdir()) == [".lock", "plan.json", "results.csv", "results.json", "runs"]


def test_a_cluster_works_for_nobody_no_longer(pool, cluster, tmp_path):
    out = tmp_path / "comparison"

    def interrupt(p: ComparisonProgress) -> None:
        if p.evaluations:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compare(make(pool, budget=300), pool, FISH, out, cluster=cluster.scheduler.address, on_progress=interrupt)
    for folder in (out / "runs/aligned").glob("*/seed-*"):
        with FileLock(folder / ".lock", timeout=30):
            pass
    assert sum(lines(out).values()) < 100
    assert not (out / ".session").exists()


def test_a_scheduler_that_isnt_there_is_named(pool, tmp_path, monkeypatch):
    monkeypatch.setattr("swim2real.comparison.executors._CONNECT", 1)
    with pytest.raises(RunError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:9': .*; check the address"):
        compare(make(pool), pool, FISH, tmp_path / "comparison", cluster="tcp://127.0.0.1:9")


def test_workers_are_asked_what_they_see(tmp_path, cluster, caplog):
    with session(tmp_path) as token:
        found = cluster.run(probe, tmp_path, token)
        assert len(list(tmp_path.glob(".probe-*"))) == len(found) == 2
        judge(found, tmp_path)
        assert not list(tmp_path.glob(".probe-*"))
        assert caplog.text == ""
        worker: Worker = next(iter(found.values()))
        old = replace(worker, wrote=probe(tmp_path, token).wrote, versions={**worker.versions, "numpy": "1.0"})
        judge({"": old}, tmp_path)
        assert f"worker {worker.host} has numpy 1.0; last digits of results may differ" in caplog.text
    for change, says in [
        ({"sees": False}, rf"worker {worker.host} doesn't see comparison '{tmp_path}'; put it on a file system that"),
        ({"wrote": None}, rf"worker {worker.host} can't write into '{tmp_path}' such that it is seen here; allow it"),
        ({"wrote": probe_name(tmp_path), "versions": {"swim2real": "9"}}, r"has swim2real 9, here it is \d"),
    ]:
        with pytest.raises(RunError, match=says):
            judge({"": replace(worker, **change)}, tmp_path)


def probe_name(folder: Path) -> str:
    (folder / ".probe-x").touch()
    return ".probe-x"


def test_a_worker_that_doesnt_see_the_folder_says_so(tmp_path):
    with pytest.raises(RunError, match=f"doesn't see comparison '{tmp_path / 'elsewhere'}'; put it on a file system"):
        check_session(tmp_path / "elsewhere", "token", patience=0.1)

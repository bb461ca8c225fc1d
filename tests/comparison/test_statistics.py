"""Statistics over seeds: numbers that can be worked out by hand, and the tables made of them."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from made_results import BUDGET, ROUNDS, TRIALS, evidence_of, made_results, made_run, playback_results, two_methods
from swim2real.comparison.results import ComparisonResults, load_results
from swim2real.comparison.statistics import (
    best_method,
    bootstrap_interval,
    differences,
    evaluations_to_reach,
    held_out_errors,
    marker_errors,
    method_statistics,
    speeds,
    step_statistics,
)
from swim2real.comparison.tables import all_tables, as_markdown, tables


def flat(method: str, finals: list[float]):
    return [made_run(method, seed, [0.2] * (BUDGET - 1) + [loss]) for seed, loss in enumerate(finals)]


@pytest.fixture(scope="module")
def results() -> ComparisonResults:
    return two_methods()


def test_best_worst_and_auc_are_what_they_say(results: ComparisonResults) -> None:
    good, bad = method_statistics(results, "aligned")  # the absent method has no runs
    assert (good.method, bad.method, good.seeds) == ("good", "bad", (0, 1, 2))
    np.testing.assert_allclose(good.final.values, [0.010, 0.012, 0.014])
    # 0.2, then 0.08 twice, then 0.04 four times, then the seed's own
    assert good.auc[0] == pytest.approx((0.2 + 2 * 0.08 + 4 * 0.04 + 0.01) / 8)
    assert bad.auc[2] == pytest.approx((6 * 0.2 + 0.1 + 0.064) / 8)
    assert good.typical_run().seed == 1
    assert best_method((bad, good)).method == "good"
    run = made_run("a", 0, [1.0, 0.0, 0.3, 0.2, 0.2, 0.2, 0.2, 0.2, 0.01], failed=(0, 1))
    (one,) = method_statistics(made_results(run), "aligned")
    np.testing.assert_allclose(one.curves[0], [1.0, 1.0, 0.3, 0.2, 0.2, 0.2, 0.2, 0.2])  # cut at the budget


def test_differences_are_paired_by_the_seeds_that_both_have() -> None:
    # every seed is worse by 1 mm, though the seeds lie far apart: sure only when paired
    finals = [0.01, 0.05, 0.09, 0.13, 0.17]
    worse = flat("b", [loss + 0.001 for loss in finals])
    for others, seeds in ((worse, (0, 1, 2, 3, 4)), (worse[1:], (1, 2, 3, 4)), (worse[:1], (0,))):
        gap = differences(method_statistics(made_results(*flat("a", finals), *others), "aligned"))["b"]
        if len(seeds) == 1:  # no interval
            gap = differences(method_statistics(made_results(*flat("a", finals[:1]), *others), "aligned"))["b"]
        assert gap
        assert (gap.reference, gap.seeds, gap.is_significant) == ("a", seeds, len(seeds) > 1)
        assert gap.mean == pytest.approx(0.001)
        expected = [0.001] * 2 if len(seeds) > 1 else [math.nan] * 2
        assert [gap.low, gap.high] == pytest.approx(expected, nan_ok=True)
    apart = made_results(*flat("a", [0.01]), made_run("b", 7, [0.2] * 7 + [0.1]))
    assert differences(method_statistics(apart, "aligned")) == {"a": None, "b": None}
    assert differences(()) == {}


def test_the_interval_is_seeded_and_covers_as_it_should() -> None:
    values = np.array([0.3, -0.1, 0.2, 0.5, 0.1])
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    assert bootstrap_interval(values, 3) == bootstrap_interval(values, 3) != bootstrap_interval(values, 4)
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002
    rng = np.random.default_rng(5)
    intervals = [bootstrap_interval(rng.normal(1.0, 1.0, size=40)) for _ in range(200)]
    assert 180 <= sum(low < 1.0 < high for low, high in intervals) <= 200  # 95 %


def test_how_soon_an_error_is_reached_counts_those_who_never_do(results: ComparisonResults) -> None:
    good, bad = method_statistics(results, "aligned")
    found = evaluations_to_reach(good, (0.2, 0.08, 0.04, 0.012))
    assert found.median().tolist() == [1, 2, 4, 8]  # at or below
    assert found.count().tolist() == [3, 3, 3, 2]
    assert evaluations_to_reach(bad, (0.03,)).isna().all(axis=None)


def test_rounds_that_the_budget_cut_short_are_not_counted() -> None:
    found = step_statistics([made_run("a", seed, [0.2] * 8, rounds=ROUNDS) for seed in (0, 1)])
    assert found
    assert (found.rounds, found.accepted, found.cut_short, found.steps, found.calls) == (6, 4, 2, 12, 4)
    assert (found.accept_rate, found.steps_per_accepted) == pytest.approx((2 / 3, 3))
    assert found.shares == {1.0: 0.5, 0.5: 0.5, 0.25: 0.0}
    assert step_statistics([made_run("a", 0, [0.2] * 8)]) is None
    none = step_statistics([made_run("a", 0, [0.2] * 8, rounds=ROUNDS[2:])])
    assert none
    assert (none.accept_rate, none.shares, none.by_size[1.0], none.steps_per_accepted) == (0, {}, 0, math.inf)


def test_speeds_go_by_frequency_and_divergence_is_no_speed() -> None:
    run = made_run("a", 0, [0.1] * 8, speed_miss=-0.03)
    broken = evidence_of(0.1, speed_miss=-0.03)
    fast = broken.trials["fast"].model_copy(update={"divergence": "grew without limit", "velocity_simulated": 0.0})
    broken = broken.model_copy(update={"trials": {**broken.trials, "fast": fast}})
    found = speeds([run, replace(run, seed=1, fit=broken)])
    assert found
    assert found.trials == ("slow", "fast")
    np.testing.assert_allclose(found.errors, [[0.03, 0.03], [0.03, np.nan]])
    np.testing.assert_allclose(found.mean_error, [0.03, 0.03])
    assert speeds([]) is None


def test_results_and_marker_errors_come_back_as_they_are(tmp_path) -> None:
    runs = [made_run("a", 0, [0.1] * 8), made_run("a", 1, [0.2] * 8, lost=True)]
    np.testing.assert_allclose(marker_errors(runs, "aligned", 3), [[0.05, 0.1, 0.15], [0.1, 0.2, 0.3]])
    np.testing.assert_allclose(marker_errors(runs, "marker", 3), 2 * marker_errors(runs, "aligned", 3))
    np.testing.assert_allclose(marker_errors(runs, "shape", 3), [[0, 0.05, 0.1], [0, 0.1, np.nan]])
    for made in (playback_results(), two_methods()):
        (tmp_path / "results.json").write_text(json.dumps(made.as_dict()))
        assert load_results(tmp_path) == made


def test_left_out_trials_are_judged_beside_the_fit_that_knew_them(results: ComparisonResults) -> None:
    found = held_out_errors(results, "good", "aligned")
    assert found is not None
    assert tuple(found["trial"]) == TRIALS
    np.testing.assert_allclose(found[["held_out", "same_when_fitted"]], [[0.03, 0.01]] * 2)
    assert held_out_errors(results, "bad", "aligned") is None
    # and no statistic mixes them with the others
    assert all(run.held_out is None for one in method_statistics(results, "aligned") for run in one.runs)


def test_the_tables_of_swims(results: ComparisonResults) -> None:
    made = {table.key: table for table in tables(results, "aligned")}
    assert made["paper"].title == "Calibration performance over 3 seeds, aligned protocol, 8 evaluations"
    assert "real speeds are 20, 200 mm/s" in made["velocity"].note
    shown = {
        "paper": "| good | **12.0 ± 2.0** | **14.0** | **66.5 ± ", "sureness": "| bad | 62.0 | 50.0 [50.0, 50.0] |",
        "reached": "not reached (0/3)", "left-out": "30.0", "figures": "Aligned marker error (mm)", "seeds": "Seed 2",
        "steps": "at step 0.5 (%)", "markers": "M2 (mm)", "velocity": "1.50 Hz (mm/s)",
    }  # fmt: skip
    assert set(made) == set(shown)
    assert [key for key, text in shown.items() if text not in as_markdown(made[key])] == []
    assert all_tables(results).count("aligned protocol") == len(made)
    assert tables(results, "paper") == ()
    alone = tables(made_results(*flat("a", [0.03])), "aligned")[0]
    assert alone.rows[0][1][0].text == "30.0"  # one seed has no deviation


def test_the_tables_of_recordings_have_the_figures_that_there_are() -> None:
    made = {table.key: table for table in tables(playback_results(sensor_errors={"load": 0.01234}), "playback")}
    assert made["figures"].columns == ("Method", "Marker error (mm)", "load (N)")
    assert [cell.text for cell in made["figures"].rows[0][1]] == ["15.0 ± 7.1", "0.0123 ± 0"]
    assert [(name, [one.text for one in cells]) for name, cells in made["markers"].rows] == [("good", ["0.0", "30.0"])]
    assert "lowest playback error" in made["paper"].note
    assert "velocity" not in made  # the trials have no frequency
    turning = {table.key: table for table in tables(playback_results(heading_error=math.pi / 2), "playback")}
    assert turning["figures"].columns[-1] == "Heading error (°)"
    assert turning["figures"].rows[0][1][-1].text == "90.0 ± 0.0"


def test_a_comparison_is_a_table_with_a_row_for_each_run():
    results = two_methods()
    table = results.to_dataframe()
    assert list(zip(table["method"], table["seed"], strict=True)) == [(run.method, run.seed) for run in results.runs]
    assert list(table["loss"]) == [float(run.best[-1]) for run in results.runs]
    assert set(results.runs[0].values) <= set(table.columns)

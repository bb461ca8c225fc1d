"""Stage after stage, under one budget."""

import json
from dataclasses import replace

import numpy as np
import pytest
from driving import answered, points
from hypothesis import given
from hypothesis import strategies as st

from refused import refusal, says
from swim2real.optimizers import Evaluation, RandomSearch, first_point, streams
from swim2real.optimizers.staged import GridScan, Stage, Staged
from swimbase.errors import OptimizerError

D = 8
BEST = np.array([0.3, 0.3, 0.3, 0.71, 0.2, 0.6, 0.9, 0.4])
BEAT, ARM, FLUID = (0, 1, 2), (3,), (4, 5)  # 6 is held, and no stage touches 7
HELD = 0.125


def part(name):
    return lambda detail: detail[name]


STAGES = (
    Stage("beat", BEAT, 1.0, "scan", part("beat")),
    Stage("arm", ARM, 1.0, "scan", part("arm")),
    Stage("fluid", FLUID, 5.0),
)


def evaluation(candidate, failed=False):
    """Separable: each stage's part depends on its own coordinates, and the loss is the fluid's part."""
    off = np.square(candidate.point - BEST)
    parts = {"beat": float(off[list(BEAT)].sum()), "arm": float(off[3])}
    return Evaluation(candidate, 1.0 if failed else float(off[list(FLUID)].sum()), failed, parts)


def random_search(dimension, rng, first):
    return RandomSearch(dimension, rng, first)


def staged(seed=0, budget=40, stages=STAGES, search=random_search, held=None):
    held = {6: HELD} if held is None else held
    return Staged(first_point(D, seed), stages, budget, search, streams(seed)[1], held)


def driven(count=40, answer=evaluation, optimizer=None, **settings):
    return answered(optimizer or staged(**settings), count, lambda i, candidate: answer(candidate))


def by_stage(told):
    found = {}
    for one in told:
        found.setdefault(one.candidate.note.get("stage"), []).append(one)
    return found


def fluid_of(answer):
    """Points of the last stage, which begins where the others ended."""
    return points(by_stage(driven(answer=answer))["fluid"])


def test_the_budget_is_shared_out_to_the_last_evaluation():
    assert staged().counts == (6, 5, 28)
    counted = {name: len(told) for name, told in by_stage(driven()).items()}
    assert counted == {None: 1, "beat": 6, "arm": 5, "fluid": 28}


@given(st.integers(1, 400), st.lists(st.floats(0.01, 10), min_size=1, max_size=3))
def test_shares_add_up(budget, shares):
    stages = [replace(stage, share=share) for stage, share in zip(STAGES, shares, strict=False)]
    counts = staged(budget=budget, stages=stages).counts
    assert sum(counts) == budget - 1
    assert min(counts) >= 0
    np.testing.assert_allclose(counts, (budget - 1) * np.array(shares) / sum(shares), atol=1.001)


def test_a_stage_moves_its_coordinates_and_no_others():
    told = by_stage(driven())
    first = first_point(D, 0)
    np.testing.assert_array_equal(told[None][0].candidate.point, first)
    base = first.copy()
    base[6] = HELD
    for name, moved in (("beat", BEAT), ("arm", ARM), ("fluid", FLUID)):
        moving = points(told[name])
        still = [i for i in range(D) if i not in moved]
        np.testing.assert_array_equal(moving[:, still], np.broadcast_to(base[still], (len(moving), len(still))))
        assert len(np.unique(moving[:, moved[0]])) == len(moving)
        if name != "fluid":
            assert np.all(moving[:, list(moved)] == moving[:, moved[:1]])  # together
            best = min(told[name], key=lambda one: one.detail[name])
            base[list(moved)] = best.candidate.point[list(moved)]
    fluid = points(told["fluid"])
    assert np.all(fluid[:, 4] != fluid[:, 5])  # each for itself


def test_a_stage_ends_at_its_best_score_whatever_the_loss_says():
    def against(candidate):
        one = evaluation(candidate)
        return replace(one, loss=1 - one.detail["beat"])

    fluid = fluid_of(against)
    assert np.all(np.abs(fluid[:, :3] - 0.3) < 0.05)
    assert np.all(np.abs(fluid[:, 3] - 0.71) < 0.06)


def test_what_is_known_of_the_place_where_a_stage_begins_is_told_and_not_paid_for_again():
    seen = []

    class Listening(RandomSearch):
        def _learn(self, evaluation):
            seen.append((evaluation.candidate.point, evaluation.loss))

    told = driven(search=Listening)
    stages = by_stage(told)
    assert len(seen) == 1 + len(stages["fluid"])
    start = min(stages["arm"], key=lambda one: one.detail["arm"])
    np.testing.assert_array_equal(seen[0][0], start.candidate.point[list(FLUID)])
    assert seen[0][1] == start.loss
    assert len(np.unique(points(told), axis=0)) == 40


def test_a_record_replays_bit_for_bit():
    def failing(candidate):
        return evaluation(candidate, failed=bool(candidate.point[4] > 0.8))

    told = driven(answer=failing)
    assert any(one.failed for one in told)
    entries = iter(
        json.dumps({"point": e.candidate.point.tolist(), "loss": e.loss, "failed": e.failed, "detail": e.detail})
        for e in told
    )

    def recorded(candidate):
        entry = json.loads(next(entries))
        assert entry["point"] == candidate.point.tolist()
        return Evaluation(candidate, entry["loss"], entry["failed"], entry["detail"])

    half = staged()
    driven(23, recorded, half)
    np.testing.assert_array_equal(points(driven(17, failing, half)), points(told)[23:])


def test_failures_are_never_the_start_of_a_stage():
    def failing(candidate):
        return evaluation(candidate, failed=bool(abs(candidate.point[0] - 0.3) < 0.15))  # the best place fails

    fluid = fluid_of(failing)
    assert np.all(np.abs(fluid[:, 0] - 0.3) >= 0.15)


@pytest.mark.parametrize("answer", ["failed", "nothing to tell"])
def test_a_stage_without_any_result_leaves_its_coordinates(answer):
    def nothing(candidate):
        if answer == "failed":
            return evaluation(candidate, failed=True)
        return replace(evaluation(candidate), detail={"beat": np.nan, "arm": np.nan})

    fluid = fluid_of(nothing)
    expected = np.broadcast_to(first_point(D, 0)[:4], (28, 4))
    np.testing.assert_array_equal(fluid[:, :4], expected)


@pytest.mark.parametrize("budget", [1, 2, 3, 5])
def test_small_budgets_leave_stages_out_and_the_last_goes_on(budget):
    told = driven(budget + 20, budget=budget)
    assert sum(one.candidate.note.get("stage") == "fluid" for one in told) >= 20
    assert len(np.unique(points(told), axis=0)) == budget + 20


def test_stages_find_a_separable_optimum_and_a_search_that_begins_elsewhere_is_refused():
    told = driven(400, budget=400)
    best = min(by_stage(told)["fluid"], key=lambda one: one.loss).candidate.point
    np.testing.assert_allclose(best[:4], BEST[:4], atol=0.01)
    np.testing.assert_allclose(best[4:6], BEST[4:6], atol=0.1)
    said = refusal(OptimizerError, driven, search=lambda size, rng, first: random_search(size, rng, 1 - first))
    assert says(said, "stage 'fluid'", "must begin at the point that it is given")


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"budget": 0}, "budget is 0"), ({"stages": ()}, "no stages"), ({"held": {-1: 0.5}}, "coordinate -1"),
        ({"stages": (Stage("a", (1, 1), 1.0),)}, "'a' has coordinates (1, 1)"),
        ({"held": {3: 0.5}}, "coordinate 3, which is held"),
        ({"stages": (Stage("a", (1,), np.nan),)}, "share of nan"), ({"held": {6: 1.5}}, "unit cube"),
        ({"stages": (Stage("a", (8,), 1.0),)}, "coordinate 8"),
    ],
)  # fmt: skip
def test_settings_out_of_range_are_refused(changes, part):
    assert part in refusal(OptimizerError, staged, **changes)


def scan(count, best, planned=None, first=None, failed=lambda x: False):
    def answer(i, candidate):
        place = float(candidate.point[0])
        return Evaluation(candidate, abs(place - best), failed(place))

    return points(answered(GridScan(planned or count, first), count, answer))[:, 0].tolist()


@given(st.floats(0, 1), st.integers(1, 60))
def test_a_scan_stays_within_reach_of_the_best_place_and_never_repeats(best, count):
    places = scan(count, best)
    assert len(set(places)) == count
    coarse = max(int(np.ceil(0.6 * count)), count - 8)
    assert min(abs(place - best) for place in places) <= 0.5 / coarse + 1e-9


def test_a_scan_refines_beside_places_that_did_not_fail():
    places = scan(13, 0.5, failed=lambda x: abs(x - 0.5) < 0.2)
    assert places[8:10] == [0.125, 0.25]  # beside 0.1875, the best on the grid that didn't fail
    assert len(set(places)) == 13

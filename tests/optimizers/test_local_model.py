"""The local model on residuals that are known."""

from __future__ import annotations

import numpy as np
import pytest

from swim2real.optimizers import Candidate, Evaluation
from swim2real.optimizers.contract import cube_point
from swim2real.optimizers.local_model import LocalModel
from swimbase.errors import OptimizerError

LOWEST = np.array([0.3, 0.6, 0.5, 0.4])
SLOPES = np.random.default_rng(1).standard_normal((4, 60)) * 0.02


def evaluate(point, bend=0.0, turning=None):
    """A residual that is linear but for its bend; a trial turns where the margin, which falls with x0, is below 0."""
    away = np.asarray(point) - LOWEST
    residual = 0.001 + away @ SLOPES + bend * np.square(away).sum() * SLOPES[0]
    margin = np.array([0.1]) if turning is None else np.array([turning - point[0]])
    length = float(np.linalg.norm(residual))
    stage = (residual, np.full_like(residual, length**-0.5))  # whose squares add up to the length
    loss = length + (0.5 if margin[0] < 0 else 0.0)
    return Evaluation(Candidate(cube_point(point)), loss, stages=(stage,) * 4, margins=margin)


def around(center, count, rng, size=0.05, **how):
    points = np.clip(np.asarray(center) + size * rng.standard_normal((count, 4)), 0, 1)
    return [evaluate(point, **how) for point in points]


def test_a_linear_residual_is_predicted_and_solved_exactly():
    evaluations = around([0.5, 0.5, 0.5, 0.5], 8, np.random.default_rng(0))
    model = LocalModel(evaluations)
    expected = model.predict(LOWEST)
    assert expected.known > 0.97
    assert np.allclose(model.known, 1.0, atol=0.05)
    solved = model.solve(0.5)
    assert evaluate(solved).loss <= evaluate(LOWEST).loss
    assert model.predict(solved).loss < model.base.loss


def distances(point):
    """A residual of 30 distances in the plane, whose mean is the loss."""
    residual = 0.001 + (np.asarray(point) - LOWEST) @ SLOPES
    lengths = np.linalg.norm(residual.reshape(-1, 2), axis=1)
    stage = (residual / 30**0.5, np.repeat(1 / np.sqrt(lengths), 2))
    return Evaluation(
        Candidate(cube_point(point)), float(lengths.mean()), stages=(stage,) * 4, widths=np.full(30, 2)
    )  # fmt: skip


def test_a_loss_is_the_mean_of_the_distances_that_are_expected():
    """Far from where it is weighted the root of weighted squares is more than a mean of distances."""
    rng = np.random.default_rng(0)
    tried = [distances(np.clip([0.5] * 4 + 0.1 * rng.standard_normal(4), 0, 1)) for _ in range(12)]
    model = LocalModel(tried)
    for point in (LOWEST + 0.1, LOWEST, np.array([0.8, 0.2, 0.6, 0.6])):
        expected, made = model.predict(point), distances(point)
        assert expected.loss == pytest.approx(made.loss, rel=0.05)
        (residual, _), (here, weights) = made.stages[-1], model.base.stages[-1]
        squares = (np.square(one * weights).sum() for one in (residual, here))
        assert model.base.loss * np.sqrt(next(squares) / next(squares)) > 1.02 * made.loss
    slopes, stds = model.loss_slopes
    here = model.base.candidate.point
    sides = [0.005 * side for side in np.eye(4)]
    made = [(distances(here + side).loss - distances(here - side).loss) / 0.01 for side in sides]
    assert slopes == pytest.approx(made, abs=float(4 * stds.max() + 1e-3))


def test_what_nobody_tried_is_unknown_and_left_alone():
    rng = np.random.default_rng(0)
    evaluations = [evaluate([*(0.5 + 0.05 * rng.standard_normal(3)), 0.5]) for _ in range(8)]
    model = LocalModel(evaluations)
    assert model.known[3] == pytest.approx(0.0, abs=1e-3)
    assert model.solve(0.3)[3] == pytest.approx(0.5, abs=1e-6)
    here = model.base.candidate.point
    tried = model.predict(here + np.array([0, 0, 0, 0.2]))
    assert tried.known < 0.1
    assert tried.std > 10 * model.predict(here + np.array([0.01, 0, 0, 0])).std


def test_a_step_keeps_to_its_names_and_its_radius():
    model = LocalModel(around([0.5, 0.5, 0.5, 0.5], 8, np.random.default_rng(0)))
    here = model.base.candidate.point
    step = model.solve(0.02, np.array([True, False, True, False])) - here
    assert np.all(step[[1, 3]] == 0)
    assert np.abs(step).max() <= 0.02 + 1e-6
    assert np.abs(step).max() > 0.01


def test_a_step_keeps_the_margin_of_the_first_beats():
    center = LOWEST - np.array([0.2, 0, 0, 0])
    evaluations = around(center, 10, np.random.default_rng(0), turning=0.25)
    model = LocalModel(evaluations)
    free, solved = LocalModel(around(center, 10, np.random.default_rng(0))).solve(0.5), model.solve(0.5)
    assert evaluate(free, turning=0.25).loss > 0.5  # without the margin it goes over the edge
    assert evaluate(solved, turning=0.25).loss < model.base.loss
    assert evaluate(solved, turning=0.25).margins[0] > 0.3 * model.base.margins[0]


def test_the_uncertainty_covers_what_bends():
    rng = np.random.default_rng(2)
    evaluations = around([0.5, 0.5, 0.5, 0.5], 14, rng, size=0.08, bend=1.5)
    model = LocalModel(evaluations)
    tried = [model.base.candidate.point + 0.06 * rng.standard_normal(4) for _ in range(60)]
    within = [
        abs(evaluate(point, bend=1.5).loss - model.predict(point).loss) <= 2 * model.predict(point).std
        for point in tried
    ]
    assert np.mean(within) > 0.7


def test_a_step_goes_half_the_way_at_most_toward_what_turned_around():
    evaluations = around([0.2, 0.5, 0.5, 0.5], 10, np.random.default_rng(0))
    base = LocalModel(evaluations).base
    free = LocalModel(evaluations).solve(0.3) - base.candidate.point
    beyond = evaluate(base.candidate.point + 0.5 * free)
    turned = Evaluation(beyond.candidate, beyond.loss + 0.5, stages=beyond.stages, margins=beyond.margins)
    model = LocalModel([*evaluations, turned])
    step, toward = model.solve(0.3) - base.candidate.point, 0.5 * free
    assert step @ toward <= 0.5 * toward @ toward + 1e-6
    assert not model.safe(turned.candidate.point)
    assert model.safe(base.candidate.point)


def test_a_lucky_point_counts_as_rough():
    """All around it is worse by the same: what is expected next to it is nearer to what the others have."""
    rng = np.random.default_rng(0)
    flat = [evaluate(point) for point in 0.5 + 0.01 * rng.standard_normal((12, 4))]
    lucky = min(flat, key=lambda one: one.loss)
    residual, weights = lucky.stages[0]
    stage = (0.5 * residual, weights)
    lucky = Evaluation(lucky.candidate, 0.5 * lucky.loss, stages=(stage,) * 4, margins=lucky.margins)
    others = [one for one in flat if one.candidate is not lucky.candidate]
    expected = LocalModel([*others, lucky]).predict(lucky.candidate.point + 0.002)
    assert expected.loss > 1.3 * lucky.loss


def test_failed_and_turned_evaluations_are_left_out():
    evaluations = around([0.2, 0.5, 0.5, 0.5], 8, np.random.default_rng(0), turning=0.4)
    failed = Evaluation(Candidate(cube_point([0.9, 0.9, 0.9, 0.9])), 1.0, failed=True)
    turned = evaluate([0.6, 0.5, 0.5, 0.5], turning=0.4)
    with_both, without = LocalModel([*evaluations, failed, turned]), LocalModel(evaluations)
    point = np.array([0.22, 0.55, 0.5, 0.5])
    assert with_both.predict(point).loss == without.predict(point).loss


def test_a_model_needs_four_evaluations():
    with pytest.raises(OptimizerError, match=r"needs 4 evaluations .* has 3"):
        LocalModel(around(LOWEST, 3, np.random.default_rng(0)))


def test_slopes_that_physics_expects_tell_parameters_that_matter_from_others():
    """Five evaluations of four parameters, two of which hardly matter: knowing which makes predictions better."""
    lasting = np.array([1.0, 1.0, 0.05, 0.05])[:, None] * SLOPES

    def made(point):
        residual = 0.001 + (np.asarray(point) - LOWEST) @ lasting
        length = float(np.linalg.norm(residual))
        return Evaluation(
            Candidate(cube_point(point)), length, stages=((residual, np.full_like(residual, length**-0.5)),) * 4
        )

    misses = np.zeros(2)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        tried = [made(0.5 + 0.1 * rng.standard_normal(4)) for _ in range(5)]
        point = 0.5 + 0.1 * rng.standard_normal(4)
        models = LocalModel(tried), LocalModel(tried, lambda at: lasting[:, :3])
        misses += [abs(model.predict(point).loss - made(point).loss) for model in models]
    assert misses[1] < 0.8 * misses[0]


def test_what_is_weighed_more_comes_out_lower():
    def made(point):
        residual = np.concatenate([np.full(10, point[0] - 0.7), np.full(10, point[0] - 0.3)]) * 0.01 + 1e-3
        stage = (residual, np.ones(20))
        parts = (("slow", "shape", 10), ("fast", "shape", 10))
        return Evaluation(
            Candidate(cube_point(point)), float(np.abs(residual).mean()), stages=(stage,) * 4, parts=parts
        )

    tried = [made(np.array([x, 0.5])) for x in (0.45, 0.5, 0.52, 0.56, 0.6)]
    slow, fast = (LocalModel(tried, weigh={name: 10.0}).solve(0.3)[0] for name in ("slow", "fast"))
    assert slow > 0.55
    assert fast < 0.45
    sizes = LocalModel(tried).sizes(np.array([0.55, 0.5]))
    assert sizes.shape == (2,)

"""Fits the response of `swim2real.robots.fish.response` to the swims that `measure.py` simulated, and tests it.

    python experiments/fish_response/fit.py runs/response src/swim2real/robots/fish/response.npz
    python experiments/fish_response/fit.py runs/response --test 500
    python experiments/fish_response/fit.py runs/extended src/swim2real/robots/fish/response-extended.npz --corrects

With `--test` that many sets are held out, and what is predicted of them is compared with what they do, for training
sets of growing number. With `--corrects` the sets are those of the extended fish, and only what the response of the
plain one gets wrong there is learned. Kernels are chosen by their marginal likelihood on at most a thousand sets.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from measure import FREQUENCIES, LEAST_STRIDE, SAMPLES, way_in_a_beat

from markertrack import frames
from swim2real.advisor.physics.model import direction
from swim2real.robots.fish import FISH
from swim2real.robots.fish.response import fish_response, read_correction, read_response

SUBSET, ROUNDS, RATE = 1000, 150, 0.08  # sets, rounds and rate of the search for a kernel
LEAST_NOISE, MOST_COORDINATES, KEPT_VARIANCE = 0.02, 16, 0.998
LOGS = np.log(FREQUENCIES) - np.log(FREQUENCIES).mean()


def swims_of(folder):
    blocks = [np.load(path) for path in sorted(Path(folder).glob("block_????.npz"))]
    points, cycles = (np.concatenate([block[key] for block in blocks]) for key in ("points", "cycles"))
    good = np.isfinite(cycles).all(axis=(1, 2, 3, 4))  # a diverged swim tells nothing
    return points[good], cycles[good].astype(float)


def fundamental(values):
    """Complex amplitude at the beat, over the samples of one cycle. Shape (..., SAMPLES + 1) to (...)."""
    return 2 * (values[..., :-1] * np.exp(-2j * np.pi * np.arange(SAMPLES) / SAMPLES)).mean(axis=-1)


def motions(cycles):
    """Fundamentals of the markers in the body frame, of sway and of yaw, turned to the last marker's phase.

    Shape (N, F, S, M, 2) to (N, F, M + 2), complex.
    """
    shape = cycles.shape
    body = np.array([frames.to_body(cycle) for cycle in cycles.reshape(-1, *shape[2:])]).reshape(shape)
    markers = fundamental(np.moveaxis(body[..., 1], 2, 3))
    axes = cycles[..., 1, :] - cycles[..., 0, :]
    heading = np.unwrap(np.arctan2(axes[..., 1], axes[..., 0]), axis=2)
    share = np.arange(SAMPLES + 1) / SAMPLES
    course = (heading[:, :, -1:] - heading[:, :, :1]) * share
    steps = np.diff(frames.heads(cycles.reshape(-1, *shape[3:])).reshape(*shape[:3], 2), axis=2) @ np.array([1, 1j])
    way = np.cumsum(steps * np.exp(-0.5j * (course[:, :, 1:] + course[:, :, :-1])), axis=2)
    way = np.concatenate([np.zeros_like(way[:, :, :1]), way], axis=2)
    mean = (heading - course)[:, :, :-1].mean(axis=2)
    along = way[:, :, -1] * np.exp(-1j * mean)  # from head to tail is the frame's x
    axis = np.where(along.real >= 0, 1, -1) * way[:, :, -1] / np.maximum(np.abs(way[:, :, -1]), 1e-9)
    left = (way * np.conj(axis)[:, :, None]).imag
    head = np.stack([fundamental(left), fundamental(heading - course)], axis=2)
    every = np.concatenate([markers, head], axis=2)
    return every * np.exp(-1j * np.angle(markers[:, :, -1:]))


def parts_of(motion):
    return np.concatenate([motion.real, motion.imag], axis=2)


def level_and_growth(stride):
    """Mean of the logarithms of strides [m], and their slope over those of the frequencies. (N, F) to (N,), (N,)."""
    logs = np.log(stride)
    return logs.mean(axis=1), (logs * LOGS).sum(axis=1) / (LOGS**2).sum()


def outputs(points, cycles, plain=None):
    """What each process learns: rows of the sets, and outputs there; less what a plain response expects."""
    stride, motion = way_in_a_beat(cycles), parts_of(motions(cycles))
    forward = (stride > LEAST_STRIDE).all(axis=1)
    level, growth = level_and_growth(stride[forward])
    table = motion[forward].reshape(forward.sum(), -1)
    average = table.mean(axis=0) if plain is None else plain.average.ravel()
    # a radian of yaw moves the tail by a fraction of a meter
    weight = np.tile([1.0] * (motion.shape[2] // 2 - 1) + [0.3], 2 * len(FREQUENCIES))
    if plain is None:
        _, sizes, directions = np.linalg.svd((table - average) * weight, full_matrices=False)
        kept = int(np.searchsorted(np.cumsum(sizes**2) / (sizes**2).sum(), KEPT_VARIANCE)) + 1
        basis = directions[: min(kept, MOST_COORDINATES)]
    else:
        basis = plain.basis.reshape(len(plain.basis), -1) * weight
    rows = np.flatnonzero(forward)
    learned = {
        "direction": (np.arange(len(points)), direction(stride * FREQUENCIES, FREQUENCIES)),
        "stride": (rows, level[:, None]),
        "growth": (rows, growth[:, None]),
        "motion": (rows, (table - average) * weight @ basis.T),
    }
    if plain is not None:
        learned = {
            name: (kept, values - getattr(plain, name)(points[kept, : len(FISH.space)]))
            for name, (kept, values) in learned.items()
        }
    shape = (len(basis), len(FREQUENCIES), motion.shape[2])
    return learned, (basis / weight).reshape(shape), average.reshape(shape[1:])


def covariances(a, b, lengths, bend, slope):
    """Prior covariance between points on a scale from -1 to 1. Shapes (N, d), (K, d) to (N, K)."""
    near, far = a / lengths, b / lengths
    squared = np.maximum((near**2).sum(axis=1)[:, None] + (far**2).sum(axis=1) - 2 * near @ far.T, 0.0)
    return bend * np.exp(-0.5 * squared) + slope / a.shape[1] * (a @ b.T)


def kernel_of(points, values):
    """Length scales, variances of the two parts and of the noise that explain the outputs best, all outputs alike."""
    x, y = torch.tensor(2 * points - 1), torch.tensor(values)
    p = torch.cat([torch.ones(x.shape[1]), torch.tensor([0.0, -2.0, -4.0])]).double().requires_grad_()
    search = torch.optim.Adam([p], lr=RATE)
    for _ in range(ROUNDS):
        search.zero_grad()
        near = x / p[:-3].exp()
        squared = (near.square().sum(1)[:, None] + near.square().sum(1) - 2 * near @ near.T).clamp_min(0)
        covariance = p[-3].exp() * torch.exp(-0.5 * squared) + p[-2].exp() / x.shape[1] * (x @ x.T)
        factor = torch.linalg.cholesky(covariance + (p[-1].exp() + LEAST_NOISE**2) * torch.eye(len(x)))
        solved = torch.cholesky_solve(y, factor)
        loss = 0.5 * (y * solved).sum() + y.shape[1] * factor.diagonal().log().sum()
        (loss + 0.02 * (p[:-3] - 1).square().sum()).backward()
        search.step()
    found = p.detach().exp().numpy()
    return found[:-3], float(found[-3]), float(found[-2]), float(found[-1]) + LEAST_NOISE**2


def fitted(points, cycles, plain=None):
    """The content of the response's file, or of its correction's."""
    learned, basis, average = outputs(points, cycles, plain)
    rest, content = FISH.rest_markers, {"points": points.astype(np.float32)}
    if plain is None:
        content |= {
            "basis": basis.astype(np.float32), "average": average.astype(np.float32), "frequencies": FREQUENCIES,
            "behind": rest[:, 0] - rest[:2, 0].mean(),
        }  # fmt: skip
    for name, (rows, values) in learned.items():
        mean, scale = values.mean(axis=0), values.std(axis=0)
        scaled, here = (values - mean) / scale, 2 * points[rows] - 1
        chosen = np.random.default_rng(0).permutation(len(rows))[:SUBSET]
        lengths, bend, slope, noise = kernel_of(points[rows][chosen], scaled[chosen])
        covariance = covariances(here, here, lengths, bend, slope) + noise * np.eye(len(rows))
        content[f"{name}_rows"] = rows.astype(np.int32)
        content[f"{name}_weights"] = np.linalg.solve(covariance, scaled).astype(np.float32)
        content[f"{name}_kernel"] = np.array([*lengths, bend, slope])
        content[f"{name}_scales"] = np.array([mean, scale])
    return content


def tested(points, cycles, held_out, plain):
    order = np.random.default_rng(1).permutation(len(points))
    points, cycles = points[order], cycles[order]
    unseen, cycles_unseen = points[:held_out], cycles[:held_out]
    stride, motion = way_in_a_beat(cycles_unseen), motions(cycles_unseen)
    forward = (stride > LEAST_STRIDE).all(axis=1)
    level, growth = level_and_growth(stride[forward])
    truth = {
        "log stride": level, "slope of log stride": growth,
        "log yaw": np.log(np.abs(motion[forward, :, -1])).mean(axis=1),
        "log sway": np.log(np.abs(motion[forward, :, -2])).mean(axis=1),
    }  # fmt: skip
    available = len(points) - held_out
    for count in (*(n for n in (300, 1000) if n < available), available):
        content = fitted(points[held_out:][:count], cycles[held_out:][:count], plain)
        response = read_response(content) if plain is None else read_correction(content, plain)
        _, score = response.speeds(unseen, FREQUENCIES)
        right = np.sign(score) == np.sign(stride)
        sure = np.abs(score) > 0.5
        print(
            f"{count} sets: direction right {right.mean():.3f}, {right[sure].mean():.3f} where sure ({sure.mean():.2f})"
        )
        parts = response.average + np.einsum("nc,cfk->nfk", response.motion(unseen[forward]), response.basis)
        half = parts.shape[2] // 2
        predicted = parts[..., :half] + 1j * parts[..., half:]
        found = {
            "log stride": response.stride(unseen[forward])[:, 0],
            "slope of log stride": response.growth(unseen[forward])[:, 0],
            "log yaw": np.log(np.abs(predicted[..., -1])).mean(axis=1),
            "log sway": np.log(np.abs(predicted[..., -2])).mean(axis=1),
        }
        for name, real in truth.items():
            error = found[name] - real
            print(
                f"    {name:20s} correlation {np.corrcoef(found[name], real)[0, 1]:.3f}, R² "
                f"{1 - np.mean(error**2) / real.var():.3f}, median error {np.median(np.abs(error)):.3f}"
            )
        tail = np.abs(predicted[..., :9] - motion[forward, :, :9])[..., -1]
        print(f"    last marker's beat off by {1e3 * np.median(tail):.1f} mm (median)", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("target", type=Path, nargs="?")
    parser.add_argument("--test", type=int, default=0, help="sets that are held out")
    parser.add_argument("--corrects", action="store_true", help="correct the plain fish's response")
    a = parser.parse_args()
    plain = fish_response() if a.corrects else None
    torch.set_num_threads(2)
    torch.set_default_dtype(torch.float64)
    points, cycles = swims_of(a.folder)
    if a.test:
        tested(points, cycles, a.test, plain)
    if a.target:
        np.savez_compressed(a.target, **fitted(points, cycles, plain))
        print(f"{len(points)} sets, {a.target.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()

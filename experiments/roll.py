"""Does the fish roll? What six tracks from above say of it, without a simulator.

    python experiments/roll.py ../shared/data/fishsim-markers

Prints each trial's yaw and sway of the head, and the shift of the low markers in the body frame, as amplitudes with
standard errors and phases relative to the tail tip; then hypotheses of how the sway follows from the yaw, as complex
numbers, fitted to all trials and with one left out at a time. In words: if the hull floats and rolls with a resonance,
the head's markers, which stand above the axis, sway by the roll as well, and low markers shift against them.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from markertrack import frames
from swim2real.calibration.protocols import examine_swims
from swim2real.objective.head import head_motion
from swim2real.robots import load_robot
from swim2real.trials import load_reference

TIP, LOW, SEEN = 8, (3, 4, 5), 0.6  # markers; share of frames


def fundamental(times, values, frequency):
    """A signal's complex fundamental, cos for real, and the standard error of its amplitude."""
    seen = np.isfinite(values)
    turn = np.exp(2j * np.pi * frequency * times[seen])
    columns = [np.ones(seen.sum()), times[seen] - times[seen].mean(), turn.real, turn.imag, (turn**2).real,
               (turn**2).imag]  # fmt: skip
    basis = np.column_stack(columns)
    found, *_ = np.linalg.lstsq(basis, values[seen], rcond=None)
    rest = values[seen] - basis @ found
    return complex(found[2], -found[3]), float(np.sqrt(2 / len(rest)) * rest.std())


def measured(reference, robot):
    """Frequency, sway, yaw and each low marker's sideways fundamental of every trial, relative to the tail tip."""
    rows = []
    for swim in examine_swims(reference, robot):
        track, frequency = swim.trial.track, swim.beat.frequency
        times = track.times - track.times[0]
        body = frames.to_body(track.positions)
        tip = np.angle(fundamental(times, body[:, TIP, 1], frequency)[0])
        head = head_motion(times, track.positions, frequency)
        low = [body[:, m, 1] if np.isfinite(body[:, m, 1]).mean() > SEEN else 0 * times for m in LOW]
        signals = [fundamental(times, values, frequency) for values in (head.sway, head.yaw, *low)]
        rows.append((frequency, [(value * np.exp(-1j * tip), error) for value, error in signals]))
    return sorted(rows, key=lambda row: row[0])


def resonance(f, f0, zeta):
    """Amplitude of an oscillator that an acceleration drives, times the squared frequency."""
    return f**2 / (f0**2 - f**2 + 2j * zeta * f0 * f)


HYPOTHESES = {  # of sway over yaw [m/rad], with first guesses
    "a fixed pivot": (lambda f, p: p[0] + 0j * f, [0.1]),
    "forces that grow with f²": (lambda f, p: p[0] + p[1] * f**2 + 0j, [0.1, 0.0]),
    "linear damping": (lambda f, p: p[0] / (1 + p[1] * 1j / f) + p[2], [0.1, 0.1, 0.0]),
    "a tether, the tank as a spring": (lambda f, p: p[0] * resonance(f, p[1], p[2]), [0.1, 0.2, 0.3]),
    "roll": (lambda f, p: p[0] * (1 + p[1] * resonance(f, p[2], p[3])), [0.15, 0.8, 0.5, 0.4]),
}


def fitted(model, first, f, yaw, sway):
    """The constants that explain the sway best."""

    def rest(p):
        off = yaw * model(f, p) - sway
        return np.concatenate([off.real, off.imag])

    starts = [np.array(first) * factor for factor in (1.0, -1.0, 0.6, 1.5)]
    return min((least_squares(rest, start) for start in starts), key=lambda one: one.cost).x


def rms(off):
    return 1e3 * np.sqrt(np.mean(np.abs(off) ** 2))


def shown(value, error, factor):
    return f"{factor * abs(value):5.1f} ± {factor * error:3.1f} @{np.degrees(np.angle(value)) % 360:3.0f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reference", type=Path)
    rows = measured(load_reference(parser.parse_args().reference), load_robot("fish"))
    print(f"{'beat Hz':8s}{'yaw °':18s}{'sway mm':18s}M3 to M5, sideways in the body frame, mm")
    for f, ((sway, sway_std), (yaw, yaw_std), *low) in rows:
        cells = shown(yaw, yaw_std, np.degrees(1)), shown(sway, sway_std, 1e3)
        print(
            f"{f:<8.3f}{cells[0]:18s}{cells[1]:18s}"
            + "  ".join(shown(*one, 1e3) if one[0] else f"{'lost':17s}" for one in low)
        )
    f, sway, yaw = (np.array(x) for x in zip(*((f, row[0][0], row[1][0]) for f, row in rows), strict=True))
    print(f"\n{'hypothesis':32s}{'constants':>10s}{'rms mm':>8s}{'left out mm':>13s}   values")
    for name, (model, first) in HYPOTHESES.items():
        values = fitted(model, first, f, yaw, sway)
        left = []
        for k in range(len(f)):
            kept = np.arange(len(f)) != k
            left.append((yaw * model(f, fitted(model, first, f[kept], yaw[kept], sway[kept])) - sway)[k])
        off = yaw * model(f, values) - sway
        print(f"{name:32s}{len(first):10d}{rms(off):8.1f}{rms(np.array(left)):13.1f}   {np.round(values, 3)}")


if __name__ == "__main__":
    main()

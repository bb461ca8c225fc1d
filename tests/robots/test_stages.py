"""How the fish is fitted stage by stage."""

import numpy as np
import pytest

from swim2real.robots.fish.stages import beat_distance

WAVE = 0.05 * np.exp(1j * np.linspace(0, 2, 9))


def listed(wave):
    return {
        "amplitude": [None if np.isnan(z) else abs(z) for z in wave],
        "phase": [None if np.isnan(z) else float(np.angle(z)) for z in wave],
    }


def evidence_of(*pairs):
    """Evidence of trials with these simulated and real fundamentals."""
    beats = [{"beat_simulated": listed(simulated), "beat_real": listed(real)} for simulated, real in pairs]
    return {"trials": {f"swim{i}": trial for i, trial in enumerate(beats)}}


def test_amplitude_and_phase_along_the_body_make_the_distance():
    assert beat_distance(evidence_of((WAVE, WAVE), (0.5 * WAVE, 0.5 * WAVE))) == pytest.approx(0.0, abs=1e-12)
    assert beat_distance(evidence_of((WAVE * np.exp(1.3j), WAVE))) == pytest.approx(0.0, abs=1e-12)
    assert beat_distance(evidence_of((1.2 * WAVE, WAVE))) == pytest.approx(0.01)
    assert beat_distance(evidence_of((np.conj(WAVE), WAVE))) > 0.03  # the wave runs the other way
    assert beat_distance(evidence_of((WAVE, WAVE), (1.2 * WAVE, WAVE))) == pytest.approx(0.005)

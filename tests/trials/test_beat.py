import numpy as np
import pytest

from markertrack.quality import check_track
from markertrack.track import MarkerTrack
from swim2real.robots.fish import FISH
from swim2real.trials.beat import identify_beat
from swimbase.errors import TrialError
from swimmers import REST, Swimmer

TIMES = np.arange(300) / 60


def beat_of(track, name=""):
    return identify_beat(track, FISH.swims.tail_markers, check_track(track, REST), name)


@pytest.mark.slow
@pytest.mark.parametrize("swimmer", [Swimmer(0.4, 0.03), Swimmer(1.0, 0.1, -2.0), Swimmer(1.7, 0.2, 3.0)])
def test_frequency_phase_and_speed_are_recovered_within_their_standard_errors(swimmer):
    rows = []
    for seed in range(6):
        beat = beat_of(swimmer.track(noise=1e-3, seed=seed))
        clean = beat_of(swimmer.track(noise=0.0, seed=seed))  # the head's sway shifts the phase in the body frame
        phase = np.angle(np.exp(1j * (beat.phase - clean.phase)))
        frequency, speed = beat.frequency - swimmer.frequency, beat.start_speed - swimmer.speed
        rows.append([frequency / beat.frequency_std, phase / beat.phase_std, speed / beat.start_speed_std])
        assert beat.frequency == pytest.approx(swimmer.frequency, rel=0.01)
        assert beat.start_speed == pytest.approx(swimmer.speed, abs=3e-3)
        assert beat.explained > 0.9
    errors = np.abs(rows)
    assert np.mean(errors < 3, axis=0).min() > 0.9
    assert errors.max() < 5
    assert np.sqrt(np.mean(errors**2, axis=0)).min() > 0.2  # and the standard errors aren't just large


def test_amplitude_and_phase_are_those_of_the_last_marker():
    track = Swimmer(frequency=1.0, phase=1.2, duration=5.0).track(noise=0.0)
    beat = beat_of(track)
    whole = slice(0, 300)  # five cycles, for a plain Fourier sum
    wave = 2 * np.mean(track.body[whole, 8, 1] * np.exp(-2j * np.pi * track.times[whole]))
    assert beat.amplitude == pytest.approx(abs(wave), rel=1e-3)
    assert beat.phase == pytest.approx(np.angle(wave), abs=1e-3)
    quarter_later = MarkerTrack(track.times[:-15], track.positions[15:])
    assert beat_of(quarter_later).phase - beat.phase == pytest.approx(np.pi / 2, abs=0.01)
    slow = MarkerTrack(7.0 + 2 * track.times, track.positions)
    assert beat_of(slow).frequency == pytest.approx(beat.frequency / 2, rel=1e-4)


def test_harmonics_and_lost_frames_dont_mislead():
    swimmer = Swimmer(0.9)
    positions = swimmer.body(TIMES)
    share = (REST[:, 0] / REST[-1, 0]) ** 2
    positions[..., 1] += 0.6 * swimmer.amplitude * share * np.cos(4 * np.pi * 0.9 * TIMES + 1.0)[:, None]
    track = MarkerTrack(TIMES, positions - [0.1, 0.0] * TIMES[:, None, None])
    assert beat_of(track).frequency == pytest.approx(0.9, rel=1e-3)
    track = Swimmer().track(seed=4)
    positions = track.positions.copy()
    positions[80:140, 8] = positions[80, 8]
    positions[:, 6] = np.nan
    clean, damaged = beat_of(track), beat_of(MarkerTrack(track.times, positions))
    assert damaged.frequency == pytest.approx(clean.frequency, abs=3e-3)
    assert np.isfinite([damaged.frequency_std, damaged.phase_std, damaged.start_speed_std]).all()


def test_a_tail_first_swimmer_isnt_started_backward():
    assert beat_of(Swimmer(speed=-0.05).track()).actuation.start_speed == 0.0
    actuation = beat_of(Swimmer().track()).actuation
    assert (actuation.phase, actuation.frequency) == (0.0, pytest.approx(1.0, abs=5e-3))
    assert actuation.start_speed == pytest.approx(0.1, abs=3e-3)


def wandering():
    times = np.arange(600) / 60
    angle = np.cumsum(np.convolve(np.random.default_rng(1).normal(0, 0.2, 600), np.ones(15) / 4, mode="same"))
    positions = Swimmer().body(times)
    positions[..., 1] = 0.06 * (REST[:, 0] / 0.551) ** 2 * np.cos(angle)[:, None]
    return MarkerTrack(times, positions)


def tailless():
    track = Swimmer().track()
    return MarkerTrack(track.times, np.where(np.arange(9)[:, None] < 6, track.positions, np.nan))


@pytest.mark.parametrize(("track", "parts"), [
    (MarkerTrack(TIMES, np.repeat(REST[None], 300, axis=0)), ("4.98 s of tail motion are too little",)),
    (Swimmer(amplitude=0.0).track(noise=1e-3), ("no regular beat: the best sine, at ",)),
    (MarkerTrack(TIMES, REST + 0.003 * np.random.default_rng(0).normal(size=(300, 9, 2))),
     ("explains", "at least 50 % are needed")),
    (wandering(), ("no regular beat",)),
    (Swimmer(duration=0.1, frequency=0.5).track(), ()),
    (Swimmer(frequency=0.4, duration=0.6).track(), ("no whole beat: in 0.60 s", "more slowly than")),
    (Swimmer(frequency=0.4, duration=2.0).track(), ("no whole beat: in 2.00 s",)),
    (tailless(), ("the tail markers are lost for nearly the whole trial",)),
])  # fmt: skip
def test_what_has_no_beat_is_refused(track, parts):
    with pytest.raises(TrialError) as caught:
        beat_of(track, "swim")
    assert str(caught.value).startswith("trial 'swim': ")
    for part in parts:
        assert part in str(caught.value)


def test_the_published_tail_beats_at_three_quarters_of_the_command(tracks):
    for trial in tracks:
        beat = beat_of(trial.track, trial.name)
        assert beat.frequency == pytest.approx(0.75 * trial.nominal_frequency, rel=0.01), trial.name
        assert beat.frequency_std < 0.002
        assert beat.start_speed == pytest.approx(trial.track.speed, rel=0.1), trial.name
        assert beat.amplitude > 0.05

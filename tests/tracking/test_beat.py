import numpy as np
import pytest

from swim2real.errors import TrialError
from swim2real.robots.fish import FISH
from swim2real.tracking import check_track, identify_beat
from swim2real.trials import MarkerTrack
from swimmers import REST, Swimmer

SEEDS = range(6)


def beat_of(track, name=""):
    return identify_beat(track, FISH.swims.tail_markers, check_track(track, REST), name)


def refusal(track, name="swim") -> str:
    with pytest.raises(TrialError) as caught:
        beat_of(track, name)
    return str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("swimmer", [Swimmer(0.4, 0.03), Swimmer(1.0, 0.1, -2.0), Swimmer(1.7, 0.2, 3.0)])
def test_frequency_phase_and_speed_are_recovered_within_their_standard_errors(swimmer):
    rows = []
    for seed in SEEDS:
        beat = beat_of(swimmer.track(noise=1e-3, seed=seed))
        clean = beat_of(swimmer.track(noise=0.0, seed=seed))  # the head's sway shifts the phase in the body frame
        phase = np.angle(np.exp(1j * (beat.phase - clean.phase)))
        rows.append(
            [
                (beat.frequency - swimmer.frequency) / beat.frequency_std,
                phase / beat.phase_std,
                (beat.start_speed - swimmer.speed) / beat.start_speed_std,
            ]
        )
        assert beat.frequency == pytest.approx(swimmer.frequency, rel=0.01)
        assert beat.start_speed == pytest.approx(swimmer.speed, abs=3e-3)
        assert beat.explained > 0.9
    errors = np.abs(rows)
    assert np.mean(errors < 3, axis=0).min() > 0.9
    assert errors.max() < 5
    assert np.sqrt(np.mean(errors**2, axis=0)).min() > 0.2  # and the standard errors aren't just large


def test_more_noise_gives_larger_standard_errors():
    quiet, loud = (beat_of(Swimmer().track(noise=noise, seed=3)) for noise in (5e-4, 2e-3))
    assert 2 < loud.frequency_std / quiet.frequency_std < 8
    assert 2 < loud.phase_std / quiet.phase_std < 8


def test_amplitude_and_phase_are_those_of_the_last_marker():
    track = Swimmer(frequency=1.0, phase=1.2, duration=5.0).track(noise=0.0)
    beat = beat_of(track)
    whole = slice(0, 300)  # five cycles, for a plain Fourier sum
    wave = 2 * np.mean(track.body[whole, 8, 1] * np.exp(-2j * np.pi * track.times[whole]))
    assert beat.amplitude == pytest.approx(abs(wave), rel=1e-3)
    assert beat.phase == pytest.approx(np.angle(wave), abs=1e-3)
    quarter_later = MarkerTrack(track.times[:-15], track.positions[15:])
    assert beat_of(quarter_later).phase - beat.phase == pytest.approx(np.pi / 2, abs=0.01)


def test_the_time_base_sets_the_frequency():
    track = Swimmer().track()
    slow = MarkerTrack(7.0 + 2 * track.times, track.positions)
    assert beat_of(slow).frequency == pytest.approx(beat_of(track).frequency / 2, rel=1e-4)


def test_harmonics_dont_mislead():
    swimmer = Swimmer(0.9)
    times = np.arange(301) / 60
    positions = swimmer.body(times)
    share = (REST[:, 0] / REST[-1, 0]) ** 2
    positions[..., 1] += 0.6 * swimmer.amplitude * share * np.cos(4 * np.pi * 0.9 * times + 1.0)[:, None]
    assert beat_of(MarkerTrack(times, positions - [0.1, 0.0] * times[:, None, None])).frequency == pytest.approx(
        0.9, rel=1e-3
    )


def test_lost_frames_are_left_out():
    track = Swimmer().track(seed=4)
    positions = track.positions.copy()
    positions[80:140, 8] = positions[80, 8]
    positions[:, 6] = np.nan
    clean, damaged = beat_of(track), beat_of(MarkerTrack(track.times, positions))
    assert damaged.frequency == pytest.approx(clean.frequency, abs=3e-3)
    assert np.isfinite([damaged.frequency_std, damaged.phase_std, damaged.start_speed_std]).all()


def test_a_tail_first_swimmer_isnt_started_backward():
    track = Swimmer(speed=-0.05).track()
    assert beat_of(track).actuation.start_speed == 0.0
    actuation = beat_of(Swimmer().track()).actuation
    assert (actuation.phase, actuation.frequency) == (0.0, pytest.approx(1.0, abs=5e-3))
    assert actuation.start_speed == pytest.approx(0.1, abs=3e-3)


def test_a_swim_without_motion_has_no_beat():
    times = np.arange(300) / 60
    message = "trial 'swim': 4.98 s of tail motion are too little to identify a beat"
    assert refusal(MarkerTrack(times, np.repeat(REST[None], 300, axis=0))) == message


def test_a_drifting_fish_that_doesnt_beat_is_refused():
    track = Swimmer(amplitude=0.0).track(noise=1e-3)
    assert refusal(track).startswith("trial 'swim': no regular beat: the best sine, at ")


def test_noise_is_no_beat():
    rng = np.random.default_rng(0)
    positions = REST + 0.003 * rng.normal(size=(300, 9, 2))
    message = refusal(MarkerTrack(np.arange(300) / 60, positions))
    assert "explains" in message
    assert "at least 50 % are needed. Is the fish swimming?" in message


def test_an_irregular_beat_is_refused():
    rng = np.random.default_rng(1)
    times = np.arange(600) / 60
    angle = np.cumsum(np.convolve(rng.normal(0, 0.2, 600), np.ones(15) / 4, mode="same"))  # wanders
    positions = Swimmer().body(times)
    positions[..., 1] = 0.06 * (REST[:, 0] / 0.551) ** 2 * np.cos(angle)[:, None]
    assert "no regular beat" in refusal(MarkerTrack(times, positions))


@pytest.mark.parametrize("duration", [0.1, 0.2])
def test_a_short_trial_is_refused(duration):
    assert "trial 'swim': " in refusal(Swimmer(duration=duration, frequency=0.5).track())


@pytest.mark.parametrize("duration", [0.6, 1.25, 2.0])
def test_less_than_a_cycle_is_refused(duration):
    message = refusal(Swimmer(frequency=0.4, duration=duration).track())
    assert message.startswith(f"trial 'swim': no whole beat: in {duration:.2f} s the tail moves more slowly than the ")


def test_little_more_than_a_cycle_is_enough():
    assert beat_of(Swimmer(frequency=0.8, duration=1.6).track()).frequency == pytest.approx(0.8, abs=0.05)


def test_a_tail_that_is_lost_is_said():
    track = Swimmer().track()
    positions = track.positions.copy()
    positions[:, 6:] = np.nan
    message = "trial 'swim': the tail markers are lost for nearly the whole trial, so no beat can be identified"
    assert refusal(MarkerTrack(track.times, positions)) == message


# the published tracks, whichever are there

MEASURED = {"f0_50": 0.3775, "f1_00": 0.7495, "f1_25": 0.9402, "f1_50": 1.1276, "f1_75": 1.3124, "f2_00": 1.5005}


@pytest.mark.parametrize("name", MEASURED)
def test_published_beats_are_the_measured_ones(tracks, name):
    if name not in tracks.names:
        pytest.skip(f"{name} isn't among the published tracks that are there")
    beat = beat_of(tracks[name].track, name)
    assert beat.frequency == pytest.approx(MEASURED[name], abs=0.002)
    assert beat.frequency_std < 0.002


def test_the_published_tail_beats_at_three_quarters_of_the_command(tracks):
    for trial in tracks:
        beat = beat_of(trial.track, trial.name)
        assert beat.frequency == pytest.approx(0.75 * trial.nominal_frequency, rel=0.01), trial.name
        if trial.name in MEASURED and trial.name != "f0_50":
            assert beat.frequency == pytest.approx(0.75 * trial.nominal_frequency, rel=0.005), trial.name
        assert beat.start_speed == pytest.approx(trial.track.speed, rel=0.1), trial.name
        assert beat.amplitude > 0.05

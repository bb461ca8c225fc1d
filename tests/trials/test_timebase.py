"""The clocks of a trial's streams: described, followed through cuts, doubted where durations contradict each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markertrack.span import Span
from markertrack.track import MarkerTrack
from swim2real.trials import Signals, Trial
from swim2real.trials.timebase import Timebase, contradictions, described


def trial(film: float, table: float, rows: int = 200) -> Trial:
    """A trial whose film and commands last so long [s]."""
    times = np.linspace(0, film, 121)
    track = MarkerTrack(times, np.random.default_rng(0).normal(size=(121, 2, 2)))
    return Trial("pull", track, controls=Signals(np.linspace(0, table, rows), ("motor",), np.zeros((rows, 1))))


@given(st.floats(0.5, 60), st.floats(0.05, 20))
def test_durations_contradict_each_other_where_their_ratio_is_far_from_1(table, ratio):
    told = contradictions(trial(ratio * table, table))
    if 0.7 < ratio < 1.45:
        assert told == []
    elif ratio < 0.65 or ratio > 1.55:
        rate = 120 / table  # that makes both equal
        (said,) = told
        assert f"{ratio:.3g} times as long" in said
        assert float(said.rsplit(" ", 1)[1]) == pytest.approx(rate, rel=6e-3)


def test_what_is_not_on_record_is_said_by_stamps_and_commands_by_hand_contradict_nothing():
    assert contradictions(trial(10, 2, rows=4)) == []
    pull = trial(2, 4)
    assert described(pull) == (
        "track 60 Hz by its time stamps, from the first row, as nothing else is on record; "
        "controls 49.75 Hz by its time stamps, from the first row, as nothing else is on record"
    )
    known = Trial("pull", pull.track, timebases={"track": Timebase("first frame of a.mp4", 60, "container")})
    assert described(known) == "track 60 Hz by its container, from the first frame of a.mp4"
    cut = described(known.within(Span(0.5)))
    assert cut == "track 60 Hz by its container, from the first frame of a.mp4 plus 0.5 s"

"""Late commands and readings of recordings: found where they matter, and not looked for at length where they don't."""

from dataclasses import replace

import pytest

from recorded import PENDULUM, PENDULUM_HIDDEN, pendulum_reference, telling
from refused import says
from swim2real.checks import delays as checked
from swim2real.checks.motion import Motion
from swim2real.trials import Signals, TrialSet

ROBOT = telling(PENDULUM, start="fitted")


def shifted(reference, table, seconds):
    """The trials, with a table whose rows are later."""

    def late(trial):
        signals = getattr(trial, table)
        return replace(trial, **{table: Signals(signals.times + seconds, signals.names, signals.values)})

    return TrialSet(tuple(map(late, reference)), reference.marker_names)


@pytest.mark.parametrize(("table", "stream", "seconds"), [
    ("controls", "commands seem 20 ms late", 0.02), ("sensors", "readings seem 10 ms early", 0.01),
    ("sensors", "readings seem 40 ms early", 0.04),
])  # fmt: skip
def test_a_stream_whose_clock_is_off_is_named_with_how_far(table, stream, seconds):
    wrong = {**PENDULUM_HIDDEN, "lower_mass": 0.065}
    found = checked.delays(ROBOT, shifted(pendulum_reference(2e-4), table, seconds), wrong)
    named = [one for one in found if one.startswith(f"the {stream}; ")]
    assert says(named[0], "without that the error falls from", "calibrate a parameter with targets")


def test_trials_on_time_cost_no_search(monkeypatch):
    searches = []
    monkeypatch.setattr(Motion, "searched", lambda *arguments: searches.append(arguments))
    assert checked.delays(ROBOT, pendulum_reference(2e-4), PENDULUM_HIDDEN) == []
    assert searches == []

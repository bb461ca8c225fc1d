"""Probes: single changes that are measured before a proposal, and what an advisor is told of them."""

from dataclasses import replace

import numpy as np
import pytest
from waves import EEL_SPACE, Wave, after, eel, evaluate, start

from swim2real.advisor import ProbingAdvisor
from swim2real.advisor.briefing.facts import facts
from swim2real.advisor.briefing.prompt import describe
from swim2real.errors import ArgumentError
from swim2real.optimizers import BacktrackingLineSearch, Candidate, Evaluation, Measurement, Proposal, ScriptedAdvisor

FIRST = np.array([0.2, 0.8])
REAL = [Wave(f, yaw=0.1) for f in (0.5, 1.0)]


def swims(point, speed: float, loss: float, **more) -> Evaluation:
    """An evaluation whose swims are all so much faster than the real ones."""
    simulated = [replace(one, speed=speed * one.speed, **more) for one in REAL]
    return evaluate(point, list(zip(REAL, simulated, strict=True)), "motion", loss=loss)


def test_parameters_are_measured_in_order_toward_the_middle_then_the_other_proposes():
    search = BacktrackingLineSearch(ProbingAdvisor(ScriptedAdvisor([FIRST, FIRST, [0.5, 0.5]]), EEL_SPACE, 2), FIRST)
    told = []
    for loss in (1.0, 2.0, 0.9, 0.8):
        told.append(Evaluation(search.ask(), loss))
        search.tell(told[-1])
    np.testing.assert_allclose([one.candidate.point for one in told], [FIRST, [0.3, 0.8], [0.2, 0.7], [0.5, 0.5]])
    assert [one.candidate.note.get("parameter") for one in told] == [None, "grip", "spring", None]
    assert len(search.rounds) == 1


def test_more_probes_than_parameters_are_refused():
    with pytest.raises(ArgumentError, match="probes is 3; the robot has 2 parameters to measure"):
        ProbingAdvisor(ScriptedAdvisor([]), EEL_SPACE, 3)


def test_a_measurement_is_told_by_trial():
    first = swims(FIRST, 1.0, 0.1)
    probe = swims([0.3, 0.8], 1.1, 0.12, yaw=0.12)
    text = describe(facts(replace(start(first), measurements=(probe,)), eel(), EEL_SPACE))
    values = [EEL_SPACE.to_values(point)["grip"] for point in (FIRST, [0.3, 0.8])]
    (row,) = [line for line in text.splitlines() if line.startswith("| grip ") and "→" in line]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[0] == f"grip {values[0]:.3g} → {values[1]:.3g}"
    assert cells[1] == "+20.0"
    assert [float(cell) for cell in cells[2:4]] == [pytest.approx(10.0, abs=0.6)] * 2  # % of the real speed
    assert float(cells[-1]) == pytest.approx(20.0, abs=1.0)  # % of the real yaw
    assert "| change | loss mm | 0.50 Hz % speed | 1.00 Hz % speed | shape mm | recoil mm |" in text
    assert "What was measured" not in describe(facts(start(first), eel(), EEL_SPACE))


def test_a_measurement_is_compared_with_the_best_point_of_its_time():
    first, better = swims(FIRST, 1.0, 0.1), swims([0.4, 0.8], 1.2, 0.05)
    probe = Evaluation(Candidate(np.array([0.4, 0.7])), 1.0, True)
    situation = after(first, (Proposal(np.array([0.4, 0.8])), [better]))
    rows = facts(replace(situation, measurements=(probe,)), eel(), EEL_SPACE)["history"]["measured"]
    assert [change["name"] for change in rows[0]["changes"]] == ["spring"]  # against the step that was accepted
    assert rows[0]["failed"]
    assert rows[0]["loss"] is rows[0]["by_trial"] is None
    assert "diverged" in describe(facts(replace(situation, measurements=(probe,)), eel(), EEL_SPACE))


def test_a_measurement_keeps_its_place_in_finished_rounds():
    first, probe, step = swims(FIRST, 1.0, 0.1), swims([0.3, 0.8], 1.1, 0.08), swims([0.5, 0.5], 1.2, 0.05)
    search = BacktrackingLineSearch(ScriptedAdvisor([Measurement(np.array([0.3, 0.8])), [0.5, 0.5], FIRST]), FIRST)
    for one in (first, probe, step):
        search.tell(replace(one, candidate=search.ask()))
    (done,) = search.rounds
    situation = replace(after(first), incumbent=done.steps[-1].evaluation, rounds=search.rounds)
    rows = facts(situation, eel(), EEL_SPACE)["history"]["measured"]
    assert [row["loss"] for row in rows] == [pytest.approx(-0.02)]

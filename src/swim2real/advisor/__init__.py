"""Advisors: who says what is physically wrong and where to go. Optimizers ask them through one protocol."""

from swim2real.advisor.choice import Surroundings, asks_a_vlm, make_advisor, replayed_run
from swim2real.advisor.physics import PhysicsAdvisor, SensitivityAdvisor
from swim2real.advisor.vlm.events import AdvisorEvent

__all__ = [
    "AdvisorEvent",
    "PhysicsAdvisor",
    "SensitivityAdvisor",
    "Surroundings",
    "asks_a_vlm",
    "make_advisor",
    "replayed_run",
]

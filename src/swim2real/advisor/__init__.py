"""Advisors: who says what is physically wrong and where to go. Optimizers ask them through one protocol."""

from swim2real.advisor.choice import AdvisorContext, ProbingAdvisor, make_advisor
from swim2real.advisor.physics import PhysicsAdvisor, SensitivityAdvisor
from swim2real.advisor.vlm.advisor import AdvisorEvent

__all__ = [
    "AdvisorContext", "AdvisorEvent", "PhysicsAdvisor", "ProbingAdvisor", "SensitivityAdvisor", "make_advisor",
]  # fmt: skip

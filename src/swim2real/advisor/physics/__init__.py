"""The built-in physics advisors: rules and measured sensitivities, not a VLM."""

from swim2real.advisor.physics.advisor import PhysicsAdvisor
from swim2real.advisor.physics.sensitivity import SensitivityAdvisor

__all__ = ["PhysicsAdvisor", "SensitivityAdvisor"]

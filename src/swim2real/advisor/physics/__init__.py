"""The built-in physics advisor: rules and measured sensitivities, not a VLM."""

from swim2real.advisor.physics.advisor import PhysicsAdvisor

__all__ = ["PhysicsAdvisor"]

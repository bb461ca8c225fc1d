"""The root of what swim2real raises on purpose; `swimbase.errors` has the kinds."""

from swimbase.errors import Swim2RealError

__all__ = ["Swim2RealError"]

"""fluidstep: a fast step for MuJoCo models in a fluid, checked against the engine.

The names of `__init__.pyi` are imported when they are used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

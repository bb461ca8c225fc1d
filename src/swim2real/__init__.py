"""swim2real: marker tracks of a swimming robot in, a calibrated MuJoCo simulator out.

The names of `__init__.pyi` are imported when they are used, so `import swim2real` is quick.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""markertrack: films to marker tracks, each position with a confidence.

The names of `__init__.pyi` are imported when they are used, so that a page for clicking needs no tracker.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""The engine's warnings, in Python's log."""

from __future__ import annotations

import logging
from threading import Lock

import mujoco

_log = logging.getLogger(__name__)
_ASKING = Lock()


def log_warnings() -> None:
    """Takes the engine's warnings into the log; it would write MUJOCO_LOG.TXT into the working folder.

    Whoever steps a simulation sees that it diverges, so they are of interest to developers only. The engine's bindings
    wait for each other forever where two threads ask for the first time.
    """
    with _ASKING:
        if mujoco.get_mju_user_warning() is None:
            mujoco.set_mju_user_warning(_log.debug)

"""A robot to look at: its simulated motion with the real markers as ghosts, in a window or as a film."""

from __future__ import annotations

from swim2real.viewing.film import write_film
from swim2real.viewing.motion import Motion, shown_model, shown_swim, shown_trial
from swim2real.viewing.window import KEYS, check_display, open_window

__all__ = ["KEYS", "Motion", "check_display", "open_window", "shown_model", "shown_swim", "shown_trial", "write_film"]

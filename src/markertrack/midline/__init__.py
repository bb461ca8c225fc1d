"""Midlines of swimmers without markers, from a film of a fixed camera and two clicks: `follow_midline`."""

from markertrack.midline.midline import Midline as Midline
from markertrack.midline.midline import follow_midline as follow_midline

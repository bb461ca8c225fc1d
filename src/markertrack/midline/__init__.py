"""Midlines of swimmers without markers: `follow_midline` in a film of a fixed camera, from two clicks."""

from markertrack.midline.midline import Midline as Midline
from markertrack.midline.midline import follow_midline as follow_midline

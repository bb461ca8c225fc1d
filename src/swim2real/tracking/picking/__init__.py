"""The markers of a first frame: their file, the page to click them on, and how they are found without a click."""

from swim2real.tracking.picking.labeling import Labeled, label_markers
from swim2real.tracking.picking.picker import write_pick_page
from swim2real.tracking.picking.points import load_points, save_points

__all__ = ["Labeled", "label_markers", "load_points", "save_points", "write_pick_page"]

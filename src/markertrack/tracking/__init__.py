"""Trackers: positions of markers in one picture after another, each with a confidence."""

"""Midlines of swimmers without markers, from a film of a fixed camera and two clicks."""

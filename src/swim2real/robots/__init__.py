"""Robots: how one is built with MjSpec and what its parameters write."""

"""Steady swims, as a VLM is told and shown them."""

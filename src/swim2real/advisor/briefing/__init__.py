"""Briefing of a VLM at each round: data first, then words and media."""

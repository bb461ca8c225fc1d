"""What a VLM is told and shown at each round: data first, then words and media."""

"""Pictures and films of swims, real or simulated."""

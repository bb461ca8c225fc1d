"""A first robot file for an MJCF model: candidates of what to calibrate, and the text of the file."""

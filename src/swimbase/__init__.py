"""Base of the four packages: errors, whole files, checked content, names and text from outside, types of arrays."""

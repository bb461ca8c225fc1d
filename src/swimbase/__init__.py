"""What the four packages share: errors, whole files, checked content, names and text from outside."""

"""Videos, read and written frame by frame in constant memory. Knows nothing of markers."""

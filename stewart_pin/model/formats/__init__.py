"""One module per loop dialect, read and write."""

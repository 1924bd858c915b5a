"""One module per dialect of loops and couplings; a new file with a ``DIALECT`` in it is found by itself."""

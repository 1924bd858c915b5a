"""What a mechanism is: frozen descriptions, and the files they are read from and written to."""

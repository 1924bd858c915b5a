"""Command line: every command writes with --json what it printed."""

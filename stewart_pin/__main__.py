"""``python -m stewart_pin``: the command line."""

from stewart_pin.cli.entry import main

main()

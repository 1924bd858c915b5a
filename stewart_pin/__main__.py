"""``python -m stewart_pin``: the command line."""

from stewart_pin.cli import main

if __name__ == "__main__":  # worker processes import this module again
    main()

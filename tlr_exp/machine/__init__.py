"""The machine: cores, precision, a terminal."""

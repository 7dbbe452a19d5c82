"""What the machine gives: cores, precision, a terminal."""

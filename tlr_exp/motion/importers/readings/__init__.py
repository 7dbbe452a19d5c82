"""Decides what files leave open (orders, units, axes), and finds signs of a wrong reading."""

"""A training: one iteration, the loop around it, the run around the loop."""

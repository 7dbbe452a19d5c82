"""What is physically wrong with a clip, what of it can be repaired, and joining clips."""

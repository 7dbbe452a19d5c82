"""A trained policy as files that are given away."""

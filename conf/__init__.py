"""The configuration tree: every value, stated once."""

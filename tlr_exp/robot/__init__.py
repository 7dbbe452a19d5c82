"""A robot as one value, and the MuJoCo model made from it."""
